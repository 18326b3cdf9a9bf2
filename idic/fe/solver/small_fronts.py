"""LU of a sparse matrix by dense fronts that are small, as those of plane meshes: one compiled function for all fronts.

As `idic.fe.solver.multifrontal`, whose fronts it takes, but without a call of LAPACK for each: of a front of a hundred
equations the call costs as much as the work. A front is one array, column by column: its pivots' columns and, beside
them, those of the boundary. Every column is reduced by the columns before it, four at a time, and stays in the cache
meanwhile. Rows are exchanged among the pivots of a front where the diagonal is small (threshold pivoting: Duff, Erisman
and Reid, Direct Methods for Sparse Matrices, 1986, section 5.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idic.fe.solver.compilation import kernel
from idic.fe.solver.multifrontal import Front

MIN_PIVOT = 0.1  # of the largest entry of the pivots below it: a smaller diagonal is exchanged
MIN_TOGETHER, MAX_TOGETHER = 8, 128  # right-hand sides that share one reading of the factors
_U = np.uint64


@dataclass(frozen=True)
class SmallFronts:
    """The fronts of a mesh in flat arrays; entries of a front begin at `starts`, and so on.

    Attributes
    ----------
    first, end : (n_fronts,) int64
        Pivots of each front, equations first ... end - 1.
    beginning, boundary : (n_fronts + 1,), (n_boundary,) int64
        Later equations that a front touches.
    starts : (n_fronts + 1,) int64
        Factors of each front: (m, s) of the pivots, (s, b) beside them; m = s + b.
    below, children, places_from, places : int64
        Fronts directly below each front, and where the boundary of each of them is in it (pivots, then boundary).
    sources_from, sources, targets : int64
        Stored entries of the matrix that belong to each front, and their places in it: column by column, (m, m).
    highest, widest, stack : int
        Rows of the largest front; entries beside the pivots of a front, and of all updates waiting, at most.
    """

    first: np.ndarray
    end: np.ndarray
    beginning: np.ndarray
    boundary: np.ndarray
    starts: np.ndarray
    below: np.ndarray
    children: np.ndarray
    places_from: np.ndarray
    places: np.ndarray
    sources_from: np.ndarray
    sources: np.ndarray
    targets: np.ndarray
    highest: int
    widest: int
    stack: int

    @property
    def n(self) -> int:
        """Equations."""
        return int(self.end.max(initial=0))


@dataclass(frozen=True)
class SmallFactor:
    """P F11 = L U of each front: entries as `SmallFronts.starts` says, exchanges (n,) from the front's first pivot."""

    tree: SmallFronts
    entries: np.ndarray
    exchanges: np.ndarray

    def solve(self, rhs: np.ndarray, transposed: bool = False) -> np.ndarray:
        """Solutions for right-hand sides (n, m)  # (n, m), of each the same bits however many there are"""
        if rhs.shape[1] >= MIN_TOGETHER:
            return self._solved_together(rhs, transposed)
        x, tree = np.array(rhs.T, dtype=float, order="C"), self.tree
        room = np.empty(tree.highest)
        substitution = solve_transposed if transposed else solve
        substitution(self.entries, self.exchanges, tree.first, tree.end, tree.beginning, tree.boundary, tree.starts, x,
                     room)
        return np.ascontiguousarray(x.T)

    def _solved_together(self, rhs: np.ndarray, transposed: bool) -> np.ndarray:
        """`solve` by blocks of columns, which read the factors once."""
        solution, tree = np.empty(rhs.shape), self.tree
        substitution = solve_many_transposed if transposed else solve_many
        for begin in range(0, rhs.shape[1], MAX_TOGETHER):
            x = np.array(rhs[:, begin:begin + MAX_TOGETHER], dtype=float, order="C")
            width = x.shape[1]
            substitution(self.entries, self.exchanges, tree.first, tree.end, tree.beginning, tree.boundary, tree.starts,
                         width, x.ravel(), np.empty(tree.highest * width))
            solution[:, begin:begin + width] = x
        return solution


