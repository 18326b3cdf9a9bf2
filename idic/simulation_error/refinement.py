"""A test on a finer mesh: quadratic elements in the place of linear ones, else elements of half the size.

Boundary conditions, loads, fields of temperature and frame-local unknowns are carried over; a motion on the finer mesh
comes back as its mean-square projection onto the functions of the given one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.errors import InputError
from idic.fe import Mesh, curved, halve, raise_order
from idic.model import DriveTable, Experiment, Parametrised, Prescribed, TemperatureField

RAISED = "quadratic elements"  # in the place of linear ones


@dataclass(frozen=True)
class Refined:
    """The same test on a finer mesh.

    coarse : on the given one; carry : nodal fields onto the finer mesh's nodes  # (n_fine, n_coarse); way : in words
    """

    coarse: Experiment
    experiment: Experiment
    carry: sparse.csr_array
    way: str

    @property
    def is_raised(self) -> bool:
        """Whether elements of higher order, and not smaller ones, make the mesh finer: little is left then."""
        return self.way == RAISED

    def carried_local(self, local: np.ndarray) -> np.ndarray:
        """Frame-local unknowns on the finer mesh: measured edges interpolated along them, all others as they are
        # (n_frames, m) mm -> (n_frames, m_fine)"""
        coarse, finer, dim = DriveTable.of(self.coarse), DriveTable.of(self.experiment), self.coarse.model.n_dim
        motion = np.zeros((len(local), self.coarse.model.mesh.n_nodes * dim))
        measured = np.flatnonzero(coarse.measured[:len(coarse.local)])
        motion[:, coarse.dofs] = local[:, measured] @ coarse.basis[:, np.array(coarse.local, dtype=int)[measured]].T
        nodal = motion.reshape(len(local), -1, dim)
        fine = np.stack([(self.carry @ nodal[:, :, i].T).T for i in range(dim)], axis=2).reshape(len(local), -1)
        carried = np.zeros((len(local), finer.n_local))
        carried[:, np.flatnonzero(~finer.measured)] = local[:, np.flatnonzero(~coarse.measured)]
        for column, dof in measured_dofs(finer).items():
            carried[:, column] = fine[:, dof]
        return carried

    def difference(self) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """Function of a motion on the given mesh and one on the finer mesh, (n, k) mm each: the second one less the
        first one, on the given mesh  # (n_coarse, k) mm"""
        on_coarse = projection(self.experiment.model.mesh, self.carry)
        return lambda coarse, finer: on_coarse(finer - self.carry @ coarse)


def refined(experiment: Experiment, raise_bricks: bool = False) -> Refined:
    """The experiment on quadratic elements where it has linear ones, else (and bricks) on elements of half the size.

    raise_bricks : whether linear bricks are computed as quadratic ones too, which have half as many nodes

    Raises
    ------
    InputError
        An external solver, whose mesh is its own; a mesh that a crack cuts; tetrahedra of second order.
    """
    model = experiment.model
    mesh = model.mesh
    if model.solver is not None:
        raise InputError("an external solver has its own mesh", expected="the built-in solver", found="external",
                         remedy="refine the mesh of the external solver and identify again")
    if model.cracks:
        raise InputError("a mesh that a crack cuts is not refined", expected="a model without [[crack]]",
                         found=", ".join(crack.name for crack in model.cracks),
                         remedy="identify again with smaller elements, and compare")
    if mesh.is_raised_by_default or (raise_bricks and mesh.can_raise_order):
        fine, way = curved(raise_order(mesh)), RAISED
        carry = _midpoints(mesh.n_nodes, fine)
    elif mesh.can_halve:
        halved = halve(mesh)
        fine, carry, way = halved.mesh, halved.carry, "elements of half the size"
    else:
        raise InputError("these elements are not refined", expected="triangles, quadrilaterals, bricks, tet4",
                         found=", ".join(block.cell for block in mesh.blocks),
                         remedy="use such elements, or compare with an identification on a finer mesh")
    remeshed = replace(experiment, model=replace(model, mesh=fine, motion_error=None))
    prescribed = tuple(_carried_shapes(experiment, remeshed, carry, entry) for entry in model.prescribed)
    temperatures = tuple(
        replace(entry, drive=replace(entry.drive, values=(carry @ entry.drive.values.T).T))
        if isinstance(entry.drive, TemperatureField) else entry for entry in model.temperatures)
    morphs = tuple(replace(morph, velocity=carry @ morph.velocity) for morph in model.morphs)
    finer = replace(remeshed, model=replace(remeshed.model, prescribed=prescribed, temperatures=temperatures,
                                            morphs=morphs))
    return Refined(experiment, finer, carry, way)


