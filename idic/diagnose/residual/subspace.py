"""What a free motion could explain: smooth displacement fields in the image, and their share of chi-square.

Fields are bilinear hats on a regular grid of the reference image, evaluated at the nodes: few, local, the same for any
mesh, and their gain in chi-square has as many degrees of freedom as there are fields that pixels can see, so that its
expectation under noise is known without a simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numba import njit
from scipy import sparse
from scipy.linalg import cholesky, solve_triangular

from idic.diagnose.residual.evidence import Evidence, FrameEvidence

MIN_EIGENVALUE_SHARE = 1e-6  # of the most visible direction: less visible ones are not counted


@dataclass(frozen=True, eq=False)
class Grid:
    """A regular grid over the reference image, and where the nodes are in it.

    Models of one recording that are compared share it: a lens that a model adds moves the nodes, and a row of cells
    more or less would be taken for a better or worse model.

    at : (n_nodes, d) px, column and row of the nodes, camera by camera, of a volume with the slice; low, extent : (d,)
    px, its corner and size; cells : (d,) numbers
    """

    at: np.ndarray
    low: np.ndarray
    extent: np.ndarray
    cells: np.ndarray


def grid_over(evidence: Evidence, at: np.ndarray, spacing_px: float) -> Grid:
    """A grid of about this spacing over the nodes that pixels see.

    Parameters
    ----------
    at : (n_nodes, d) px, the nodes in the reference image
    """
    points = at[np.unique(evidence.seen // evidence.n_components)]
    low, extent = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-9)
    return Grid(at, low, extent, np.maximum(1, np.rint(extent / spacing_px)).astype(int))


@dataclass(frozen=True, eq=False)
class Basis:
    """Motions that are free in every frame.

    fields : (n_seen, p) image motion at the seen dofs, px (height images: their unit for the third component); places :
    (p, d) place of the hat in the reference image; component : (p,) 0 column, 1 row, 2 height or slice.
    """

    fields: sparse.csr_array
    places: np.ndarray
    component: np.ndarray

    @property
    def n(self) -> int:
        return self.fields.shape[1]

    def first_node(self, evidence: Evidence) -> np.ndarray:
        """A node that every field moves; of further cameras beyond the first n_nodes  # (p,)"""
        by_field = self.fields.tocsc()
        return evidence.seen[by_field.indices[by_field.indptr[:-1]]] // evidence.n_components


def hats(evidence: Evidence, grid: Grid) -> Basis:
    """Hats of a grid, linear along each axis."""
    c, cells = evidence.n_components, grid.cells
    node, component = np.divmod(evidence.seen, c)
    at = np.clip((grid.at[node] - grid.low) / grid.extent, 0.0, 1.0) * cells  # in cells
    first = np.minimum(at.astype(int), cells - 1)
    offset = at - first
    rows, columns, values = [], [], []
    n_grid = int(np.prod(cells + 1))
    for side in product((0, 1), repeat=len(cells)):
        weight = np.prod(np.abs(1 - np.array(side) - offset), axis=1)
        rows.append(np.arange(len(node)))
        columns.append(component * n_grid + np.ravel_multi_index((first + side).T, cells + 1))
        values.append(weight)
    fields = sparse.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                              shape=(len(node), c * n_grid))
    weight = fields.sum(axis=0)
    keep = np.flatnonzero(weight > 0.0)
    corner, kind = keep % n_grid, keep // n_grid
    places = grid.low + np.column_stack(np.unravel_index(corner, cells + 1)) / cells * grid.extent
    return Basis(sparse.csr_array(fields[:, keep]), places, kind)


def affine(evidence: Evidence, positions: np.ndarray) -> Basis:
    """Rigid motion and uniform deformation of the image: 1, x, y for every component."""
    c = evidence.n_components
    node, component = np.divmod(evidence.seen, c)
    middle, size = positions[node].mean(axis=0), np.maximum(np.ptp(positions[node], axis=0), 1e-9)
    monomials = np.column_stack([np.ones(len(node)), (positions[node] - middle) / size])  # (n_seen, 1 + d)
    n = monomials.shape[1]
    fields = np.zeros((len(node), n * c))
    for k in range(c):
        fields[component == k, n * k:n * (k + 1)] = monomials[component == k]
    return Basis(sparse.csr_array(fields), np.tile(middle, (n * c, 1)), np.repeat(np.arange(c), n))


@dataclass(frozen=True, eq=False)
class Explained:
    """Drop of chi-square by a basis in every frame, and how many of its fields are seen.

    gain, rank : (T,); under mere noise the gain of a frame is chi-square distributed with `rank` degrees of freedom.
    """

    gain: np.ndarray
    rank: np.ndarray

    @property
    def excess(self) -> float:
        """(gain - rank) / rank over all frames: 0 for mere noise."""
        return float((self.gain.sum() - self.rank.sum()) / max(self.rank.sum(), 1))

    @property
    def excess_z(self) -> float:
        """The same in standard deviations of its noise."""
        return float((self.gain.sum() - self.rank.sum()) / np.sqrt(2.0 * max(self.rank.sum(), 1)))


