"""Spots that are not the specimen's pattern: dust, which is fixed in the image, and lost paint, which is fixed on the
specimen.

Of every place where the pattern is lost (`lost_pattern`) a disc is fitted under three histories:

    dust on the lens or sensor from the start    the disc in the reference image, and where each frame shows it: either,
                                                 not both, as one grey covers the other
    dust from a frame on                         where each of these frames shows it
    lost paint from a frame on                   the disc on the specimen

The history whose pixels agree best with the lost ones counts (intersection over union, all frames); those that agree
nearly as well stay beside it. What is no disc (a crack that opens, an edge) agrees with none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from idic.diagnose.residual.lost_pattern import LostPattern, lost_pattern
from idic.identification import Identification

DUST, PAINT = "dust", "paint_loss"
LEFT_OUT = "options.left_out_px"  # key of the circles in which no pixel is correlated
MIN_PIXELS, MIN_FRAMES = 4, 2  # of a place where the pattern is lost
MIN_AGREEMENT = 0.5  # intersection over union
SAME_AGREEMENT = 0.04  # a history that agrees so little less is not excluded; 1.4 px under a disc of 6 px tell 0.05
MAX_SPOTS = 12
MARGIN_PX = 4.0  # around a spot that is left out: interpolation and low-pass carry it outwards, as along an edge
RADII_PX = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0)  # of the first search
MAX_DOUBT = 0.3  # of an agreement
COARSE_PX = (-4.0, -2.0, 0.0, 2.0, 4.0)  # around a start
MAX_WINDOW_PX = 160
SOFT_PX = 1.5  # half the width over which the window of the residual smears the rim of a spot
COVERED = (0.15, 0.3, 0.5)  # part of a grey value that hides the pattern: the more contrast, the less


@dataclass(frozen=True)
class Spot:
    """A spot of another grey value.

    kind : `DUST` or `PAINT`; alternatives : kinds that are not excluded; column, row : centre in the reference image,
    px; radius_px; first : frame from which on, 0 of dust that was there from the start; grey : mean difference from the
    pattern, grey values; agreement : of its pixels with those whose pattern is lost; left_out : circles (column, row,
    radius) of the reference image that leave it out of all frames
    """

    kind: str
    alternatives: tuple[str, ...]
    column: float
    row: float
    radius_px: float
    first: int
    grey: float
    agreement: float
    left_out: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Spots that were left out of the images.

    result : of the model identified without their pixels (keys of result.json); place_mm : of every spot, in the
    reference state
    """

    spots: tuple[Spot, ...]
    result: Mapping
    place_mm: tuple[tuple[float, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Their kinds, each once."""
        return tuple(dict.fromkeys(spot.kind for spot in self.spots))


@dataclass(frozen=True, eq=False)
class _Window:
    """A part of the lost pattern. column, row : (h, w) px; lost : (T, h, w); u : (T, 2) motion of the place, px;
    image : (h, w) the reference."""

    column: np.ndarray
    row: np.ndarray
    lost: np.ndarray
    u: np.ndarray
    image: np.ndarray


def find_spots(identification: Identification) -> tuple[Spot, ...]:
    """The spots of a recording, the largest first; () where there is none."""
    pattern = lost_pattern(identification)
    if pattern is None:
        return ()
    spots: list[Spot] = []
    lost = pattern.lost.copy()
    labels, n = ndimage.label(ndimage.binary_dilation(_lasting(lost)))
    sizes = ndimage.sum_labels(lost.sum(axis=0), labels, np.arange(1, n + 1)) if n else np.zeros(0)
    for number in 1 + np.argsort(-sizes)[:2 * MAX_SPOTS]:
        place = (labels == number) & _lasting(lost)
        if place.sum() < MIN_PIXELS or len(spots) == MAX_SPOTS:
            continue
        spot, pixels = _fitted(pattern, lost, place)
        if spot is not None:
            spots.append(spot)
            lost &= ~pixels
    return tuple(spots)


def _lasting(lost: np.ndarray) -> np.ndarray:
    """Pixels that are lost in some frames  # (ny, nx)"""
    return lost.sum(axis=0) >= MIN_FRAMES


def _fitted(pattern: LostPattern, lost: np.ndarray, place: np.ndarray) -> tuple[Spot | None, np.ndarray]:
    """The spot at a place of the reference image, None without one, and its pixels in all frames."""
    u = np.array([np.nan_to_num(np.nanmean(motion[place], axis=0)) for motion in pattern.motion])
    rows, columns = np.nonzero(place)
    reach = int(np.ceil(np.abs(u).max())) + 4
    low = np.maximum([rows.min() - reach, columns.min() - reach], 0)
    high = np.minimum([rows.max() + reach + 1, columns.max() + reach + 1], lost.shape[1:])
    if (high - low).max() > MAX_WINDOW_PX:
        return None, np.zeros_like(lost)
    part = (slice(low[0], high[0]), slice(low[1], high[1]))
    row, column = np.mgrid[low[0]:high[0], low[1]:high[1]].astype(float)
    window = _Window(column, row, lost[:, part[0], part[1]], u, pattern.reference[part])
    best = {}
    for name in (PAINT, DUST, "later dust"):
        start = np.array([columns.mean(), rows.mean()])
        farthest = u[np.argmax(np.abs(u).sum(axis=1))]
        starts = [start] if name == PAINT else [start, start + farthest, start + 0.5 * u[-1]]
        best[name] = _search(window, name, starts)
    name = max(best, key=lambda trial: best[trial][0])
    agreement, first, centre, radius, least = best[name]
    pixels = np.zeros_like(lost)
    hidden = _mask(window, name, centre, radius, first, least)
    pixels[:, part[0], part[1]] = ndimage.binary_dilation(hidden, np.ones((1, 3, 3)))
    if agreement < MIN_AGREEMENT:
        return None, pixels
    kinds = {name: _kind(name) for name in best}
    alternatives = {kinds[trial] for trial in best if best[trial][0] > agreement - SAME_AGREEMENT} - {kinds[name]}
    is_shown = _shown(window, name, centre, radius, first)
    grey = float(pattern.brighter[:, part[0], part[1]][is_shown].mean()) if is_shown.any() else float("nan")
    frame = 0 if name == DUST else int(pattern.frames[first])
    return Spot(kinds[name], tuple(sorted(alternatives)), float(centre[0]), float(centre[1]), float(radius), frame,
                grey,
                float(agreement), _circles(name, centre, radius, u[first:])), pixels


def _kind(name: str) -> str:
    return PAINT if name == PAINT else DUST


def _search(window: _Window, name: str, starts: list[np.ndarray]) -> tuple[float, int, np.ndarray, float, float]:
    """Agreement, first frame (index), centre, radius and least cover of the best disc near a start, from coarse to
    fine."""
    def best(centres, sizes, covers):
        tried = ((*_agreement(window, name, centre, size, least), centre, size, least)
                 for centre in centres for size in sizes for least in covers)
        return max(tried, key=lambda trial: trial[0] - (_pattern_left(window, *trial[2:4]) if name == DUST else 0.0))

    disc = best([start + [dx, dy] for start in starts for dx in COARSE_PX for dy in COARSE_PX], RADII_PX, COVERED[1:2])
    for step in (1.0, 0.5, 0.25):
        moves = step * np.array([-1.0, 0.0, 1.0])
        for covers in (COVERED[1:2], COVERED):
            sizes = [r for r in disc[3] + moves if r >= 1.0]
            disc = best([disc[2] + [dx, dy] for dx in moves for dy in moves], sizes, covers)
    return disc


def _pattern_left(window: _Window, centre: np.ndarray, radius: float) -> float:
    """What speaks against dust from the start: the part of the pattern's variance that the reference image shows under
    it, at most `MAX_DOUBT`. Of dust whose rim shows on one side alone it tells which side is the dust."""
    under = np.hypot(window.column - centre[0], window.row - centre[1]) <= max(radius - 1.0, 1.0)
    values = window.image[under]
    if not np.isfinite(values).any():
        return MAX_DOUBT
    return MAX_DOUBT * min(float(np.nanvar(values) / np.nanvar(window.image)), 1.0)


def _agreement(window: _Window, name: str, centre: np.ndarray, radius: float, least: float) -> tuple[float, int]:
    """Intersection over union of a disc's history with the lost pixels, and the best first frame (index)."""
    covered = _mask(window, name, centre, radius, 0, least)
    n_common = (covered & window.lost).sum(axis=(1, 2))
    either = (covered | window.lost).sum(axis=(1, 2))
    n_lost = window.lost.sum(axis=(1, 2))
    if name == DUST:
        return float(n_common.sum() / max(either.sum(), 1)), 0
    since = np.cumsum(n_common[::-1])[::-1]  # of frames from here on
    union = np.cumsum(either[::-1])[::-1] + np.concatenate([[0], np.cumsum(n_lost)[:-1]])
    overlap = since / np.maximum(union, 1)
    first = int(np.argmax(overlap))
    return float(overlap[first]), first


def _mask(window: _Window, name: str, centre: np.ndarray, radius: float, first: int, least: float) -> np.ndarray:
    """Pixels of the reference image whose residual a disc has changed  # (T, h, w) bool

    least : part of the disc's grey value that hides the pattern
    """
    still = _cover(window, centre[None], radius)
    if name == PAINT:
        hidden = np.repeat(still > least, len(window.u), axis=0)
    else:
        moved = _cover(window, centre - window.u, radius)
        hidden = np.abs(moved - still if name == DUST else moved) > least
    hidden[:first] = False
    return hidden


def _shown(window: _Window, name: str, centre: np.ndarray, radius: float, first: int) -> np.ndarray:
    """Pixels of the reference image in whose place a frame shows the disc, and the reference does not  # (T, h, w)"""
    is_shown = _cover(window, centre - (0.0 if name == PAINT else 1.0) * window.u, radius) > 0.5
    if name == DUST:
        is_shown &= ~(_cover(window, centre[None], radius) > 0.5)
    is_shown[:first] = False
    return is_shown


def _cover(window: _Window, centres: np.ndarray, radius: float) -> np.ndarray:
    """Part of a disc's grey value at every pixel; centres : (T, 2) px -> (T, h, w)"""
    distance = np.hypot(window.column - centres[:, 0, None, None], window.row - centres[:, 1, None, None])
    return np.clip(0.5 + (radius - distance) / (2.0 * SOFT_PX), 0.0, 1.0)


def _circles(name: str, centre: np.ndarray, radius: float, u: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    """Circles of the reference image under which a spot lies in any frame."""
    size = radius + MARGIN_PX
    if name == PAINT:
        return ((float(centre[0]), float(centre[1]), float(size)),)
    centres: list[np.ndarray] = [centre] if name == DUST else []
    for at in centre - u:
        if all(np.hypot(*(at - neighbour)) > 0.25 * radius for neighbour in centres):
            centres.append(at)
    return tuple((float(at[0]), float(at[1]), float(size + 0.25 * radius)) for at in centres)
