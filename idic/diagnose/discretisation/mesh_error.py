"""The error of the identified model by its own mesh.

A mesh that is coarse for its body moves otherwise than the body at the same parameters: by 0.006 px at the notches of
a strip of rubber, of which a tilted camera explained six standard deviations. At the identified values the test is
simulated once more on a finer mesh (`idic.identify.systematic.refinement`), with the same increments or a few
(`idic.diagnose.discretisation.increments`) and without derivatives. The difference of the two motions and of the
channels,

    e(x, t) = u_finer(x, t) - u(x, t),

is added to the simulation of every model that the diagnosis compares (`idic.model.motion_error`), and found anew for
every model that a cause has joined. So the residual of every test is that of the finer mesh, to first order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from idic.diagnose.discretisation.increments import compared_increments
from idic.errors import NotConverged
from idic.fe.mesh.halve import can_halve
from idic.fe.mesh.refine import can_raise_order
from idic.identify.discrepancy.mesh_error import MAX_NODES, projection
from idic.identify.in_memory import Identification
from idic.identify.systematic.refinement import carried_local, refined
from idic.model.drives import build_drives
from idic.model.experiment import Experiment
from idic.model.forward import build_forward
from idic.model.motion_error import MotionError

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
    onto_given = projection(finer.experiment.mesh, finer.carry)
    return lacking(found, experiment, finer.experiment, start, lambda u, other: onto_given(other - finer.carry @ u))


def lacking(found: Identification, experiment: Experiment, other: Experiment, local: np.ndarray,
             difference: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> MotionError | None:
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
