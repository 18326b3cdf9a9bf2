"""The error of the identified model by its own mesh.

A mesh that is coarse for its body moves otherwise than the body at the same parameters: by 0.006 px at the notches of
a strip of rubber, of which a tilted camera explained six standard deviations. At the identified values the test is
simulated once more on a finer mesh (`idic.identification.finer_models.refinement`), with the same increments or a few
(`idic.diagnose.discretisation.increments`) and without derivatives. The difference of the two motions and of the
channels,

    e(x, t) = u_finer(x, t) - u(x, t),

is added to the simulation of every model that the diagnosis compares (`idic.model.motion_error`), and found anew for
every model that a cause has joined. So the residual of every test is that of the finer mesh, to first order.

Where bricks of the thickness are counted (`idic.diagnose.discretisation.bricks`), the finer mesh is theirs: at a grip
the strain changes within half the thickness, and bricks behind a mesh that suits the sheet are too stiff there. In a
strip of rubber 3 mm thick, whose elements are as wide as that, the body between the grips moved by 0.004 px: a
compliance of the load train of nine standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_interp_spline

from idic.diagnose.discretisation.bricks import MAX_LINEAR_BRICK_NODES
from idic.diagnose.discretisation.increments import compared_increments
from idic.errors import NotConverged
from idic.fe import Model, can_halve, can_raise_order, is_linear
from idic.identification import (
    Identification, LOOSE, MAX_NODES, RAISED, Refined, can_be_thick, carried_local, projection, refined, thick,
)
from idic.model import Experiment, ForwardModel, MotionError, build_drives, build_forward

# of the change of a reaction by elements of half the size: it converges with the order p = 2 lambda = 1.5 of the
# singular strains at the corner of a grip (lambda: Williams 1952, doi:10.1115/1.4010553), and 1/(2^p - 1) is left
REACTION_LEFT = 1.0 / (2.0**1.5 - 1.0)
Difference = Callable[[np.ndarray, np.ndarray], np.ndarray]
MAX_NODES_OF_FINER_BRICKS = 20_000  # of half the thickness, not superposed: rubber takes 2 s per frame
MAX_STRIDE_SHARE = 0.125  # of the frames: how far apart those may be in which finer bricks are compared
STILL_SHARE = 0.05  # of the largest rate of a motion: a slower one is taken as rest
MAX_NODES_OF_A_PLANE = 40_000  # of the finer mesh; of a solid as many as an identification spends on its error


def can_be_found(experiment: Experiment) -> bool:
    """Whether a finer mesh of this experiment can be made and is not too large."""
    if experiment.solver is not None:
        return False
    mesh, raised = experiment.mesh, can_raise_order(experiment.mesh)
    if not (raised or can_halve(mesh)):
        return False
    plane = experiment.n_dim == 2
    growth = (3 if plane else 4) if raised else (4 if plane else 7)
    return growth * mesh.n_nodes <= (MAX_NODES_OF_A_PLANE if plane else MAX_NODES)


def motion_error(found: Identification) -> MotionError | None:
    """What the simulation of an identification lacks by its mesh; None where no finer one can be made or simulated.

    An error that its experiment has already takes no part.
    """
    experiment = replace(found.experiment, motion_error=None)
    if not can_be_found(experiment):
        return None
    finer = refined(experiment, raise_bricks=True)
    start = carried_local(build_drives(experiment), build_drives(finer.experiment), experiment, finer, found.local)
    error = lacking(found, experiment, finer.experiment, start, _on_given(finer))
    return error if error is None or _is_raised(finer) else _with_reactions_of_the_limit(error, experiment)


def brick_mesh_error(found: Identification) -> MotionError | None:
    """What the surface of bricks of a sheet's thickness lacks by their mesh; None where there are none, or those behind
    the finer sheet are too many or cannot be simulated. Of many bricks that of an elastic body is taken."""
    experiment = replace(found.experiment, motion_error=None)
    if not (can_be_found(experiment) and can_be_thick(experiment)):
        return None
    finer = refined(experiment)
    own, further = (build_forward(thick(one)) for one in (experiment, finer.experiment))
    assert isinstance(own, ForwardModel) and isinstance(further, ForwardModel)  # sheets of idic's own solver
    linear, n_nodes = is_linear(own.model), further.experiment.mesh.n_nodes
    if n_nodes > (MAX_LINEAR_BRICK_NODES if linear else MAX_NODES_OF_FINER_BRICKS):
        elastic = None if linear or n_nodes > MAX_LINEAR_BRICK_NODES else as_elastic(experiment)
        return None if elastic is None else _of_elastic_bricks(found, elastic)
    start = carried_local(build_drives(experiment), build_drives(finer.experiment), experiment, finer, found.local)
    n, m, difference = experiment.mesh.n_nodes, finer.experiment.mesh.n_nodes, _on_given(finer)
    frames = np.arange(len(own.frames)) if linear else compared_frames(own.model_at(found.parameters, found.local))
    u, channels = [], []
    try:
        for given, state in zip(*(replace(model, control=LOOSE).march_at(found.parameters, there, frames)
                                  for model, there in ((own, found.local), (further, start))), strict=True):
            u.append(difference(given.u[:n, :2], state.u[:m, :2]))
            channels.append(state.channels - given.channels)
    except NotConverged:
        return None
    between = make_interp_spline(experiment.reference + frames, np.column_stack(
        [np.reshape(u, (len(frames), -1)), np.reshape(channels, (len(frames), -1))]), k=1)
    made = np.zeros((experiment.n_frames, 2 * n + len(experiment.channels)))
    seen = experiment.reference + np.arange(len(own.frames))
    made[seen] = between(seen)
    error = MotionError(made[:, :2 * n].reshape(-1, n, 2), made[:, 2 * n:])
    return error if _is_raised(finer) else _with_reactions_of_the_limit(error, experiment)


def as_elastic(experiment: Experiment) -> Experiment | None:
    """The experiment with linear elasticity of small strains in the place of laws that have E and nu; None where one
    has other constants, or where pressures follow the surface and temperatures the body."""
    named = experiment.parameters.keys()
    if any(not {f"{one.element_set}.E", f"{one.element_set}.nu"} <= named for one in experiment.materials):
        return None
    materials = tuple(replace(one, law="elastic", kinematics="small") for one in experiment.materials)
    elastic = replace(experiment, materials=materials)
    return elastic if is_linear(build_forward(thick(elastic)).model) else None  # type: ignore[union-attr]


def _of_elastic_bricks(found: Identification, elastic: Experiment) -> MotionError | None:
    """The error of too many bricks for a body of other laws: that of an elastic one, whose motions are superposed.

    What a mesh lacks are the strains beside grips and notches, in proportion to the motion and to the readings. Of a
    body that yields about half is found so, and the recording says how much more there is (`error_beside`).
    """
    forward = build_forward(elastic)
    error = brick_mesh_error(replace(found, experiment=elastic, forward=forward, path=None))
    if error is None or not isinstance(forward, ForwardModel):
        return None
    given = np.zeros_like(error.channels)
    for state in forward.march(found.parameters, (), found.local):
        given[elastic.reference + state.frame] = state.channels
    measured = np.array([channel.values for channel in elastic.channels]).reshape(len(elastic.channels), -1).T
    size = (given**2).sum(axis=0)
    share = np.divide((given * measured).sum(axis=0), size, out=np.zeros_like(size), where=size > 0.0)
    return replace(error, channels=error.channels * np.clip(share, 0.0, 1.0))


def _is_raised(finer: Refined) -> bool:
    """Whether elements of higher order, and not smaller ones, make the mesh finer: little is left then."""
    return finer.how == RAISED


def _with_reactions_of_the_limit(error: MotionError, experiment: Experiment) -> MotionError:
    """With what still smaller elements would change in reactions. Motions converge faster: of six specimens of the
    trial the second halving changed them by a tenth of the first, and the force by 0.17 to 0.5."""
    factor = np.array([1.0 + REACTION_LEFT if channel.kind == "reaction" else 1.0 for channel in experiment.channels])
    return replace(error, channels=factor * error.channels)


def without_reactions(error: MotionError, experiment: Experiment) -> MotionError:
    """The same error of motions and other channels: reactions are at their limit, whatever else is lacking."""
    factor = np.array([0.0 if channel.kind == "reaction" else 1.0 for channel in experiment.channels])
    return replace(error, channels=factor * error.channels)


def _on_given(finer: Refined) -> Difference:
    """Difference of two motions on the given mesh; of : the motion on it, and that on the finer one"""
    onto_given = projection(finer.experiment.mesh, finer.carry)
    return lambda u, other: onto_given(other - finer.carry @ u)


def compared_frames(model: Model) -> np.ndarray:
    """Frames between which a path is nearly straight, the reference first: where a prescribed motion or a load turns,
    and others in between, at most `MAX_STRIDE_SHARE` of the frames apart."""
    histories = model.constraints.histories
    if model.loads.dead_histories is not None:
        histories = np.column_stack([histories, model.loads.dead_histories])
    rates = np.diff(histories, axis=0)
    rates[np.abs(rates) < STILL_SHARE * np.abs(rates).max(axis=0, initial=0.0)] = 0.0
    turns = 1 + np.flatnonzero((np.sign(rates[1:]) != np.sign(rates[:-1])).any(axis=1))
    ends = np.unique([0, *turns, len(histories) - 1])
    stride = max(1, int(MAX_STRIDE_SHARE * len(histories)))
    return np.unique(np.concatenate([np.linspace(a, b, 1 + -(-(b - a) // stride)).round().astype(int)
                                     for a, b in pairwise(ends)]))


def lacking(found: Identification, experiment: Experiment, other: Experiment, local: np.ndarray,
             difference: Difference) -> MotionError | None:
    """Motion and channels of another simulation of an identification, less those of its own; None where one fails.

    local : frame-local unknowns of the other; difference : of the motion of both, (n_nodes, dim) mm on the own mesh
    """
    u = np.zeros((experiment.n_frames, *experiment.mesh.nodes.shape))
    channels = np.zeros((experiment.n_frames, len(experiment.channels)))
    try:
        own, further = (build_forward(one).march(  # type: ignore[call-arg]  # an external solver has no finer mesh
            found.parameters, (), there, compared_increments(found), may_cut=True)
            for one, there in ((experiment, found.local), (other, local)))
        for given, state in zip(own, further, strict=True):
            frame = experiment.reference + given.frame
            u[frame] = difference(given.u, state.u)
            channels[frame] = state.channels - given.channels
    except NotConverged:
        return None
    return MotionError(u, channels)
