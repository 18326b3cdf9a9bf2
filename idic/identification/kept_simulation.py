"""The simulation of an accepted point, kept in memory: the warm start of the next one, which also spares a repetition.

`idic.run.prepared.warm_start` does the same with the files of a RUN.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import FrameResponse
from idic.fe import FrameState

MAX_KEPT_BYTES = 100e6  # of fields: of the accepted point and of all parallel trials


@dataclass(frozen=True, eq=False)
class Path:
    """A simulated point.

    values : of all parameters, internal units; local : (n_frames, m) mm; moving : the parameters of `du`; frames :
    every simulated frame, the reference first; steps : its increments (s)
    """

    values: Mapping[str, float]
    local: np.ndarray
    moving: tuple[str, ...]
    frames: tuple[FrameResponse, ...]
    steps: np.ndarray

    def is_at(self, values: Mapping[str, float], local: np.ndarray, steps: Sequence[float] | None) -> bool:
        """Whether a simulation of these values with these increments would be this one."""
        return (dict(values) == dict(self.values) and np.array_equal(local, self.local)
                and steps is not None and np.array_equal(steps, self.steps))

    def predicted_at(self, values: Mapping[str, float], local: np.ndarray) -> Iterator[np.ndarray]:
        """First-order prediction of the displacements of every frame at other values  # (n_nodes, dim) mm"""
        change = np.array([values[name] - self.values[name] for name in self.moving])
        for at in self.frames:
            yield at.u + at.du @ change + at.local_du @ (local[at.frame] - self.local[at.frame])


class PathKeeper:
    """Collects the frames of a simulation while they are small enough.

    steps : increments (s) of the frames so far

    Parameters
    ----------
    paths : kept at a time, all together in `MAX_KEPT_BYTES`
    """

    def __init__(self, paths: int):
        self.frames: list[FrameResponse] | None = []
        self.steps: Sequence[float] | np.ndarray = ()
        self._left = MAX_KEPT_BYTES / paths

    def passed_on(self, simulation: Iterable[tuple[FrameResponse, Sequence[float] | np.ndarray]]
                  ) -> Iterator[FrameResponse]:
        """The frames of a simulation, which come with the increments so far."""
        for response, self.steps in simulation:
            self.add(response)
            yield response

    def add(self, response: FrameResponse) -> None:
        """Another frame, in order."""
        if self.frames is None:
            return
        self._left -= response.u.nbytes + response.du.nbytes + response.local_du.nbytes
        if self._left < 0.0:
            self.frames = None
        else:
            self.frames.append(response)

    def path(self, values: Mapping[str, float], local: np.ndarray, moving: Sequence[str]) -> Path | None:
        """The whole simulation, None where it is too large."""
        if self.frames is None:
            return None
        return Path(dict(values), local.copy(), tuple(moving), tuple(self.frames), np.array(self.steps, float))


def response_of(state: FrameState, reference: int) -> FrameResponse:
    """The response that the correlation needs of a simulated frame; reference : number of the first simulated frame."""
    return FrameResponse(state.frame + reference, state.seen_u.copy(), state.channels.copy(), state.seen_du.copy(),
                         state.dchannels.copy(), state.seen_local_du.copy(), state.local_dchannels.copy())
