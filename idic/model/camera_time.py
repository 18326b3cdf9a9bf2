"""Cameras whose images are taken later than those of the main camera: ``NAME.time_offset``.

Frame k of such a camera shows u(t_k + offset) = u_k + offset (u_k - u_{k-1}) / (t_k - t_{k-1}): between two frames the
motion is taken as straight, which is exact for offsets of -1 … 0 frames of a steady motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from idic.fe import FrameState
from idic.model.records.recording import CAMERA_TIME

def is_camera_time(name: str) -> bool:
    """Whether a degree of freedom is the time offset of a camera."""
    return name.rpartition(".")[2] == CAMERA_TIME


def with_velocities(states: Iterable[FrameState], names: Sequence[str], times: np.ndarray) -> Iterator[FrameState]:
    """States with the velocity as the derivative by every time offset of a camera.

    Parameters
    ----------
    states : of consecutive frames from the reference on, with the derivatives by the other names
    names : all degrees of freedom, in the order that is wanted
    times : (n_frames,) s, of these frames
    """
    moving = [i for i, name in enumerate(names) if not is_camera_time(name)]
    late = [i for i, name in enumerate(names) if is_camera_time(name)]
    u, rise = np.zeros(0), np.zeros(0)
    for number, state in enumerate(states):
        interval = times[number] - times[number - 1] if number else np.inf
        u_before, rise_before = (u, rise) if number else (state.u, state.rise)
        du, d_rise = np.zeros((*state.u.shape, len(names))), None
        du[..., moving] = state.du
        du[..., late] = ((state.u - u_before) / interval)[..., None]
        if state.rise is not None:
            d_rise = np.zeros((len(state.rise), len(names)))
            d_rise[:, moving] = state.d_rise
            d_rise[:, late] = ((state.rise - rise_before) / interval)[:, None]
            rise = state.rise.copy()
        dchannels = np.zeros((len(state.channels), len(names)))
        dchannels[:, moving] = state.dchannels
        u = state.u.copy()
        yield replace(state, du=du, dchannels=dchannels, d_rise=d_rise)
