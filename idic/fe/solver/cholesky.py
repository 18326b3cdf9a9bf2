"""Cholesky factors of the symmetric part of a sparse matrix, by the fronts of `idic.fe.solver.multifrontal`.

Half the work and the memory of an LU. The tangent of most laws is nearly symmetric (F-bar and follower loads are not,
by parts of the order of stress over stiffness), and a few iterations correct the remaining error
(`idic.fe.solver.krylov`). They correct the rounding of single precision as well, which takes half the work and the
memory once more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import DTypeLike

from idic.fe.solver.compilation import kernel
from idic.fe.solver.lapack import factorise_lower, product, solve_triangle, subtract_square
from idic.fe.solver.multifrontal import Elimination, Front, columns, eliminated, independent_parts
from idic.fe.solver.threads import pool_of_threads

MIN_ENTRIES_FOR_BLAS = 16_000  # of a front: below, calls take longer than loops (one right-hand side; of several 4000)
PARTS = 4  # of the tree, whatever the number of threads: the bits do not depend on it


@dataclass(frozen=True)
class Tree:
    """Where the fronts of a mesh store their factors.

    starts, first, end : per front, its first stored entry, its pivots first ... end - 1
    boundary, beginning : equations of all boundaries, and where those of each front begin
    parts, above : fronts of subtrees that do not see each other, and those above them, as spans
    """

    starts: np.ndarray
    first: np.ndarray
    end: np.ndarray
    boundary: np.ndarray
    beginning: np.ndarray
    parts: tuple[tuple[int, int], ...]
    above: tuple[tuple[int, int], ...]

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        return self.starts, self.first, self.end, self.boundary, self.beginning

    @property
    def highest(self) -> int:
        """Rows of the largest front."""
        return int((self.end - self.first + np.diff(self.beginning)).max(initial=0))

    @cached_property
    def runs(self) -> dict[tuple[int, int], list[tuple[int, int, bool]]]:
        """Of each span, runs of fronts one after the other: small ones together, each large one alone."""
        is_large = np.diff(self.starts) >= MIN_ENTRIES_FOR_BLAS
        runs = {}
        for begin, stop in (*self.parts, *self.above):
            edges = [k for k in range(begin, stop) if is_large[k] or k == begin or is_large[k - 1]]
            runs[begin, stop] = [(k, following, bool(is_large[k]))
                                 for k, following in zip(edges, [*edges[1:], stop], strict=True)]
        return runs


@dataclass(frozen=True)
class SymmetricFactor:
    """Front after front, (s + b, s) column by column: L11 in the lower triangle, below it F21 L11^-T.

    entries : float64, or float32 of the matrix times `scale`, a power of two, so that no entry leaves its range
    """

    tree: Tree
    entries: np.ndarray
    scale: float = 1.0

    @property
    def is_single(self) -> bool:
        return self.entries.dtype == np.float32

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solutions for right-hand sides (n, m)  # (n, m)"""
        x, pool = np.array(rhs.T, dtype=float, order="C"), pool_of_threads()
        sizes = np.ones((len(x), 1))
        if self.is_single:
            largest = np.abs(x).max(axis=1, keepdims=True, initial=0.0)
            sizes[largest > 0.0] = largest[largest > 0.0]
            x /= sizes
        run = map if pool is None else pool.map
        tree, beyond = self.tree, np.zeros((len(self.tree.parts), *x.shape))

        def down(part: int) -> None:
            span = tree.parts[part]
            self._forward(span, tree.end[span[1] - 1], x, beyond[part])

        list(run(down, range(len(tree.parts))))
        for (_, part_end), share in zip(tree.parts, beyond, strict=True):
            reached = tree.boundary[tree.beginning[part_end - 1]:tree.beginning[part_end]]
            x[:, reached] += share[:, reached]
        for span in tree.above:
            self._forward(span, x.shape[1], x, x)
        for span in reversed(tree.above):
            self._backward(span, x)
        list(run(lambda span: self._backward(span, x), tree.parts))
        if self.is_single:
            x *= self.scale * sizes
        return np.ascontiguousarray(x.T)

    def _forward(self, span: tuple[int, int], limit: int, x: np.ndarray, beyond: np.ndarray) -> None:
        """Forward substitution in a span; x (m, n); equations from `limit` on change in `beyond`."""
        for begin, stop, is_large in self.tree.runs[span]:
            if not is_large:
                forward(self.entries, *self.tree.arrays, begin, stop, limit, x, beyond, self._room(x))
                continue
            pivots, boundary, block, z = self._front(begin, x)
            solve_triangle(block[:len(z)], z, right=False, lower=True, unit=False)
            x[:, pivots] = z.T
            share, inside = product(block[len(z):], z).T, int(np.searchsorted(boundary, limit))
            x[:, boundary[:inside]] -= share[:, :inside]
            beyond[:, boundary[inside:]] -= share[:, inside:]

    def _backward(self, span: tuple[int, int], x: np.ndarray) -> None:
        """Backward substitution in a span; x (m, n)."""
        for begin, stop, is_large in reversed(self.tree.runs[span]):
            if not is_large:
                backward(self.entries, *self.tree.arrays, begin, stop, x, self._room(x))
                continue
            pivots, boundary, block, z = self._front(begin, x)
            if len(boundary):
                z -= product(block[len(z):], np.array(x[:, boundary], dtype=z.dtype, order="C").T, transposed=True)
            solve_triangle(block[:len(z)], z, right=False, lower=True, unit=False, transposed=True)
            x[:, pivots] = z.T

    def _front(self, k: int, x: np.ndarray) -> tuple[slice, np.ndarray, np.ndarray, np.ndarray]:
        """Pivots, boundary, entries (s + b, s) of a front, and a copy of its part of x (m, n)  # (s, m)"""
        tree = self.tree
        pivots = slice(int(tree.first[k]), int(tree.end[k]))
        boundary = tree.boundary[tree.beginning[k]:tree.beginning[k + 1]]
        block = columns(self.entries[tree.starts[k]:tree.starts[k + 1]], pivots.stop - pivots.start + len(boundary))
        return pivots, boundary, block, np.array(x[:, pivots], dtype=self.entries.dtype, order="C").T

    def _room(self, x: np.ndarray) -> np.ndarray:
        return np.empty((len(x), self.tree.highest), dtype=self.entries.dtype)


