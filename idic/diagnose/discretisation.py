"""The error of the identified model by its own mesh, known before any cause is blamed for it.

A mesh that is coarse for its body moves otherwise than the body at the same parameters: by 0.006 px at the notches of
a strip of rubber, of which a tilted camera explained six standard deviations. At the identified values the test is
simulated once more on a finer mesh (`idic.identify.systematic.refinement`), with the same increments and without
derivatives. The difference of the two motions and of the channels,

    e(x, t) = u_finer(x, t) - u(x, t),

is added to the simulation of every model that the diagnosis compares (`idic.model.motion_error`), and found anew for
every model that a cause has joined. So the residual of every test is that of the finer mesh, to first order.

A thick sheet is not in plane stress, either: a bent beam of bricks, 3 mm wide and 2.8 mm thick, moves by 0.026 px
otherwise. Where a sound model would leave nothing, the test is simulated on bricks of the stated thickness
(`idic.identify.systematic.real_thickness`). Where their difference, which has no unknown, explains most of what there
is, it is added as well, and a caution says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.channel_left import channels_left, excess
from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.refit_job import ExperimentSource
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.heldout import fit
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.score import null_model, score
from idic.errors import NotConverged
from idic.fe.mesh.halve import can_halve
from idic.fe.mesh.refine import can_raise_order
from idic.identify.discrepancy.mesh_error import MAX_NODES, projection
from idic.identify.in_memory import Identification
from idic.identify.step.state import AcceptedPoint
from idic.identify.systematic.real_thickness import can_be_thick, thick
from idic.identify.systematic.refinement import carried_local, refined
from idic.model.drives import build_drives
from idic.model.experiment import Experiment
from idic.model.forward import build_forward
from idic.model.motion_error import MotionError

MAX_NODES_OF_A_PLANE = 40_000  # of the finer mesh; of a solid as many as an identification spends on its error
MAX_BRICK_NODES = 6_000  # of half the thickness
MIN_DROP = 25.0  # of chi-square by bricks: five standard deviations
MIN_DROP_SHARE = 0.5  # of what free motions and channels explain
MAX_TURNS, TURNED_STD = 12, 0.1  # of error and parameters; standard deviations of the last step
MIN_ERROR_CHI2 = 1.0  # on the whole recording, beside the parameters: one standard deviation of any cause
MAX_RISE = 25.0  # of the chi-square of the recording by an error: five standard deviations
LIKELY_SHARE, SHARE_STD = 0.5, 0.5  # of the difference of bricks, where the recording does not tell: none or all of it
MIN_OPEN_STD = 1.0  # of a parameter by the difference of bricks that may be missing: more is said
MIN_SHIFT_STD = 0.5  # of a parameter by the change of a known error: what the parameters take up is no chi-square


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
    onto_given = projection(finer.experiment.mesh, finer.carry)
    return _lacking(found, experiment, finer.experiment, start, lambda u, other: onto_given(other - finer.carry @ u))


def thickness_error(found: Identification) -> MotionError | None:
    """What a simulation in plane stress lacks of the surface of bricks; None where none can be made or simulated."""
    experiment = replace(found.experiment, motion_error=None)
    if not can_be_thick(experiment):
        return None
    bricks = thick(experiment)
    if bricks.mesh.n_nodes > MAX_BRICK_NODES:
        return None
    n = experiment.mesh.n_nodes
    return _lacking(found, experiment, bricks, found.local, lambda u, other: other[:n, :2] - u)


@dataclass(frozen=True)
class OpenThickness:
    """What plane stress may have done to the parameters, where the recording does not tell it from bricks.

    share, share_std : of the difference of bricks that the body has, by the recording, between none and all of it
    moves : by how much each free parameter would move with all of it, internal units
    """

    share: float
    share_std: float
    moves: Mapping[str, float]


def open_thickness(found: Identification, residual: ResidualEvidence) -> OpenThickness | None:
    """What bricks would change in the parameters of a model in plane stress; None where they cannot be made, are
    counted already, or would move no parameter by a standard deviation.

    residual : of the model. The share of the difference is an unknown of its own, none or all of it without the
    recording.
    """
    known = residual.context.experiment.motion_error
    error = None if known is not None and known.thickness is not None else thickness_error(found)
    if error is None:
        return None
    null = null_model(residual.evidence, residual.null)
    seen = score(residual.evidence, null, error_column(residual, error))
    precision = float(seen.own[0]) + 1.0 / SHARE_STD**2
    share = float(np.clip((seen.U[0] + LIKELY_SHARE / SHARE_STD**2) / precision, 0.0, 1.0))
    std, moves = precision**-0.5, seen.moves[:, 0]
    noise = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    if float((np.abs(moves) * np.hypot(share, std) / noise).max(initial=0.0)) < MIN_OPEN_STD:
        return None
    return OpenThickness(share, std, dict(zip(null.names, moves.tolist(), strict=True)))


def known_error(found: Identification, old: MotionError | None) -> MotionError | None:
    """The error of the mesh of a changed model, with that of plane stress where `old` counts it."""
    error = motion_error(found)
    if old is None or old.thickness is None:
        return error
    nothing = MotionError(np.zeros_like(old.u), np.zeros_like(old.channels))
    return (error or nothing).with_thickness(thickness_error(found) or old.thickness)


def _lacking(found: Identification, experiment: Experiment, other: Experiment, local: np.ndarray,
             difference: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> MotionError | None:
    """Motion and channels of another simulation of an identification, less those of its own; None where one fails.

    local : frame-local unknowns of the other; difference : of the motion of both, (n_nodes, dim) mm on the own mesh
    """
    u = np.zeros((experiment.n_frames, *experiment.mesh.nodes.shape))
    channels = np.zeros((experiment.n_frames, len(experiment.channels)))
    try:
        own, further = (build_forward(one).march(  # type: ignore[call-arg]  # an external solver has no finer mesh
            found.parameters, (), there, found.steps, may_cut=True)
            for one, there in ((experiment, found.local), (other, local)))
        for given, state in zip(own, further, strict=True):
            frame = experiment.reference + given.frame
            u[frame] = difference(given.u, state.u)
            channels[frame] = state.channels - given.channels
    except NotConverged:
        return None
    return MotionError(u, channels)


def counts(residual: ResidualEvidence, error: MotionError) -> bool:
    """Whether an error changes chi-square by more than one beside the identified parameters, which is the most that it
    can feign of any cause, and does not raise that of the recording.

    A virtual test on the mesh of its own model has no such error, and its chi-square rises by five standard deviations
    or more. Where a cause is still unknown, the sign is one of chance; it is asked again for every model that a cause
    has joined.
    """
    chi2, rise, _ = _weighed(residual, error)
    return chi2 >= MIN_ERROR_CHI2 and rise <= MAX_RISE


def _weighed(residual: ResidualEvidence, error: MotionError) -> tuple[float, float, float]:
    """Chi-square of an error beside the parameters, by how much it raises that of the recording, and its largest shift
    of a parameter in standard deviations."""
    null = null_model(residual.evidence, residual.null)
    found = score(residual.evidence, null, error_column(residual, error))
    shift = np.abs(found.moves[:, 0]) / np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    return float(found.own[0]), float(found.own[0] - 2.0 * found.U[0]), float(shift.max(initial=0.0))


def error_column(residual: ResidualEvidence, error: MotionError) -> Columns:
    """An error as images and channels record it."""
    frames = residual.evidence.frames
    fields = np.array([in_images(residual, t, error.u[frame][..., None]) for t, frame in enumerate(frames)])
    return Columns(("mesh",), fields, error.channels[frames][..., None])


def with_error(source: ExperimentSource,
               found: Identification) -> tuple[ExperimentSource, Identification, ResidualEvidence]:
    """The source and the identification with the error of the mesh added, where it matters, as they are elsewhere; and
    the residual of that identification."""
    error, residual = motion_error(found), residual_evidence(found, light=False)
    if error is None or not counts(residual, error):
        return source, found, residual
    source, found = _knowing(source, found, error)
    return source, found, residual_evidence(found, light=False)


def with_thickness(source: ExperimentSource, found: Identification, residual: ResidualEvidence,
                   grid: Grid) -> tuple[ExperimentSource, Identification]:
    """The source and the identification with the error of plane stress added, where the recording asks for it; as they
    are elsewhere.

    The error grows with Poisson's ratio, which has taken a part of it (0.18 in the place of 0.35 in a bent beam): error
    and parameters are found in turns. No unknown is added, so that the drop of chi-square decides.

    residual : of the identification, whose mismatch is significant
    """
    left = fit(residual, grid)
    settled = _in_turns(found, found.experiment.motion_error, grid, left.chi2)
    if settled is None:
        return source, found
    error, there = settled
    after = fit(residual_evidence(there, light=False), grid)
    if left.chi2 - after.chi2 < least_drop(residual, grid):
        return source, found
    return source.with_motion_error(error), there


def _in_turns(found: Identification, mesh: MotionError | None, grid: Grid,
              bar: float = np.inf) -> tuple[MotionError, Identification] | None:
    """The error of plane stress on top of that of the mesh, and the parameters that belong to it; None where bricks
    cannot be simulated, or where chi-square does not fall below the bar."""
    there = found
    for turn in range(MAX_TURNS):
        thickness = thickness_error(there)
        if thickness is None:
            return None
        nothing = MotionError(np.zeros_like(thickness.u), np.zeros_like(thickness.channels))
        error = (mesh or nothing).with_thickness(thickness)
        there = _at(found, replace(found.experiment, motion_error=error), there.parameters.as_values())
        here = residual_evidence(there, light=False)
        step, std, gain = _remaining(here)
        if turn and fit(here, grid).chi2 - gain >= bar:
            return None
        there = _moved(there, step)
        if np.abs(step / std).max(initial=0.0) < TURNED_STD:
            break
    return error, there


def _knowing(source: ExperimentSource, found: Identification,
             error: MotionError) -> tuple[ExperimentSource, Identification]:
    """With an error; the parameters follow by one step, as they have taken a part of it."""
    there = _at(found, replace(found.experiment, motion_error=error), found.parameters.as_values())
    return source.with_motion_error(error), _moved(there, _remaining(residual_evidence(there, light=False))[0])


def _remaining(residual: ResidualEvidence) -> tuple[np.ndarray, np.ndarray, float]:
    """What the free parameters would still move, their standard deviations, and the chi-square that it brings  # (n,),
    (n,)"""
    null = null_model(residual.evidence, residual.null)
    return (null.remaining, np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300)),
            float(null.b @ null.remaining))


def _moved(found: Identification, step: np.ndarray) -> Identification:
    """At other values of the free parameters, within their bounds; step : (n,), in the order of `_remaining`"""
    values = found.parameters.as_values()
    for name, change in zip(found.parameters.free, step.tolist(), strict=True):
        low, high = found.parameters[name].bounds
        values[name] = float(np.clip(values[name] + change, low, high))
    return _at(found, found.experiment, values)


def change_matters(residual: ResidualEvidence, old: MotionError | None, new: MotionError) -> bool:
    """Whether the present error of a model differs from the added one by more than noise, and the recording does not
    contradict the difference; residual : of the model.

    A renewed error also matters by what it does to the parameters: that of plane stress grows with Poisson's ratio,
    which a cause has moved, and its change is nearly a factor of the stiffness.
    """
    if old is None:
        return counts(residual, new)
    chi2, rise, shift = _weighed(residual, MotionError(new.u - old.u, new.channels - old.channels))
    return (chi2 >= MIN_ERROR_CHI2 or shift >= MIN_SHIFT_STD) and rise <= MAX_RISE


def renewed_error(found: Identification, residual: ResidualEvidence, grid: Grid) -> MotionError | None:
    """The error of a model at its present values, where it differs from the known one (`change_matters`)."""
    old = residual.context.experiment.motion_error
    if old is None:
        return None
    new = motion_error(found)
    if old.thickness is not None:
        settled = _in_turns(found, new, grid)
        new = None if settled is None else settled[0]
    return new if new is not None and change_matters(residual, old, new) else None


def with_bricks(found: Identification, residual: ResidualEvidence, grid: Grid) -> MotionError | None:
    """The known error with that of plane stress, where a model with a cause leaves what bricks explain: as
    `with_thickness`, to first order; None elsewhere.

    Before the cause was known it hid the difference: finite strains and bricks both stiffen a bent beam.
    """
    known = residual.context.experiment.motion_error
    error = None if known is not None and known.thickness is not None else thickness_error(found)
    if error is None:
        return None
    seen = score(residual.evidence, null_model(residual.evidence, residual.null), error_column(residual, error))
    if 2.0 * seen.U[0] - seen.own[0] < least_drop(residual, grid):
        return None
    settled = _in_turns(found, known, grid)
    return None if settled is None else settled[0]


def least_drop(residual: ResidualEvidence, grid: Grid) -> float:
    """Drop of chi-square from which on bricks are counted: significant, and most of what there is."""
    readings = sum(max(excess(one.before), 0.0) for one in channels_left(residual, None))
    return max(MIN_DROP, MIN_DROP_SHARE * (fit(residual, grid).room + readings))


def _at(found: Identification, experiment: Experiment, values: dict[str, float]) -> Identification:
    """The record of an identification with another experiment and other values; its simulation is not kept."""
    accepted = found.state.accepted
    state = replace(found.state, accepted=AcceptedPoint(values) if accepted is None else replace(accepted,
                                                                                               values=values))
    return replace(found, experiment=experiment, forward=build_forward(experiment), state=state, path=None)
