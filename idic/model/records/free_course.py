"""An identified time course: linear between knots at even numbers of frames, zero at the reference frame.

Every knot is a degree of freedom ``NAME_knot[FRAME]``, the amplitude in that frame.
"""

from __future__ import annotations

import numpy as np

TEMPERATURE = "temperature"  # stem of the knots of a warmth
KNOTS = 6  # of a course, unless the file says otherwise


def knot_frames(n_frames: int, reference: int, knots: int) -> tuple[int, ...]:
    """Frames of the knots behind the reference; the last frame is one of them."""
    places = np.unique(np.rint(np.linspace(reference, n_frames - 1, knots + 1)).astype(int))
    return tuple(int(frame) for frame in places if frame != reference)


def hats(times: np.ndarray, reference: int, frames: tuple[int, ...]) -> np.ndarray:
    """Course of every knot: 1 there, linear in time to its neighbours  # (n_knots, n_frames)"""
    places = [reference, *frames]
    return np.array([np.interp(times, times[places], row) for row in np.eye(len(places))[1:]])


def knot_name(stem: str, frame: int) -> str:
    """Name of the degree of freedom of one knot."""
    return f"{stem}_knot[{frame}]"


def jump_name(stem: str, frame: int) -> str:
    """Name of the degree of freedom of a jump from one frame on."""
    return f"{stem}_jump[{frame}]"


def jump_frame(name: str) -> int | None:
    """The frame of a jump, None of another degree of freedom."""
    _, separator, index = name.partition("_jump[")
    return int(index.removesuffix("]")) if separator else None


def without_knot(name: str) -> str:
    """The name of a degree of freedom without its knot or jump."""
    return name.partition("_knot[")[0].partition("_jump[")[0]
