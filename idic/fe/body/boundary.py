"""Boundary conditions: prescribed motion, dead loads, follower pressure; helpers that make them from mesh sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from idic.errors import InputError
from idic.fe.mesh.element import cell_type
from idic.fe.mesh.mesh import Mesh
from idic.fe.body.body import Constraints, Direction, Body


# from sets to dofs and load vectors ---------------------------------------------------------------
def dofs_of(nodes: np.ndarray, component: str | int, n_dim: int) -> np.ndarray:
    """Dofs of one component ("x", "y", "z" or 0, 1, 2) of some nodes  # (n,)"""
    index = "xyz".index(component) if isinstance(component, str) else component
    return np.asarray(nodes, dtype=np.int64) * n_dim + index


def constrain(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], n_frames: int) -> Constraints:
    """Constraints out of parts ``(dofs (n,), basis (n, m), histories (n_frames, m))``; drives numbered in this order.

    m = 0 holds the dofs at rest. A dof held at rest by several parts is kept once; any other repetition is left for
    the model's validation to refuse.
    """
    n_drives = sum(part[1].shape[1] for part in parts)
    dofs, rows, histories, first = [], [], np.zeros((n_frames, n_drives)), 0
    at_rest: set[int] = set()
    for part_dofs, basis, history in parts:
        m = basis.shape[1]
        histories[:, first:first + m] = history
        for dof, row in zip(part_dofs, basis, strict=True):
            if m == 0 and int(dof) in at_rest:
                continue
            if m == 0:
                at_rest.add(int(dof))
            full = np.zeros(n_drives)
            full[first:first + m] = row
            dofs.append(int(dof))
            rows.append(full)
        first += m
    return Constraints(np.array(dofs, dtype=np.int64), np.array(rows).reshape(len(dofs), n_drives), histories)


def traction(mesh: Mesh, faces: np.ndarray, vector: Sequence[float], thickness: float = 1.0) -> np.ndarray:
    """Nodal forces (n_dof,) N of a dead traction `vector` (d,) MPa on edges or faces (n, 2) of the reference shape."""
    force = np.zeros(mesh.nodes.shape)
    for nodes, shape, normal_area in _face_points(mesh, faces):
        area = np.linalg.norm(normal_area, axis=1)
        force[nodes] += np.outer(shape.T @ area, np.asarray(vector, dtype=float)) * _depth(mesh, thickness)
    return force.ravel()


def dead_pressure(mesh: Mesh, faces: np.ndarray, thickness: float = 1.0) -> np.ndarray:
    """Nodal forces (n_dof,) of a unit pressure that keeps the direction of the reference normal; N per MPa."""
    force = np.zeros(mesh.nodes.shape)
    for nodes, shape, normal_area in _face_points(mesh, faces):
        force[nodes] -= shape.T @ normal_area * _depth(mesh, thickness)
    return force.ravel()


def face_area(mesh: Mesh, faces: np.ndarray, thickness: float = 1.0) -> float:
    """Area of edges (times thickness) or faces in the reference shape, mm²."""
    areas = [float(np.linalg.norm(normal, axis=1).sum()) for _, _, normal in _face_points(mesh, faces)]
    return sum(areas) * _depth(mesh, thickness)


def _depth(mesh: Mesh, thickness: float) -> float:
    return thickness if mesh.n_dim == 2 else 1.0


def _face_points(mesh: Mesh, faces: np.ndarray):
    """Nodes, shape functions (nq, nf) and outward normal times weighted area (nq, d) of each face."""
    for face in np.asarray(faces).reshape(-1, 2):
        kind = mesh.block_of(int(face[0])).kind.face_cell
        nodes = mesh.face_nodes(face)
        points, weights = cell_type(kind).quadrature_rule()
        tangents = np.einsum("qai,ak->qik", cell_type(kind).shape_gradients(points), mesh.nodes[nodes])
        yield nodes, cell_type(kind).shape_functions(points), _normal(tangents) * weights[:, None]


