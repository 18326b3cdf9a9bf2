"""The error of plane stress: what bricks of the specimen's thickness move otherwise than the sheet.

A thick sheet is not in plane stress: a bent beam of bricks, 3 mm wide and 2.8 mm thick, moves by 0.026 px otherwise.
The test is simulated on bricks of the stated thickness (`idic.simulation_error.real_thickness`) at the parameters of a
model, with its increments or a few (`idic.simulation_error.comparison`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from idic.errors import NotConverged
from idic.fe import FrameState, Body
from idic.model import Experiment, ForwardModel, Model, MotionError, build_forward
from idic.simulation_error.comparison import LOOSE, ModelPoint, compared_increments
from idic.simulation_error.limits import LIMITS
from idic.simulation_error.real_thickness import can_be_thick, extruded, thick


class SheetFrame(Protocol):
    """A simulated frame of a sheet: u (n_nodes, 2) mm, channels (n_channels,), and their derivatives."""

    @property
    def u(self) -> np.ndarray: ...

    @property
    def channels(self) -> np.ndarray: ...

    @property
    def du(self) -> np.ndarray: ...

    @property
    def dchannels(self) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Bricks:
    """Bricks at the parameters of a sheet.

    error : of the sheet; path : their motion in every simulated frame, (n_nodes, 3) mm, () where it is of no use to
    the next one; changes : derivatives of the error by parameters of the laws, None where none were asked for
    """

    error: MotionError
    path: tuple[np.ndarray, ...] = ()
    changes: ErrorChanges | None = None

    @classmethod
    def of(cls, point: ModelPoint, sheet: Iterable[SheetFrame], neighbour: Bricks | None = None,
           of_sheet: Sequence[str] | None = None) -> Bricks | None:
        """The bricks of a sheet; None where none can be made or simulated.

        sheet : its simulated frames without a known error, the reference first; neighbour : bricks at similar
        parameters; of_sheet : parameters by which the sheet is differentiated, where the bricks are to be by those
        of the laws
        """
        model = _brick_model(point.experiment)
        if model is None:
            return None
        experiment, n, path = point.experiment, point.experiment.model.mesh.n_nodes, []
        u = np.zeros((experiment.model.n_frames, *experiment.model.mesh.nodes.shape))
        channels = np.zeros((experiment.model.n_frames, len(experiment.model.channels)))
        linear, names = model.body.is_linear, _of_the_laws(experiment.model, of_sheet or ())
        columns = [(of_sheet or ()).index(name) for name in names]
        changes = None if of_sheet is None else ErrorChanges(names, np.zeros((*u.shape, len(names))),
                                                             np.zeros((*channels.shape, len(names))))
        steps = compared_increments(point)
        if steps is not point.steps:
            sheet, columns = simulated_sheet(replace(point, steps=steps), names), list(range(len(names)))
        states = model.march(point.parameters, names, point.local, steps,
                             warm_start=neighbour.path or None if neighbour is not None else None, may_cut=True)
        try:
            for sheet_state, state in zip(sheet, states, strict=True):
                frame = experiment.model.reference + state.frame
                u[frame] = state.u[:n, :2] - sheet_state.u
                channels[frame] = state.channels - sheet_state.channels
                if changes is not None:
                    changes.u[frame] = state.du[:n, :2] - sheet_state.du[..., columns]
                    changes.channels[frame] = state.dchannels - sheet_state.dchannels[:, columns]
                if not linear:
                    path.append(state.u)
        except NotConverged:
            return None
        return cls(MotionError(u, channels), tuple(path), changes)


@dataclass(frozen=True, eq=False)
class ErrorChanges:
    """Derivatives of an error by parameters: u (n_frames, n_nodes, 2, n) mm, channels (n_frames, n_channels, n)."""

    names: tuple[str, ...]
    u: np.ndarray
    channels: np.ndarray


def thickness_error(point: ModelPoint) -> MotionError | None:
    """What a simulation in plane stress lacks of the surface of bricks; None where none can be made or simulated."""
    bricks = Bricks.of(point, simulated_sheet(point))
    return None if bricks is None else bricks.error


def simulated_sheet(point: ModelPoint, names: Sequence[str] = (),
                    guesses: Iterable[np.ndarray] | None = None) -> Iterator[FrameState]:
    """All frames of the model, the reference first.

    names : to differentiate by; guesses : (n_nodes, 2) mm of every frame, those of the point where none are given

    Raises
    ------
    NotConverged
        While iterating, if equilibrium is not found.
    """
    forward = build_forward(point.experiment)
    return forward.march(point.parameters, names, point.local, point.steps,
                         bool(names) and forward.drives.n_local > 0, point.guesses() if guesses is None else guesses,
                         may_cut=True)


def reason_against_bricks(experiment: Experiment) -> str | None:
    """Why a sheet of known, even thickness is not compared with bricks; None where it is, and of all other bodies."""
    model = experiment.model
    cells = {block.cell for block in model.mesh.blocks}
    if model.solver is not None or model.kind != "plane_stress" or model.thickness is None:
        return None
    if len(cells) > 1:
        return f"the mesh mixes elements ({', '.join(sorted(cells))})"
    if cells <= {"quad4", "tri3"}:
        return 'the elements are of first order (element_order under [options])'
    if not can_be_thick(experiment):
        return None
    nodes = extruded(model.mesh, 0.5 * float(model.thickness)).n_nodes
    limit = _max_bricks(build_forward(experiment).body)
    return f"bricks behind this mesh would have {nodes} nodes, more than {limit}" if nodes > limit else None


def _of_the_laws(model: Model, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters that the error of plane stress may follow: those of the laws."""
    sets = {material.element_set for material in model.materials}
    return tuple(name for name in names if name.partition(".")[0] in sets)


def _brick_model(experiment: Experiment) -> ForwardModel | None:
    """The model of bricks, loosely solved; None where none can be made or it is too large."""
    if not can_be_thick(experiment):
        return None
    forward = build_forward(thick(experiment))
    assert isinstance(forward, ForwardModel)  # a sheet of an external solver is not made thick
    if forward.model.mesh.n_nodes > _max_bricks(forward.body):
        return None
    return replace(forward, control=LOOSE)


def _max_bricks(model: Body) -> int:
    return LIMITS.superposed if model.is_linear else LIMITS.solid
