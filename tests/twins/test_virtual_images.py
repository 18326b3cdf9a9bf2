"""The virtual camera against closed forms: known motions, known noise, and no code shared with the correlator."""

from __future__ import annotations

import ast
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import idic.virtual_tests.rendering.inverse_mapping
import idic.images.pattern
import idic.virtual_tests.rendering.render
from idic.errors import InputError
from idic.images import Camera, dense_speckle, sparse_speckle
from idic.virtual_tests import render
from idic.virtual_tests.rendering.render import noisy_channel
from idic.virtual_tests import Sensor, clean_image, painted, record

SHAPE = (60, 80)
CAMERA = Camera.from_table(pixel_size=0.05, origin=(38.3, 29.1))


def plate(cell: str, n: int = 4):
    """A 3 x 2 mm plate about the origin, its inner nodes moved about a little; nodes (n, 2) and one block."""
    quadratic = cell in ("quad8", "tri6")
    m = 2 * n if quadratic else n
    i, j = np.meshgrid(np.arange(m + 1), np.arange(m + 1), indexing="xy")
    X = np.stack([3.0 * i.ravel() / m - 1.5, 2.0 * j.ravel() / m - 1.0], axis=1)
    inner = (np.abs(X[:, 0]) < 1.49) & (np.abs(X[:, 1]) < 0.99)
    if not quadratic:  # straight edges stay straight, so mid-side nodes stay where they are
        X[inner] += 0.1 * np.sin(7.0 * X[inner][:, ::-1])
    at = lambda a, b: b * (m + 1) + a  # noqa: E731
    step, conn = m // n, []
    for b in range(0, m, step):
        for a in range(0, m, step):
            c = [at(a, b), at(a + step, b), at(a + step, b + step), at(a, b + step)]
            if quadratic:
                mid = [at(a + 1, b), at(a + 2, b + 1), at(a + 1, b + 2), at(a, b + 1)]
            if cell == "quad4":
                conn.append(c)
            elif cell == "quad8":
                conn.append(c + mid)
            elif cell == "tri3":
                conn += [[c[0], c[1], c[2]], [c[0], c[2], c[3]]]
            else:
                middle = at(a + 1, b + 1)
                conn += [[c[0], c[1], c[2], mid[0], mid[1], middle], [c[0], c[2], c[3], middle, mid[2], mid[3]]]
    return X, [SimpleNamespace(cell=cell, connectivity=np.array(conn))]


def pixels():
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return np.stack([column.ravel(), row.ravel()], axis=1)


@pytest.mark.parametrize("cell", ["tri3", "quad4", "tri6", "quad8"])
def test_a_pixel_sees_the_material_point_that_moved_there(cell):
    X, blocks = plate(cell)
    bend = 0.08 * X[:, ::-1] ** 2 if cell in ("quad8", "tri6") else 0.04 * np.sin(2.0 * X[:, ::-1])
    u = X @ np.array([[0.05, 0.12], [-0.1, 0.02]]) + bend + [0.03, -0.02]
    sensor = Sensor(SHAPE, bits=0, background=np.nan, supersampling=1)
    seen = np.stack([clean_image(u, X, blocks, CAMERA, lambda x, c=c: x[:, c], sensor).ravel() for c in (0, 1)], axis=1)
    inside = np.isfinite(seen[:, 0])
    assert inside.sum() > 1500  # the plate covers 60 x 40 px of the image
    if cell in ("quad8", "tri6"):  # this motion lies in the element's space, so it is known everywhere
        x = seen[inside]
        moved = x + x @ np.array([[0.05, 0.12], [-0.1, 0.02]]) + 0.08 * x[:, ::-1] ** 2 + [0.03, -0.02]
        gap = CAMERA.project(moved) - pixels()[inside]
        assert np.abs(gap).max() < 1e-8  # Newton stops at 1e-6 and has squared that error
    else:  # elsewhere: the material coordinate field, interpolated, must be the identity at the nodes' images
        assert np.abs(seen[inside]).max(axis=0) == pytest.approx([1.5, 1.0], abs=0.05)  # a pixel is 0.05 mm


