"""Shape functions, quadrature and face tables of the cells, in the node numbering of Abaqus, CalculiX and VTK.

Reference cells: triangles on (0, 0), (1, 0), (0, 1); tetrahedra with a fourth corner on (0, 0, 1); quadrilaterals and
hexahedra on [-1, 1]^d. Corner nodes first, counter-clockwise; mid-side node ``k`` of a quad8 or tri6 lies on the edge
from corner ``k`` to corner ``k + 1``, those of a tet10 and a hex20 on the edges of `TET_EDGES`, `HEX_EDGES`.
Source: Hughes, The Finite Element Method (2000), chapter 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from idic.errors import InputError


@dataclass(frozen=True)
class Cell:
    """A kind of element.

    Attributes
    ----------
    faces : tuple of tuples
        Local nodes of each edge (2D) or face (3D); corners first. Walking an edge leaves the cell on the left, and the
        corners of a face run counter-clockwise seen from outside: the normal points outwards.
    face_cell : str
        Kind of the faces: "line2", "line3", "tri3", "tri6", "quad4" or "quad8".
    order : int
        Default quadrature order: the number of points per direction (triangles, tetrahedra: the degree integrated).
    """

    name: str
    dim: int
    n_nodes: int
    n_corners: int
    reference_nodes: np.ndarray  # (n_nodes, dim)
    faces: tuple[tuple[int, ...], ...]
    face_cell: str
    order: int

    @property
    def edges(self) -> tuple[tuple[int, int], ...]:
        """Corner pairs of the edges, in the order of the mid-side nodes of the quadratic kind."""
        if self.name.startswith("tet"):
            return TET_EDGES
        if self.name.startswith("hex"):
            return HEX_EDGES
        return tuple((k, (k + 1) % self.n_corners) for k in range(self.n_corners))

    @property
    def n_face_corners(self) -> int:
        """Corners of each face (edge)."""
        return cell_type(self.face_cell).n_corners

    def shape_functions(self, points: np.ndarray) -> np.ndarray:
        """Shape functions at reference points  # (n, dim) dimensionless -> (n, n_nodes) dimensionless"""
        return _tables(self.name, np.atleast_2d(np.asarray(points, dtype=float)))[0]

    def shape_gradients(self, points: np.ndarray) -> np.ndarray:
        """Derivatives of the shape functions by the reference coordinates  # (n, dim) -> (n, n_nodes, dim)"""
        return _tables(self.name, np.atleast_2d(np.asarray(points, dtype=float)))[1]

    def quadrature_rule(self, order: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Gauss points (n, dim) and weights (n,); order : as above, None: the default"""
        return _quadrature(self.name, self.order if order is None else order)


_TRI = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
_QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float)
_HEX = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
                dtype=float)
TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))  # of the mid-side nodes, in their order
_TET_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
_TET = np.vstack([_TET_CORNERS, *[_TET_CORNERS[list(edge)].mean(axis=0) for edge in TET_EDGES]])
_LINE = np.array([[-1.0], [1.0], [0.0]])
HEX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
_HEX20 = np.vstack([_HEX, *[_HEX[list(edge)].mean(axis=0) for edge in HEX_EDGES]])
_HEX_FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # Abaqus S1..S6
_HEX20_FACES = tuple((*face, *(8 + [set(edge) for edge in HEX_EDGES].index({a, b})
                               for a, b in zip(face, (*face[1:], face[0]), strict=True))) for face in _HEX_FACES)
_TET_FACES = ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9))  # Abaqus S1..S4

# cells by what another discretisation of the same body takes in their place
QUADRATIC = {"tri3": "tri6", "quad4": "quad8", "tet4": "tet10", "hex8": "hex20"}
RAISED_BY_DEFAULT = ("tri3", "quad4", "tet4")  # hex8 has a remedy against locking, and hex20 three times its nodes
HALVED_AS = {"tri3": "tri3", "tri6": "tri3", "quad4": "quad4", "quad8": "quad4", "hex8": "hex8", "hex20": "hex8"}

CELL_TYPES = {
    c.name: c
    for c in (
        Cell("line2", 1, 2, 2, _LINE[:2], ((0,), (1,)), "", 2),
        Cell("line3", 1, 3, 2, _LINE, ((0,), (1,)), "", 3),
        Cell("tri3", 2, 3, 3, _TRI[:3], ((0, 1), (1, 2), (2, 0)), "line2", 1),
        Cell("tri6", 2, 6, 3, _TRI, ((0, 1, 3), (1, 2, 4), (2, 0, 5)), "line3", 2),
        Cell("quad4", 2, 4, 4, _QUAD[:4], ((0, 1), (1, 2), (2, 3), (3, 0)), "line2", 2),
        Cell("quad8", 2, 8, 4, _QUAD, ((0, 1, 4), (1, 2, 5), (2, 3, 6), (3, 0, 7)), "line3", 2),
        Cell("tet4", 3, 4, 4, _TET[:4], tuple(face[:3] for face in _TET_FACES), "tri3", 1),
        Cell("tet10", 3, 10, 4, _TET, _TET_FACES, "tri6", 2),
        Cell("hex8", 3, 8, 8, _HEX, _HEX_FACES, "quad4", 2),
        Cell("hex20", 3, 20, 8, _HEX20, _HEX20_FACES, "quad8", 2),  # reduced integration: no volumetric locking
    )
}


def cell_type(name: str) -> Cell:
    """The cell called `name`; InputError naming the cells there are if it is unknown."""
    try:
        return CELL_TYPES[name]
    except KeyError:
        raise InputError(f"element type {name!r} is not supported", expected=", ".join(CELL_TYPES), found=name,
                         remedy="mesh the specimen with one of these") from None


@cache
def _quadrature(name: str, order: int) -> tuple[np.ndarray, np.ndarray]:
    if name.startswith("tri"):
        return _triangle_rule(order)
    if name.startswith("tet"):
        return _tetrahedron_rule(order)
    x, w = np.polynomial.legendre.leggauss(order)
    dim = cell_type(name).dim
    grid = np.meshgrid(*[x] * dim, indexing="ij")
    weights = np.ones(())
    for _ in range(dim):
        weights = np.multiply.outer(weights, w)
    return np.stack([g.ravel() for g in grid], axis=1), weights.ravel()


def _triangle_rule(order: int) -> tuple[np.ndarray, np.ndarray]:
    if order == 1:
        return np.array([[1 / 3, 1 / 3]]), np.array([0.5])
    if order == 2:
        return np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]]), np.full(3, 1 / 6)
    # collapsed Gauss rule, exact to degree 2 * order - 2; tests and error norms only
    x, wx = np.polynomial.legendre.leggauss(order)
    a, b = np.meshgrid((1 + x) / 2, (1 + x) / 2, indexing="ij")
    w = np.outer(wx, wx) / 4 * (1 - a)
    return np.stack([a.ravel(), ((1 - a) * b).ravel()], axis=1), w.ravel()


def _tetrahedron_rule(order: int) -> tuple[np.ndarray, np.ndarray]:
    if order == 1:
        return np.full((1, 3), 0.25), np.array([1 / 6])
    if order == 2:
        a = (5.0 - np.sqrt(5.0)) / 20.0
        return a + (1.0 - 4.0 * a) * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.full(4, 1 / 24)
    # collapsed Gauss rule, exact to degree 2 * order - 3; tests and error norms only
    x, wx = np.polynomial.legendre.leggauss(order)
    a, b, c = (g.ravel() for g in np.meshgrid(*[(1 + x) / 2] * 3, indexing="ij"))
    w = np.einsum("i,j,k->ijk", wx, wx, wx).ravel() / 8 * (1 - a) ** 2 * (1 - b)
    return np.stack([a, b * (1 - a), c * (1 - a) * (1 - b)], axis=1), w


def _tables(name: str, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if name == "line2" or name == "line3":
        return _line(xi[:, 0], name == "line3")
    if name == "tri3" or name == "tri6":
        return _triangle(xi[:, 0], xi[:, 1], name == "tri6")
    if name == "tet4" or name == "tet10":
        return _tetrahedron(xi, name == "tet10")
    if name == "quad8":
        return _serendipity(xi)
    if name == "hex20":
        return _serendipity_brick(xi)
    nodes = CELL_TYPES[name].reference_nodes  # quad4, hex8: products of (1 + xi xi_a) / 2
    factor = (1 + xi[:, None, :] * nodes[None]) / 2  # (n, n_nodes, dim)
    values = factor.prod(axis=2)
    grads = np.empty(factor.shape)
    for i in range(nodes.shape[1]):
        other_factors = np.delete(factor, i, axis=2).prod(axis=2)
        grads[:, :, i] = nodes[None, :, i] / 2 * other_factors
    return values, grads


def _line(x, quadratic):
    if not quadratic:
        return np.stack([(1 - x) / 2, (1 + x) / 2], 1), np.tile([[[-0.5], [0.5]]], (len(x), 1, 1))
    values = np.stack([x * (x - 1) / 2, x * (x + 1) / 2, 1 - x * x], 1)
    return values, np.stack([x - 0.5, x + 0.5, -2 * x], 1)[:, :, None]


def _triangle(x, y, quadratic):
    area = np.stack([1 - x - y, x, y], 1)  # (n, 3)
    slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if not quadratic:
        return area, np.tile(slope, (len(x), 1, 1))
    values, grads = np.empty((len(x), 6)), np.empty((len(x), 6, 2))
    for k in range(3):
        m = (k + 1) % 3
        values[:, k] = area[:, k] * (2 * area[:, k] - 1)
        grads[:, k] = (4 * area[:, k] - 1)[:, None] * slope[k]
        values[:, 3 + k] = 4 * area[:, k] * area[:, m]
        grads[:, 3 + k] = 4 * (area[:, k, None] * slope[m] + area[:, m, None] * slope[k])
    return values, grads


def _tetrahedron(xi, quadratic):
    volume = np.column_stack([1 - xi.sum(axis=1), xi])  # (n, 4)
    slope = np.array([[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    if not quadratic:
        return volume, np.tile(slope, (len(xi), 1, 1))
    a, b = np.array(TET_EDGES).T
    values = np.hstack([volume * (2 * volume - 1), 4 * volume[:, a] * volume[:, b]])
    corners = (4 * volume - 1)[:, :, None] * slope
    middles = 4 * (volume[:, a, None] * slope[b] + volume[:, b, None] * slope[a])
    return values, np.concatenate([corners, middles], axis=1)


def _serendipity(xi):
    x, y = xi[:, 0], xi[:, 1]
    values, grads = np.empty((len(x), 8)), np.empty((len(x), 8, 2))
    for a, (xa, ya) in enumerate(_QUAD):
        if a < 4:
            fx, fy, s = 1 + x * xa, 1 + y * ya, x * xa + y * ya - 1
            values[:, a] = fx * fy * s / 4
            grads[:, a, 0] = xa * fy * (s + fx) / 4
            grads[:, a, 1] = ya * fx * (s + fy) / 4
        elif xa == 0:
            values[:, a] = (1 - x * x) * (1 + y * ya) / 2
            grads[:, a, 0] = -x * (1 + y * ya)
            grads[:, a, 1] = (1 - x * x) * ya / 2
        else:
            values[:, a] = (1 + x * xa) * (1 - y * y) / 2
            grads[:, a, 0] = xa * (1 - y * y) / 2
            grads[:, a, 1] = -(1 + x * xa) * y
    return values, grads


def _serendipity_brick(xi):
    """Corners (1 + x xa)(1 + y ya)(1 + z za)(x xa + y ya + z za - 2) / 8; middles (1 - x²)(1 + y ya)(1 + z za) / 4 on
    an edge along x, and likewise."""
    corner = _HEX20.prod(axis=1) != 0.0
    factor = np.where(_HEX20[None] == 0.0, 1 - xi[:, None, :] ** 2, 1 + xi[:, None, :] * _HEX20[None])  # (n, 20, 3)
    slope = np.where(_HEX20[None] == 0.0, -2 * xi[:, None, :], _HEX20[None])
    reach = xi @ _HEX20.T - 2  # of the corners alone
    values = factor.prod(axis=2) * np.where(corner, reach / 8, 0.25)
    grads = np.empty(factor.shape)
    for i in range(3):
        other_factors = np.delete(factor, i, axis=2).prod(axis=2)
        grads[:, :, i] = other_factors * np.where(corner, (slope[:, :, i] * reach + factor[:, :, i] * _HEX20[:, i]) / 8,
                                                  slope[:, :, i] / 4)
    return values, grads
