"""Affine motion of the surface over a series of frames, in milliseconds per frame: what `check` and the table of causes
look at.

A few subsets of the binned reference image are looked for around the place of the frame before, by normalised
correlation; the affine motion that most of them agree with is that of the frame. How many agree tells whether the
surface is still one body.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idic.measure.dic.start import affine_by_vote, binned, search_everywhere, subset_centres, vertex

SUBSETS_PER_SIDE = 4
SIDE_PX = (16, 40)  # smallest and largest side of a subset, binned px
MAX_SEARCH_PX = 400  # longer side of the binned images
REACH_PX = 8  # of the search around the place of the frame before, binned px
MIN_CORRELATION = 0.5  # normalised, of a usable match: the best of 300 unrelated places reaches 0.3 to 0.4
MIN_AGREEING = 0.7  # share of the subsets; with fewer the whole frame is searched
MAX_SEARCHES = 4  # of the whole frame in one series: each takes as long as 50 others
MIN_PLACES = 6  # with a measured motion, for an affine one of all
NOISE_PX = 0.03  # standard deviation of a place, binned px


@dataclass(frozen=True)
class AffineMotions:
    """Affine motions p -> [1, p] @ fit of frames against the reference image, and how places depart from them.

    Attributes
    ----------
    frames : their numbers
    places_px : (m, 2) places that were measured
    fits : (n, 3, 2) px, NaN where no motion was recognised
    rests : (n, m, 2) px, motion of the places less the affine one, NaN where a place was not recognised
    agreeing : (n,) share of the places that follow the affine motion
    noise_px : standard deviation of the motion of a place
    """

    frames: tuple[int, ...]
    places_px: np.ndarray
    fits: np.ndarray
    rests: np.ndarray
    agreeing: np.ndarray
    noise_px: float

    @classmethod
    def of_places(cls, frames: Sequence[int], places_px: np.ndarray, motions: np.ndarray,
                  noise_px: float) -> AffineMotions:
        """Of motions that were measured place by place  # places_px (m, 2), motions (n, m, 2) px, NaN: not measured"""
        design = np.column_stack([np.ones(len(places_px)), places_px])
        fits = np.full((len(motions), 3, 2), np.nan)
        measured = np.isfinite(motions).all(axis=2)
        for k, measured_places in enumerate(measured):
            if measured_places.sum() >= MIN_PLACES:
                fits[k] = np.linalg.lstsq(design[measured_places], motions[k][measured_places], rcond=None)[0]
        return cls(tuple(frames), places_px, fits, motions - design @ fits, measured.mean(axis=1), noise_px)

    def only(self, kept_rows: Sequence[bool] | np.ndarray) -> AffineMotions:
        """Of some of the frames  # (n,) bool"""
        at = np.flatnonzero(kept_rows)
        return AffineMotions(tuple(self.frames[i] for i in at), self.places_px, self.fits[at], self.rests[at],
                             self.agreeing[at], self.noise_px)

    def at_places(self, kept_rows: np.ndarray) -> AffineMotions:
        """With some of the places alone  # indices"""
        return replace(self, places_px=self.places_px[kept_rows], rests=self.rests[:, kept_rows])

    def joined(self, more: AffineMotions) -> AffineMotions:
        """With further frames of the same places, in the order of their numbers."""
        frames = np.array([*self.frames, *more.frames])
        order = np.argsort(frames, kind="stable")
        fits, rests, agreeing = (np.concatenate([getattr(self, name), getattr(more, name)])[order]
                                 for name in ("fits", "rests", "agreeing"))
        return AffineMotions(tuple(frames[order].tolist()), self.places_px, fits, rests, agreeing, self.noise_px)

    def at(self, places_px: np.ndarray) -> np.ndarray:
        """Motion of places of the reference image: the affine one, and what the nearest measured place departs from it
        # (p, 2) px -> (n, p, 2) px"""
        motions = np.column_stack([np.ones(len(places_px)), places_px]) @ self.fits
        distance = np.linalg.norm(places_px[:, None] - self.places_px, axis=2)
        for k, rests in enumerate(self.rests):
            measured_places = np.isfinite(rests).all(axis=1)
            if measured_places.any():
                motions[k] += rests[measured_places][np.argmin(distance[:, measured_places], axis=1)]
        return motions

    @classmethod
    def of(cls, reference: np.ndarray, picture: Callable[[int], np.ndarray], frames: Sequence[int],
           points_px: np.ndarray) -> AffineMotions | None:
        """Affine motion of the surface in some frames, each searched from the one before.

        Parameters
        ----------
        reference : (ny, nx) image
        picture : frame -> (ny, nx) image
        frames : in the order in which they are followed
        points_px : (n, 2) column and row of points of the surface, e.g. the visible nodes

        Returns
        -------
        None where the surface has no room for three subsets.
        """
        factor = int(np.ceil(max(reference.shape) / MAX_SEARCH_PX))
        first = binned(reference, factor)
        points = (points_px - (factor - 1) / 2) / factor
        side = int(np.clip(np.ptp(points, axis=0).min() / 3, *SIDE_PX)) // 2 * 2
        if side > min(first.shape):
            return None
        centres = subset_centres(points, first.shape, side, SUBSETS_PER_SIDE)
        if len(centres) < 3:
            return None
        templates = _windows(first, centres, side // 2)
        design = np.column_stack([np.ones(len(centres)), centres])
        fit, searches, fits, rests, shares = np.zeros((3, 2)), MAX_SEARCHES, [], [], []
        for frame in frames:
            image = binned(picture(frame), factor)
            motion, departure, share = _voted(design, *_matched(templates, image, centres, design @ fit), side)
            if share < MIN_AGREEING and searches:
                searches -= 1
                wide_search = _voted(design, *search_everywhere(first, image, centres, side), side)
                motion, departure, share = wide_search if wide_search[2] > share else (motion, departure, share)
            fit = motion if share >= MIN_AGREEING else fit
            for values, value in ((fits, motion), (rests, departure), (shares, share)):
                values.append(value)
        return cls(tuple(frames), factor * centres + (factor - 1) / 2,
                   _unbinned(np.reshape(fits, (-1, 3, 2)), factor),
                   factor * np.reshape(rests, (-1, len(centres), 2)), np.array(shares), NOISE_PX * factor)


def _voted(design: np.ndarray, shifts: np.ndarray, scores: np.ndarray,
           side: int) -> tuple[np.ndarray, np.ndarray, float]:
    """The affine shift that most good matches agree with, how all good ones depart from it, the share that agrees."""
    good = scores > MIN_CORRELATION
    tolerance = 1.0 + 0.03 * side
    fit = affine_by_vote(design[good, 1:], shifts[good], tolerance)
    if fit is None:
        return np.full((3, 2), np.nan), np.full(shifts.shape, np.nan), 0.0
    departure = shifts - design @ fit
    share = float((good & (np.linalg.norm(departure, axis=1) < tolerance)).mean())
    return fit, np.where(good[:, None], departure, np.nan), share


def _windows(image: np.ndarray, centres: np.ndarray, half: int) -> np.ndarray:
    """Squares of 2 half px around (column, row), the edge continued  # (n, 2 half, 2 half)"""
    reach = np.arange(-half, half)
    rows = np.clip(centres[:, 1, None] + reach, 0, image.shape[0] - 1)
    columns = np.clip(centres[:, 0, None] + reach, 0, image.shape[1] - 1)
    return image[rows[:, :, None], columns[:, None, :]]


def _matched(templates: np.ndarray, image: np.ndarray, centres: np.ndarray,
             expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift of every subset near an expected one, and its correlation  # (n, 2) binned px, (n,)"""
    n, side = templates.shape[:2]
    places = centres + np.rint(expected).astype(int)
    windows = _windows(image, places, side // 2 + REACH_PX)
    windows = windows - windows.mean(axis=(1, 2), keepdims=True)
    detail = templates - templates.mean(axis=(1, 2), keepdims=True)
    shape = (scipy.fft.next_fast_len(windows.shape[1], real=True),) * 2
    product = scipy.fft.irfft2(scipy.fft.rfft2(windows, shape) * np.conj(scipy.fft.rfft2(detail, shape)), shape)
    span = 2 * REACH_PX + 1
    product = product[:, :span, :span]
    norms = np.sqrt((detail**2).sum(axis=(1, 2)))
    mean, square = (_box_means(values, side) for values in (windows, windows**2))
    spread = side * np.sqrt(np.maximum(square - mean**2, 0.0))
    scores = product / (norms[:, None, None] * np.maximum(spread, 0.1 * np.median(spread)) + 1e-12)
    best = np.argmax(scores.reshape(n, -1), axis=1)
    rows, columns = np.unravel_index(best, (span, span))
    fine = np.array([(vertex(score[i], j), vertex(score[:, j], i))
                     for score, i, j in zip(scores, rows, columns, strict=True)])
    shifts = places - centres + np.column_stack([columns, rows]) - REACH_PX + fine
    at_rim = (rows == 0) | (rows == span - 1) | (columns == 0) | (columns == span - 1)
    return shifts, np.where(at_rim, 0.0, scores.reshape(n, -1)[np.arange(n), best])


def _box_means(values: np.ndarray, side: int) -> np.ndarray:
    """Means over squares of `side`, by their first pixel  # (n, w, w) -> (n, w - side + 1, w - side + 1)"""
    sums = np.pad(values.astype(float), ((0, 0), (1, 0), (1, 0))).cumsum(axis=1).cumsum(axis=2)
    box = sums[:, side:, side:] - sums[:, :-side, side:] - sums[:, side:, :-side] + sums[:, :-side, :-side]
    return box / side**2


def _unbinned(fits: np.ndarray, factor: int) -> np.ndarray:
    """Fits in binned px as fits in px, p_binned = (p - (factor - 1) / 2) / factor  # (n, 3, 2)"""
    gradients = fits[:, 1:]
    offsets = factor * fits[:, :1] - 0.5 * (factor - 1) * gradients.sum(axis=1, keepdims=True)
    return np.concatenate([offsets, gradients], axis=1)
