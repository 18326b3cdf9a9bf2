"""What another law, load or motion would change at first order, seen from a simulation that is already there.

The other model is driven along the displacements of the first one; the forces that it lacks for equilibrium, and the
prescribed motion that it has otherwise, act on the tangent of the first one:

    K du = -(R_other(u) - R(u) + K_fp du_p),      dF = R_other(u) - R(u) + K du   at the held dofs

One Newton step for any change of the model, at the cost of one evaluation and one back-substitution per frame. Each
model keeps its own history along the given path; the change of the path itself enters at the present frame only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.errors import NotConverged
from idic.fe import assembly
from idic.fe.assembly import System, discretise
from idic.fe.boundary import drives_at
from idic.fe.equilibrium import factorise_tangent
from idic.fe.model import Model


@dataclass(frozen=True)
class Alternative:
    """Another model on the same mesh with the same held dofs; params as for `march`."""

    model: Model
    params: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Response:
    """Change of the displacement (n_nodes, d) mm and of the channels (n_channels,) of one frame."""

    du: np.ndarray
    dchannels: np.ndarray


def first_responses(base: Alternative, times: np.ndarray, frames: Sequence[int], u: np.ndarray,
                    others: Sequence[Alternative]) -> Iterator[list[Response]]:
    """The response of every other model at each of some frames.

    Parameters
    ----------
    times : (n_frames,) s, of the models' histories, the reference first
    frames : increasing frame numbers, the reference (0) not among them; the path is straight in between
    u : (n, n_nodes, d) mm, equilibrium of `base` at these frames

    Raises
    ------
    NotConverged
        If a law finds no answer at a point along the path.
    """
    known = [_Path(discretise(model.model), model.params) for model in (base, *others)]
    for before, frame, moved in zip((0, *frames), frames, u, strict=False):
        first = known[0].at(times, before, frame, moved, stiffness=True)
        factor = factorise_tangent(known[0].system, first)
        yield [_response(known[0], first, factor, path, path.at(times, before, frame, moved, stiffness=False))
               for path in known[1:]]


class _Path:
    """A model led along given displacements; its points keep their history."""

    def __init__(self, system: System, params: Mapping[str, np.ndarray]):
        self.system, self.params, self.states = system, params, system.rest()
        self.drives = None

    def at(self, times: np.ndarray, before: int, frame: int, u: np.ndarray, stiffness: bool) -> assembly.Evaluation:
        self.drives = drives_at(self.system.model, times, times[frame])
        found = assembly.evaluate(self.system, self.params, u, self.states, times[frame] - times[before], self.drives,
                                  guesses=self.states if before else None, stiffness=stiffness)
        if found.trouble:
            raise NotConverged(f"{found.trouble}, frame {frame}")
        self.states = tuple(group.state for group in found.groups)
        return found


def _response(base: _Path, here: assembly.Evaluation, factor, other: _Path, there: assembly.Evaluation) -> Response:
    system = base.system
    held, free = np.asarray(system.model.constraints.dofs), system.pattern.dofs
    forces = (there.residual - here.residual).ravel()
    du = np.zeros(forces.size)
    du[held] = other.drives.prescribed - base.drives.prescribed
    if du.any():
        forces = forces + assembly.stiffness_times(system, here, du[:, None])[:, 0]
    moved = np.zeros_like(du)
    moved[free] = factor.solve(-forces[free])
    forces = forces + assembly.stiffness_times(system, here, moved[:, None])[:, 0]
    channels = [r.factor * forces[np.asarray(r.dofs, dtype=np.int64)].sum() for r in system.model.channels]
    return Response((du + moved).reshape(here.u.shape), np.array(channels))
