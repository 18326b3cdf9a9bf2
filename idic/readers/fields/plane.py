"""Surfaces that were measured in three coordinates: their mean plane, and the motion out of it.

The measured side of a sheet moves by h (F33 - 1), h half of the thickness. A sheet also bends; what a polynomial of the
third degree of the position explains is lost. The largest possible rest has F33 = 1 / det F in the plane: a material
that keeps its volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

BENDING_DEGREE = 3  # of a strip between grips that are out of line, bent to the shape of an S
NEIGHBOURS = 21  # of a point, itself among them: its strain is that of their affine motion
MIN_NEIGHBOURS = 6  # measured ones


@dataclass(frozen=True, eq=False)
class Plane:
    """axes : (3, 3) rows are the directions along x, along y and normal; flatness_mm : rms distance from the plane."""

    axes: np.ndarray
    flatness_mm: float


def mean_plane(points: np.ndarray) -> Plane:
    """The plane with the least squared distance, turned as little as possible against x and y  # (n, 3) mm

    The normal points to the side of +z: towards the cameras of the usual systems.
    """
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    normal = normal if normal[2] >= 0 else -normal
    cross, cosine = np.cross(normal, [0.0, 0.0, 1.0]), float(normal[2])
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    axes = np.eye(3) + skew + skew @ skew / (1.0 + cosine)  # Rodrigues: the smallest turn of normal to z
    return Plane(axes, float(np.sqrt(np.mean((centred @ normal) ** 2))))


@dataclass(frozen=True)
class OutOfPlane:
    """Motion along the normal: rms of all (mm), tilt (mm per mm, both axes), largest curvature (1/mm)."""

    rms_mm: float
    tilt: tuple[float, float]
    curvature: float


def out_of_plane(points: np.ndarray, rise: np.ndarray) -> OutOfPlane | None:
    """Tilt and curvature by a polynomial of the second degree; None for fewer than 12 points.

    points : (n, 2) mm; rise : (n,) mm, NaN where not measured
    """
    measured = np.isfinite(rise)
    if measured.sum() < 12:
        return None
    x, y = (points[measured] - points[measured].mean(axis=0)).T
    size = max(np.ptp(x), np.ptp(y))
    x, y = x / size, y / size
    c = np.linalg.lstsq(np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y]), rise[measured], rcond=None)[0]
    bend = np.linalg.eigvalsh([[2 * c[3], c[4]], [c[4], 2 * c[5]]])
    return OutOfPlane(float(np.sqrt(np.mean(rise[measured] ** 2))), (c[1] / size, c[2] / size),
                      float(np.abs(bend).max() / size**2))


def powers(degree: int) -> list[tuple[int, int]]:
    """Exponents of the polynomials up to a degree, the constant first."""
    return [(n - j, j) for n in range(degree + 1) for j in range(n + 1)]


def largest_change(positions: np.ndarray, moved: np.ndarray, half_mm: float) -> float:
    """rms over the points of the motion of the seen side that a change of thickness can make, less bending  # mm

    positions : (n, 2) mm; moved : (n, 2) mm in the plane, NaN where not measured
    """
    rise = half_mm * (1.0 / area_ratio(positions, moved, neighbours(positions)) - 1.0)
    measured = np.isfinite(rise)
    degree = powers(BENDING_DEGREE)
    if measured.sum() <= 2 * len(degree):
        return 0.0
    x, y = (positions[measured] - positions[measured].mean(axis=0)).T / np.ptp(positions, axis=0).max()
    bent = np.column_stack([x**i * y**j for i, j in degree])
    residual = rise[measured] - bent @ np.linalg.lstsq(bent, rise[measured], rcond=None)[0]
    return float(np.sqrt(np.mean(residual**2)))


def neighbours(positions: np.ndarray) -> np.ndarray:
    """The points around every point, itself among them  # (n, 2) mm -> (n, NEIGHBOURS)"""
    return scipy.spatial.cKDTree(positions).query(positions, k=min(NEIGHBOURS, len(positions)))[1]


def area_ratio(positions: np.ndarray, moved: np.ndarray, around: np.ndarray) -> np.ndarray:
    """det F of the motion of the neighbours of every point, NaN where too few are measured  # (n,)"""
    measured = np.isfinite(moved).all(axis=1)[around]
    n = np.maximum(measured.sum(axis=1), 1)
    x, u = (np.where(measured[:, :, None], values[around], 0.0) for values in (positions, moved))
    x, u = (np.where(measured[:, :, None], values - (values.sum(axis=1) / n[:, None])[:, None], 0.0)
            for values in (x, u))
    spread, product = np.einsum("nki,nkj->nij", x, x), np.einsum("nki,nkj->nij", u, x)
    determined = (measured.sum(axis=1) >= MIN_NEIGHBOURS) & (np.linalg.det(spread) > 1e-6 * np.trace(spread, axis1=1,
                                                                                               axis2=2) ** 2)
    ratio = np.full(len(positions), np.nan)
    ratio[determined] = np.linalg.det(np.eye(2) + product[determined] @ np.linalg.inv(spread[determined]))
    return ratio
