"""The simulation of an accepted point, kept in memory: the warm start of the next one, which also spares a repetition.

`idic.run.prepared.warm_start` does the same with the files of a RUN. Near enough to a simulated point
(`Path.second_order_std`) the motions of another one are those of first order, and no simulation is needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import FrameResponse

MAX_KEPT_BYTES = 100e6  # of fields: of the accepted point and of all parallel trials
# of the parameters by what is beyond first order, in standard deviations: at the end of a search, where chi-square then
# changes by 6e-4, and on the way there, which need not be that exact
MAX_SECOND_ORDER_STD, MAX_SECOND_ORDER_STD_ON_THE_WAY = 0.025, 0.5


@dataclass(frozen=True, eq=False)
class Path:
    """A simulated point.

    values : of all parameters, internal units; local : (n_frames, m) mm; moving : the parameters of `du`; frames :
    every simulated frame, the reference first; steps : its increments (s); origin : the simulation that this point is
    foreseen from to first order, None where it is simulated itself
    """

    values: Mapping[str, float]
    local: np.ndarray
    moving: tuple[str, ...]
    frames: tuple[FrameResponse, ...]
    steps: np.ndarray
    origin: Path | None = None

    def is_at(self, values: Mapping[str, float], local: np.ndarray, steps: Sequence[float] | None) -> bool:
        """Whether a simulation of these values with these increments would be this one."""
        return (dict(values) == dict(self.values) and np.array_equal(local, self.local)
                and steps is not None and np.array_equal(steps, self.steps))

    def predicted_at(self, values: Mapping[str, float], local: np.ndarray) -> Iterator[np.ndarray]:
        """First-order prediction of the displacements of every frame at other values  # (n_nodes, dim) mm"""
        change = self._change(values)
        for at in self.frames:
            yield at.u + at.du @ change + at.local_du @ (local[at.frame] - self.local[at.frame])

    def second_order_std(self, values: Mapping[str, float], names: Sequence[str], information: np.ndarray) -> float:
        """Standard deviations of the parameters by what first order lacks at other values: a step of k of them, by a
        share r of its parameters, lacks about r k / 2.

        names, information : (n, n) the inverse covariance of the free parameters, internal units
        """
        simulated = (self.origin or self).values
        change = np.array([values[name] - simulated[name] for name in names])
        largest = max((abs(values[name] - simulated[name]) / max(abs(simulated[name]), 1e-300)
                       for name in self.moving), default=0.0)
        return 0.5 * largest * float(np.sqrt(max(change @ information @ change, 0.0)))

    def foreseen_at(self, values: Mapping[str, float], local: np.ndarray) -> Path:
        """The point at other values to first order, channels included, with the derivatives of the simulated one."""
        origin = self.origin or self
        change = origin._change(values)
        frames = []
        for at, u in zip(origin.frames, origin.predicted_at(values, local), strict=True):
            local_change = local[at.frame] - origin.local[at.frame]
            frames.append(replace(at, u=u, channels=at.channels + at.dchannels @ change
                                  + at.local_dchannels @ local_change))
        return Path(dict(values), local.copy(), self.moving, tuple(frames), self.steps, origin)

    def _change(self, values: Mapping[str, float]) -> np.ndarray:
        """Of the parameters of `du`, from the values of this point  # (n_moving,)"""
        return np.array([values[name] - self.values[name] for name in self.moving])


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
