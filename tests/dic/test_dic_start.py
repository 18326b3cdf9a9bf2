"""Starts for motions far beyond a speckle."""

from __future__ import annotations

import numpy as np
import pytest
from dic_cases import grid, pictures, rest, set_up

from idic.measure.dic import build_pyramid, descend
from idic.measure import Regularisation, build_smoother
from idic.measure.dic import coarse_motion

SHAPE = (420, 380)


FRAME = (40, 40, 180, 200, 20)


def turned(nodes: np.ndarray) -> np.ndarray:
    turn = np.radians(4.0)
    stretch = np.array([[1.03 * np.cos(turn), -np.sin(turn)], [np.sin(turn), 0.98 * np.cos(turn)]])
    return (nodes - 100.0) @ (stretch - np.eye(2)).T + (131.0, 148.0)


@pytest.fixture(scope="module")
def moved():
    mesh = grid(*FRAME)
    return mesh, turned(mesh.nodes), *pictures(FRAME, [rest, turned], SHAPE, noise=3.0)


def test_subsets_find_a_motion_of_200_px_with_rotation_and_stretch(moved):
    mesh, u, f, g = moved
    found = coarse_motion(f, g, mesh.nodes)
    assert np.abs(found - u).max() < 2.0  # the blur pyramid takes 8


def test_subsets_of_unrelated_images_find_nothing(moved):
    mesh, u, f, g = moved
    rng = np.random.default_rng(5)
    assert coarse_motion(f, rng.normal(100.0, 30.0, SHAPE), mesh.nodes) is None


def test_the_blur_pyramid_converges_from_a_start_that_is_six_px_off(moved):
    mesh, u, f, g = moved
    reference, _ = set_up(mesh, f)
    pyramid = build_pyramid(reference.pixel_map, f, mesh.blocks, 40.0)
    found = descend(pyramid, g, u + (5.0, -4.0))
    assert np.sqrt(np.mean((found - u) ** 2)) < 0.3  # a fifth of the speckle: the full images converge from there


def test_the_smoother_of_a_level_has_the_length_of_its_blur(moved):
    mesh, u, f, g = moved
    reference, _ = set_up(mesh, f)
    lengths = [level.smoother.length_px for level in build_pyramid(reference.pixel_map, f, mesh.blocks, 40.0)]
    assert lengths == sorted(lengths, reverse=True) and lengths[-1] == 40.0
    assert build_smoother(mesh.nodes, mesh.blocks, Regularisation.smooth()).length_px == 40.0
