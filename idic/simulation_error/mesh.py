"""The error of a simulation by its mesh, from a simulation on a finer one.

    e(x, t) = u_finer(x, t) - u(x, t),      e_c(t) = F_c,finer(t) - F_c(t)           (docs/method.md, equation 14.8)

A mesh that is coarse for its body moves otherwise than the body at the same parameters: by 0.006 px at the notches of
a strip of rubber, of which a tilted camera explained six standard deviations. The field is the mean-square projection
of the difference onto the shape functions of the given mesh, as the sums know no others: what a quadratic element
bulges between the nodes of a linear one counts. Linear elements are computed as quadratic ones, quadratic bricks on
half their size.

Where bricks of the thickness are counted (`idic.simulation_error.bricks`), the finer mesh is theirs: at a grip the
strain changes within half the thickness, and bricks behind a mesh that suits the sheet are too stiff there. In a strip
of rubber 3 mm thick, whose elements are as wide as that, the body between the grips moved by 0.004 px: a compliance of
the load train of nine standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from idic.fe import Body
from idic.model import Experiment, ForwardModel, Model, MotionError, build_forward
from idic.simulation_error.coarsening import Coarsened, coarsened
from idic.simulation_error.comparison import (
    ErrorInFrames, ModelPoint, BetterModel, error_in_every_frame, error_in_frames,
)
from idic.simulation_error.limits import LIMITS
from idic.simulation_error.real_thickness import can_be_thick, thick
from idic.simulation_error.refinement import Refined, refined

# of the change of a reaction by elements of half the size: it converges with the order p = 2 lambda = 1.5 of the
# singular strains at the corner of a grip (lambda: Williams 1952, doi:10.1115/1.4010553), and 1/(2^p - 1) is left
REACTION_LEFT = 1.0 / (2.0**1.5 - 1.0)
MAX_STRIDE_SHARE = 0.125  # of the frames: how far apart those may be in which finer bricks are compared
STILL_SHARE = 0.05  # of the largest rate of a motion: a slower one is taken as rest


def can_be_refined(model: Model) -> bool:
    """Whether a finer mesh of this experiment can be made and is not too large."""
    if model.solver is not None or model.cracks:
        return False
    mesh, raised = model.mesh, model.mesh.can_raise_order
    if not (raised or mesh.can_halve):
        return False
    plane = model.n_dim == 2
    growth = (3 if plane else 4) if raised else (4 if plane else 7)
    return growth * mesh.n_nodes <= (LIMITS.plane if plane else LIMITS.solid)


def mesh_error(point: ModelPoint) -> MotionError | None:
    """What a simulation lacks by its mesh; None where no finer one can be made or simulated."""
    if not can_be_refined(point.experiment.model):
        return None
    finer = refined(point.experiment, raise_bricks=True)
    error = error_in_every_frame(point, _on_finer_mesh(point, finer))
    return error if error is None or finer.is_raised else _with_reactions_of_the_limit(error, point.experiment.model)


def mesh_error_in(point: ModelPoint, frames: np.ndarray, motions: Sequence[np.ndarray]) -> ErrorInFrames | None:
    """The same in some frames; of a solid too large for a finer mesh from its change by a coarser one.

    frames : the reference and later ones; motions : (n_nodes, dim) mm of each of them: first guesses
    """
    if can_be_refined(point.experiment.model):
        finer = refined(point.experiment, raise_bricks=True)
        return error_in_frames(point, _on_finer_mesh(point, finer), frames, motions)  # carried guesses: they fold
    coarser = coarsened(point.experiment)
    return None if coarser is None else _change_by_coarser_mesh(point, coarser, frames, motions)


def brick_mesh_error(point: ModelPoint) -> MotionError | None:
    """What the surface of bricks of a sheet's thickness lacks by their mesh; None where there are none, or those behind
    the finer sheet are too many or cannot be simulated. Of many bricks that of an elastic body is taken."""
    experiment = point.experiment
    if not (can_be_refined(experiment.model) and can_be_thick(experiment)):
        return None
    finer = refined(experiment)
    bricks, finer_bricks = thick(experiment), thick(finer.experiment)
    forward = build_forward(bricks)
    linear, n_nodes = forward.body.is_linear, finer_bricks.model.mesh.n_nodes
    if n_nodes > (LIMITS.superposed if linear else LIMITS.solid_in_few_frames):
        elastic = None if linear or n_nodes > LIMITS.superposed else as_elastic(experiment)
        return None if elastic is None else _of_elastic_bricks(point, elastic)
    n, m, difference = experiment.model.mesh.n_nodes, finer.experiment.model.mesh.n_nodes, finer.difference()
    n_simulated = experiment.model.n_frames - experiment.model.reference
    frames = np.arange(n_simulated) if linear else compared_frames(forward.body_at(point.parameters, point.local))
    error = error_in_frames(
        replace(point, experiment=bricks),
        BetterModel(finer_bricks, finer.carried_local(point.local),
                    lambda state, better: difference(state.u[:n, :2], better.u[:m, :2])),
        experiment.model.reference + frames)
    if error is None:
        return None
    of_mesh = error.in_every_frame(experiment.model.n_frames)
    return of_mesh if finer.is_raised else _with_reactions_of_the_limit(of_mesh, experiment.model)


def as_elastic(experiment: Experiment) -> Experiment | None:
    """The experiment with linear elasticity of small strains in the place of laws that have E and nu; None where one
    has other constants, or where pressures follow the surface and temperatures the body."""
    model = experiment.model
    named = model.parameters.keys()
    if any(f"{material.element_set}.{constant}" not in named
           for material in model.materials for constant in ("E", "nu")):
        return None
    materials = tuple(replace(material, law="elastic", kinematics="small") for material in model.materials)
    elastic = replace(experiment, model=replace(model, materials=materials))
    return elastic if build_forward(thick(elastic)).body.is_linear else None


def compared_frames(model: Body) -> np.ndarray:
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


def _on_finer_mesh(point: ModelPoint, finer: Refined) -> BetterModel:
    difference = finer.difference()
    return BetterModel(finer.experiment, finer.carried_local(point.local),
                       lambda state, better: difference(state.u, better.u))


def _change_by_coarser_mesh(point: ModelPoint, coarser: Coarsened, frames: np.ndarray,
                            motions: Sequence[np.ndarray]) -> ErrorInFrames | None:
    carry = coarser.carry()
    on_coarser = BetterModel(coarser.experiment, coarser.carried_local(point.local),
                             lambda state, coarse: carry @ coarse.u - state.u)
    change = error_in_frames(point, on_coarser, frames, motions)
    if change is None:
        return None
    channels = _read_at_given_nodes(change, point.experiment)
    return replace(change, u=-coarser.error_share * change.u, channels=-coarser.error_share * channels)


def _read_at_given_nodes(change: ErrorInFrames, experiment: Experiment) -> np.ndarray:
    """Channels of a change, gauges of motion at the given nodes: the mean of fewer is that of another place
    # (k, n_channels)"""
    forward = build_forward(experiment)
    if not isinstance(forward, ForwardModel) or forward.readings is None:
        return change.channels
    moved = change.u.reshape(len(change.frames), -1) @ forward.readings.motion.T
    return np.where([channel.kind == "displacement" for channel in experiment.model.channels], moved, change.channels)


