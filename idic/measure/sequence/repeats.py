"""Images that repeat the one before, and images that are missing, by their motion against the log."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

MAX_REPEATED = 0.4  # motion of a repeated image per change of the log, over that of the pair beside it
BESIDE = 3  # pairs of images on both sides
USUAL = 0.8  # quantile of the motion per change of the log: of copies three in a row, two thirds have none
MIN_MOVED = 0.6  # the same of an image that is none: steps in between are those of an unsteady camera
MAX_STEP = 0.35  # its step over that of the pair beside it
MIN_LOG_STEP = 0.3  # change of the log over that of a pair beside it that it is compared with: the log moves on
MIN_LOST, MAX_LOST = 1.6, 6.5  # motion over a missing image per change of the log, over that of the pairs beside it
MAX_UNLIKE = 1.25  # of the pairs on both sides
MIN_MOVING = 0.5  # share of motion in the distance of two images: the rest is noise
MIN_CHANGE = 1e-3  # of the range of a column: less is none
MIN_HALF = 0.4  # share of the images: more are every second one


@dataclass(frozen=True)
class Steps:
    """From each image to the next: how far they are apart, the part of it that is motion, and the change of the log.

    apart_px, moved_px, logged : (n - 1,); logged is the mean over its columns, each over its whole way
    """

    apart_px: np.ndarray
    moved_px: np.ndarray
    logged: np.ndarray

    @classmethod
    def of(cls, apart_px: np.ndarray, two_apart_px: np.ndarray, courses: np.ndarray) -> Steps:
        """Noise makes images differ that do not move: f² in d₁² = f² + m², d₂² = f² + 4 m² over one and two steps.

        apart_px : (n - 1,), two_apart_px : (n - 2,) from each image to the one after next; courses : (m, n)
        """
        squares = (2.0 * (apart_px[:-1] ** 2 + apart_px[1:] ** 2) - two_apart_px**2) / 3.0
        noise = min(max(float(np.median(squares)), 0.0), float(apart_px.min() ** 2)) if len(squares) else 0.0
        change = np.abs(np.diff(courses, axis=1))
        return cls(apart_px, np.sqrt(np.maximum(apart_px**2 - noise, 0.0)),
                   (change / np.maximum(change.sum(axis=1, keepdims=True), 1e-300)).mean(axis=0))

    def repeats(self) -> list[int]:
        """Frames without the motion that the log and frames beside them have."""
        n, frames, n_between = len(self.apart_px), [], 0
        if n < 3 or not self.logged.any():
            return []
        rates = self.moved_px / np.where(self.logged > 0.0, self.logged, np.inf)
        usual = float(np.quantile(rates[self.logged > 0.0], USUAL))  # images may be lost beside: a larger step
        for k in range(n):
            pairs = [j for j in range(max(k - BESIDE, 0), min(k + BESIDE + 1, n))
                     if self.logged[k] >= MIN_LOG_STEP * self.logged[j] > 0.0]
            neighbour = max(pairs, key=lambda j: self.moved_px[j], default=k)
            if neighbour == k:
                continue
            share = min(1.0, usual / max(rates[neighbour], 1e-300))
            if self.apart_px[k] < MAX_STEP * share * self.apart_px[neighbour] and (
                    rates[k] < MAX_REPEATED * share * rates[neighbour]):
                frames.append(k + 1)
            elif rates[k] < MIN_MOVED * share * rates[neighbour]:
                n_between += 1
        return frames if len(frames) > n_between else []


def repeated_frames(steps: Steps, labels: Sequence[str], equal: Collection[int], has_log: bool,
                    excluding: Callable[[Sequence[int]], str]) -> list[str]:
    """One sentence on the frames that repeat the one before, with the line that excludes them.

    excluding : numbers -> the value of exclude_frames, "" where too few would remain; equal : frames that are equal to
    the last grey value; has_log : whether the steps know the change of a log
    """
    moving = [k for k in equal if not has_log or steps.logged[k - 1] > MIN_CHANGE / len(labels)]
    numbers = sorted({*(steps.repeats() if has_log else ()), *moving})
    if not numbers:
        return []
    likeness = "to the last grey value" if set(numbers) <= set(equal) else "within the noise"
    subject = (f"{labels[numbers[0]]} repeats {labels[numbers[0] - 1]}" if len(numbers) == 1
               else f"{len(numbers)} of {len(labels)} images, {labels[numbers[0]]} the first, repeat the one before")
    cause = ("a film that was decoded to a multiple of its rate?" if len(numbers) >= MIN_HALF * len(labels) > 2
           else "the recording lost images, and put the ones before in their place?")
    log = " while the log moves on" if has_log else ""
    names = excluding(numbers)
    remedy = f"write exclude_frames = {names}, and check" if names else "check"
    return [f"{subject} {likeness}{log}: {cause} Their motion is that of another moment: {remedy} that log and images "
            "belong together after them"]


def lost_frames(steps: Steps, labels: Sequence[str], has_log: bool, remedy: str) -> list[str]:
    """Sentences on places where one step of the motion is a multiple of those beside it, and that of the log is not."""
    if len(steps.apart_px) < 4 or steps.repeats():
        return []
    texts, moved, logged = [], steps.moved_px, steps.logged
    for k in range(1, len(moved) - 1):
        if min(logged[k - 1:k + 2]) <= 0.0 or min(moved[k - 1:k + 2] / steps.apart_px[k - 1:k + 2]) < MIN_MOVING:
            continue
        first, ratio, second = moved[k - 1:k + 2] / logged[k - 1:k + 2]
        usual = 0.5 * (first + second)
        if max(first, second) > MAX_UNLIKE * min(first, second) or not MIN_LOST < ratio / usual < MAX_LOST:
            continue
        n = round(float(ratio / usual)) - 1
        texts.append(f"from {labels[k]} to {labels[k + 1]} the images move {ratio / usual:.2g} times as far as "
                     f"{'the log says' if has_log else 'before and after'}: {'an image' if n < 2 else f'{n} images'} "
                     f"lost between them? Then the times of all later images are too early: {remedy}. If the grip "
                     "slipped there, do nothing")
    return texts
