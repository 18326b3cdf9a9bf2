"""Sheets that tilt and bend before two cameras: the motion of their middle, laid flat."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from idic.readers import Flattening

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


@pytest.mark.parametrize("share", [0.43, 1.0])  # of the largest change of thickness: metal, a volume that stays
def test_a_neck_is_not_taken_for_bending(share):
    half, bend, width = 2.0, 2e-5, 4.0
    x, y = np.stack(np.meshgrid(*[np.arange(-7.5, 8.0, 0.75)] * 2), axis=-1).reshape(-1, 2).T
    along = STRAIN * (1.0 + 2.0 * np.exp(-((y / width) ** 2)))
    middle = np.column_stack([-0.3 * along * x, STRAIN * (y + width * np.sqrt(np.pi) * erf(y / width))])
    rise = half * share * (1.0 / ((1.0 + along) * (1.0 - 0.3 * along)) - 1.0) + 0.5 * bend * y**2
    seen = np.column_stack([middle[:, 0], middle[:, 1] - half * bend * y, rise])
    seen += np.random.default_rng(2).normal(0.0, 5e-4, seen.shape)
    at = np.column_stack([x, y])
    flat = Flattening.of(at, np.zeros(len(at)), 2.0 * half)(seen)
    truth, found = strains(middle, at)[0][1, 1], strains(flat[:, :2], at)[0][1, 1]
    assert found == pytest.approx(truth, rel=0.03 * share)  # 0.088 of the share where the neck counts as bending
