"""The narrowest width of an outline of measured points and its uncertainty: a force is compared with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.readers.fields.outline import MAX_CIRCUMRADIUS, PointOutline

MIN_NOTCH_PITCHES = 3.0  # depth of a notch or waist by which `idic init` takes its sides as free edges
SLICES, SLICED = 200, (0.1, 0.9)  # across an outline, for its narrowest width, and over which part of its length
MIN_NOTCH = 0.7  # radii of a closed gap: how much wider it is a gap beside the narrowest place; less is no notch


def narrowest_width(contour: PointOutline, pitch: float) -> tuple[float, float]:
    """The smallest width of the material across the loaded axis, and its uncertainty  # mm

    Between a tenth of the length from both ends; holes are left out. Each edge lies half a distance beyond the
    outermost points, give or take half a distance. The tip of a notch is filled where it is narrower than the gaps that
    are closed, and the lines of its sides meet deeper than its round: it is known to the radius of such a gap.
    """
    along, gap = _loaded_axis(contour, pitch), MAX_CIRCUMRADIUS * pitch
    widths_of_material = _widths(contour, along)
    at = int(np.argmin(widths_of_material))
    widths = _widths(replace(contour, holes=()), along)  # a hole is a circle through many points
    neighbours = np.clip(at + np.array([-1, 1]) * _slices_of(contour, along, 2.0 * gap), 0, SLICES - 1)
    is_notched = (widths[neighbours] - widths[at]).min() > MIN_NOTCH * gap
    return float(widths_of_material[at]), 2.0 * gap if is_notched else pitch


def _loaded_axis(contour: PointOutline, pitch: float) -> int:
    """Between the loaded ends: not through notched sides, else the longer one."""
    a, b = contour.outline, np.roll(contour.outline, -1, axis=0)
    edges = (a[:, None] + np.linspace(0.0, 1.0, SLICES)[:, None] * (b - a)[:, None]).reshape(-1, 2)
    notched = notched_axis(edges, pitch)
    return int(np.argmax(np.ptp(contour.outline, axis=0))) if notched is None else 1 - notched


def _widths(contour: PointOutline, along: int) -> np.ndarray:
    """Widths across an axis  # (SLICES,) mm"""
    low, extent = contour.outline.min(axis=0), np.ptp(contour.outline, axis=0)
    loops = [contour.outline, *(_circle(hole) if hole.ndim == 1 else hole for hole in contour.holes)]
    return np.array([sum(_width(loop, along, at) * (1.0 if k == 0 else -1.0) for k, loop in enumerate(loops))
                     for at in low[along] + extent[along] * np.linspace(*SLICED, SLICES)])


def _slices_of(contour: PointOutline, along: int, length: float) -> int:
    """How many slices are a length apart."""
    return int(np.ceil(length * (SLICES - 1) / (np.ptp(contour.outline[:, along]) * (SLICED[1] - SLICED[0]))))


def _circle(hole: np.ndarray) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, SLICES, endpoint=False)
    return hole[:2] + hole[2] * np.column_stack([np.cos(angle), np.sin(angle)])


def _width(loop: np.ndarray, along: int, at: float) -> float:
    """Length of the line at one coordinate inside a loop."""
    a, b = loop, np.roll(loop, -1, axis=0)
    over = (a[:, along] > at) != (b[:, along] > at)
    a, b = a[over], b[over]
    share = (at - a[:, along]) / (b[:, along] - a[:, along])
    crossed = np.sort(a[:, 1 - along] + share * (b - a)[:, 1 - along])
    return float(np.sum(crossed[1::2] - crossed[::2]))


def notched_axis(positions: np.ndarray, pitch: float) -> int | None:
    """The axis whose two sides (0: left and right, 1: below and above) are notched or waisted; None: neither or both.

    A side is notched where it recedes between two places that lie further out, by `MIN_NOTCH_PITCHES` at least.

    positions : (n, 2); pitch : distance of neighbours
    """
    deep = [max(_recess(positions[:, axis], positions[:, 1 - axis], pitch),
                _recess(-positions[:, axis], positions[:, 1 - axis], pitch)) / pitch for axis in (0, 1)]
    axis = int(np.argmax(deep))
    return axis if deep[axis] >= MIN_NOTCH_PITCHES and deep[axis] > 2.0 * deep[1 - axis] else None


def _recess(across: np.ndarray, along: np.ndarray, pitch: float) -> float:
    """How far the lower end of `across` recedes between two places along the side."""
    places, place = np.unique(np.floor((along - along.min()) / (2.0 * pitch)), return_inverse=True)
    lowest = np.full(len(places), np.inf)
    np.minimum.at(lowest, place, across)
    from_start, from_end = np.minimum.accumulate(lowest), np.minimum.accumulate(lowest[::-1])[::-1]
    return float((lowest - np.maximum(from_start, from_end)).max())
