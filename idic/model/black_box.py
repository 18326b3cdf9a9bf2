"""The forward model of an experiment that an external program simulates: it has `solve`, but no derivatives.

The drives are in ``[[boundary]]`` as usual; the deck reads them as tables ``{TABLE.boundary.SET.x}`` of time and value.
Derivatives come from perturbed runs:

    du/dp = (u(p + dp) - u(p)) / dp

Those by the frame-local unknowns (the noise w_k of a logged grip) come from one run with all frames shifted by one
amount. With a history-dependent material this includes the shift of earlier frames; in a monotonic test the difference
is of second order, and the unknown itself is a fraction of a micrometre.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from idic.errors import InputError, NotConverged
from idic.fe import ExternalSetup, ExternalSolver, FrameState, Solution, StepList, ExpectedOutput, inp_text
from idic.model.drives import DriveTable
from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.options import Options
from idic.model.records.parts import Measured, Parametrised
from idic.model.readings import Readings, build_readings, controlled
from idic.parameters import ParameterSet

TABLE = "TABLE."
THICKNESS = "geometry.thickness"
TIMES = ("TIME.end", "TIME.frames", "TIME.points")  # of the deck: its last time, number of frames, all times


@dataclass(frozen=True)
class ExternalForward:
    """A model prepared for simulation by an external program."""

    model: Model
    options: Options
    drives: DriveTable
    readings: Readings | None
    scratch: Path | None = None  # folder of the folders of single runs; None: a temporary one
    label: str = "run"  # of the next run, in messages and folders

    @property
    def setup(self) -> ExternalSetup:
        return self.model.solver

    @property
    def frames(self) -> np.ndarray:
        """Frame numbers that are simulated: the reference and all later ones  # (n_simulated,)"""
        return np.arange(self.model.reference, self.model.n_frames)

    @property
    def morphs(self) -> tuple[str, ...]:
        """Degrees of freedom that move the nodes of the mesh."""
        return tuple(morph.name for morph in self.model.morphs)

    @property
    def body(self):
        raise InputError("stresses and tangents of an external solver are not available",
                         file=self.setup.experiment_file, key="solver",
                         expected="the built-in solver, where stresses and tangents are needed",
                         found=" ".join(self.setup.arguments), remedy="remove [solver] for this")

    def moves(self, name: str) -> bool:
        """Whether a degree of freedom changes the simulation (and not only camera or channels)."""
        return not name.startswith(("camera.", "channel.")) and (
            name in self.setup.deck.names or name in self.drives.derivatives or name in self.drives.loads.names()
            or name in self.morphs)

    def local_changes(self) -> np.ndarray:
        """By how much each frame-local unknown is shifted in its perturbed run  # (n_local,) mm, MPa or N"""
        drives, loads = self.drives, self.drives.loads
        histories = np.hstack([drives.columns[:, list(drives.local)], loads.columns[:, list(loads.local)]])
        return np.maximum(self.options.perturbation * np.abs(histories).max(axis=0, initial=0.0),
                          np.diagonal(drives.local_precision)**-0.5 if drives.n_local else 0.0)

    def respond(self, parameters: ParameterSet, local: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """One simulation  # (n_simulated, n_nodes, dim) mm, (n_simulated, n_channels)

        Raises
        ------
        NotConverged
            If the program crashed, took too long, or gave unusable output.
        """
        mesh = self.model.at_geometry(parameters).mesh
        request = replace(self._request, motions=self.motions(parameters, local))
        solver, texts = ExternalSolver(self.setup, request), self._tables(parameters, local)
        if self.setup.mesh_file is not None:
            texts[self.setup.mesh_file] = inp_text(mesh, "idic", self.setup.element_types)
        if self.scratch is not None:
            solution = solver.run(self._values(parameters), texts, self.scratch, self.label)
        else:
            folder = Path(tempfile.mkdtemp(prefix="idic-"))
            solution = solver.run(self._values(parameters), texts, folder, self.label)
            folder.rmdir()  # where it failed, it stays
        return solution.u, self._channels(solution, parameters, local)

    def motions(self, parameters: ParameterSet,
                local: np.ndarray | None = None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Degrees of freedom and history of every prescribed motion that is not zero  # (n,), (n_simulated,) mm"""
        histories, drives = self._histories(parameters, local), self.drives
        return {name: (drives.dofs[drives.basis[:, k] == 1.0], histories[:, k]) for k, name in enumerate(drives.names)
                if np.any(histories[:, k]) and np.any(drives.basis[:, k] == 1.0)}

    def march(self, parameters: ParameterSet, names: Sequence[str] = (), local: np.ndarray | None = None,
              steps: np.ndarray | None = None, influence: bool = False, warm_start: Iterable[np.ndarray] | None = None,
              may_cut: bool = False, increments: int | None = None) -> Iterator[FrameState]:
        """As `idic.model.forward.ForwardModel.march`, with one more run per derivative.

        The whole test is simulated before the first frame is yielded; the solver chooses its start and its increments:
        `steps`, `warm_start`, `may_cut` and `increments` have no effect.
        """
        u, channels = self.respond(parameters, local)
        perturbed = []
        for name in names:
            change = parameters[name].perturbation(self.options.perturbation)
            perturbed_parameters = parameters.with_values({name: parameters[name].value + change})
            perturbed.append((self.respond(perturbed_parameters, local), change))
        shifts = enumerate(self.local_changes()) if influence else ()
        local_runs = [(self.respond(parameters, self.shifted(local, i)), change) for i, change in shifts]
        du, dchannels = self._quotients(u, channels, perturbed)
        local_du, local_dchannels = self._quotients(u, channels, local_runs)
        step_list = StepList(tuple(float(t) for t in self.model.times[self.model.reference:]))
        for k, time in enumerate(step_list.times):
            yield FrameState(k, time, u[k], channels[k], du[k], dchannels[k], local_du[k], local_dchannels[k], 0, (),
                             step_list)

    def shifted(self, local: np.ndarray | None, index: int) -> np.ndarray:
        """Frame-local values with one of them shifted in all frames  # (n_frames, n_local)"""
        moved = np.zeros((self.model.n_frames, self.drives.n_local)) if local is None else local.copy()
        moved[:, index] += self.local_changes()[index]
        return moved

    @staticmethod
    def _quotients(u: np.ndarray, channels: np.ndarray, runs: list) -> tuple[np.ndarray, np.ndarray]:
        """(n_frames, n_nodes, dim, n), (n_frames, n_channels, n)"""
        if not runs:
            return np.zeros((*u.shape, 0)), np.zeros((*channels.shape, 0))
        return (np.stack([(run[0] - u) / change for run, change in runs], axis=-1),
                np.stack([(run[1] - channels) / change for run, change in runs], axis=-1))

    @cached_property
    def _request(self) -> ExpectedOutput:
        model = self.model
        mesh, reactions = model.mesh, [channel for channel in model.channels if channel.kind == "reaction"]
        return ExpectedOutput(np.asarray(mesh.node_labels), model.n_dim, self._clock()[1:],
                      tuple(dict.fromkeys(f"{c.nodes}.{c.component}" for c in reactions)),
                      {c.nodes: model.node_set(c.nodes) for c in reactions},
                      float(np.linalg.norm(np.ptp(mesh.nodes, axis=0))))

    def _clock(self) -> np.ndarray:
        """Times of the deck, 0 at the reference  # (n_simulated,)"""
        times = self.model.times[self.model.reference:]
        return np.arange(len(times), dtype=float) if self.setup.clock == "frames" else times - times[0]

    def _values(self, parameters: ParameterSet) -> dict[str, float]:
        return {THICKNESS: self.model.thickness or 1.0, "TIME.end": float(self._clock()[-1]),
                "TIME.frames": float(len(self.frames) - 1), **{n: float(v) for n, v in parameters.as_values().items()}}

    def _histories(self, parameters: ParameterSet, local: np.ndarray | None) -> np.ndarray:
        """Motions (mm), then loads (MPa, N), zero at the reference  # (n_simulated, n_drives + n_loads)"""
        drives, loads = self.drives, self.drives.loads
        histories = np.hstack([
            drives.histories(parameters, local),
            loads.values(parameters, None if local is None else local[:, len(drives.local):])])[self.frames]
        histories[0] = 0.0
        return histories

    def _tables(self, parameters: ParameterSet, local: np.ndarray | None) -> dict[str, str]:
        """Tables of the deck: one line "time, value" per frame; TIME.points: the times of the frames, one per line."""
        drives, loads = self.drives, self.drives.loads
        histories, clock = self._histories(parameters, local), self._clock()
        tables = {f"{TABLE}{name}": "\n".join(f"{t:.9g}, {value:.12g}" for t, value in zip(clock, history, strict=True))
                  for name, history in zip((*drives.names, *loads.stems), histories.T, strict=True)}
        return tables | {"TIME.points": "\n".join(f"{t:.9g}" for t in clock[1:])}

    def _channels(self, solution: Solution, parameters: ParameterSet, local: np.ndarray | None) -> np.ndarray:
        """What the channels read  # (n_simulated, n_channels)"""
        forces = np.zeros((len(self.frames), len(self.model.channels)))
        for column, channel in enumerate(self.model.channels):
            if channel.kind == "reaction":
                forces[:, column] = channel.factor * solution.forces[f"{channel.nodes}.{channel.component}"]
        if self.readings is None:
            return forces
        n = len(self.drives.local)
        values = self.drives.loads.values(parameters, None if local is None else local[:, n:])[self.frames]
        flat = solution.u.reshape(len(self.frames), -1)
        return forces + flat @ self.readings.motion.T + values @ self.readings.load.T


def build_external(experiment: Experiment) -> ExternalForward:
    """The forward model of an experiment with a ``[solver]``; nothing is started.

    Raises
    ------
    InputError
        The deck uses an unknown name, or does not use a drive or an identified parameter.
    """
    model = experiment.model
    drives = DriveTable.of(experiment)
    forward = ExternalForward(model, experiment.options, drives, build_readings(model, drives.loads))
    setup, file = model.solver, model.solver.experiment_file
    _check_drives(forward)
    tables, values = forward._tables(model.parameters, None), forward._values(model.parameters)
    setup.deck.check(set(tables) | set(values))
    try:
        setup.deck.render(values | tables)
    except NotConverged as problem:
        raise InputError("the deck cannot be made for the start values", file=setup.deck.file,
                         expected="a finite number in every place", found=str(problem),
                         remedy="give the parameters other values, or correct the deck") from None
    moving = [name for name, column in zip(drives.names, drives.columns.T, strict=True) if np.any(column != column[0])]
    for name in (*moving, *drives.loads.stems):
        if f"{TABLE}{name}" not in setup.deck.names:
            raise InputError("a motion or load that the deck does not read", file=setup.deck.file,
                             expected=f"{{{TABLE}{name}}}: lines of time and value", found="nowhere in the deck",
                             remedy="write it as the data of an *AMPLITUDE, or remove the [[boundary]]")
    for name in model.parameters.free:
        material = name.rpartition(".")[0] in {m.element_set for m in model.materials}
        if (material or name == THICKNESS) and name not in setup.deck.names:
            raise InputError("a parameter to be identified that the deck does not read", file=setup.deck.file,
                             expected=f"{{{name}}}", found="nowhere in the deck",
                             remedy="write it where the deck has its value, or lock it with identify = false")
    morphs = any(morph.name in model.parameters for morph in model.morphs)
    if morphs and setup.mesh_file is None:
        raise InputError("a geometry that changes, but the deck has its own mesh", file=file, key="solver.mesh",
                         expected="the name under which idic writes the mesh", found="nothing",
                         remedy='write mesh = "mesh.inp" under [solver] and *INCLUDE it')
    return forward


def _check_drives(forward: ExternalForward) -> None:
    """Refuse drives that are not one history for a whole node set."""
    model, basis = forward.model, forward.drives.basis
    file = model.solver.experiment_file
    if (drive := controlled(model)) is not None:
        raise InputError("a gauge that controls a motion or force", file=file, key="[[boundary]] controlled_by",
                         expected="numbers or columns: an external solver is given the motion before it starts",
                         found=f"controlled_by, column {drive.column}",
                         remedy="use the built-in solver, or give the motion as a column")
    for entry in model.prescribed:
        if isinstance(entry.drive, (Measured, Parametrised)):
            raise InputError("a motion that differs from node to node", file=file,
                             key=f"[[boundary]] nodes = {entry.nodes}, u{entry.component}",
                             expected="a number or a column: an external solver gets one history per node set",
                             found="measured" if isinstance(entry.drive, Measured) else "virtual",
                             remedy="use the built-in solver, or give the motion as a column")
    if np.any((basis != 0.0) & (basis != 1.0)) or np.any((basis != 0.0).sum(axis=1) > 1):
        raise InputError("a motion that differs from node to node", file=file, key="[[boundary]]",
                         expected="one history per node set", found="corrections or overlapping motions",
                         remedy="use the built-in solver, or leave them out")
    if model.temperatures:
        raise InputError("temperatures with an external solver", file=file, key="[[boundary]] temperature",
                         expected="none: the deck has its own", found="a temperature", remedy="write it in the deck")
