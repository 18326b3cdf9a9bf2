"""The finite-element model as records: sections, constraints, loads, reaction channels, directions of differentiation.

Degree of freedom ``node * n_dim + component``. Everything that changes with time is given at the frames and is linear
in time between them; the first frame is the undeformed, unloaded reference.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from idic.errors import InputError
from idic.fe.body.variation import Variation
from idic.fe.body.seam import Seam
from idic.fe.mesh.mesh import Mesh, PerMesh
from idic.fe.solver.rigid_motion import free_parts
from idic.laws import CompiledLaw, MODES


@dataclass(frozen=True)
class Section:
    """Elements of one law. `name` is the key of its parameters; `elements` (n,) are global element indices.

    ``expansion`` is the linear coefficient of thermal expansion in 1/K; it acts where the model has a temperature.
    """

    name: str
    law: CompiledLaw
    elements: np.ndarray
    expansion: float = 0.0


@dataclass(frozen=True)
class Constraints:
    """Prescribed displacements ``u[dofs](t_k) = basis @ histories[k]`` in mm.

    Attributes
    ----------
    dofs : (n_p,) int, each once
    basis : (n_p, n_drives); a row of zeros holds the dof at rest
    histories : (n_frames, n_drives); row 0 is zero
    """

    dofs: np.ndarray
    basis: np.ndarray
    histories: np.ndarray


@dataclass(frozen=True)
class Loads:
    """Forces on the body; the values at the first frame are ignored (the reference is unloaded).

    Attributes
    ----------
    dead : (n_dof, n_dead) N per unit of history: forces of fixed direction
    dead_histories : (n_frames, n_dead)
    pressure_faces : one (n, 2) array [element, local face] per follower pressure
    pressure_histories : (n_frames, n_pressure) MPa, positive pushes onto the body
    """

    dead: np.ndarray | None = None
    dead_histories: np.ndarray | None = None
    pressure_faces: tuple[np.ndarray, ...] = ()
    pressure_histories: np.ndarray | None = None


@dataclass(frozen=True)
class Reaction:
    """A simulated force: factor x sum of the forces (N) that hold these dofs (internal minus external force)."""

    dofs: np.ndarray  # (n,) int
    factor: float = 1.0


@dataclass(frozen=True)
class PathControl:
    """A drive or a load of unknown size, and the gauge whose course decides it: ``gauge @ u(t_k) = readings[k]``.

    Attributes
    ----------
    gauge : (n_dof,) weights of the displacements
    readings : (n_frames,) mm; row 0 is zero
    drive, load : the column of ``Constraints.basis``, or the index of a load (dead ones first, then pressures), to
        whose history the unknown is added
    """

    gauge: np.ndarray
    readings: np.ndarray
    drive: int | None = None
    load: int | None = None


@dataclass(frozen=True)
class Direction:
    """What to differentiate with respect to: exactly one kind (d_loads may come with thickness, d_temperature with
    d_histories).

    Attributes
    ----------
    material : (section index, parameter index) of ``params[section.name]``
    d_histories : (n_frames, n_drives) mm per unit: derivative of ``Constraints.histories``
    d_loads : (n_frames, n_dead + n_pressure): derivative of the load histories, dead loads first
    thickness : the model's thickness, 2D only. Stresses and follower pressures act on it; dead loads are forces (N),
        where one was made of a traction, its own change goes into d_loads
    expansion : index of the section whose coefficient of thermal expansion changes
    d_temperature : (n_frames, n_nodes) K per unit: derivative of ``Body.temperature``
    variation : (index, name) of ``Body.variations[index].values``
    d_readings : (n_frames,) mm per unit: derivative of ``Body.control.readings``; alone or with d_histories
    d_tips : (n_frames, n_seams) mm per unit: derivative of the tips of ``Body.seams``
    """

    name: str
    material: tuple[int, int] | None = None
    d_histories: np.ndarray | None = None
    d_loads: np.ndarray | None = None
    thickness: bool = False
    expansion: int | None = None
    d_temperature: np.ndarray | None = None
    variation: tuple[int, str] | None = None
    d_readings: np.ndarray | None = None
    d_tips: np.ndarray | None = None


@dataclass(frozen=True)
class Body:
    """A body, its supports and loads, and its output channels.

    Attributes
    ----------
    kind : "plane_stress", "plane_strain" or "solid"
    locking : "auto", "none" or "mean_dilatation"
        "auto": mean dilatation (B-bar for small, F-bar for finite strain) for hex8 and tet10, and for quad4 in plane
        strain. A tet4 has no remedy: it locks in plastic flow and rubber.
    local_drives, local_loads : indices of drives, and of loads (dead ones first, then pressures), whose same-frame
        influence fields are wanted
    quadrature : {cell: order} where the default is not wanted, e.g. ``{"quad8": 3}``
    temperature : (n_frames, n_nodes) K, change since the first frame (whose row is ignored); None: isothermal
    start_temperature : (n_nodes,) °C at the first frame, for laws whose parameters depend on it
    variations : factors on the stress that vary over the body
    control : a drive or load of unknown size that keeps a gauge on its course
    seams : cuts whose faces open behind a tip; the nodes of the mesh exist twice along them
    surface_side : plane stress, +1 or -1: the surface on this side is seen, and its motion out of the plane by the
        change of thickness is wanted; 0: not wanted
    """

    mesh: Mesh
    kind: str
    sections: tuple[Section, ...]
    constraints: Constraints
    thickness: float = 1.0
    loads: Loads = field(default_factory=Loads)
    channels: tuple[Reaction, ...] = ()
    local_drives: tuple[int, ...] = ()
    local_loads: tuple[int, ...] = ()
    locking: str = "auto"
    surface_side: int = 0
    quadrature: Mapping[str, int] = field(default_factory=dict)
    temperature: np.ndarray | None = None
    start_temperature: np.ndarray | None = None
    variations: tuple[Variation, ...] = ()
    control: PathControl | None = None
    seams: tuple[Seam, ...] = ()

    @property
    def mode(self) -> int:
        """The stress state as the material kernels number it: 0 solid, 1 plane strain, 2 plane stress."""
        return MODES[self.kind]

    @property
    def n_dof(self) -> int:
        return self.mesh.nodes.size

    def at_frames(self, frames: np.ndarray) -> Body:
        """The body with its histories at some frames, whose numbers increase."""
        def sampled(histories: np.ndarray | None) -> np.ndarray | None:
            return None if histories is None else histories[frames]

        loads = replace(self.loads, dead_histories=sampled(self.loads.dead_histories),
                        pressure_histories=sampled(self.loads.pressure_histories))
        control = None if self.control is None else replace(self.control, readings=self.control.readings[frames])
        constraints = replace(self.constraints, histories=self.constraints.histories[frames])
        seams = tuple(replace(seam, tips=seam.tips[frames]) for seam in self.seams)
        return replace(self, control=control, constraints=constraints, loads=loads,
                       temperature=sampled(self.temperature), seams=seams)

    def validate(self, n_frames: int) -> None:
        """Raise InputError if the model cannot be solved as it stands."""
        mesh = self.mesh
        if self.kind not in MODES:
            raise InputError("unknown kind of model", key="experiment.kind", expected=", ".join(MODES), found=self.kind,
                             remedy="write one of these names")
        expected_dim = 3 if self.kind == "solid" else 2
        if mesh.n_dim != expected_dim:
            raise InputError(f"{self.kind} needs a {expected_dim}D mesh", key="experiment.kind",
                             expected=f"{expected_dim} coordinates per node", found=str(mesh.n_dim),
                             remedy="use a mesh of that dimension, or another kind")
        if self.locking not in ("auto", "none", "mean_dilatation"):
            raise InputError("unknown treatment of locking", expected="auto, none or mean_dilatation",
                             found=self.locking, remedy="write one of these names")
        if self.locking == "mean_dilatation" and self.kind == "plane_stress":
            raise InputError("plane stress does not lock: the thickness follows the volume",
                             found="locking = mean_dilatation", remedy="use locking = auto")
        if not self.thickness > 0:
            raise InputError("the thickness must be positive", expected="> 0 mm", found=str(self.thickness),
                             remedy="give the thickness of the specimen in mm (experiment.thickness_mm)")
        _PASSED.once(mesh, "elements", mesh.check_elements)
        _check_sections(self)
        _check_constraints(self, n_frames)
        _check_loads(self, n_frames)
        _check_temperature(self, n_frames)
        _check_control(self, n_frames)
        _check_seams(self, n_frames)
        _PASSED.once(mesh, np.asarray(self.constraints.dofs).tobytes(), lambda: _check_rigid_motion(self))

    @property
    def is_linear(self) -> bool:
        """Whether displacements and forces are linear in the histories of drives and loads."""
        laws = [section.law for section in self.sections]
        return (all(law.small and law.spec.linear for law in laws) and not self.loads.pressure_faces
                and self.temperature is None and self.control is None and not self.seams)


def uses_mean_dilatation(body: Body, cell: str) -> bool:
    """Whether elements of this cell are computed with mean dilatation, against volumetric locking."""
    if body.kind == "plane_stress" or body.locking == "none":
        return False
    if body.locking == "mean_dilatation":
        return not cell.startswith(("tri", "tet4"))
    return cell in ("hex8", "tet10") or (cell == "quad4" and body.kind == "plane_strain")


MIN_NAMED = 0.1  # part of the largest component of a free rigid motion that a message names


# validation ---------------------------------------------------------------------------------------
_PASSED = PerMesh()  # checks that a mesh and its supports have passed


def _check_sections(body: Body) -> None:
    count = np.zeros(body.mesh.n_elements, dtype=int)
    for section in body.sections:
        np.add.at(count, section.elements, 1)
    for bad, fault in ((count == 0, "have no material"), (count > 1, "have more than one material")):
        if bad.any():
            labels = list(map(str, body.mesh.element_labels[bad]))
            raise InputError(f"{bad.sum()} element(s) {fault}", expected="each element in exactly one section",
                             found="elements " + ", ".join(labels[:10]) + (" ..." if len(labels) > 10 else ""),
                             remedy="check the element sets named in [material.SET]")


def _check_constraints(body: Body, n_frames: int) -> None:
    c = body.constraints
    if c.basis.shape != (len(c.dofs), c.histories.shape[1]) or len(c.histories) != n_frames:
        raise InputError("constraints of inconsistent size",
                         expected=f"basis ({len(c.dofs)}, n_drives), histories ({n_frames}, n_drives)",
                         found=f"basis {c.basis.shape}, histories {c.histories.shape}",
                         remedy="give basis and histories one column per drive")
    unique, counts = np.unique(c.dofs, return_counts=True)
    if (counts > 1).any():
        node, component = divmod(int(unique[counts > 1][0]), body.mesh.n_dim)
        raise InputError(f"u{'xyz'[component]} of node {body.mesh.node_labels[node]} is prescribed twice",
                         remedy="let only one [[boundary]] prescribe it")
    if not np.isfinite(c.histories).all():
        frame = int(np.flatnonzero(~np.isfinite(c.histories).all(axis=1))[0])
        raise InputError(f"a prescribed displacement is not a number at frame {frame}",
                         remedy="check the log, or exclude the frame")
    largest, first = np.abs(c.histories).max(initial=0.0), np.abs(c.histories[0]).max(initial=0.0)
    if first > 1e-12 * largest:
        raise InputError("the prescribed displacement of the first frame is not zero",
                         expected="0 mm: the first frame is the reference", found=f"{first:g} mm",
                         remedy="subtract the value of the reference frame")


def _check_loads(body: Body, n_frames: int) -> None:
    loads = body.loads
    n_dead = 0 if loads.dead is None else loads.dead.shape[1]
    for kind, n, histories in (("dead load", n_dead, loads.dead_histories),
                               ("pressure", len(loads.pressure_faces), loads.pressure_histories)):
        shape = (n_frames, 0) if histories is None else histories.shape
        if shape != (n_frames, n):
            raise InputError(f"{kind} histories of inconsistent size", expected=str((n_frames, n)), found=str(shape),
                             remedy="give one row per frame and one column per load")
        if histories is not None and not np.isfinite(histories).all():
            raise InputError(f"a {kind} is not a number", remedy="check the log")


def _check_control(body: Body, n_frames: int) -> None:
    control = body.control
    if control is None:
        return
    if np.shape(control.gauge) != (body.n_dof,) or np.shape(control.readings) != (n_frames,):
        raise InputError("a gauge that does not fit the model",
                         expected=f"{body.n_dof} weights and {n_frames} readings",
                         found=f"{np.shape(control.gauge)}, {np.shape(control.readings)}",
                         remedy="give one weight per degree of freedom and one reading per frame")
    if (control.drive is None) == (control.load is None):
        raise InputError("a gauge controls one drive or one load", expected="drive or load",
                         found="none" if control.drive is None else "both", remedy="give one of them")
    if not np.isfinite(control.readings).all():
        frame = int(np.flatnonzero(~np.isfinite(control.readings))[0])
        raise InputError(f"a reading of the controlling gauge is not a number at frame {frame}",
                         remedy="check the log, or exclude the frame")
    if control.readings[0] != 0.0:
        raise InputError("the controlling gauge does not read zero at the first frame", expected="0 mm",
                         found=f"{control.readings[0]:g} mm", remedy="subtract the reading of the reference frame")


def _check_seams(body: Body, n_frames: int) -> None:
    for seam in body.seams:
        if np.shape(seam.tips) != (n_frames,) or not np.isfinite(seam.tips).all():
            raise InputError("a crack whose tip does not fit the frames", expected=f"{n_frames} finite positions",
                             found=f"{np.shape(seam.tips)}", remedy="give the position of the tip in every frame")


def _check_temperature(body: Body, n_frames: int) -> None:
    if body.temperature is None:
        return
    start = body.start_temperature
    if start is not None and not (np.shape(start) == (body.mesh.n_nodes,) and np.isfinite(start).all()):
        raise InputError("the temperature at the first frame does not fit the mesh",
                         expected=f"{body.mesh.n_nodes} numbers",
                         found=str(np.shape(start)), remedy="give a temperature for every node")
    expected = (n_frames, body.mesh.n_nodes)
    if body.temperature.shape != expected:
        raise InputError("temperatures of inconsistent size", expected=f"{expected}: one per frame and node",
                         found=str(body.temperature.shape), remedy="give a temperature for every frame and node")
    if not np.isfinite(body.temperature).all():
        frame, node = np.argwhere(~np.isfinite(body.temperature))[0]
        raise InputError(f"the temperature of node {body.mesh.node_labels[node]} is not a number at frame {frame}",
                         remedy="check the log or the infrared images")


def _check_rigid_motion(body: Body) -> None:
    """Every part of the body must be held against translation and rotation."""
    mesh = body.mesh
    names = [f"translation along {'xyz'[i]}" for i in range(mesh.n_dim)]
    names += ["rotation"] if mesh.n_dim == 2 else [f"rotation about {axis}" for axis in "xyz"]
    for part in free_parts(mesh, np.asarray(body.constraints.dofs)):
        weights = np.abs(part.motions).max(axis=1)
        motions = [name for name, weight in zip(names, weights, strict=True) if weight > MIN_NAMED * weights.max()]
        piece = f"the piece with node {mesh.node_labels[part.nodes[0]]} ({len(part.nodes)} nodes)"
        description = f"{', '.join(motions)} of {piece}"
        raise InputError("rigid motion not prevented: the stiffness matrix is singular",
                         expected="prescribed displacements that hold every piece of the body",
                         found=f"{description} is free" + (", which hangs on the rest by single nodes"
                                                           if part.hangs else ""),
                         remedy="prescribe further components in [[boundary]]"
                         + (", or join the pieces by whole faces of elements" if part.hangs else ""))
