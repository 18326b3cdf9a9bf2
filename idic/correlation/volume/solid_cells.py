"""The cells of solids in monomials of their own coordinates: tet4, hex8, tet10 and hex20.

Node numbering and reference cells are those of `idic.fe`. A nodal field is a sum of monomials per element, whose
coefficients are ``TRANSFORMS[kind] @ nodal values`` (docs/method.md, equation 3.6).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.fe import cell_type

SOLIDS = ("tet4", "hex8", "tet10", "hex20")
N_SOLID_NODES = np.array([cell_type(name).n_nodes for name in SOLIDS])
N_TERMS = 20  # monomials of the largest cell
# powers of the three coordinates; a cell has as many as nodes
_LINEAR = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
_BRICK = [*_LINEAR, (1, 1, 0), (0, 1, 1), (1, 0, 1), (1, 1, 1)]
_QUADRATIC = [*_LINEAR, (1, 1, 0), (0, 1, 1), (1, 0, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2)]
_SERENDIPITY = [*_BRICK, (2, 0, 0), (0, 2, 0), (0, 0, 2), (2, 1, 0), (2, 0, 1), (1, 2, 0), (0, 2, 1), (1, 0, 2),
                (0, 1, 2), (2, 1, 1), (1, 2, 1), (1, 1, 2)]
POWERS = [np.array(table) for table in (_LINEAR, _BRICK, _QUADRATIC, _SERENDIPITY)]
TABLE_SCALE = 32000  # steps of a place in its cell, per unit


def monomials(kind: int, places: np.ndarray) -> np.ndarray:
    """Monomials of a cell  # (n, 3) places in the cell -> (n, n_nodes)"""
    return (np.asarray(places, float)[:, None, :] ** POWERS[kind][None]).prod(axis=2)


def monomial_slopes(kind: int, places: np.ndarray) -> np.ndarray:
    """Their derivatives by the three coordinates  # (n, 3) -> (n, n_nodes, 3)"""
    powers, places = POWERS[kind], np.asarray(places, float)
    slopes = np.empty((len(places), len(powers), 3))
    for d in range(3):
        lowered = powers.copy()
        lowered[:, d] = np.maximum(powers[:, d] - 1, 0)
        slopes[:, :, d] = powers[:, d] * (places[:, None, :] ** lowered[None]).prod(axis=2)
    return slopes


def _transforms() -> np.ndarray:
    table = np.zeros((len(SOLIDS), N_TERMS, N_TERMS))
    for kind, name in enumerate(SOLIDS):
        n = N_SOLID_NODES[kind]
        at_nodes = monomials(kind, cell_type(name).reference_nodes)
        assert np.allclose(cell_type(name).shape_functions(cell_type(name).reference_nodes), np.eye(n))
        table[kind, :n, :n] = np.linalg.inv(at_nodes)
    return table


TRANSFORMS = _transforms()  # (kind, monomial, node)
MIDDLES = np.array([[0.25] * 3 if name.startswith("tet") else [0.0] * 3 for name in SOLIDS])


def coefficients_of(conn: np.ndarray, kind: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Monomial coefficients of a nodal field in every element  # (n_nodes, c) -> (n_elements, c, n_max)"""
    n_max = conn.shape[1]
    out = np.zeros((len(conn), nodal.shape[1], n_max))
    for k in np.unique(kind):
        n, of_kind = N_SOLID_NODES[k], kind == k
        out[of_kind, :, :n] = np.einsum("mi,eic->ecm", TRANSFORMS[k, :n, :n], nodal[conn[of_kind, :n]], optimize=True)
    return out


@njit(cache=True, nogil=True)
def fill_monomials(kind, place, n, powers):
    """The monomials of the places of a buffer  # place (3, >= n) float32 -> powers (n_terms, >= n)"""
    for k in range(n):
        a, b, c = place[0, k], place[1, k], place[2, k]
        powers[0, k], powers[1, k], powers[2, k], powers[3, k] = np.float32(1.0), a, b, c
    if kind == 0:
        return
    for k in range(n):
        a, b, c = place[0, k], place[1, k], place[2, k]
        powers[4, k], powers[5, k], powers[6, k] = a * b, b * c, a * c
    if kind == 2:
        for k in range(n):
            a, b, c = place[0, k], place[1, k], place[2, k]
            powers[7, k], powers[8, k], powers[9, k] = a * a, b * b, c * c
        return
    for k in range(n):
        powers[7, k] = place[0, k] * place[1, k] * place[2, k]
    if kind == 1:
        return
    for k in range(n):
        a, b, c = place[0, k], place[1, k], place[2, k]
        aa, bb, cc = a * a, b * b, c * c
        powers[8, k], powers[9, k], powers[10, k] = aa, bb, cc
        powers[11, k], powers[12, k], powers[13, k] = aa * b, aa * c, bb * a
        powers[14, k], powers[15, k], powers[16, k] = bb * c, cc * a, cc * b
        powers[17, k], powers[18, k], powers[19, k] = aa * b * c, bb * a * c, cc * a * b


@njit(cache=True, nogil=True)
def local_places(affine, middle, inverse, table, first, n, x, y, z, place):
    """Places of the voxels of a buffer in their cell, by its affine map or from the table.

    middle: int32 (3,) a voxel in the element; inverse: float32 (3, 4) d place / d voxel, place of that voxel; table:
    int16 (3, n_table), in steps of 1 / TABLE_SCALE, from `first` on.
    """
    if affine:
        x0, y0, z0 = middle[0], middle[1], middle[2]
        xx, xy, xz, xt = inverse[0, 0], inverse[0, 1], inverse[0, 2], inverse[0, 3]
        yx, yy, yz, yt = inverse[1, 0], inverse[1, 1], inverse[1, 2], inverse[1, 3]
        zx, zy, zz, zt = inverse[2, 0], inverse[2, 1], inverse[2, 2], inverse[2, 3]
        for k in range(n):
            dx, dy, dz = np.float32(x[k] - x0), np.float32(y[k] - y0), np.float32(z[k] - z0)
            place[0, k] = xt + xx * dx + xy * dy + xz * dz
            place[1, k] = yt + yx * dx + yy * dy + yz * dz
            place[2, k] = zt + zx * dx + zy * dy + zz * dz
        return
    step = np.float32(1.0 / TABLE_SCALE)
    for d in range(3):
        for k in range(n):
            place[d, k] = step * np.float32(table[d, first + k])