def tree_of(fronts: Sequence[Front]) -> Tree:
    """The tree of all fronts."""
    first, end = (np.array([getattr(front, name) for front in fronts], dtype=np.int64) for name in ("first", "end"))
    beginning = np.concatenate([[0], np.cumsum([len(front.boundary) for front in fronts])]).astype(np.int64)
    rows = end - first + np.diff(beginning)
    parts = sorted(independent_parts(fronts, PARTS))
    beneath = {k for begin, part_end in parts for k in range(begin, part_end)}
    above = tuple((k, k + 1) for k in range(len(fronts)) if k not in beneath)
    return Tree(np.concatenate([[0], np.cumsum(rows * (end - first))]).astype(np.int64), first, end,
                np.concatenate([front.boundary for front in fronts]).astype(np.int64), beginning, tuple(parts), above)


def factor(fronts: Sequence[Front], tree: Tree, values: np.ndarray, single: bool = False) -> SymmetricFactor | None:
    """Factors of the symmetric part of the matrix with these stored values; None where it is not positive definite.

    single : in single precision
    """
    scale = float(np.exp2(-np.round(np.log2(np.abs(values).max())))) if single and values.any() else 1.0
    work = _Elimination(fronts, values, tree, scale, np.float32 if single else np.float64)
    return None if eliminated(fronts, work) is None else SymmetricFactor(tree, work.entries, scale)


