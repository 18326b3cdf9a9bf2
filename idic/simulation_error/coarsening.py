"""A test on a coarser mesh: of how much a mesh changes, when a finer one is too large to be simulated.

The error of a mesh is taken to grow with the power p of the size of its elements. A mesh of elements r times as large
then errs r^p times as much, and the given mesh errs by

    1 / (r^p - 1)

of the change between the two (Richardson 1911, doi:10.1098/rsta.1911.0009). p = 1.2 is that of the force on one bar
between rigid grips with 8, 16 and 31 cubed hex8 (studies/evidence/volumes/scale.py), and was tried on no other body.
Motion inside that bar converges faster: its error is taken too large rather than too small. Sign and pattern are
not trusted: of such a bar on 12 cubed hex8, whose parameters err by that size, the residual held -0.06 +- 0.10 of it.

The coarser mesh is the given one with layers of bricks taken out (`idic.fe.Coarse`). Its motion between its nodes
is that of its own functions, whose error counts too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from scipy import sparse

from idic.fe import Coarse, PerMesh, interpolation
from idic.model import Controlled, DriveTable, Experiment, Model, Parametrised
from idic.simulation_error.refinement import measured_dofs

GROWTH = 2.0  # of the elements' size, about
MIN_GROWTH = 1.5  # less tells too little
ORDER = 1.2  # of convergence

_COARSE = PerMesh()


@dataclass(frozen=True, eq=False)
class Coarsened:
    """The same test on a coarser mesh.

    fine : on the given mesh; experiment : on the coarser one; nodes : which of the given nodes its nodes are; growth :
    of the size of the elements
    """

    fine: Experiment
    experiment: Experiment
    nodes: np.ndarray
    growth: float

    @property
    def error_share(self) -> float:
        """Error of the given mesh over its change from the coarser one."""
        return float(1.0 / (self.growth**ORDER - 1.0))

    def carried_local(self, local: np.ndarray | None) -> np.ndarray | None:
        """Frame-local unknowns on the coarser mesh: those of its nodes, and all that belong to no node
        # (n_frames, m) mm -> (n_frames, m_coarse)"""
        if local is None:
            return None
        fine, coarse, d = DriveTable.of(self.fine), DriveTable.of(self.experiment), self.fine.model.n_dim
        carried = np.zeros((len(local), coarse.n_local))
        carried[:, np.flatnonzero(~coarse.measured)] = local[:, np.flatnonzero(~fine.measured)]
        columns = {dof: column for column, dof in measured_dofs(fine).items()}
        for column, dof in measured_dofs(coarse).items():
            carried[:, column] = local[:, columns[d * self.nodes[dof // d] + dof % d]]
        return carried

    def carry(self) -> sparse.csr_array:
        """Nodal fields of the coarser mesh at the given nodes  # (n_nodes, n_coarse)

        Beside a curved surface that the coarser mesh cuts off: as at the nearest node.
        """
        fine, coarse = self.fine.model.mesh, self.experiment.model.mesh
        between = np.setdiff1d(np.arange(fine.n_nodes), self.nodes)
        weights, inside = interpolation(coarse.nodes, coarse.blocks, fine.nodes[between])
        outside, within = between[~inside], weights.tocoo()
        _, nearest = scipy.spatial.cKDTree(coarse.nodes).query(fine.nodes[outside])
        rows = np.concatenate([self.nodes, between[within.row], outside])
        columns = np.concatenate([np.arange(coarse.n_nodes), within.col, nearest])
        values = np.concatenate([np.ones(coarse.n_nodes), within.data, np.ones(len(outside))])
        return sparse.csr_array((values, (rows, columns)), shape=(fine.n_nodes, coarse.n_nodes))


def coarsened(experiment: Experiment) -> Coarsened | None:
    """The test on elements about twice as large; None where no layers of linear bricks can be taken out of a solid, or
    something is bound to the nodes that go: shapes, cracks, a gauge that drives the test."""
    coarse = _coarse(experiment.model)
    if coarse is None:
        return None
    return Coarsened(experiment, experiment.on_coarse_mesh(coarse), coarse.nodes, _growth(experiment.model, coarse))


def _coarse(model: Model) -> Coarse | None:
    shaped = model.morphs or model.cracks or any(isinstance(drive, Parametrised | Controlled) for drive in model.drives)
    if model.n_dim != 3 or model.solver is not None or shaped or not model.mesh.can_raise_order:
        return None
    number = int(model.mesh.n_elements / GROWTH**3)
    coarse = _COARSE.once(model.mesh, number, lambda: Coarse.of(model.mesh, number))
    return coarse if coarse is not None and _growth(model, coarse) >= MIN_GROWTH else None


def _growth(model: Model, coarse: Coarse) -> float:
    return float((model.mesh.n_elements / coarse.mesh.n_elements) ** (1.0 / 3.0))
