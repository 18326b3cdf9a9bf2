"""The error of plane stress: what bricks of the specimen's thickness move otherwise than the sheet.

A thick sheet is not in plane stress: a bent beam of bricks, 3 mm wide and 2.8 mm thick, moves by 0.026 px otherwise.
The test is simulated on bricks of the stated thickness (`idic.identification.finer_models.real_thickness`) at the
parameters of a model, with its increments or a few (`idic.diagnose.discretisation.increments`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import FrameResponse
from idic.diagnose.discretisation.increments import compared_increments
from idic.errors import NotConverged
from idic.fe import is_linear
from idic.identification import Identification, LOOSE, can_be_thick, extruded, response_of, thick
from idic.model import ForwardModel, MotionError, build_forward

MAX_BRICK_NODES = 12_000  # of half the thickness: 40 CPU s under a load that yields, 36 frames of 9000
MAX_LINEAR_BRICK_NODES = 40_000  # of a body whose motions are superposed: 9000 take a second


@dataclass(frozen=True, eq=False)
class Bricks:
    """Bricks at the parameters of a sheet.

    error : of the sheet; path : their motion in every simulated frame, (n_nodes, 3) mm, () where it is of no use to
    the next one; changes : derivatives of the error by parameters of the laws, None where none were asked for
    """

    error: MotionError
    path: tuple[np.ndarray, ...] = ()
    changes: ErrorChanges | None = None


@dataclass(frozen=True, eq=False)
class ErrorChanges:
    """Derivatives of an error by parameters: u (n_frames, n_nodes, 2, n) mm, channels (n_frames, n_channels, n)."""

    names: tuple[str, ...]
    u: np.ndarray
    channels: np.ndarray


def thickness_error(found: Identification) -> MotionError | None:
    """What a simulation in plane stress lacks of the surface of bricks; None where none can be made or simulated."""
    bricks = bricks_of(found, simulated_sheet(found))
    return None if bricks is None else bricks.error


def law_parameters(found: Identification) -> tuple[str, ...]:
    """The free parameters that the error of plane stress may follow: those of the laws."""
    sets = {material.element_set for material in found.experiment.materials}
    return tuple(name for name in found.parameters.free
                 if name.partition(".")[0] in sets and found.forward.moves(name))  # type: ignore[union-attr]


def bricks_of(found: Identification, sheet: Iterable[FrameResponse], near: Bricks | None = None,
              of_sheet: Sequence[str] | None = None) -> Bricks | None:
    """The bricks of an identification; None where none can be made or simulated.

    sheet : its simulated frames without a known error, the reference first; near : bricks at similar parameters;
    of_sheet : parameters by which the sheet is differentiated, where the bricks are to be by those of the laws
    """
    model = brick_model(found)
    if model is None:
        return None
    experiment, n, kept = found.experiment, found.experiment.mesh.n_nodes, []
    u = np.zeros((experiment.n_frames, *experiment.mesh.nodes.shape))
    channels = np.zeros((experiment.n_frames, len(experiment.channels)))
    linear, names = is_linear(model.model), () if of_sheet is None else law_parameters(found)
    own_columns = [(of_sheet or ()).index(name) for name in names]
    changes = None if of_sheet is None else ErrorChanges(names, np.zeros((*u.shape, len(names))),
                                                         np.zeros((*channels.shape, len(names))))
    steps = compared_increments(found)
    if steps is not found.steps:
        sheet, own_columns = simulated_sheet(replace(found, steps=steps), names), list(range(len(names)))
    states = model.march(found.parameters, names, found.local, steps,
                         warm_start=near.path or None if near is not None else None, may_cut=True)
    try:
        for own, other in zip(sheet, states, strict=True):
            u[own.frame] = other.u[:n, :2] - own.u
            channels[own.frame] = other.channels - own.channels
            if changes is not None:
                changes.u[own.frame] = other.du[:n, :2] - own.du[..., own_columns]
                changes.channels[own.frame] = other.dchannels - own.dchannels[:, own_columns]
            if not linear:
                kept.append(other.u)
    except NotConverged:
        return None
    return Bricks(MotionError(u, channels), tuple(kept), changes)


def simulated_sheet(found: Identification, names: Sequence[str] = (),
                    guesses: Iterable[np.ndarray] | None = None) -> Iterator[FrameResponse]:
    """All frames of the model without a known error, the reference first.

    names : to differentiate by; guesses : (n_nodes, 2) mm of every frame

    Raises
    ------
    NotConverged
        While iterating, if equilibrium is not found.
    """
    experiment = replace(found.experiment, motion_error=None)
    forward = build_forward(experiment)
    states = forward.march(found.parameters, names, found.local, found.steps,  # type: ignore[call-arg]
                           bool(names) and forward.drives.n_local > 0, guesses, may_cut=True)
    return (response_of(at, experiment.reference) for at in states)


def reason_against_bricks(found: Identification) -> str | None:
    """Why a sheet of known, even thickness is not compared with bricks; None where it is, and of all other bodies."""
    experiment, cells = found.experiment, {block.cell for block in found.experiment.mesh.blocks}
    if experiment.solver is not None or experiment.kind != "plane_stress" or experiment.thickness is None:
        return None
    if len(cells) > 1:
        return f"the mesh mixes elements ({', '.join(sorted(cells))})"
    if cells <= {"quad4", "tri3"}:
        return 'the elements are of first order (element_order under [options])'
    if not can_be_thick(experiment):
        return None
    nodes = extruded(experiment.mesh, 0.5 * float(experiment.thickness)).n_nodes
    limit = MAX_LINEAR_BRICK_NODES if is_linear(found.forward.model) else MAX_BRICK_NODES  # type: ignore[union-attr]
    return f"bricks behind this mesh would have {nodes} nodes, more than {limit}" if nodes > limit else None


def brick_model(found: Identification) -> ForwardModel | None:
    """The model of bricks, loosely solved; None where none can be made or it is too large."""
    experiment = replace(found.experiment, motion_error=None)
    if not can_be_thick(experiment):
        return None
    forward = build_forward(thick(experiment))
    assert isinstance(forward, ForwardModel)  # a sheet of an external solver is not made thick
    size = forward.experiment.mesh.n_nodes
    if size > MAX_LINEAR_BRICK_NODES or (size > MAX_BRICK_NODES and not is_linear(forward.model)):
        return None
    return replace(forward, control=LOOSE)