def _of_elastic_bricks(point: ModelPoint, elastic: Experiment) -> MotionError | None:
    """The error of too many bricks for a body of other laws: that of an elastic one, whose motions are superposed.

    What a mesh lacks are the strains beside grips and notches, in proportion to the motion and to the readings. Of a
    body that yields about half is found so, and the recording says how much more there is.
    """
    error, forward = brick_mesh_error(replace(point, experiment=elastic)), build_forward(elastic)
    if error is None or not isinstance(forward, ForwardModel):
        return None
    simulated = np.zeros_like(error.channels)
    for state in forward.march(point.parameters, (), point.local):
        simulated[elastic.model.reference + state.frame] = state.channels
    measured = np.array([channel.values for channel in elastic.model.channels]).reshape(len(elastic.model.channels),
                                                                                        -1).T
    size = (simulated**2).sum(axis=0)
    share = np.divide((simulated * measured).sum(axis=0), size, out=np.zeros_like(size), where=size > 0.0)
    return replace(error, channels=error.channels * np.clip(share, 0.0, 1.0))


def _with_reactions_of_the_limit(error: MotionError, model: Model) -> MotionError:
    """With what still smaller elements would change in reactions. Motions converge faster: of six specimens of the
    trial the second halving changed them by a tenth of the first, and the force by 0.17 to 0.5."""
    factor = np.array([1.0 + REACTION_LEFT if channel.kind == "reaction" else 1.0 for channel in model.channels])
    return replace(error, channels=factor * error.channels)