def projection(mesh: Mesh, carry: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """Mean-square projection of nodal fields of a finer mesh onto the functions of the given one.

    carry : (n_fine, n_coarse) the given functions at the fine nodes

    Returns
    -------
    function (n_fine, k) -> (n_coarse, k)
    """
    values, weights = [], []
    for block in mesh.blocks:
        xi, w = block.kind.quadrature_rule()
        n, (q, nodes) = block.n_elements, block.kind.shape_functions(xi).shape
        jacobians = np.einsum("qad,eai->eqdi", block.kind.shape_gradients(xi), mesh.nodes[block.connectivity])
        weights.append((w * np.abs(np.linalg.det(jacobians))).ravel())
        columns = np.repeat(block.connectivity[:, None], q, axis=1).ravel()
        values.append(sparse.csr_array((np.tile(block.kind.shape_functions(xi).ravel(), n), columns,
                                        np.arange(0, n * q * nodes + 1, nodes)), shape=(n * q, mesh.n_nodes)))
    at_points = sparse.vstack(values, format="csr")
    coarse = (at_points @ carry).tocsr()
    weighed = (coarse.T * np.concatenate(weights)).tocsr()
    solve = splu((weighed @ coarse).tocsc()).solve
    return lambda field: solve(weighed @ (at_points @ field))


def measured_dofs(drives: DriveTable) -> dict[int, int]:
    """Column of the frame-local unknowns -> degree of freedom of the measured edge that it alone moves."""
    by_one_drive = (drives.basis != 0.0).sum(axis=1) == 1
    return {column: int(drives.dofs[np.flatnonzero(by_one_drive & (drives.basis[:, drive] != 0.0))[0]])
            for column, (drive, measured) in enumerate(zip(drives.local, drives.measured, strict=False))
            if measured and drives.basis[:, drive].any()}


def _carried_shapes(experiment: Experiment, finer: Experiment, carry: sparse.csr_array,
                    entry: Prescribed) -> Prescribed:
    """Shapes of a measured boundary's own modes on the nodes of the finer edge."""
    drive = entry.drive
    if not isinstance(drive, Parametrised) or drive.shapes is None:
        return entry
    nodal = np.zeros((experiment.model.mesh.n_nodes, drive.shapes.shape[1]))
    nodal[experiment.model.node_set(entry.nodes)] = drive.shapes
    return replace(entry, drive=replace(drive, shapes=(carry @ nodal)[finer.model.node_set(entry.nodes)]))


def _midpoints(n_old: int, fine: Mesh) -> sparse.csr_array:
    """Nodal fields on a mesh of raised order: old nodes, then the means of the ends of each edge."""
    rows, columns = [], []
    ends: dict[int, tuple[int, int]] = {}
    for block in fine.blocks:
        cell = block.kind
        pairs = block.kind.edges
        for nodes in block.connectivity.tolist():
            ends.update({nodes[cell.n_corners + i]: (nodes[a], nodes[b]) for i, (a, b) in enumerate(pairs)})
    for node, pair in ends.items():
        rows += [node, node]
        columns += pair
    corners = np.arange(n_old)
    values = np.concatenate([np.ones(n_old), np.full(len(rows), 0.5)])
    return sparse.csr_array((values, (np.concatenate([corners, rows]), np.concatenate([corners, columns]))),
                            shape=(len(fine.nodes), n_old))
