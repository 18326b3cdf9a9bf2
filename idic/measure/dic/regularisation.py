"""Regularisation of a measured displacement where the image has little information: mechanical or by gradient.

    minimise  sum_px r^2 + w |D u|^2

"mechanical": D u is the equilibrium gap div sigma(u) of an elastic body at the inner nodes (rows of K u, the tangent on
the same mesh, divided by the nodal area) and the second difference along the edges at the boundary nodes. Every affine
motion passes unchanged; of waves of length lambda the part 1/(1 + (l/lambda)^4) passes.
"gradient": D u = grad u (Tikhonov); 1/(1 + (l/lambda)^2) passes, and strain is damped at any length.

The weight w follows from the mean squared image gradient, so the length l means the same for every image: a wave of
that length is damped by half. Source: Rethore, Roux & Hild 2009, doi:10.3166/ejcm.18.239-257 (equilibrium gap).
docs/method.md, equation 13.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from idic.errors import InputError
from idic.fe import Block

KINDS = ("none", "mechanical", "gradient")
POISSON_RATIO = 0.3  # of the elastic tangent; the result hardly depends on it
_CORNER_COS = np.cos(np.radians(30.0))  # an edge that turns by more is a corner: no smoothness along the edge there


@dataclass(frozen=True)
class Regularisation:
    """How a free displacement is regularised.

    Attributes
    ----------
    kind : "none" | "mechanical" | "gradient"
    length_px : float or None
        Waves of this length are damped by half. None: `per_node` times the distance of the nodes, at least `least_px`.
    per_node, least_px : float
        By default the field keeps what its elements can describe: there noise times resolution is smallest
        (docs/dic-resolution.md).
    """

    kind: str = "mechanical"
    length_px: float | None = None
    per_node: float = 0.5
    least_px: float = 8.0

    def __post_init__(self):
        if self.kind not in KINDS:
            raise InputError("no such regularisation", key="regularisation", expected=", ".join(KINDS), found=self.kind,
                             remedy="write one of these names")
        if self.length_px is not None and not self.length_px > 0:
            raise InputError("not a regularisation length", key="length_px", expected="px, above 0",
                             found=self.length_px, remedy="give a length of one to some elements, in pixels")

    @classmethod
    def smooth(cls, kind: str = "mechanical") -> Regularisation:
        """Where a motion is searched for, judged, or shown on the fine mesh of a model: over twice the distance of the
        nodes, the length of the shortest wave on the mesh, and 24 px at least."""
        return cls(kind, per_node=2.0, least_px=24.0)

    def of_nodes(self, distance_px: float) -> float:
        """The length on a mesh with this distance of the nodes (px)."""
        return max(self.per_node * distance_px, self.least_px) if self.length_px is None else self.length_px


@dataclass(frozen=True, eq=False)
class Smoother:
    """A regularisation on one mesh in the image; make it with :func:`build_smoother`.

    Attributes
    ----------
    kind : str
    length_px : float
        0 for "none".
    operator : csr_array (n_rows, 2 n_nodes)
        D, scaled so that |D u|^2 approximates the integral over px^2 of the squared gap (px^-2) or gradient.
    row_node : array (n_rows,)
        Node that each row belongs to, -1 for "gradient" (rows of elements).
    neighbours : csr_array (n_nodes, n_nodes)
        Nodes that share an element.
    size_px : float
        Distance of neighbouring nodes (median).
    """

    kind: str
    length_px: float
    operator: sparse.csr_array
    row_node: np.ndarray
    neighbours: sparse.csr_array
    size_px: float

    def matrix(self, mean_square_gradient: float, unlocated: np.ndarray) -> sparse.csc_array:
        """w D^T D; the rows of `unlocated` nodes (not located by pixels) weigh at least as over one element.

        mean_square_gradient : (f_x^2 + f_y^2)/2 averaged over the ROI, GV^2/px^2; unlocated : (n_nodes,) bool.
        """
        order = 1 if self.kind == "gradient" else 2
        weight = np.full(len(self.row_node), (self.length_px / (2 * np.pi)) ** (2 * order))
        if self.kind == "none":
            weight[:] = 0.0
        if order == 2:
            in_unlocated = unlocated[self.row_node]
            weight[in_unlocated] = np.maximum(weight[in_unlocated], (2 * self.size_px / (2 * np.pi)) ** 4)
            if in_unlocated.any():
                weight = np.maximum(weight, 1e-5 * (2 * self.size_px / (2 * np.pi)) ** 4)  # a unique solution, no more
        rows = np.flatnonzero(weight)
        scaled = sparse.diags_array(np.sqrt(weight[rows] * mean_square_gradient)) @ self.operator[rows]
        return (scaled.T @ scaled).tocsc()

    def reached(self, measured: np.ndarray) -> np.ndarray:
        """Nodes within the regularisation length of a measured node, one element at least  # (n_nodes,) bool"""
        rings = max(1, round(self.length_px / self.size_px))
        reached_nodes = measured.copy()
        for _ in range(rings):
            reached_nodes |= (self.neighbours @ reached_nodes.astype(np.float64)) > 0
        return reached_nodes


