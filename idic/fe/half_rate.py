"""The error of one increment per frame, estimated from one increment for two frames.

Backward Euler errs by C h in every frame, h the length of an increment (docs/method.md, equation 12.8). A second
simulation in steps of two frames errs by 2 C h; the difference of the two is the error of the first

    u - u(no time error) = (u_2h - u_h) / (2^p - 1),   p = 1

at the frames that both have; in between it is taken as linear in time. The second simulation has half the increments,
no derivatives, and begins at the first one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from idic.fe.extrapolation import time_order
from idic.fe.time_march import FrameState
from idic.fe.body.body import Body

Motion = tuple[np.ndarray, np.ndarray]  # (n_nodes, d) mm and channels (n_channels,) of a frame


def without_time_error(body: Body, n_frames: int, simulation: Callable[[], Iterable[Motion]],
                       march: Callable[[np.ndarray, Iterator[np.ndarray]], Iterable[FrameState]]) -> Iterator[Motion]:
    """Motion and channels of every frame, extrapolated in time from a simulation and one in steps of two frames.

    Parameters
    ----------
    simulation : gives every frame anew at every call, the reference first
    march : called as march(frames, warm_start), simulates with an increment from each of some frames to the next; the
        states keep the numbers of the frames, warm_start holds (n_nodes, d) mm of each

    Raises
    ------
    NotConverged
        If `march` does not find equilibrium.
    """
    frames = np.unique(np.append(np.arange(0, n_frames, 2), n_frames - 1))
    chosen = set(frames.tolist())
    coarse = march(frames, (u for number, (u, _) in enumerate(simulation()) if number in chosen))
    yield from _extrapolated(body, simulation(), coarse)


def _extrapolated(body: Body, fine: Iterable[Motion], coarse: Iterable[FrameState]) -> Iterator[Motion]:
    """The motion of every frame out of both; coarse : numbered as `fine`, the first and the last frame included"""
    share, frames = 1.0 / (2.0 ** time_order(body) - 1.0), iter(fine)
    first = next(frames)
    yield first
    last_frame, start_error = 0, tuple(np.zeros_like(part) for part in first)
    for state in coarse:
        if state.frame == 0:
            continue
        between = [next(frames) for _ in range(last_frame, state.frame)]
        end_error = tuple(share * (fine_part - coarse_part)
                          for fine_part, coarse_part in zip(between[-1], (state.seen_u, state.channels), strict=True))
        for number, motion in enumerate(between, start=1):
            part = number / (state.frame - last_frame)
            yield tuple(quantity + (1.0 - part) * a + part * b
                        for quantity, a, b in zip(motion, start_error, end_error, strict=True))
        last_frame, start_error = state.frame, end_error