@pytest.mark.parametrize("cell", ["tri3", "quad4", "tri6", "quad8"])
def test_a_homogeneous_motion_gives_the_texture_at_the_inverse_point(cell):
    X, blocks = plate(cell)
    A = np.array([[1.2, 0.15], [-0.2, 0.9]])
    shift = np.array([0.07, -0.04])
    u = X @ A.T + shift - X
    texture = painted(dense_speckle(np.random.default_rng(3)), CAMERA)
    image = clean_image(u, X, blocks, CAMERA, texture, Sensor(SHAPE, background=0.0, supersampling=3))
    expected, covered = np.zeros(SHAPE), np.ones(SHAPE, dtype=bool)
    for dc in (-1 / 3, 0.0, 1 / 3):
        for dr in (-1 / 3, 0.0, 1 / 3):
            point = (CAMERA.inverse(pixels() + [dc, dr]) - shift) @ np.linalg.inv(A).T
            expected += texture(point).reshape(SHAPE) / 9.0
            covered &= (np.abs(point) < [1.5, 1.0]).all(axis=1).reshape(SHAPE)
    assert covered.sum() > 1500
    assert np.abs(image - expected)[covered].max() < 1e-6  # 1e-12 px of position at some 30 GV per px


def test_the_edge_of_the_specimen_shares_its_pixels_with_the_background():
    X, blocks = plate("quad4")
    camera = Camera.from_table(pixel_size=0.05, origin=(38.3, 29.0))  # the right edge: column 68.3
    image = clean_image(
        np.zeros_like(X), X, blocks, camera, lambda x: np.full(len(x), 100.0), Sensor(SHAPE, supersampling=10)
    )
    assert image[29, 67] == pytest.approx(100.0)
    assert image[29, 68] == pytest.approx(80.0)  # pixel 68 reaches from 67.5 to 68.5
    assert image[29, 69] == 0.0


def test_a_grating_finer_than_the_pixels_loses_contrast_as_the_pixel_area_tells():
    X, blocks = plate("quad4")
    for cycles_per_px in (0.3, 0.7, 1.3):  # beyond 0.5 it aliases; the area still weighs it with a sinc
        k = 2.0 * np.pi * cycles_per_px
        sensor = Sensor(SHAPE, background=np.nan, supersampling=16)
        image = clean_image(
            np.zeros_like(X), X, blocks, CAMERA, lambda x, k=k: np.cos(k * CAMERA.project(x)[:, 0]), sensor
        )
        expected = np.sinc(cycles_per_px) * np.cos(k * np.arange(SHAPE[1]))
        valid = np.isfinite(image[29])
        assert np.abs(image[29] - expected)[valid].max() < 0.01  # the midpoint rule: (k/16)²/24 of the amplitude


def test_a_distorting_tilted_camera_is_inverted_exactly():
    camera = Camera(CAMERA.matrix, (38.3, 29.1), k1=4e-5, centre_px=(40.0, 30.0), tilt=(0.02, -0.01))
    X, blocks = plate("quad8")
    u = 0.02 * X + 0.01
    sensor = Sensor(SHAPE, background=np.nan, supersampling=1)
    seen = np.stack([clean_image(u, X, blocks, camera, lambda x, c=c: x[:, c], sensor).ravel() for c in (0, 1)], axis=1)
    inside = np.isfinite(seen[:, 0])
    assert np.abs(camera.project(seen[inside] * 1.02 + 0.01) - pixels()[inside]).max() < 1e-8


def test_a_surface_in_space_may_carry_its_height():
    X, blocks = plate("quad8")
    X3 = np.hstack([X, np.full((len(X), 1), 0.25)])
    u = np.hstack([0.03 * X, 0.1 * X[:, :1] * X[:, 1:]])
    sensor = Sensor(SHAPE, bits=0, supersampling=1)
    image = clean_image(u, X3, blocks, CAMERA, lambda x: np.full(len(x), 7.0), sensor, rise=1.0)
    point = CAMERA.inverse(pixels()) / 1.03
    inside = (np.abs(point) < [1.499, 0.999]).all(axis=1)
    assert np.allclose(image.ravel()[inside], 7.0 + 0.1 * point[inside].prod(axis=1), atol=1e-9)