def build_smoother(nodes_px: np.ndarray, cells: Sequence[Block], regularisation: Regularisation) -> Smoother:
    """Discretise a regularisation on the cells in the image.

    Parameters
    ----------
    nodes_px : array (n_nodes, 2)
        (column, row) of all nodes.
    cells : blocks of tri3, quad4, tri6, quad8
    """
    nodes_px = np.asarray(nodes_px, dtype=float)
    neighbours = _neighbours(len(nodes_px), cells)
    size = _node_distance(nodes_px, cells)
    length = regularisation.of_nodes(size)
    if regularisation.kind == "gradient":
        operator, row_node = _gradient_rows(nodes_px, cells)
    else:
        operator, row_node = _gap_rows(nodes_px, cells, neighbours)
    return Smoother(regularisation.kind, 0.0 if regularisation.kind == "none" else float(length), operator, row_node,
                    neighbours, size)


def _neighbours(n_nodes, cells):
    parts = [(np.repeat(block.connectivity, block.connectivity.shape[1], axis=1).ravel(),
              np.tile(block.connectivity, block.connectivity.shape[1]).ravel()) for block in cells]
    i, j = (np.concatenate(column) for column in zip(*parts, strict=True))
    graph = sparse.coo_array((np.ones(len(i)), (i, j)), shape=(n_nodes, n_nodes)).tocsr()
    graph.data[:] = 1.0
    return graph


def _node_distance(nodes_px, cells):
    """Median distance of neighbouring nodes along the edges, px."""
    distance = []
    for block in cells:
        x = nodes_px[block.connectivity[:, : block.kind.n_corners]]
        edges = np.linalg.norm(x - np.roll(x, -1, axis=1), axis=2).ravel()
        distance.append(edges / (2 if block.cell in ("tri6", "quad8") else 1))
    return float(np.median(np.concatenate(distance)))


def _slopes(nodes_px, block):
    """Shape function gradients and areas at the integration points  # (nel, nq, nn, 2) 1/px, (nel, nq) px^2"""
    xi, w = block.kind.quadrature_rule()
    slopes = block.kind.shape_gradients(xi)
    jacobian = np.einsum("eak,qai->eqki", nodes_px[block.connectivity], slopes)
    area = np.abs(np.linalg.det(jacobian)) * w
    return np.einsum("qai,eqik->eqak", slopes, np.linalg.inv(jacobian)), area


def _gradient_rows(nodes_px, cells):
    """Rows sqrt(area) du_c/dx_k at every integration point."""
    operators = []
    for block in cells:
        slopes, area = _slopes(nodes_px, block)
        nel, nq, nn, _ = slopes.shape
        values = np.sqrt(area)[:, :, None, None] * slopes  # (nel, nq, nn, 2)
        row = np.arange(nel * nq).reshape(nel, nq, 1)
        for c in range(2):
            for k in range(2):
                columns = np.broadcast_to(2 * block.connectivity[:, None, :] + c, (nel, nq, nn))
                operators.append(sparse.coo_array(
                    (values[..., k].ravel(), (np.broadcast_to(row, columns.shape).ravel(), columns.ravel())),
                    shape=(nel * nq, 2 * len(nodes_px))))
    operator = sparse.vstack(operators).tocsr()
    return operator, np.full(operator.shape[0], -1)


def _gap_rows(nodes_px, cells, neighbours):
    """Equilibrium gap at the inner nodes, second difference along the edge at the boundary nodes, times sqrt(area)."""
    n_nodes = len(nodes_px)
    stiffness, area = _stiffness(nodes_px, cells)
    previous, following = _along_boundary(n_nodes, cells)
    used = area > 0
    inner = np.flatnonzero(used & (previous < 0))
    scale = np.zeros(n_nodes)
    lame, shear = POISSON_RATIO / (1 - POISSON_RATIO**2), 0.5 / (1 + POISSON_RATIO)
    scale[inner] = 1.0 / np.sqrt(area[inner] * shear * (lame + 2 * shear))  # between longitudinal and transverse waves
    rows = np.repeat(scale, 2)
    gap = (sparse.diags_array(rows) @ stiffness).tocsr()[np.repeat(2 * inner, 2) + np.tile([0, 1], len(inner))]
    edge_nodes, edge = _edge_rows(nodes_px, area, previous, following, neighbours)
    edge_gap = sparse.kron(edge, sparse.eye_array(2), format="csr")
    return sparse.vstack([gap, edge_gap]).tocsr(), np.repeat(np.concatenate([inner, edge_nodes]), 2)


