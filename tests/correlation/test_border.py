"""`border_px`: the mirror at the borders of an image bends its spline; pixels that come close to it can be left out."""

import numpy as np
import pytest
from pictures import Texture, make_map

from idic.correlation import ReferenceImage, nodal_equations, residual_map
from idic.images import prefilter

SHAPE, BORDER = (90, 113), 6



def moved(texture, shift):
    return texture.picture(SHAPE, shift=shift)


def inner():
    mask = np.zeros(SHAPE, bool)
    mask[BORDER:-BORDER, BORDER:-BORDER] = True
    return mask


def test_exactly_the_pixels_closer_than_the_border_are_lost():
    texture, shift = Texture(), (2.5, -1.25)
    reference = ReferenceImage.of(make_map("quad4", shape=SHAPE, mask=inner()), texture.picture(SHAPE),
                                  border_px=BORDER)
    share = nodal_equations(reference, prefilter(moved(texture, shift)), rigid(reference.pixel_map, shift))
    x = reference.pixel_map.points() + shift
    outside = ((x < BORDER) | (x > np.array(SHAPE[::-1]) - 1 - BORDER)).any(axis=1)
    assert np.array_equal(share.lost_pixels, np.flatnonzero(outside)) and outside.any()


def test_at_rest_nothing_is_lost():
    texture = Texture()
    reference = ReferenceImage.of(make_map("quad4", shape=SHAPE, mask=inner()), texture.picture(SHAPE),
                                  border_px=BORDER)
    assert nodal_equations(reference, prefilter(texture.picture(SHAPE)),
                           rigid(reference.pixel_map, (0.0, 0.0))).n_lost == 0


@pytest.mark.parametrize("degree", [3, 5])
def test_pixels_that_the_mirror_boundary_changes_are_left_out(degree):
    """Half a pixel off, a texture of 10 px and longer: inside, the spline is right; at the border it bends with the
    mirror."""
    texture, shift = Texture(shortest_px=10.0, longest_px=30.0), (0.5, 0.5)
    f, g, pm = texture.picture(SHAPE), moved(texture, shift), make_map("quad4", shape=SHAPE, mask=inner())
    kept = residual_map(ReferenceImage.of(pm, f, degree, border_px=BORDER), prefilter(g, degree), rigid(pm, shift))
    whole = make_map("quad4", shape=SHAPE)
    everything = residual_map(ReferenceImage.of(whole, f, degree), prefilter(g, degree), rigid(whole, shift))
    assert kept.valid.mean() > 0.9
    # the mirror decays by 0.27 (cubic) or 0.43 (quintic) per pixel: 4e-4 or 6e-3 of it are left after six
    assert np.abs(kept.r[kept.valid]).max() < 0.1 * np.abs(everything.r[everything.valid]).max()


def rigid(pixel_map, shift):
    return np.tile(np.asarray(shift, dtype=float), (pixel_map.n_nodes, 1))