def _normal(tangents: np.ndarray) -> np.ndarray:
    """Outward normal times area ratio; tangents (nq, d - 1, d)."""
    if tangents.shape[1] == 1:
        return np.stack([tangents[:, 0, 1], -tangents[:, 0, 0]], axis=1)
    return np.cross(tangents[:, 0], tangents[:, 1])


# follower pressure --------------------------------------------------------------------------------
@dataclass(frozen=True)
class PressureFaces:
    """Faces of one kind under one follower pressure, ready for the Newton iteration."""

    load: int  # column of `pressure_histories`
    nodes: np.ndarray  # (n, nf)
    dofs: np.ndarray  # (n, nf * d)
    shape: np.ndarray  # (nq, nf)
    slope: np.ndarray  # (nq, nf, d - 1)
    weights: np.ndarray  # (nq,)
    depth: float  # thickness in mm (2D)


def pressure_faces(body: Body) -> tuple[PressureFaces, ...]:
    """The model's follower pressures, grouped by kind of face."""
    mesh, groups = body.mesh, []
    for load, faces in enumerate(body.loads.pressure_faces):
        faces = np.asarray(faces).reshape(-1, 2)
        if len(faces) == 0:
            raise InputError("a pressure acts on no edge", remedy="check the edge set of the load")
        kinds = np.array([mesh.block_of(int(e)).kind.face_cell for e in faces[:, 0]])
        for kind in np.unique(kinds):
            nodes = np.array([mesh.face_nodes(f) for f in faces[kinds == kind]])
            dofs = (nodes[:, :, None] * mesh.n_dim + np.arange(mesh.n_dim)).reshape(len(nodes), -1)
            face = cell_type(str(kind))
            points, weights = face.quadrature_rule()
            groups.append(PressureFaces(load, nodes, dofs, face.shape_functions(points), face.shape_gradients(points),
                                        weights, _depth(mesh, body.thickness)))
    return tuple(groups)


def pressure_force(faces: PressureFaces, x: np.ndarray) -> np.ndarray:
    """Nodal forces per unit pressure on the present shape  # (n, nf, d) N/MPa; x (n_nodes, d) present coordinates"""
    tangents = np.einsum("qai,eak->eqik", faces.slope, x[faces.nodes])
    normal = _normal(tangents.reshape(-1, *tangents.shape[2:])).reshape(*tangents.shape[:2], -1)
    return -faces.depth * np.einsum("q,qa,eqk->eak", faces.weights, faces.shape, normal)