def _stiffness(nodes_px, cells):
    """Plane-stress stiffness of unit modulus and thickness, and the area of every node (diagonal mass scaling)."""
    lame, shear = POISSON_RATIO / (1 - POISSON_RATIO**2), 0.5 / (1 + POISSON_RATIO)
    n_nodes = len(nodes_px)
    total = sparse.csr_array((2 * n_nodes, 2 * n_nodes))
    nodal_area = np.zeros(n_nodes)
    for block in cells:
        g, area = _slopes(nodes_px, block)
        dot = np.einsum("eq,eqak,eqbk->eab", area, g, g)
        dyad = np.einsum("eq,eqai,eqbj->eaibj", area, g, g)
        k = lame * dyad + shear * dyad.transpose(0, 1, 4, 3, 2)
        k[:, :, 0, :, 0] += shear * dot
        k[:, :, 1, :, 1] += shear * dot
        dofs = (2 * block.connectivity[:, :, None] + np.arange(2)).reshape(len(k), -1)
        k = k.reshape(len(k), dofs.shape[1], dofs.shape[1])
        i, j = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        total = total + sparse.coo_array((k.ravel(), (i.ravel(), j.ravel())), shape=total.shape).tocsr()
        shape = block.kind.shape_functions(block.kind.quadrature_rule()[0])
        mass = np.einsum("eq,qa->ea", area, shape**2)
        np.add.at(nodal_area, block.connectivity, mass / mass.sum(axis=1, keepdims=True) * area.sum(axis=1)[:, None])
    return total, nodal_area


def _along_boundary(n_nodes, cells):
    """Boundary nodes on either side of each one, -1 elsewhere and where edges meet in a node  # 2 x (n_nodes,)"""
    segments = []
    for block in cells:
        for local in block.kind.faces:
            path = [local[0], *local[2:], local[1]]
            ends = block.connectivity[:, [local[0], local[1]]]
            segments.append(np.column_stack([ends, np.full(len(ends), path[1] if len(path) > 2 else -1)]))
            if len(path) > 2:
                segments[-1][:, 2] = block.connectivity[:, path[1]]
    edges = np.concatenate(segments)
    _, index, count = np.unique(np.sort(edges[:, :2], axis=1), axis=0, return_inverse=True, return_counts=True)
    outer = edges[count[index.ravel()] == 1]
    straight, curved = outer[outer[:, 2] < 0], outer[outer[:, 2] >= 0]
    links = np.concatenate([straight[:, :2], curved[:, [0, 2]], curved[:, [2, 1]]])
    links = np.concatenate([links, links[:, ::-1]])
    degree = np.bincount(links[:, 0], minlength=n_nodes)
    previous, following = np.full(n_nodes, -1), np.full(n_nodes, -1)
    previous[links[:, 0]] = links[:, 1]  # the last one written
    second_links = links[previous[links[:, 0]] != links[:, 1]]
    following[second_links[:, 0]] = second_links[:, 1]
    following[degree > 2] = -1
    return previous, following


def _edge_rows(nodes_px, area, previous, following, neighbours):
    """Second differences along the edge, zero for affine motion by the smallest change over the node's neighbours.

    Returns the nodes and a csr_array (n_edge_nodes, n_nodes).
    """
    nodes, rows, columns, values = [], [], [], []
    for i in np.flatnonzero((previous >= 0) & (following >= 0)):
        a, b = nodes_px[previous[i]] - nodes_px[i], nodes_px[following[i]] - nodes_px[i]
        la, lb = np.linalg.norm(a), np.linalg.norm(b)
        if -(a @ b) < _CORNER_COS * la * lb:
            continue
        around = neighbours.indices[neighbours.indptr[i] : neighbours.indptr[i + 1]]
        c = np.zeros(len(around))
        c[around == previous[i]], c[around == following[i]] = 2 / (la * (la + lb)), 2 / (lb * (la + lb))
        c[around == i] = -2 / (la * lb)
        offset = (nodes_px[around] - nodes_px[i]) / (la + lb)
        affine = np.column_stack([np.ones(len(around)), offset])
        c -= affine @ np.linalg.lstsq(affine.T @ affine, affine.T @ c, rcond=1e-10)[0]
        columns.append(around)
        values.append(c * np.sqrt(area[i]))
        rows.append(np.full(len(around), len(nodes)))
        nodes.append(i)
    if not nodes:
        return np.zeros(0, dtype=int), sparse.csr_array((0, len(nodes_px)))
    triplet = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return np.array(nodes), sparse.coo_array(triplet, shape=(len(nodes), len(nodes_px))).tocsr()
