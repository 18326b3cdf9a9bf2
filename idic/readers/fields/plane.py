"""Surfaces that were measured in three coordinates: their mean plane, and the motion out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
    known = np.isfinite(rise)
    if known.sum() < 12:
        return None
    x, y = (points[known] - points[known].mean(axis=0)).T
    size = max(np.ptp(x), np.ptp(y))
    x, y = x / size, y / size
    c = np.linalg.lstsq(np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y]), rise[known], rcond=None)[0]
    bend = np.linalg.eigvalsh([[2 * c[3], c[4]], [c[4], 2 * c[5]]])
    return OutOfPlane(float(np.sqrt(np.mean(rise[known] ** 2))), (c[1] / size, c[2] / size),
                      float(np.abs(bend).max() / size**2))
