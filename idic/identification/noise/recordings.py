"""Which images show the noise of a camera best: those at rest, else all of the test.

At rest are the images that the experiment file declares still and those that are averaged to the reference; without
any, the frames next to the reference whose readings stay at its readings (`idic.measure.dic.still`). Frames at rest
with a load between them are no pair: light and focus have changed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from idic.measure import declared_stack, find_still_frames
from idic.images import Stack
from idic.model import Experiment

STILL, CONSECUTIVE, FREE_RESIDUAL = "still_frames", "consecutive_images", "free_residual"


@dataclass(frozen=True, eq=False)
class Recording:
    """Images whose consecutive differences show noise.

    frames : their numbers in the stack, in the order of recording; source : "still_frames" | "consecutive_images"
    """

    stack: Stack
    frames: tuple[int, ...]
    source: str


def recordings(view: Experiment) -> Iterator[Recording]:
    """The recordings of one camera, the best one first; frames that are left out do not count in the test."""
    still = find_still_frames(view)
    if still.separate:
        stack = declared_stack(view.recording)
        yield Recording(stack, tuple(range(stack.n_frames)), STILL)
    declared = tuple(sorted({*view.recording.still_frames, *view.recording.averaged}))
    still_frames = declared if len(declared) > 1 else _run_around(still.frames, view.model.reference)
    if len(still_frames) > 1:
        yield Recording(view.recording.stack, still_frames, STILL)
    frames = tuple(k for k in range(view.model.reference, view.model.n_frames) if k not in view.recording.excluded)
    yield Recording(view.recording.stack, frames, CONSECUTIVE)


def _run_around(frames: Collection[int], reference: int) -> tuple[int, ...]:
    """The consecutive numbers that the reference is among."""
    first = end = reference
    while first - 1 in frames:
        first -= 1
    while end + 1 in frames:
        end += 1
    return tuple(range(first, end + 1))
