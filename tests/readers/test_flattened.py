"""Sheets that tilt and bend before two cameras: the motion of their middle, laid flat."""

from __future__ import annotations

import numpy as np
import pytest

from idic.readers.fields.flattened import Flattening

SHEET = np.stack(np.meshgrid(np.linspace(-10, 10, 9), np.linspace(-60, 60, 40)), axis=-1).reshape(-1, 2)  # mm, along it
STRAIN, HALF = 2e-3, 1.0


def surface(sheet: np.ndarray, curvature: float) -> np.ndarray:
    """The seen side of a sheet on a cylinder about x, exactly  # (n, 2) mm -> (n, 3) mm"""
    angle = curvature * sheet[:, 1]
    middle = np.column_stack([sheet[:, 0], np.sin(angle) / curvature, (1.0 - np.cos(angle)) / curvature])
    return middle + HALF * np.column_stack([np.zeros(len(angle)), -np.sin(angle), np.cos(angle)])


def turn(about_x: float, about_y: float) -> np.ndarray:
    (cx, sx), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (about_x, about_y))
    return np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]) @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])


def strains(u: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, float]:
    """Gradient of the best affine field (2, 2), and the rms of the residual displacement, µm."""
    known = np.isfinite(u).all(axis=1)
    matrix = np.column_stack([at, np.ones(len(at))])[known]
    c = np.linalg.lstsq(matrix, u[known], rcond=None)[0]
    return c[:2].T, 1e3 * float(np.sqrt(np.mean((u[known] - matrix @ c) ** 2)))


@pytest.mark.parametrize("before, after", [(4e-4, -1e-4), (1e-9, 3e-4)])
def test_a_bowed_sheet_that_is_pulled_straight_and_tilts_shows_its_own_strain(before, after):
    reference = surface(SHEET, before)
    now = surface(SHEET * [1.0 - 0.3 * STRAIN, 1.0 + STRAIN], after) @ turn(0.02, -0.01).T + [0.1, 0.2, 0.3]
    moved = now - reference
    moved[5] = np.nan
    raw, _ = strains(moved[:, :2], reference[:, :2])
    assert abs(raw[1, 1] / STRAIN - 1.0) > 0.1  # bending and tilt, as seen from the front
    flat = Flattening.of(reference[:, :2], reference[:, 2] - reference[:, 2].mean(), 2.0 * HALF)(moved)[:, :2]
    assert np.isnan(flat[5]).all()
    found, left = strains(flat, reference[:, :2])
    assert found[1, 1] == pytest.approx(STRAIN, rel=5e-3) and found[0, 0] == pytest.approx(-0.3 * STRAIN, rel=0.015)
    assert left < 0.1


def test_without_a_thickness_the_strain_of_bending_stays():
    reference = surface(SHEET, 1e-9)
    moved = surface(SHEET, 2e-4) - reference
    flat = Flattening.of(reference[:, :2], reference[:, 2] - reference[:, 2].mean(), None)(moved)[:, :2]
    assert strains(flat, reference[:, :2])[0][1, 1] == pytest.approx(-HALF * 2e-4, rel=0.01)