def explained(evidence: Evidence, basis: Basis | list[np.ndarray]) -> Explained:
    """What free motions explain frame by frame.

    basis : a `Basis`, or per frame the fields (n_seen, p) of that frame.
    """
    gains, ranks = [], []
    for t, part in enumerate(evidence.parts):
        fields = basis.fields if isinstance(basis, Basis) else basis[t]
        gain, rank = gain_and_rank(*projected(evidence, part, fields))
        gains.append(gain)
        ranks.append(rank)
    return Explained(np.array(gains), np.array(ranks))


def gain_and_rank(matrix: np.ndarray, rhs: np.ndarray) -> tuple[float, int]:
    """Drop of chi-square by the fields of normal equations, and how many of them are seen.

    Where all fields are seen beyond doubt two Cholesky factors tell so, at a tenth of the cost of the eigenvalues.
    """
    scale = unit_scale(matrix)
    is_seen = scale > 0.0
    scaled = matrix[np.ix_(is_seen, is_seen)] * np.outer(scale[is_seen], scale[is_seen])
    right = rhs[is_seen] * scale[is_seen]
    if not len(right):
        return 0.0, 0
    largest = float(np.abs(scaled).sum(axis=1).max())  # no eigenvalue is larger
    try:
        cholesky(scaled - MIN_EIGENVALUE_SHARE * largest * np.eye(len(right)), lower=True, overwrite_a=True,
                 check_finite=False)
        half = solve_triangular(cholesky(scaled, lower=True, check_finite=False), right, lower=True, check_finite=False)
        return float(half @ half), len(right)
    except np.linalg.LinAlgError:
        values, vectors, scale = spectrum(matrix)
    good = values > MIN_EIGENVALUE_SHARE * max(values.max(initial=0.0), 1e-300)
    return float(((vectors[:, good].T @ (rhs * scale)) ** 2 / values[good]).sum()), int(good.sum())


def projected(evidence: Evidence, part: FrameEvidence, fields) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of free fields in one frame, its own unknowns eliminated  # (p, p), (p,)"""
    n = len(part.q)
    border = np.asarray(fields.T @ part.border[:n])  # (p, m)
    q, _ = evidence.residual(part)
    return gram_of_fields(part.A, fields) - border @ part.inner @ border.T, np.asarray(fields.T @ q)


def gram_of_fields(A: sparse.csr_array, fields) -> np.ndarray:
    """fields^T A fields of sparse or dense fields (n_seen, p)  # (p, p)"""
    if not sparse.issparse(fields):
        return np.asarray(fields.T @ (A @ fields))
    fields, gram = sparse.csr_array(fields), np.zeros((fields.shape[1], fields.shape[1]))
    _add_gram(A.indptr, A.indices, A.data, fields.indptr, fields.indices, fields.data, gram)
    return gram


@njit(cache=True, nogil=True)
def _add_gram(starts, columns, values, field_starts, field_columns, field_values, gram):
    """Row by row of A: row of A times the fields, then every field of that dof times it  # gram (p, p), in place"""
    n_fields = gram.shape[0]
    row, is_touched, touched = np.zeros(n_fields), np.zeros(n_fields, np.bool_), np.empty(n_fields, np.int64)
    for i in range(len(starts) - 1):
        if field_starts[i] == field_starts[i + 1]:
            continue
        n = 0
        for k in range(starts[i], starts[i + 1]):
            value, j = values[k], columns[k]
            for m in range(field_starts[j], field_starts[j + 1]):
                b = field_columns[m]
                if not is_touched[b]:
                    is_touched[b], touched[n] = True, b
                    n += 1
                row[b] += value * field_values[m]
        for m in range(field_starts[i], field_starts[i + 1]):
            weight, a = field_values[m], field_columns[m]
            for c in range(n):
                gram[a, touched[c]] += weight * row[touched[c]]
        for c in range(n):
            row[touched[c]], is_touched[touched[c]] = 0.0, False


def spectrum(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues and vectors after scaling the diagonal to one  # (p,), (p, p), (p,) the scale applied"""
    scale = unit_scale(matrix)
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    return values, vectors, scale


def unit_scale(matrix: np.ndarray) -> np.ndarray:
    """What brings the diagonal to one, 0 for fields that nothing sees  # (p,)"""
    diagonal = np.diagonal(matrix)
    return np.where(diagonal > 1e-9 * max(diagonal.max(initial=0.0), 1e-300),
                    1.0 / np.sqrt(np.maximum(diagonal, 1e-300)), 0.0)


def effect_px(evidence: Evidence, basis: Basis) -> np.ndarray:
    """Root mean square of the motion (px) that the basis asks for in every frame, noise subtracted  # (T,)

    The motion is weighed by how well pixels see it (the contrast of the texture): rms = sqrt((gain - rank) sigma^2 /
    sum |grad f|^2), 0 where the gain is below its expectation.
    """
    explanation = explained(evidence, basis)
    # sum |grad f|^2 N^2 / sigma^2
    power = np.array([part.A.diagonal().sum() / evidence.n_axes for part in evidence.parts])
    return np.sqrt(np.maximum(explanation.gain - explanation.rank, 0.0) / np.maximum(power, 1e-300))
