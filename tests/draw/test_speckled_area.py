"""The speckled area is found in images made here, and the noise floor is the scatter of a measured motion."""

from __future__ import annotations

import numpy as np
import pytest

from idic.draw.pictures import Pictures, as_bytes, contrast
from idic.draw.plan import end_names, first_sketch
from idic.draw import speckled_area, texture_of
from idic.draw.texture import noise_floor
from idic.errors import InputError
from idic.fe import Segments, mesh_polygon
from idic.readers import open_stack



def dots(shape, inside, seed=0, noise=2.0, dtype=np.uint8, radius=2.5, ground=20.0):
    """White paint with black dots where `inside` is true, on a dark ground, with noise."""
    rng = np.random.default_rng(seed)
    image = np.full(shape, 200.0)
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    for y, x in rng.uniform(0, shape, (shape[0] * shape[1] // 45, 2)):
        low, high = int(max(y - 5, 0)), int(y + 6)
        left, right = int(max(x - 5, 0)), int(x + 6)
        distance = np.hypot(rows[low:high] - y, columns[:, left:right] - x)
        image[low:high, left:right] -= 150 * np.clip(radius + 0.5 - distance, 0, 1)
    image = np.where(inside, np.clip(image, 30, 200), ground) + rng.normal(0, noise, shape)
    top = np.iinfo(dtype).max
    return np.clip(image / 255 * top, 0, top).astype(dtype)


def grid(shape):
    return np.ogrid[: shape[0], : shape[1]]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_strip_with_a_hole_is_found_to_two_pixels(dtype):
    shape = (420, 600)
    y, x = grid(shape)
    inside = (x >= 80) & (x < 520) & (y >= 60) & (y < 340) & ((x - 300) ** 2 + (y - 200) ** 2 > 60**2)
    image = dots(shape, inside, dtype=dtype)
    outline, holes = speckled_area(image, texture_of(image))
    # between the first and the last pixel of the paint; the position of an edge in an image with dots is a pixel or two
    np.testing.assert_allclose(np.array(outline), [[80, 60], [519, 60], [519, 339], [80, 339]], atol=2.0)
    (hole,) = holes
    np.testing.assert_allclose(hole, [300, 200, 60], atol=2.0)


@pytest.mark.parametrize("shape_of_it", ["slot", "ellipse"])
def test_a_short_slot_and_an_ellipse_are_no_circles(shape_of_it):
    """Both have a rounder outline than a square; a circle of their area would be 10 px off at their ends."""
    shape = (420, 600)
    y, x = grid(shape)
    around = {"slot": np.maximum(np.abs(x - 300) - 20, 0) ** 2 + (y - 200) ** 2 - 40**2,
              "ellipse": ((x - 300) / 70) ** 2 + ((y - 200) / 50) ** 2 - 1.0}[shape_of_it]
    inside = (x >= 80) & (x < 520) & (y >= 60) & (y < 340) & (around > 0)
    image = dots(shape, inside)
    _, (hole,) = speckled_area(image, texture_of(image))
    outline = Segments.of(hole)
    half = {"slot": (60, 40), "ellipse": (70, 50)}[shape_of_it]
    np.testing.assert_allclose(outline.box(), np.array([[300, 200]]) + np.array([[-1], [1]]) * half, atol=3.0)
    assert outline.area() == pytest.approx((around <= 0).sum(), rel=0.03)


def test_a_pattern_that_fills_the_image_in_uneven_light_is_one_rectangle():
    shape = (300, 500)
    _, x = grid(shape)
    image = dots(shape, np.ones(shape, dtype=bool), noise=0.0) * (1.0 - 0.8 * x / shape[1])
    image = np.clip(image + np.random.default_rng(1).normal(0, 2, shape), 0, 255).astype(np.uint8)
    outline, holes = speckled_area(image, texture_of(image))
    assert not holes
    np.testing.assert_allclose(outline, [[16, 12], [483, 12], [483, 287], [16, 287]], atol=4)  # 3 % from the border


def coarse_dots(inside, times):
    """Dots as of `dots`, `times` as large, on a part of the image."""
    small = tuple(n // times for n in inside.shape)
    coarse = dots(small, np.ones(small, dtype=bool), noise=0.0).repeat(times, axis=0).repeat(times, axis=1)
    image = np.where(inside, coarse, 20) + np.random.default_rng(2).normal(0, 2, inside.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def test_the_gaps_of_a_coarse_pattern_are_no_holes():
    shape = (420, 600)
    y, x = grid(shape)
    inside = (x >= 80) & (x < 520) & (y >= 60) & (y < 340) & ((x - 300) ** 2 + (y - 200) ** 2 > 60**2)
    image = coarse_dots(inside, 3)
    outline, holes = speckled_area(image, texture_of(image))
    np.testing.assert_allclose(outline, [[80, 60], [519, 60], [519, 339], [80, 339]], atol=2.0)
    (hole,) = holes
    np.testing.assert_allclose(hole, [300, 200, 60], atol=5.0)  # dots of 15 px


def test_a_coarse_pattern_in_a_small_image_keeps_its_hole_and_its_edges_next_to_the_border():
    shape = (200, 300)
    y, x = grid(shape)
    inside = (x >= 9) & (x < 289) & (y >= 20) & (y < 181) & ((x - 147) ** 2 + (y - 99) ** 2 > 30**2)
    image = coarse_dots(inside, 2)
    outline, (hole,) = speckled_area(image, texture_of(image))
    np.testing.assert_allclose(outline, [[9, 20], [288, 20], [288, 180], [9, 180]], atol=2.0)
    np.testing.assert_allclose(hole, [147, 99, 30], atol=2.0)


def test_a_waisted_specimen_is_found_as_a_polygon_of_its_area():
    shape = (600, 400)
    y, x = grid(shape)
    half = 60 + 60 * np.clip((np.abs(y - 300) - 150) / 100, 0, 1) ** 2
    inside = (np.abs(x - 200) < half) & (y > 30) & (y < 570)
    image = dots(shape, inside)
    outline, holes = speckled_area(image, texture_of(image))
    assert not holes and 4 < len(outline) < 30
    assert Segments.of(outline).area() == pytest.approx(inside.sum(), rel=0.05)  # blocks of 4 px along 1400 px
    assert set(first_sketch(outline, holes, shape)["edge_names"]) == {"TOP", "BOTTOM"}


def test_a_disc_is_a_circle():
    shape = (440, 460)
    y, x = grid(shape)
    image = dots(shape, (x - 230) ** 2 + (y - 210) ** 2 < 160**2)
    outline, holes = speckled_area(image, texture_of(image))
    np.testing.assert_allclose(outline, [230, 210, 160], atol=1.5)  # an edge in an image with dots: a pixel or two
    sketch = first_sketch(outline, holes, shape)
    assert not holes and sketch["edge_names"] == {} and sketch["element_px"] == 32
    mesh = mesh_polygon(outline, holes, sketch["element_px"], quads=True)
    rim = mesh.nodes[mesh.face_set_nodes(mesh.edge_sets["OUTER"])] - outline[:2]
    assert np.allclose(np.hypot(*rim.T), outline[2])


def test_round_notches_and_shoulders_are_arcs_and_straight_edges_are_lines():
    shape = (640, 400)
    y, x = grid(shape)
    inside = (np.abs(x - 200) < 120) & (y > 60) & (y < 580)
    for side in (80, 320):
        inside = inside & ((x - side) ** 2 + (y - 320) ** 2 > 60**2)
    image = dots(shape, inside)
    outline, _ = speckled_area(image, texture_of(image))
    segments = Segments.of(outline)
    assert segments.area() == pytest.approx(inside.sum(), rel=0.01)
    np.testing.assert_allclose(segments.radius[segments.curved], [60, 60], atol=6.0)  # half a circle in blocks of 4 px
    np.testing.assert_allclose(sorted(segments.centre[segments.curved].tolist()), [[80, 320], [320, 320]], atol=4.0)


def test_a_hexagon_has_no_arc():
    shape = (480, 480)
    y, x = grid(shape)
    width = [np.abs((x - 240) * np.cos(a) + (y - 240) * np.sin(a)) for a in np.pi / 3 * np.arange(3)]
    image = dots(shape, np.maximum.reduce(np.broadcast_arrays(*width)) < 150)
    outline, _ = speckled_area(image, texture_of(image))
    segments = Segments.of(outline)
    assert not segments.curved.any() and 6 <= len(outline) <= 8
    assert segments.area() == pytest.approx(2 * np.sqrt(3) * 150**2, rel=0.01)


def test_the_largest_of_several_areas_is_taken_and_writing_on_the_side_is_not():
    shape = (400, 600)
    y, x = grid(shape)
    inside = ((x > 60) & (x < 400) & (y > 50) & (y < 350)) | ((x > 480) & (x < 560) & (y > 100) & (y < 200))
    image = dots(shape, inside)
    outline, _ = speckled_area(image, texture_of(image))
    assert np.array(outline)[:, 0].max() < 405


def test_an_image_without_a_pattern_has_no_speckled_area():
    flat = np.full((300, 400), 90, np.uint8)
    assert speckled_area(flat, texture_of(flat)) == ([], [])
    sketch = first_sketch([], [], flat.shape)  # a rectangle to begin with
    assert len(sketch["outline"]) == 4


def test_an_area_that_leaves_the_image_ends_before_its_border():
    shape = (500, 300)
    _, x = grid(shape)
    image = dots(shape, np.broadcast_to((x > 80) & (x < 220), shape))
    outline, _ = speckled_area(image, texture_of(image))
    y = np.array(outline)[:, 1]
    assert 5 < y.min() < 30 and 470 < y.max() < 495


@pytest.mark.parametrize("case, expected, holes", [
    ("open-case-1-plate-with-hole-elastoplastic/images", [0, 30, 629, 349], 1),
    ("open-hole-composite/images", [537, 0, 855, 1039], 1), ("tension-necking/images", [210, 0, 600, 2049], 0)])
def test_real_recordings_give_their_specimen(shared_data, case, expected, holes):
    folder = shared_data(case)
    files = sorted([*folder.glob("*.tif"), *folder.glob("*.png")])
    image = open_stack(files[:1]).frame(0)
    outline, found = speckled_area(image, texture_of(image))
    assert len(found) == holes
    box = Segments.of(outline).box().ravel()
    border = 0.05 * np.array([*image.shape[::-1]] * 2)  # a specimen that leaves the image is cut before its border
    assert (np.abs(box - expected) < border + 5).all()


def test_the_ends_of_an_outline_are_named_along_its_longer_side():
    wide = np.array([[0, 0], [100, 0], [100, 40], [0, 40]], float)
    assert end_names(wide) == {"LEFT": [4], "RIGHT": [2]}
    assert end_names(wide[:, ::-1]) == {"TOP": [4], "BOTTOM": [2]}


def test_the_noise_floor_is_the_scatter_of_the_motion_of_an_element():
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:120, :120]
    waves = rng.uniform(0.2, 0.7, (40, 2)), rng.uniform(0, 6.3, 40)
    clean = 120 + 8 * sum(np.cos(kx * x + ky * y + phase) for (kx, ky), phase in zip(*waves, strict=True))
    std, mesh = 3.0, mesh_polygon([[20, 20], [100, 20], [100, 100], [20, 100]], (), 40.0, quads=True)
    corners = [mesh.nodes[cell] for block in mesh.blocks for cell in block.connectivity]
    expected = noise_floor(texture_of(clean + rng.normal(0, std, clean.shape)), corners, std)
    gy, gx = np.gradient(clean)
    scatter = []
    for cell in corners:
        (x0, y0), (x1, y1) = cell.min(axis=0).astype(int), cell.max(axis=0).astype(int)
        g = np.column_stack([gx[y0:y1, x0:x1].ravel(), gy[y0:y1, x0:x1].ravel()])
        r = rng.normal(0, std, (400, len(g))) - rng.normal(0, std, (400, len(g)))  # of a frame and of the reference
        u = r @ g @ np.linalg.inv(g.T @ g)
        scatter.append(np.sqrt(np.linalg.eigvalsh(np.cov(u.T))[-1]))
    # blocks of 4 px stand for an element of 40 px, to 10 %; 400 draws know a standard deviation to 4 %
    np.testing.assert_allclose(expected, scatter, rtol=0.15)


def test_a_part_of_an_image_comes_at_the_width_of_the_screen(tmp_path):
    import cv2
    import tifffile

    image = (np.add.outer(np.arange(300), np.arange(500)) * 80).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", image)
    pictures = Pictures(open_stack([tmp_path / "a.tif"]))
    whole = cv2.imdecode(np.frombuffer(pictures.part(0, (0, 0, 500, 300), 100), np.uint8), cv2.IMREAD_UNCHANGED)
    assert whole.shape == (60, 100) and whole[0, 0] < 10 and whole[-1, -1] > 245
    detail = cv2.imdecode(np.frombuffer(pictures.part(0, (100, 50, 140, 90), 4000), np.uint8), cv2.IMREAD_UNCHANGED)
    assert detail.shape == (40, 40)  # no more pixels than the image has
    shown = as_bytes(image[50:90, 100:140], *contrast(image)).astype(int)
    assert np.abs(detail.astype(int) - shown).max() < 8  # of a JPEG
    with pytest.raises(InputError):
        pictures.frame(1)