def flat(fronts: Sequence[Front]) -> SmallFronts:
    """The fronts in flat arrays."""
    first, end = (np.array([getattr(front, name) for front in fronts], dtype=np.int64) for name in ("first", "end"))
    s, b = end - first, np.array([len(front.boundary) for front in fronts], dtype=np.int64)
    targets, waiting, most = [], 0, 0
    for front, pivots, n_boundary in zip(fronts, s.tolist(), b.tolist(), strict=True):
        targets.append(_stacked(front.targets, pivots, n_boundary))
        waiting += n_boundary**2 - sum(len(places)**2 for places in front.embeddings)
        most = max(most, waiting)
    places = [place for front in fronts for place in front.embeddings]
    return SmallFronts(
        first, end, _from(b), _joined([front.boundary for front in fronts]), _from(s * (s + 2 * b)),
        _from([len(front.children) for front in fronts]), _joined([front.children for front in fronts]),
        _from([len(place) for place in places]), _joined(places), _from([len(front.sources) for front in fronts]),
        _joined([front.sources for front in fronts]), _joined(targets), int((s + b).max(initial=0)),
        int((b * (s + b)).max(initial=0)), most)


def _from(counts) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _joined(arrays) -> np.ndarray:
    return np.concatenate([np.zeros(0), *arrays]).astype(np.int64)


