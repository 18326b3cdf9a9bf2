"""How a specimen is loaded, by its mean strain and its bending under the largest force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.readers import FieldSeries, Log, MeasuredPoints, mean_strain

MIN_BENDING = 2.0  # strain of bending at the edges over the mean strain: a tension test with askew grips has less
TERMS_OF_BENDING = 5  # 1, x, y, xy, y²
BENDS = ("bending, by the strain across the specimen: check the ends, and the direction and the sign of the force")


@dataclass(frozen=True)
class Loading:
    """Component of the force on the moving end, and whether its sign is opposite to that of the log."""

    component: str
    opposite: bool
    words: str


def largest_load(series: FieldSeries, points: MeasuredPoints, log: Log | None,
                  column: str | None) -> tuple[np.ndarray, float, tuple[float, float]]:
    """Mean strain of the stage with the largest force, that force since the first stage, and the strain of bending at
    the edges of beams along x and along y; the last stage and 0 without a log  # (2, 2)"""
    force = None if log is None or column is None else log.column(column)
    k = len(series.entries) - 1 if force is None else int(np.argmax(np.abs(force)))
    moved = points.moved(series.stage(k))[:, :2]
    strain = mean_strain(points.positions, moved)
    bent = _bending(points.positions, moved, 0), _bending(points.positions, moved, 1)
    return strain, 0.0 if force is None else float(force[k] - force[0]), bent


def _bending(positions: np.ndarray, moved: np.ndarray, axis: int) -> float:
    """Strain of bending in the plane at the edges of a beam along x (0) or y (1): the change of the strain along it
    across it, times half of its width; 0 where fewer points than terms are measured, which tell no bending."""
    measured = np.isfinite(moved).all(axis=1)
    if np.count_nonzero(measured) < TERMS_OF_BENDING:
        return 0.0
    at = positions[measured] - positions[measured].mean(axis=0)
    along, across = at[:, axis], at[:, 1 - axis]
    terms = np.column_stack([np.ones(len(at)), along, across, along * across, across**2])
    curvature = np.linalg.lstsq(terms, moved[measured, axis], rcond=None)[0][3]
    return abs(float(curvature)) * 0.5 * float(np.ptp(across))


def loading(strain: np.ndarray, force: float, bent: tuple[float, float], upright: bool) -> Loading:
    """Tension, shear or bending, by the strain (2, 2) under the largest force, which is 0 without a log."""
    along, shear = strain[1, 1] if upright else strain[0, 0], 2.0 * strain[0, 1]
    sheared = bool(abs(shear) > abs(along))
    main_strain = shear if sheared else along
    if bent[upright] > MIN_BENDING * abs(main_strain):
        return Loading("x" if upright else "y", False, BENDS)
    opposite = bool(main_strain * force < 0)
    words = (f"{'shear' if sheared else 'tension' if main_strain > 0 else 'compression'}, by the mean strain"
             + ("; the log counts the other way" if opposite else ""))
    return Loading("y" if upright != sheared else "x", opposite, words)
