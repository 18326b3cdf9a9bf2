"""A test on a finer mesh: quadratic elements in the place of linear ones, else elements of half the size.

Boundary conditions, loads, fields of temperature and frame-local unknowns are carried over.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from idic.errors import InputError
from idic.fe import (
    Mesh, can_halve, can_raise_order, cell_edges, cell_type, curved, halve, is_raised_by_default, raise_order,
)
from idic.model import DriveTable, Experiment, Parametrised, Prescribed, TemperatureField, set_nodes

RAISED = "quadratic elements"  # in the place of linear ones


@dataclass(frozen=True)
class Refined:
    """The same test on a finer mesh; how : in words; carry : nodal fields onto its nodes  # (n_new, n_old)"""

    experiment: Experiment
    carry: sparse.csr_array
    how: str


def refined(experiment: Experiment, raise_bricks: bool = False) -> Refined:
    """The experiment on quadratic elements where it has linear ones, else (and bricks) on elements of half the size.

    raise_bricks : whether linear bricks are computed as quadratic ones too, which have half as many nodes

    Raises
    ------
    InputError
        An external solver, whose mesh is its own; tetrahedra of second order.
    """
    mesh = experiment.mesh
    if experiment.solver is not None:
        raise InputError("an external solver has its own mesh", expected="the built-in solver", found="external",
                         remedy="refine the mesh of the external solver and identify again")
    if is_raised_by_default(mesh) or (raise_bricks and can_raise_order(mesh)):
        fine, how = curved(raise_order(mesh)), RAISED
        carry = _midpoints(mesh.n_nodes, fine)
    elif can_halve(mesh):
        found = halve(mesh)
        fine, carry, how = found.mesh, found.carry, "elements of half the size"
    else:
        raise InputError("these elements are not refined", expected="triangles, quadrilaterals, bricks, tet4",
                         found=", ".join(block.cell for block in mesh.blocks),
                         remedy="use such elements, or compare with an identification on a finer mesh")
    made = replace(experiment, mesh=fine, motion_error=None)
    prescribed = tuple(_carried_shapes(experiment, made, carry, entry) for entry in experiment.prescribed)
    temperatures = tuple(
        replace(entry, drive=replace(entry.drive, values=(carry @ entry.drive.values.T).T))
        if isinstance(entry.drive, TemperatureField) else entry for entry in experiment.temperatures)
    morphs = tuple(replace(morph, velocity=carry @ morph.velocity) for morph in experiment.morphs)
    return Refined(replace(made, prescribed=prescribed, temperatures=temperatures, morphs=morphs), carry, how)


def carried_local(old: DriveTable, new: DriveTable, experiment: Experiment, finer: Refined,
                  local: np.ndarray) -> np.ndarray:
    """Frame-local unknowns on the finer mesh: measured edges interpolated along them, all others as they are.

    Returns
    -------
    array (n_frames, m_new) mm
    """
    dim = experiment.n_dim
    motion = np.zeros((len(local), experiment.mesh.n_nodes * dim))
    own = np.flatnonzero(old.measured[:len(old.local)])
    motion[:, old.dofs] = local[:, own] @ old.basis[:, np.array(old.local, dtype=int)[own]].T
    nodal = motion.reshape(len(local), -1, dim)
    fine = np.stack([(finer.carry @ nodal[:, :, i].T).T for i in range(dim)], axis=2).reshape(len(local), -1)
    carried = np.zeros((len(local), new.n_local))
    carried[:, np.flatnonzero(~new.measured)] = local[:, np.flatnonzero(~old.measured)]
    for column, dof in _measured_dofs(new).items():
        carried[:, column] = fine[:, dof]
    return carried


def _measured_dofs(drives: DriveTable) -> dict[int, int]:
    """Column of the frame-local unknowns -> degree of freedom of the measured edge that it alone moves."""
    alone = (drives.basis != 0.0).sum(axis=1) == 1
    return {column: int(drives.dofs[np.flatnonzero(alone & (drives.basis[:, drive] != 0.0))[0]])
            for column, (drive, measured) in enumerate(zip(drives.local, drives.measured, strict=False))
            if measured and drives.basis[:, drive].any()}


def _carried_shapes(experiment: Experiment, made: Experiment, carry: sparse.csr_array,
                    entry: Prescribed) -> Prescribed:
    """Shapes of a measured boundary's own modes on the nodes of the finer edge."""
    drive = entry.drive
    if not isinstance(drive, Parametrised) or drive.shapes is None:
        return entry
    whole = np.zeros((experiment.mesh.n_nodes, drive.shapes.shape[1]))
    whole[set_nodes(experiment, entry.nodes)] = drive.shapes
    return replace(entry, drive=replace(drive, shapes=(carry @ whole)[set_nodes(made, entry.nodes)]))


def _midpoints(n_old: int, fine: Mesh) -> sparse.csr_array:
    """Nodal fields on a mesh of raised order: old nodes, then the means of the ends of each edge."""
    rows, columns = [], []
    ends: dict[int, tuple[int, int]] = {}
    for block in fine.blocks:
        cell = cell_type(block.cell)
        pairs = cell_edges(block.cell)
        for nodes in block.connectivity.tolist():
            ends.update({nodes[cell.n_corners + i]: (nodes[a], nodes[b]) for i, (a, b) in enumerate(pairs)})
    for node, pair in ends.items():
        rows += [node, node]
        columns += pair
    old = np.arange(n_old)
    values = np.concatenate([np.ones(n_old), np.full(len(rows), 0.5)])
    return sparse.csr_array((values, (np.concatenate([old, rows]), np.concatenate([old, columns]))),
                            shape=(len(fine.nodes), n_old))