class _Elimination(Elimination):
    """As its base, with lower triangles only."""

    def __init__(self, fronts: Sequence[Front], values: np.ndarray, tree: Tree, scale: float, dtype: DTypeLike):
        super().__init__(fronts, values)
        self.tree, self.scale, self.entries = tree, scale, np.zeros(int(tree.starts[-1]), dtype)

    def eliminate(self, k: int) -> bool:
        front = self.fronts[k]
        s, b = front.end - front.first, len(front.boundary)
        blocks = self.entries[self.tree.starts[k]:self.tree.starts[k + 1]]
        update = np.zeros(b * b, dtype=blocks.dtype)
        gather(blocks, s, b, front.sources, front.targets, self.values, self.scale)
        for child, places in zip(front.children, front.embeddings, strict=True):
            extend(blocks, update, s, b, self.updates.pop(child), places)
        front_columns = columns(blocks, s + b)
        if not factorise_lower(front_columns[:s]):
            return False
        if b:
            solve_triangle(front_columns[:s], front_columns[s:], right=True, lower=True, unit=False, transposed=True)
            subtract_square(front_columns[s:], columns(update, b))
        self.updates[k] = update
        return True


@kernel
def forward(entries, starts, first, end, boundary, beginning, begin, stop, limit, x, beyond, room):
    """Forward substitution in the fronts begin ... stop - 1; x (m, n); equations from `limit` on change in `beyond`."""
    m = x.shape[0]
    for k in range(begin, stop):
        s, b = end[k] - first[k], beginning[k + 1] - beginning[k]
        for c in range(m):
            room[c, :s] = x[c, first[k]:end[k]]
            room[c, s:s + b] = 0.0
        for j in range(s):
            at = starts[k] + j * (s + b)
            column = entries[at:at + s + b]
            for c in range(m):
                z = room[c]
                value = z[j] / column[j]
                z[j] = value
                for i in range(j + 1, s + b):
                    z[i] -= column[i] * value
        for c in range(m):
            x[c, first[k]:end[k]] = room[c, :s]
            for i in range(b):
                equation = boundary[beginning[k] + i]
                if equation < limit:
                    x[c, equation] += room[c, s + i]
                else:
                    beyond[c, equation] += room[c, s + i]


@kernel
def backward(entries, starts, first, end, boundary, beginning, begin, stop, x, room):
    """Backward substitution in the fronts stop - 1 ... begin; x (m, n)."""
    m = x.shape[0]
    for k in range(stop - 1, begin - 1, -1):
        s, b = end[k] - first[k], beginning[k + 1] - beginning[k]
        for c in range(m):
            room[c, :s] = x[c, first[k]:end[k]]
            for i in range(b):
                room[c, s + i] = x[c, boundary[beginning[k] + i]]
        for j in range(s - 1, -1, -1):
            at = starts[k] + j * (s + b)
            for c in range(m):
                beneath = np.dot(entries[at + j + 1:at + s + b], room[c, j + 1:s + b])
                room[c, j] = (room[c, j] - beneath) / entries[at + j]
        for c in range(m):
            x[c, first[k]:end[k]] = room[c, :s]


@kernel
def gather(blocks, s, b, sources, targets, values, scale):
    """Add the symmetric part of the stored entries of a front, times `scale`, into its lower triangle, (s + b, s)."""
    corner = s * s + s * b
    for n in range(sources.shape[0]):
        place, value = targets[n], scale * values[sources[n]]
        if place < s * s:
            i, j = place % s, place // s
            if i == j:
                blocks[j * (s + b) + i] += value
            elif i > j:
                blocks[j * (s + b) + i] += 0.5 * value
            else:
                blocks[i * (s + b) + j] += 0.5 * value
        elif place < corner:
            i, j = (place - s * s) % b, (place - s * s) // b
            blocks[j * (s + b) + s + i] += 0.5 * value
        else:
            i, j = (place - corner) % s, (place - corner) // s
            blocks[i * (s + b) + s + j] += 0.5 * value


@kernel
def extend(blocks, update, s, b, child, places):
    """Add the lower triangle that a front leaves on its boundary, child flat (m m), to the front above."""
    m = places.shape[0]
    for j in range(m):
        column, source = places[j], j * m
        if column < s:
            at = column * (s + b)
            for i in range(j, m):
                blocks[at + places[i]] += child[source + i]
        else:
            at = (column - s) * b - s
            for i in range(j, m):
                update[at + places[i]] += child[source + i]
