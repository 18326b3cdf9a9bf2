"""The strain of bending at the surface of a pulled sheet against that of its middle, by three coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from idic.readers import FieldSeries, FieldStack, Flattening, largest_bending

THICKNESS = 2.0
SHEET = np.stack(np.meshgrid(np.linspace(-10, 10, 9), np.linspace(-40, 40, 27)), axis=-1).reshape(-1, 2)  # mm
STRAINS = [0.0, 1e-4, 1e-3, 2e-3, 3e-3]
CURVATURES = [0.0, 4e-4, 1e-4, 4e-4, 3e-4]  # 1/mm; the first loaded stage is bent most, at hardly any strain


def seen(strain: float, curvature: float) -> np.ndarray:
    """The seen side of the sheet, stretched along y and bent about x  # (n, 3) mm"""
    y, half = SHEET[:, 1] * (1.0 + strain), 0.5 * THICKNESS
    angle = curvature * y
    arc, sag = (y, 0.0 * y) if curvature == 0.0 else (np.sin(angle) / curvature, (1.0 - np.cos(angle)) / curvature)
    return np.column_stack([SHEET[:, 0] * (1.0 - 0.3 * strain), arc - half * np.sin(angle), sag + half * np.cos(angle)])


@pytest.fixture(scope="module")
def stack(tmp_path_factory):
    """Of stages as VIC-3D exports them, laid flat."""
    folder, reference = tmp_path_factory.mktemp("bent"), seen(0.0, 0.0)
    for k, (strain, curvature) in enumerate(zip(STRAINS, CURVATURES, strict=True)):
        rows = np.hstack([reference, seen(strain, curvature) - reference])
        text = "\n".join(["X,Y,Z,U,V,W,sigma", *(",".join(f"{value:.9f}" for value in row) + ",0.01" for row in rows)])
        (folder / f"stage_{k}.csv").write_text(text)
    series = FieldSeries.open(sorted(folder.glob("*.csv")))
    points = series.measured_points([0])
    return FieldStack(series, points, 2, Flattening.of(points.positions, np.zeros(len(points)), THICKNESS))


def test_the_largest_share_is_that_of_half_the_thickness_times_curvature_over_strain(stack):
    """2 %: a circle is not a parabola; 3e-3 is the largest strain, and 1e-4 too little of it to say anything."""
    found = largest_bending(stack, [1, 2, 3, 4], THICKNESS)
    assert found.stage == 3
    assert found.strain == pytest.approx(0.5 * THICKNESS * CURVATURES[3], rel=0.02)
    assert found.share == pytest.approx(found.strain / STRAINS[3], rel=0.02)


def test_a_thicker_sheet_is_bent_more_and_a_flat_one_not_at_all(stack):
    thin = largest_bending(stack, [2, 4], THICKNESS)
    assert largest_bending(stack, [2, 4], 2.0 * THICKNESS).share == pytest.approx(2.0 * thin.share)
    assert largest_bending(stack, [], THICKNESS) is None
