"""What moves the simulation: prescribed displacements as drives (histories) times patterns on degrees of freedom.

``u_prescribed(t_k) = basis @ histories[k]``. A drive is *local* where its value in every frame is an unknown of that
frame alone: the noise of a logged motion, or the nodes of a boundary whose motion is measured from the images.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.fe import followed, normal_axis, second_differences, seen_first
from idic.model.boundary_modes import edge_shapes, time_courses
from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.parts import (
    Column, Constant, Controlled, Correction, Measured, Parametrised, Prescribed, corrections_of,
)
from idic.model.loads import LoadHistories, build_loads
from idic.parameters import Parameter, ParameterSet

COMPONENTS = "xyz"
MEASURED_ROUGHNESS_PX = 0.1  # prior std of the second difference along a measured edge: a speckle edge is smoother
PX_PER_POINT = 8.0  # of measured fields: pixels of the images behind them from point to point, usually 5 to 12


@dataclass(frozen=True)
class DriveTable:
    """Every prescribed degree of freedom and the histories that drive them.

    dofs : (n_p,) node * dim + component; basis : (n_p, n_drives); names : one per drive; columns : per drive the
    logged history (n_frames,) in mm, zero where there is none; local : indices of the local drives;
    local_precision : (m, m) prior of the local values (1/mm²), those of the loads last; derivatives : parameter ->
    (n_frames, n_drives); controlled : the drive whose size a gauge decides, None: none
    """

    dofs: np.ndarray
    basis: np.ndarray
    names: tuple[str, ...]
    columns: np.ndarray  # (n_frames, n_drives)
    derivatives: dict[str, np.ndarray]
    local: tuple[int, ...]
    local_precision: np.ndarray
    measured: np.ndarray  # (m,) bool: True = node of a measured boundary, False = noise of a logged column
    loads: LoadHistories
    controlled: int | None = None

    @property
    def n_local(self) -> int:
        """Frame-local unknowns: those of the drives, then those of the loads."""
        return len(self.local) + len(self.loads.local)

    @property
    def local_scatter(self) -> np.ndarray:
        """`local_precision` as far as it is the scatter of a log, without the smoothness of measured edges  # (m, m)"""
        return np.where(self.measured[:, None] | self.measured, 0.0, self.local_precision)

    def histories(self, parameters: ParameterSet, local: np.ndarray | None = None) -> np.ndarray:
        """Histories at these parameters and local values (n_frames, m), mm  # (n_frames, n_drives)"""
        values = self.columns.copy()
        for name, derivative in self.derivatives.items():
            values += parameters[name].value * derivative
        if local is not None and self.local:
            values[:, list(self.local)] += local[:, :len(self.local)]
        return values

    @classmethod
    def of(cls, experiment: Experiment) -> DriveTable:
        """Drives of an experiment.

        Raises
        ------
        InputError
            If one degree of freedom is driven in two different ways.
        """
        builder = _Builder(experiment)
        for prescribed in experiment.model.prescribed:
            builder.add(prescribed)
        for prescribed in experiment.model.prescribed:
            builder.correct(prescribed)
        return builder.table()


def boundary_parameters(prescribed: tuple[Prescribed, ...], pixel_size: float,
                        length_unit: str = "mm") -> tuple[Parameter, ...]:
    """The degrees of freedom that parametrised and offset drives bring along (``boundary.SET.COMPONENT.name``).

    pixel_size : mm per px, for their scale; length_unit : "px" where no scale is known
    """
    parameters = []
    for entry in prescribed:
        stem = f"boundary.{entry.nodes}.{entry.component}"
        if isinstance(entry.drive, Column) and entry.drive.identify_offset:
            parameters.append(Parameter(f"{stem}.offset", 0.0, length_unit, True, scale=10.0 * pixel_size))
        parameters.extend(_correction_parameter(stem, correction, pixel_size)
                          for correction in corrections_of(entry.drive))
        if isinstance(entry.drive, Parametrised):
            parameters.extend(Parameter(name, 0.0, length_unit, True, scale=10.0 * pixel_size)
                              for name in entry.mode_names)
    return tuple(parameters)


