"""The error of the identified model by its own mesh, known before any cause is blamed for it.

A mesh that is coarse for its body moves otherwise than the body at the same parameters: by 0.006 px at the notches of
a strip of rubber, of which a tilted camera explained six standard deviations. At the identified values the test is
simulated once more on a finer mesh (`idic.identify.systematic.refinement`), with the same increments and without
derivatives. The difference of the two motions and of the channels,

    e(x, t) = u_finer(x, t) - u(x, t),

is added to the simulation of every model that the diagnosis compares (`idic.model.motion_error`), and found anew for
every model that a cause has joined. So the residual of every test is that of the finer mesh, to first order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.refit_job import ExperimentSource
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.screen.score import null_model, score
from idic.errors import NotConverged
from idic.fe.mesh.halve import can_halve
from idic.fe.mesh.refine import can_raise_order
from idic.identify.discrepancy.mesh_error import MAX_NODES, projection
from idic.identify.in_memory import Identification
from idic.identify.step.state import AcceptedPoint
from idic.identify.systematic.refinement import carried_local, refined
from idic.model.drives import build_drives
from idic.model.experiment import Experiment
from idic.model.forward import build_forward
from idic.model.motion_error import MotionError

MAX_NODES_OF_A_PLANE = 40_000  # of the finer mesh; of a solid as many as an identification spends on its error
MIN_ERROR_CHI2 = 1.0  # on the whole recording, beside the parameters: one standard deviation of any cause


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
    u = np.zeros((experiment.n_frames, *experiment.mesh.nodes.shape))
    channels = np.zeros((experiment.n_frames, len(experiment.channels)))
    try:
        coarse, fine = (build_forward(one).march(  # type: ignore[call-arg]  # an external solver has no finer mesh
            found.parameters, (), local, found.steps, may_cut=True)
            for one, local in ((experiment, found.local), (finer.experiment, start)))
        for given, other in zip(coarse, fine, strict=True):
            frame = experiment.reference + given.frame
            u[frame] = onto_given(other.u - finer.carry @ given.u)
            channels[frame] = other.channels - given.channels
    except NotConverged:
        return None
    return MotionError(u, channels)


def error_chi2(residual: ResidualEvidence, error: MotionError) -> float:
    """Chi-square of an error beside the identified parameters: the most that it can feign of any cause."""
    column = error_column(residual, error)
    return float(score(residual.evidence, null_model(residual.evidence, residual.null), column).own[0])


def error_column(residual: ResidualEvidence, error: MotionError) -> Columns:
    """An error as images and channels record it."""
    frames = residual.evidence.frames
    fields = np.array([in_images(residual, t, error.u[frame][..., None]) for t, frame in enumerate(frames)])
    return Columns(("mesh",), fields, error.channels[frames][..., None])


def with_error(source: ExperimentSource, found: Identification) -> tuple[ExperimentSource, Identification]:
    """The source and the identification with the error of the mesh added, where it matters; as they are elsewhere.

    The parameters of the identification follow by one step, as they have taken a part of the error.
    """
    error = motion_error(found)
    if error is None or error_chi2(residual_evidence(found, light=False), error) < MIN_ERROR_CHI2:
        return source, found
    there = _at(found, replace(found.experiment, motion_error=error), found.parameters.as_values())
    residual = residual_evidence(there, light=False)
    step = null_model(residual.evidence, residual.null).remaining
    values = found.parameters.as_values()
    for name, change in zip(residual.null.names, step.tolist(), strict=True):
        low, high = found.parameters[name].bounds
        values[name] = float(np.clip(values[name] + change, low, high))
    return source.with_motion_error(error), _at(found, there.experiment, values)


def change_matters(residual: ResidualEvidence, old: MotionError | None, new: MotionError) -> bool:
    """Whether the error of a model differs from the one that was added so far; residual : of that model."""
    change = new if old is None else MotionError(new.u - old.u, new.channels - old.channels)
    return error_chi2(residual, change) >= MIN_ERROR_CHI2


def _at(found: Identification, experiment: Experiment, values: dict[str, float]) -> Identification:
    """The record of an identification with another experiment and other values; its simulation is not kept."""
    accepted = found.state.accepted
    state = replace(found.state, accepted=AcceptedPoint(values) if accepted is None else replace(accepted,
                                                                                               values=values))
    return replace(found, experiment=experiment, forward=build_forward(experiment), state=state, path=None)