def test_no_seam_shows_between_elements_or_blocks():
    X, blocks = plate("quad4")
    half = len(blocks[0].connectivity) // 2
    parts = [SimpleNamespace(cell="quad4", connectivity=c) for c in np.split(blocks[0].connectivity, [half])]
    arguments = (CAMERA, lambda x: np.full(len(x), 50.0), Sensor(SHAPE, background=np.nan))
    one = clean_image(0.05 * X, X, blocks, *arguments)
    two = clean_image(0.05 * X, X, parts, *arguments)
    assert np.array_equal(one, two, equal_nan=True)
    assert np.isfinite(one[12:47, 10:66]).all()


def test_noise_has_the_declared_spread_and_the_sensor_rounds_to_its_bits():
    flat = np.full((200, 200), 120.0)
    for bits, kind in ((8, np.uint8), (12, np.uint16), (16, np.uint16), (0, np.float32)):
        sensor = Sensor(flat.shape, bits=bits, noise_std=2.55)
        image = record(flat, sensor, np.random.default_rng(1))
        assert image.dtype == kind
        # standard error of a standard deviation from 40000 samples: 0.35 %; 4 of them
        assert image.astype(float).std() == pytest.approx(sensor.total_noise_std, rel=0.014)
    assert record(np.full((2, 2), 300.0), Sensor((2, 2)), np.random.default_rng(0)).max() == 255
    assert record(np.full((2, 2), 5000.0), Sensor((2, 2), bits=12), np.random.default_rng(0)).max() == 4095
    with pytest.raises(InputError):
        Sensor((2, 2), bits=10)
    channel = noisy_channel(np.zeros(40000), 5.0, np.random.default_rng(2))
    assert channel.std() == pytest.approx(5.0, rel=0.014)


def test_the_same_generator_gives_the_same_images_and_frames_differ_in_noise():
    X, blocks = plate("quad4", 2)
    texture = painted(sparse_speckle(np.random.default_rng(0)), CAMERA)
    run = lambda: list(  # noqa: E731
        render([0.0 * X, 0.0 * X], X, blocks, CAMERA, texture, Sensor(SHAPE, noise_std=2.0), np.random.default_rng(5))
    )
    first, second = run(), run()
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    difference = first[0].astype(float) - first[1].astype(float)
    # the specimen covers half the image and half of the background's noise is clipped at zero
    assert difference[15:45, 15:60].std() == pytest.approx(np.sqrt(2.0) * np.sqrt(4.0 + 1 / 12), rel=0.08)


@pytest.mark.parametrize("make", [dense_speckle, sparse_speckle])
def test_speckle_is_smooth_bounded_and_of_the_size_asked_for(make):
    pattern = make(np.random.default_rng(0), sigma_px=1.2)
    row, column = np.mgrid[:150, :150].astype(float)
    points = np.stack([column.ravel(), row.ravel()], axis=1)
    value = pattern.value(points).reshape(150, 150)
    assert pattern.low <= value.min() and value.max() <= pattern.high and value.std() > 30.0
    centred = value - value.mean()
    correlation = (centred[:, 2:] * centred[:, :-2]).mean() / centred.var()
    assert correlation == pytest.approx(np.exp(-4.0 / (4.0 * 1.2**2)), abs=0.08)  # the squashing sharpens a little
    h = 1e-5  # a smooth function: central differences of step h and 2h agree
    slope = [(pattern.value(points + [s, 0]) - pattern.value(points - [s, 0])) / (2 * s) for s in (h, 2 * h)]
    assert np.abs(slope[0] - slope[1]).max() < 1e-3


def test_the_virtual_camera_shares_no_code_with_the_correlator():
    for module in (idic.virtual_tests.rendering.render, idic.images.pattern,
                   idic.virtual_tests.rendering.inverse_mapping):
        tree = ast.parse(Path(module.__file__).read_text())
        names = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        names += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
        assert not [n for n in names if "correlation" in n or "interpolate" in n or "dic" == n.split(".")[-1]]
