"""Which pixel lies where: partition of unity, re-projection, no holes, masks and meshes that reach beyond the image."""

import numpy as np
import pytest
from pictures import SHAPE, grid, make_map, make_mesh
from scipy import ndimage

from idic.correlation import PixelMap
from idic.errors import InputError
from idic.fe import Block
from idic.images import Camera

KINDS = ["tri3", "quad4", "tri6", "quad8", "mixed", "mixed orders"]
kinds = pytest.mark.parametrize("kind", KINDS)


@kinds
def test_the_shape_functions_sum_to_one_at_every_pixel(kind):
    weights = make_map(kind).shape_matrix()
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-14  # rounding


@kinds
def test_every_pixel_is_projected_back_onto_itself(kind):
    pm = make_map(kind)
    # a, b are float32: 3e-8 of half an element of 17 px
    assert np.abs(pm.interpolate(pm.nodes_px) - pm.points()).max() < 1e-6


@kinds
def test_there_are_no_holes_and_no_pixel_twice(kind):
    pm = make_map(kind)
    covered = np.zeros(SHAPE, dtype=int)
    np.add.at(covered, (pm.iy, pm.ix), 1)
    assert covered.max() == 1
    assert np.array_equal(ndimage.binary_fill_holes(covered), covered.astype(bool))


def test_the_area_in_pixels_is_that_of_the_mesh():
    nodes, quads = grid(6, 4)
    pm = PixelMap.of(nodes, [Block("quad4", quads, 0)], Camera.from_table(0.05, (13.3, 77.6)), SHAPE)
    assert pm.n_pixels == 100 * 68  # 5 x 3.4 mm of 0.05 mm px, edges between pixel centres


@pytest.mark.parametrize("camera", [Camera.from_table(0.05, (13.3, 12.4), ("+col", "+row")),
                                    Camera.from_table(0.05, (113.3, 77.6), ("-col", "-row")),
                                    Camera.from_table(0.05, (13.3, 77.6), k1=1e-6, centre=(60, 40))])
def test_axes_of_any_sense_and_distortion_keep_the_mesh_whole(camera):
    pm = make_map("quad8", camera=camera)
    assert pm.n_elements == 24 and np.abs(pm.interpolate(pm.nodes_px) - pm.points()).max() < 1e-6  # as above


def test_a_mesh_that_reaches_beyond_the_image_is_correlated_where_visible():
    nodes, blocks = make_mesh("quad4")
    pm = PixelMap.of(nodes, blocks, Camera.from_table(0.05, (-30.3, 77.6)), SHAPE)
    assert 0 < pm.n_elements < 24 and pm.n_nodes == len(nodes) and pm.ix.min() == 0
    assert set(pm.visible_nodes) < set(range(len(nodes)))
    assert np.array_equal(pm.element, np.unique(pm.element)) and pm.pixels_per_element.min() > 0


def test_a_pixel_outside_the_mask_is_not_in_the_map():
    mask = np.zeros(SHAPE, dtype=bool)
    mask[30:50, 40:80] = True
    pm = make_map("quad4", mask=mask)
    assert pm.n_pixels == mask.sum() and mask[pm.iy, pm.ix].all() and pm.n_unowned == 0


def test_pixels_of_the_mask_that_no_element_owns_are_counted():
    pm = make_map("quad4", mask=np.ones(SHAPE, dtype=bool))
    assert pm.n_unowned == SHAPE[0] * SHAPE[1] - pm.n_pixels > 0


def test_elements_carry_their_global_number_through_several_blocks():
    pm = make_map("mixed")
    assert np.array_equal(pm.element, np.arange(11 + 2 * 13)) and set(pm.kind[:11]) == {1} and set(pm.kind[11:]) == {0}


@kinds
def test_the_deformation_gradient_of_an_affine_motion_is_exact(kind):
    pm, f = make_map(kind), np.array([[1.3, 0.2], [-0.1, 0.8]])
    found = pm.deformation_gradient(pm.nodes_px @ (f - np.eye(2)).T + [3.0, -2.0])
    assert np.abs(found - f).max() < 1e-12  # rounding of 100 px / 17 px elements


def test_the_image_of_the_pixels_has_nan_where_there_is_no_pixel():
    pm = make_map("quad4")
    image = pm.to_image(np.arange(pm.n_pixels))
    assert np.count_nonzero(np.isfinite(image)) == pm.n_pixels and image[pm.iy[7], pm.ix[7]] == 7


def test_a_strongly_distorted_element_is_still_filled():
    nodes = np.array([[0.0, 0.0], [4.0, 0.3], [2.2, 2.0], [0.2, 3.0]])  # one corner of almost 170 degrees
    one = [Block("quad4", np.array([[0, 1, 2, 3]]), 0)]
    pm = PixelMap.of(nodes, one, Camera.from_table(0.05, (10.3, 77.6)), SHAPE)
    ends = np.roll(nodes, -1, axis=0)
    area = 0.5 * abs((nodes[:, 0] * ends[:, 1] - ends[:, 0] * nodes[:, 1]).sum()) / 0.05**2  # px
    assert abs(pm.n_pixels - area) < 0.01 * area  # lattice points against area: about half the circumference / 20


def nowhere():
    nodes, blocks = make_mesh("quad4")
    return PixelMap.of(nodes, blocks, Camera.from_table(0.05, (1000.0, 1000.0)), SHAPE)


def black_mask():
    return make_map("quad4", mask=np.zeros(SHAPE, dtype=bool))


def other_size():
    return make_map("quad4", mask=np.ones((5, 5), dtype=bool))


def solid_cells():
    return PixelMap.of(np.zeros((8, 3)), [Block("hex8", np.arange(8)[None], 0)], Camera.from_table(), SHAPE)


@pytest.mark.parametrize("make, word", [(nowhere, "no pixel lies on the mesh"), (black_mask, "mask leaves no pixel"),
                                        (other_size, "differ in size"), (solid_cells, "hex8")])
def test_an_impossible_map_is_an_input_error(make, word):
    with pytest.raises(InputError, match=word):
        make()