def pressure_stiffness(faces: PressureFaces, x: np.ndarray) -> np.ndarray:
    """Derivative of `pressure_force` with respect to the nodal displacement  # (n, nf * d, nf * d)"""
    n, nf = faces.nodes.shape
    d = x.shape[1]
    K = np.zeros((n, nf, d, nf, d))
    if d == 2:  # n ds = (dy, -dx): constant
        L = faces.depth * np.einsum("q,qa,qb->ab", faces.weights, faces.shape, faces.slope[:, :, 0])
        K[:, :, 0, :, 1] = -L
        K[:, :, 1, :, 0] = L
    else:
        t = np.einsum("qai,eak->eqik", faces.slope, x[faces.nodes])
        levi = np.zeros((3, 3, 3))
        levi[[0, 1, 2], [1, 2, 0], [2, 0, 1]], levi[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = 1, -1
        dn = (np.einsum("kcm,qb,eqm->eqkbc", levi, faces.slope[:, :, 0], t[:, :, 1])
              + np.einsum("kmc,qb,eqm->eqkbc", levi, faces.slope[:, :, 1], t[:, :, 0]))
        K -= np.einsum("q,qa,eqkbc->eakbc", faces.weights, faces.shape, dn)
    return K.reshape(n, nf * d, nf * d)


# values in time -----------------------------------------------------------------------------------
@dataclass(frozen=True)
class Drives:
    """What moves the body at one time: prescribed values (n_p,) mm, dead load factors, pressures (MPa), and the change
    of temperature (n_nodes,) in K, None for an isothermal body.

    tips : (n_seams,) mm, positions of the tips of cracks
    reading : of the gauge that controls the path; amplitude : of the drive or load that it decides, in the values above
    """

    time: float
    prescribed: np.ndarray
    dead: np.ndarray
    pressure: np.ndarray
    temperature: np.ndarray | None = None
    reading: float = 0.0
    amplitude: float = 0.0
    tips: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def as_vector(self) -> np.ndarray:
        """What scales the motion; not the temperature, whose noise would spoil every extrapolation."""
        return np.concatenate([self.prescribed, self.dead, self.pressure])


def at_time(table: np.ndarray | None, times: np.ndarray, t: float) -> np.ndarray:
    """Value of histories (n_frames, m) at time t, linear between frames, zero at the first frame."""
    if table is None:
        return np.zeros(0)
    k = int(np.clip(np.searchsorted(times, t, side="left"), 1, len(times) - 1)) if len(times) > 1 else 0
    if k == 0:
        return np.zeros(table.shape[1])
    if t == times[k]:
        return np.array(table[k], dtype=float)
    s = (t - times[k - 1]) / (times[k] - times[k - 1])
    start_value = table[k - 1] if k > 1 else 0.0
    return (1 - s) * start_value + s * table[k]


def drives_at(body: Body, times: np.ndarray, t: float) -> Drives:
    """The drives of a model at time t."""
    c = body.constraints
    return Drives(t, c.basis @ at_time(c.histories, times, t), at_time(body.loads.dead_histories, times, t),
                  at_time(body.loads.pressure_histories, times, t), _temperature_at(body.temperature, times, t),
                  0.0 if body.control is None else _reading_at(body.control.readings, times, t),
                  tips=np.array([np.interp(t, times, seam.tips) for seam in body.seams]))


def with_amplitude(body: Body, drives: Drives, amplitude: float) -> Drives:
    """The drives with another size of what the gauge of the model controls."""
    control, more = body.control, amplitude - drives.amplitude
    if control.drive is not None:
        prescribed = drives.prescribed + more * body.constraints.basis[:, control.drive]
        return replace(drives, prescribed=prescribed, amplitude=amplitude)
    loads = np.concatenate([drives.dead, drives.pressure])
    loads[control.load] += more
    n_dead = len(drives.dead)
    return replace(drives, dead=loads[:n_dead], pressure=loads[n_dead:], amplitude=amplitude)


def _tip_changes(body: Body, direction: Direction, times: np.ndarray, t: float) -> np.ndarray:
    if direction.d_tips is None:
        return np.zeros(len(body.seams))
    return np.array([np.interp(t, times, column) for column in direction.d_tips.T])


def _reading_at(readings: np.ndarray, times: np.ndarray, t: float) -> float:
    return float(at_time(readings[:, None], times, t)[0])


def _temperature_at(table: np.ndarray | None, times: np.ndarray, t: float) -> np.ndarray | None:
    return None if table is None else at_time(table, times, t)


def drive_changes(body: Body, directions: Sequence[Direction], times: np.ndarray, t: float) -> list[Drives]:
    """Derivative of the drives along each direction at time t."""
    n_p, loads = len(body.constraints.dofs), body.loads
    n_dead = 0 if loads.dead is None else loads.dead.shape[1]
    changes = []
    for direction in directions:
        prescribed, factors = np.zeros(n_p), np.zeros(n_dead + len(loads.pressure_faces))
        if direction.d_histories is not None:
            prescribed = body.constraints.basis @ at_time(direction.d_histories, times, t)
        if direction.d_loads is not None:
            factors = at_time(direction.d_loads, times, t)
        changes.append(Drives(t, prescribed, factors[:n_dead], factors[n_dead:],
                              _temperature_at(direction.d_temperature, times, t),
                              0.0 if direction.d_readings is None else _reading_at(direction.d_readings, times, t),
                              tips=_tip_changes(body, direction, times, t)))
    return changes
