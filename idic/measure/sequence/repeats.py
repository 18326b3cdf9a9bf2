"""Images that repeat the one before, and images that are missing, by their motion against the log."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

MAX_REPEATED = 0.4  # motion of a repeated image per change of the log, over that of the pair beside it
MAX_STEP = 0.35  # its step over that of the pair beside it
MIN_LOG_STEP = 0.3  # change of the log over that of the pair beside it: the log moves on
MIN_LOST, MAX_LOST = 1.6, 6.5  # motion over a missing image per change of the log, over that of the pairs beside it
MAX_UNLIKE = 1.25  # of the pairs on both sides
MIN_MOVING = 2.0  # steps beside a missing image over the smallest one: motion, and not noise
MIN_CHANGE = 1e-3  # of the range of a column: less is none
MIN_HALF = 0.4  # share of the images: more are every second one
MAX_NAMED = 40


def repeated_frames(step: np.ndarray, courses: np.ndarray, labels: Sequence[str],
                    equal: Collection[int]) -> list[str]:
    """One sentence on the frames that repeat the one before, with the line that excludes them.

    step : (n - 1,) from image to image; courses : (m, n) columns of the log; equal : frames that are equal to the last
    grey value
    """
    found = sorted({*repeats(step, courses), *(k for k in equal if _moves_on(courses, k))})
    if not found:
        return []
    named = [f'"{labels[k]}"' for k in found]
    if len(named) > MAX_NAMED:
        named = [*named[:MAX_NAMED], "…"]
    how = "to the last grey value" if set(found) <= set(equal) else "within the noise"
    subject = (f"{labels[found[0]]} repeats {labels[found[0] - 1]}" if len(found) == 1
               else f"{len(found)} of {len(labels)} images, {labels[found[0]]} the first, repeat the one before")
    why = ("every second image: a film that was decoded to twice its rate?" if len(found) >= MIN_HALF * len(labels) > 2
           else "the recording lost images, and put the ones before in their place?")
    return [f"{subject} {how}" + (" while the log moves on" if len(courses) else "") + f": {why} Their motion is that of "
            f"another moment: write exclude_frames = [{', '.join(named)}], and check that log and images belong "
            "together after them"]


def repeats(step: np.ndarray, courses: np.ndarray) -> list[int]:
    """Frames without the motion that the log and the pairs of frames beside them have."""
    if not len(courses) or len(step) < 3:
        return []
    moved, logged = _moved(step), _log_steps(courses)
    frames = []
    for k in range(len(step)):
        beside = max((j for j in (k - 1, k + 1) if 0 <= j < len(step)), key=lambda j: moved[j])
        if not logged[k] >= MIN_LOG_STEP * logged[beside] > 0.0:
            continue
        if step[k] < MAX_STEP * step[beside] and moved[k] < MAX_REPEATED * moved[beside] * min(
                1.0, logged[k] / logged[beside]):
            frames.append(k + 1)
    return frames


def lost_frames(step: np.ndarray, courses: np.ndarray, times: np.ndarray, labels: Sequence[str]) -> list[str]:
    """Sentences on places where one step of the motion is a multiple of those beside it.

    step : (n - 1,) from image to image; courses : (m, n) columns of the log; times : (n,) s of the images
    """
    if len(step) < 4 or repeats(step, courses):
        return []
    moved, logged = _moved(step), _log_steps(courses if len(courses) else times[None])
    texts = []
    for k in range(1, len(step) - 1):
        if min(logged[k - 1:k + 2]) <= 0.0 or min(step[k - 1], step[k + 1]) < MIN_MOVING * step.min() > 0.0:
            continue
        before, ratio, after = moved[k - 1:k + 2] / logged[k - 1:k + 2]
        usual = 0.5 * (before + after)
        if max(before, after) > MAX_UNLIKE * min(before, after) or not MIN_LOST < ratio / usual < MAX_LOST:
            continue
        n = round(float(ratio / usual)) - 1
        texts.append(f"from {labels[k]} to {labels[k + 1]} the images move {ratio / usual:.2g} times as far as "
                     f"{'the log says' if len(courses) else 'before and after'}"
                     f": {'an image' if n < 2 else f'{n} images'} lost between them? Then the times of all later images "
                     "are too early: give the time of every image with image_times. If the grip slipped there, do "
                     "nothing")
    return texts


def _moved(step: np.ndarray) -> np.ndarray:
    """The part of the steps that is not noise  # (n - 1,) px"""
    return np.sqrt(np.maximum(step**2 - step.min() ** 2, 0.0))


def _log_steps(courses: np.ndarray) -> np.ndarray:
    """Change of the log from frame to frame, each column over its whole way  # (n - 1,)"""
    change = np.abs(np.diff(courses, axis=1))
    return (change / change.sum(axis=1, keepdims=True)).mean(axis=0)


def _moves_on(courses: np.ndarray, k: int) -> bool:
    """Whether the log changes before a frame; without a log nothing says that it does not."""
    return not len(courses) or bool((np.abs(courses[:, k] - courses[:, k - 1]) > MIN_CHANGE).any())