def _stacked(targets: np.ndarray, s: int, b: int) -> np.ndarray:
    """Places of `Front.targets` (three blocks) in a front that is one array (m, m), column by column."""
    m, corner = s + b, s * (s + b)
    pivots, beneath, upper = targets, targets - s * s, targets - corner
    return np.where(targets < s * s, pivots // max(s, 1) * m + pivots % max(s, 1),
                    np.where(targets < corner, beneath // max(b, 1) * m + s + beneath % max(b, 1),
                             (s + upper // max(s, 1)) * m + upper % max(s, 1)))


def factor(tree: SmallFronts, values: np.ndarray) -> SmallFactor | None:
    """Factors of the matrix with these stored values; None where a front is singular."""
    entries, exchanges = np.empty(int(tree.starts[-1])), np.empty(tree.n, dtype=np.int64)
    regular = factorise(tree.first, tree.end, tree.beginning, tree.starts, tree.below, tree.children, tree.places_from,
                        tree.places, tree.sources_from, tree.sources, tree.targets, values, entries, exchanges,
                        np.empty(tree.widest), np.empty(tree.stack))
    return SmallFactor(tree, entries, exchanges) if regular else None


@kernel
def _reduce(panel, start, m, k, column, at):
    """Subtract from a column what its entries in the first k pivots bring, in turn; panel from `start` on, (m, k)."""
    j = 0
    while j + 4 <= k:
        a, b = start + j * m, start + (j + 1) * m
        c, d = start + (j + 2) * m, start + (j + 3) * m
        p = column[at + j]
        q = column[at + j + 1] - p * panel[a + j + 1]
        r = column[at + j + 2] - p * panel[a + j + 2] - q * panel[b + j + 2]
        t = column[at + j + 3] - p * panel[a + j + 3] - q * panel[b + j + 3] - r * panel[c + j + 3]
        column[at + j + 1], column[at + j + 2], column[at + j + 3] = q, r, t
        o, w, x, y, z = _U(at), _U(a), _U(b), _U(c), _U(d)
        for row in range(j + 4, m):
            i = _U(row)
            column[o + i] -= p * panel[w + i] + q * panel[x + i] + r * panel[y + i] + t * panel[z + i]
        j += 4
    while j < k:
        p = column[at + j]
        o, w = _U(at), _U(start + j * m)
        for row in range(j + 1, m):
            i = _U(row)
            column[o + i] -= p * panel[w + i]
        j += 1


@kernel
def _reduce_pair(panel, start, m, k, columns, at, partner):
    """`_reduce` for the columns at `at` and `other`: each column of the panel is read once for both."""
    j = 0
    while j + 4 <= k:
        a, b = start + j * m, start + (j + 1) * m
        c, d = start + (j + 2) * m, start + (j + 3) * m
        p, e = columns[at + j], columns[partner + j]
        lower = panel[a + j + 1]
        q, f = columns[at + j + 1] - p * lower, columns[partner + j + 1] - e * lower
        lower, second = panel[a + j + 2], panel[b + j + 2]
        r = columns[at + j + 2] - p * lower - q * second
        g = columns[partner + j + 2] - e * lower - f * second
        lower, second, third = panel[a + j + 3], panel[b + j + 3], panel[c + j + 3]
        t = columns[at + j + 3] - p * lower - q * second - r * third
        h = columns[partner + j + 3] - e * lower - f * second - g * third
        columns[at + j + 1], columns[at + j + 2], columns[at + j + 3] = q, r, t
        columns[partner + j + 1], columns[partner + j + 2], columns[partner + j + 3] = f, g, h
        o, n, w, x, y, z = _U(at), _U(partner), _U(a), _U(b), _U(c), _U(d)
        for row in range(j + 4, m):
            i = _U(row)
            l0, l1, l2, l3 = panel[w + i], panel[x + i], panel[y + i], panel[z + i]
            columns[o + i] -= p * l0 + q * l1 + r * l2 + t * l3
            columns[n + i] -= e * l0 + f * l1 + g * l2 + h * l3
        j += 4
    while j < k:
        p, e = columns[at + j], columns[partner + j]
        o, n, w = _U(at), _U(partner), _U(start + j * m)
        for row in range(j + 1, m):
            i = _U(row)
            columns[o + i] -= p * panel[w + i]
            columns[n + i] -= e * panel[w + i]
        j += 1


@kernel
def _exchange(column, at, exchanges, first, begin, stop):
    """Exchange the entries of a column as the pivots begin ... stop - 1 of a front were."""
    for j in range(begin, stop):
        row = exchanges[first + j]
        column[at + j], column[at + row] = column[at + row], column[at + j]


@kernel
def _eliminate_pivot(entries, start, m, s, k, exchanges, first):
    """The reduced column of a pivot becomes its column of U and L; False where the pivot is zero."""
    at = start + k * m
    largest, row = abs(entries[at + k]), k
    for i in range(k + 1, s):
        if abs(entries[at + i]) * MIN_PIVOT > largest:
            largest, row = abs(entries[at + i]) / MIN_PIVOT, i
    exchanges[first + k] = row
    if row != k:
        for j in range(k + 1):
            begin = start + j * m
            entries[begin + k], entries[begin + row] = entries[begin + row], entries[begin + k]
    pivot = entries[at + k]
    if pivot == 0.0 or not math.isfinite(pivot):
        return False
    inverse = 1.0 / pivot
    for i in range(k + 1, m):
        entries[at + i] *= inverse
    return True


@kernel
def _eliminate_pivots(entries, start, m, s, exchanges, first):
    """The pivots' columns of a front become L and U, two at a time; False where a pivot is zero."""
    for k in range(0, s, 2):
        at, is_single = start + k * m, k + 1 == s
        _exchange(entries, at, exchanges, first, 0, k)
        if is_single:
            _reduce(entries, start, m, k, entries, at)
        else:
            _exchange(entries, at + m, exchanges, first, 0, k)
            _reduce_pair(entries, start, m, k, entries, at, at + m)
        if not _eliminate_pivot(entries, start, m, s, k, exchanges, first):
            return False
        if is_single:
            return True
        _exchange(entries, at + m, exchanges, first, k, k + 1)
        value = entries[at + m + k]
        for i in range(k + 1, m):
            entries[at + m + i] -= value * entries[at + i]
        if not _eliminate_pivot(entries, start, m, s, k + 1, exchanges, first):
            return False
    return True


@kernel
def factorise(first, end, beginning, starts, below, children, places_from, places, sources_from, sources, targets,
              values, entries, exchanges, columns_beyond, stack):
    """Factors of all fronts; False where one is singular. Arguments as in `SmallFronts`; the last two are room."""
    top = 0
    for k in range(first.shape[0]):
        s, b, start = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k]
        m = s + b
        corner = m * s
        entries[start:start + corner] = 0.0
        columns_beyond[:m * b] = 0.0
        for n in range(sources_from[k], sources_from[k + 1]):
            place = targets[n]
            if place < corner:
                entries[start + place] += values[sources[n]]
            else:
                columns_beyond[place - corner] += values[sources[n]]
        for n in range(below[k], below[k + 1]):
            size = places_from[n + 1] - places_from[n]
            top -= size * size
        update = top
        for n in range(below[k], below[k + 1]):
            size, from_ = places_from[n + 1] - places_from[n], places_from[n]
            for j in range(size):
                column = places[from_ + j] * m
                if column < corner:
                    for i in range(size):
                        entries[start + column + places[from_ + i]] += stack[update + i]
                else:
                    for i in range(size):
                        columns_beyond[column - corner + places[from_ + i]] += stack[update + i]
                update += size
        if not _eliminate_pivots(entries, start, m, s, exchanges, first[k]):
            return False
        for j in range(b):
            _exchange(columns_beyond, j * m, exchanges, first[k], 0, s)
        for j in range(0, b - 1, 2):
            _reduce_pair(entries, start, m, s, columns_beyond, j * m, (j + 1) * m)
        if b % 2 == 1:
            _reduce(entries, start, m, s, columns_beyond, (b - 1) * m)
        for j in range(b):
            at, upper = j * m, start + corner + j * s
            for i in range(s):
                entries[upper + i] = columns_beyond[at + i]
            for i in range(b):
                stack[top + i] = columns_beyond[at + s + i]
            top += b
    return True


@kernel
def _subtract(entries, at, factor_, room, first, end):
    """room[first:end] less a column of entries times a number."""
    a = _U(at)
    for row in range(first, end):
        i = _U(row)
        room[i] -= factor_ * entries[a + i]


@kernel
def _dot(entries, at, room, first, end):
    total = 0.0
    a = _U(at)
    for row in range(first, end):
        i = _U(row)
        total += entries[a + i] * room[i]
    return total


@kernel
def solve(entries, exchanges, first, end, beginning, boundary, starts, x, room):
    """Solutions in place of right-hand sides x (m, n)."""
    for c in range(x.shape[0]):
        column = x[c]
        for k in range(first.shape[0]):
            s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
            m = s + b
            for i in range(s):
                room[i] = column[f + i]
            room[s:m] = 0.0
            for i in range(s):
                partner = exchanges[f + i]
                room[i], room[partner] = room[partner], room[i]
            _reduce(entries, start, m, s, room, 0)
            for i in range(s):
                column[f + i] = room[i]
            for i in range(b):
                column[boundary[beginning[k] + i]] += room[s + i]
        for k in range(first.shape[0] - 1, -1, -1):
            s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
            m = s + b
            for i in range(s):
                room[i] = column[f + i]
            for j in range(b):
                _subtract(entries, start + m * s + j * s, column[boundary[beginning[k] + j]], room, 0, s)
            for j in range(s - 1, -1, -1):
                room[j] /= entries[start + j * m + j]
                _subtract(entries, start + j * m, room[j], room, 0, j)
            for i in range(s):
                column[f + i] = room[i]


@kernel
def solve_transposed(entries, exchanges, first, end, beginning, boundary, starts, x, room):
    """Solutions with the transposed matrix in place of right-hand sides x (m, n)."""
    for c in range(x.shape[0]):
        column = x[c]
        for k in range(first.shape[0]):
            s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
            m = s + b
            for j in range(s):
                room[j] = column[f + j]
            for j in range(s):
                room[j] = (room[j] - _dot(entries, start + j * m, room, 0, j)) / entries[start + j * m + j]
            for j in range(b):
                column[boundary[beginning[k] + j]] -= _dot(entries, start + m * s + j * s, room, 0, s)
            for j in range(s):
                column[f + j] = room[j]
        for k in range(first.shape[0] - 1, -1, -1):
            s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
            m = s + b
            for i in range(s):
                room[i] = column[f + i]
            for i in range(b):
                room[s + i] = column[boundary[beginning[k] + i]]
            for j in range(s - 1, -1, -1):
                room[j] -= _dot(entries, start + j * m, room, j + 1, m)
            for i in range(s - 1, -1, -1):
                partner = exchanges[f + i]
                room[i], room[partner] = room[partner], room[i]
            for i in range(s):
                column[f + i] = room[i]


@kernel
def _less(target, at, source, from_, width, factor_):
    """target[at:at + width] less a part of source times a number."""
    o, w = _U(at), _U(from_)
    for c in range(width):
        i = _U(c)
        target[o + i] -= factor_ * source[w + i]


@kernel
def _less_four(target, at, source, a, b, c, d, width, first, second, third, fourth):
    """`_less` of four parts in turn."""
    o, w, x, y, z = _U(at), _U(a), _U(b), _U(c), _U(d)
    for column in range(width):
        i = _U(column)
        target[o + i] = (target[o + i] - first * source[w + i] - second * source[x + i] - third * source[y + i]
                         - fourth * source[z + i])


@kernel
def _less_sum_of_four(target, at, from_, width, first, second, third, fourth):
    """target[at:at + width] less the sum of the four parts of it from `from_` on, each times a number."""
    o, w = _U(at), _U(from_)
    x, y, z = w + _U(width), w + _U(2 * width), w + _U(3 * width)
    for column in range(width):
        i = _U(column)
        target[o + i] -= (target[w + i] * first + target[x + i] * second + target[y + i] * third
                          + target[z + i] * fourth)


@kernel
def _swap(values, first, second, width):
    """Exchange two parts."""
    for c in range(width):
        values[first + c], values[second + c] = values[second + c], values[first + c]


@kernel
def _copy(source, from_, target, at, size):
    o, w = _U(at), _U(from_)
    for k in range(size):
        target[o + _U(k)] = source[w + _U(k)]


@kernel
def solve_many(entries, exchanges, first, end, beginning, boundary, starts, width, x, room):
    """`solve` for right-hand sides side by side, x (n width,) row by row, in the same order of operations."""
    for k in range(first.shape[0]):
        s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
        m = s + b
        _copy(x, f * width, room, 0, s * width)
        room[s * width:m * width] = 0.0
        for i in range(s):
            if exchanges[f + i] != i:
                _swap(room, i * width, exchanges[f + i] * width, width)
        j = 0
        while j + 4 <= s:
            a, c, d, e = start + j * m, start + (j + 1) * m, start + (j + 2) * m, start + (j + 3) * m
            at = j * width
            _less(room, at + width, room, at, width, entries[a + j + 1])
            for below in range(2):
                _less(room, at + 2 * width, room, at + below * width, width, entries[start + (j + below) * m + j + 2])
            for below in range(3):
                _less(room, at + 3 * width, room, at + below * width, width, entries[start + (j + below) * m + j + 3])
            for row in range(j + 4, m):
                _less_sum_of_four(room, row * width, at, width, entries[a + row], entries[c + row], entries[d + row],
                                  entries[e + row])
            j += 4
        while j < s:
            for row in range(j + 1, m):
                _less(room, row * width, room, j * width, width, entries[start + j * m + row])
            j += 1
        _copy(room, 0, x, f * width, s * width)
        for i in range(b):
            o, w = _U(boundary[beginning[k] + i] * width), _U((s + i) * width)
            for c in range(width):
                x[o + _U(c)] += room[w + _U(c)]
    for k in range(first.shape[0] - 1, -1, -1):
        s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
        m = s + b
        _copy(x, f * width, room, 0, s * width)
        j = 0
        while j + 4 <= b:
            n, u = beginning[k] + j, start + m * s + j * s
            for i in range(s):
                _less_four(room, i * width, x, boundary[n] * width, boundary[n + 1] * width, boundary[n + 2] * width,
                           boundary[n + 3] * width, width, entries[u + i], entries[u + s + i], entries[u + 2 * s + i],
                           entries[u + 3 * s + i])
            j += 4
        while j < b:
            for i in range(s):
                _less(room, i * width, x, boundary[beginning[k] + j] * width, width,
                      entries[start + m * s + j * s + i])
            j += 1
        for j in range(s - 1, -1, -1):
            pivot = entries[start + j * m + j]
            for c in range(j * width, (j + 1) * width):
                room[c] /= pivot
            for i in range(j):
                _less(room, i * width, room, j * width, width, entries[start + j * m + i])
        _copy(room, 0, x, f * width, s * width)


@kernel
def _add(target, at, source, from_, width, factor_):
    """target[at:at + width] and a part of source times a number."""
    o, w = _U(at), _U(from_)
    for c in range(width):
        i = _U(c)
        target[o + i] += factor_ * source[w + i]


@kernel
def solve_many_transposed(entries, exchanges, first, end, beginning, boundary, starts, width, x, room):
    """`solve_transposed` for right-hand sides side by side, x (n width,) row by row, in the same order."""
    total = np.empty(width)
    for k in range(first.shape[0]):
        s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
        m = s + b
        _copy(x, f * width, room, 0, s * width)
        for j in range(s):
            total[:] = 0.0
            for i in range(j):
                _add(total, 0, room, i * width, width, entries[start + j * m + i])
            pivot = entries[start + j * m + j]
            for c in range(width):
                room[j * width + c] = (room[j * width + c] - total[c]) / pivot
        for j in range(b):
            total[:] = 0.0
            for i in range(s):
                _add(total, 0, room, i * width, width, entries[start + m * s + j * s + i])
            at = boundary[beginning[k] + j] * width
            for c in range(width):
                x[at + c] -= total[c]
        _copy(room, 0, x, f * width, s * width)
    for k in range(first.shape[0] - 1, -1, -1):
        s, b, start, f = end[k] - first[k], beginning[k + 1] - beginning[k], starts[k], first[k]
        m = s + b
        _copy(x, f * width, room, 0, s * width)
        for i in range(b):
            _copy(x, boundary[beginning[k] + i] * width, room, (s + i) * width, width)
        for j in range(s - 1, -1, -1):
            total[:] = 0.0
            for i in range(j + 1, m):
                _add(total, 0, room, i * width, width, entries[start + j * m + i])
            for c in range(width):
                room[j * width + c] -= total[c]
        for i in range(s - 1, -1, -1):
            if exchanges[f + i] != i:
                _swap(room, i * width, exchanges[f + i] * width, width)
        _copy(room, 0, x, f * width, s * width)