def _correction_parameter(stem: str, correction: Correction, pixel_size: float) -> Parameter:
    """The amplitude as a degree of freedom; a unit of its scale moves the set by ten pixels at most (mm per px)."""
    reach = correction.reach * float(np.abs(correction.course).max(initial=0.0))
    return Parameter(f"{stem}.{correction.name}", 0.0, correction.unit, True, scale=10.0 * pixel_size / (reach or 1.0))


def mode_shapes(model: Model, nodes: np.ndarray, drive: Parametrised,
                stem: str) -> tuple[np.ndarray, np.ndarray]:
    """Shapes of a parametrised drive on the nodes of its set and its courses in time  # (n, modes), (n_frames, t_modes)

    A "dic" drive whose modes are not measured yet has B-splines in their place.
    """
    if drive.shapes is not None:
        return drive.shapes, drive.courses
    kind = "polynomial" if drive.kind == "polynomial" else "bspline"
    return (edge_shapes(model.mesh, nodes, kind, drive.modes, stem),
            time_courses(model.times, model.reference, kind, drive.time_modes))


class _Builder:
    """Collects drives in the order of the experiment file."""

    def __init__(self, experiment: Experiment):
        self.experiment = experiment
        self.frames = experiment.model.n_frames
        self.dof_index: dict[int, int] = {}
        self.owner: dict[int, str] = {}
        self.entries: list[tuple[int, int, float]] = []  # row, drive, coefficient
        self.names: list[str] = []
        self.columns: list[np.ndarray] = []
        self.derivative_parts: dict[str, dict[int, np.ndarray]] = {}
        self.local: list[int] = []
        self.precisions: list[np.ndarray] = []
        self.measured: list[bool] = []
        self.controlled: int | None = None

    def add(self, prescribed: Prescribed) -> None:
        nodes = self.experiment.model.node_set(prescribed.nodes)
        component = COMPONENTS.index(prescribed.component)
        stem = f"boundary.{prescribed.nodes}.{prescribed.component}"
        drive = prescribed.drive
        if isinstance(drive, Measured):
            nodes = self._measurable(stem, nodes, component)
        dofs = nodes * self.experiment.model.n_dim + component
        rows, positions = self._claim(dofs, stem, drive)
        if isinstance(drive, Constant):
            if drive.value:
                index = self._drive(stem, np.full(self.frames, drive.value))
                self._pattern(rows, index, np.ones(len(rows)))
        elif isinstance(drive, Column):
            self._add_column(stem, rows, drive)
        elif isinstance(drive, Measured):
            self._add_measured(stem, rows, nodes[positions], drive)
        elif isinstance(drive, Controlled):
            self.controlled = self._drive(stem, np.zeros(self.frames))
            self._pattern(rows, self.controlled, np.ones(len(rows)))
        else:
            self._add_parametrised(stem, rows, positions, nodes, drive)

    def correct(self, prescribed: Prescribed) -> None:
        """Drives for the corrections of an entry, once it is known which degrees of freedom are held."""
        nodes = self.experiment.model.node_set(prescribed.nodes)
        stem = f"boundary.{prescribed.nodes}.{prescribed.component}"
        for correction in corrections_of(prescribed.drive):
            component, shape = correction.pattern(correction, self.experiment.model.mesh, nodes, prescribed.component)
            dofs = nodes * self.experiment.model.n_dim + COMPONENTS.index(component)
            if not all(int(dof) in self.dof_index for dof in dofs):
                raise InputError("a correction of a motion that is free", file="experiment.toml",
                                 key=f"{stem} corrections", expected=f"u{component} of {prescribed.nodes} prescribed",
                                 found="no drive for it",
                                 remedy=f"add u{component} = 0.0 to that [[boundary]], or remove the correction")
            name = f"{stem}.{correction.name}"
            index = self._drive(name, np.zeros(self.frames))
            self._pattern([self.dof_index[int(dof)] for dof in dofs], index, shape)
            self._derivative(name, index, correction.course[:self.frames])

    def _claim(self, dofs, stem, drive):
        """Rows of the degrees of freedom without a drive; a shared corner node keeps its first drive."""
        rows, positions = [], []
        for position, dof in enumerate(dofs):
            dof = int(dof)
            kind = f"{type(drive).__name__}"
            if dof in self.dof_index:
                if self.owner[dof] != kind:
                    raise InputError(f"{stem} and an earlier [[boundary]] drive the same node differently",
                                     file="experiment.toml", key="[[boundary]]",
                                     expected="one drive per node and component",
                                     found=f"{self.owner[dof].lower()} and {kind.lower()}",
                                     remedy="take the shared nodes out of one of the sets")
                continue
            self.dof_index[dof] = len(self.dof_index)
            self.owner[dof] = kind
            rows.append(self.dof_index[dof])
            positions.append(position)
        return np.array(rows, dtype=int), np.array(positions, dtype=int)

    def _drive(self, name, history) -> int:
        self.names.append(name)
        self.columns.append(np.asarray(history, float))
        return len(self.names) - 1

    def _pattern(self, rows, drive, coefficients) -> None:
        self.entries.extend((int(row), drive, float(c)) for row, c in zip(rows, coefficients, strict=True))

    def _derivative(self, parameter, drive, history) -> None:
        self.derivative_parts.setdefault(parameter, {})[drive] = np.asarray(history, float)

    def _add_column(self, stem, rows, drive: Column) -> None:
        late = None
        if "time.offset" in self.experiment.model.parameters and drive.rates is not None:
            late = self.experiment.model.rates_since_reference(drive.rates)
        index = self._drive(stem, drive.values if late is None
                            else drive.values - self.experiment.model.log_offset * late)
        self._pattern(rows, index, np.ones(len(rows)))
        if drive.identify_offset:
            moved = np.ones(self.frames)
            moved[self.experiment.model.reference] = 0.0
            self._derivative(f"{stem}.offset", index, moved)
        if late is not None:
            self._derivative("time.offset", index, late)
        if drive.noise_std > 0:
            self.local.append(index)
            self.precisions.append(np.array([[drive.noise_std**-2]]))
            self.measured.append(False)

    def _add_measured(self, stem, rows, nodes, drive: Measured) -> None:
        self._require_edge(stem, nodes)
        if not len(nodes):
            return
        mesh, surface = self.experiment.model.mesh, self.experiment.model.surface
        inside = self.experiment.recording.quantity == "volume"
        leaders = np.arange(len(nodes)) if mesh.n_dim == 2 or inside else seen_first(mesh, surface, nodes)
        if not len(leaders):
            raise InputError("hidden nodes without a visible node to follow", file="experiment.toml", key=stem,
                             expected="one [[boundary]] for the visible and the hidden nodes of an edge",
                             found=f"{len(nodes)} nodes whose visible neighbours an earlier [[boundary]] measures",
                             remedy="measure both in one set")
        unique_leaders = np.unique(leaders)
        weights = np.eye(len(nodes)) if mesh.n_dim == 2 or inside else followed(mesh.nodes[nodes], leaders)[0]
        for leader, weight in zip(unique_leaders, weights.T, strict=True):
            index = self._drive(f"{stem}.node{mesh.node_labels[nodes[leader]]}", np.zeros(self.frames))
            moved = np.flatnonzero(weight)
            self._pattern(rows[moved], index, weight[moved])
            self.local.append(index)
            self.measured.append(True)
        pixel = self.experiment.pixel_size / (1.0 if self.experiment.recording.points is None else PX_PER_POINT)
        std = drive.smoothing * MEASURED_ROUGHNESS_PX * pixel
        second = second_differences(mesh, nodes[unique_leaders], None if inside else surface)
        self.precisions.append((second.T @ second + 1e-10 * np.eye(len(unique_leaders))) / std**2)

    def _measurable(self, stem: str, nodes: np.ndarray, component: int) -> np.ndarray:
        """The nodes of a set whose motion the images tell: all of a plane mesh, or in a volume. Of a solid, hidden
        nodes move with the seen ones; across a flat surface they are free, as the thickness changes."""
        experiment = self.experiment
        if experiment.model.n_dim == 2 or experiment.recording.quantity == "volume":
            return nodes
        if component == normal_axis(experiment.model.mesh, experiment.model.surface) and not experiment.sees_space:
            raise InputError("a measured motion along the line of sight", file="experiment.toml", key=stem,
                             expected="a motion in the plane of the image, or two cameras with a lens",
                             found=f"u{COMPONENTS[component]} of a surface with normal {COMPONENTS[component]}",
                             remedy=f"give u{COMPONENTS[component]}, or leave it free; measure the other two")
        leaders = seen_first(experiment.model.mesh, experiment.model.surface, nodes)
        if not len(leaders):
            raise InputError("a measured motion that no camera sees", file="experiment.toml", key=stem,
                             expected=f"a set with nodes on the surface {experiment.model.surface}",
                             found=f"none of {len(nodes)} nodes", remedy="measure an edge of the seen surface, or "
                             "give the motion by a number or a column")
        if component == normal_axis(experiment.model.mesh, experiment.model.surface):
            return nodes[np.unique(leaders)]
        return nodes

    def _require_edge(self, stem: str, nodes: np.ndarray) -> None:
        """Refuse measured nodes inside the body: the simulation determines their motion."""
        mesh = self.experiment.model.mesh
        inside = np.setdiff1d(nodes, mesh.face_set_nodes(mesh.boundary_faces()))
        if len(inside):
            raise InputError("a measured motion inside the body", file="experiment.toml", key=stem,
                             expected="a set of nodes on the edge of the mesh",
                             found=f"{len(inside)} of {len(nodes)} nodes inside, first {mesh.node_labels[inside[0]]}",
                             remedy="narrow the set to the nodes of the edge")

    def _add_parametrised(self, stem, rows, positions, nodes, drive: Parametrised) -> None:
        """nodes : all of the set; positions : the places of those that no earlier entry moves."""
        shapes, courses = mode_shapes(self.experiment.model, nodes, drive, stem)
        for i in range(drive.modes):
            index = self._drive(f"{stem}.s{i}", np.zeros(self.frames))
            self._pattern(rows, index, shapes[positions, i])
            for j in range(drive.time_modes):
                self._derivative(f"{stem}.s{i}t{j}", index, courses[:, j])

    def table(self) -> DriveTable:
        n_drives = len(self.names)
        basis = np.zeros((len(self.dof_index), n_drives))
        for row, drive, coefficient in self.entries:
            basis[row, drive] = coefficient
        derivatives = {}
        for name, parts in self.derivative_parts.items():
            derivatives[name] = np.zeros((self.frames, n_drives))
            for drive, history in parts.items():
                derivatives[name][:, drive] = history
        columns = np.array(self.columns).T if self.columns else np.zeros((self.frames, 0))
        dofs = np.array(list(self.dof_index), dtype=np.int64)
        loads = build_loads(self.experiment.model)
        return DriveTable(dofs, basis, tuple(self.names), columns, derivatives, tuple(self.local),
                          _block_diagonal([*self.precisions, loads.local_precision]),
                          np.array([*self.measured, *(False for _ in loads.local)], dtype=bool), loads, self.controlled)


def _block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    size = sum(len(block) for block in blocks)
    matrix = np.zeros((size, size))
    first = 0
    for block in blocks:
        matrix[first:first + len(block), first:first + len(block)] = block
        first += len(block)
    return matrix
