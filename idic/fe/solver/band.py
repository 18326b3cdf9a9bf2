"""LU of narrow band matrices and solutions with it, compiled, in LAPACK's band storage.

A flat band holds column after column, each of ``3 kl + 1`` entries: A[i, j] at ``2 kl + i - j``; the first kl entries
of a column are room for fill. The factors have the layout of dgbtrf: dgbtrs solves with them (the
transposed system). Narrow bands only: LAPACK works column by column there, which moves as much memory as it computes.
"""

from __future__ import annotations

import numpy as np

from idic.fe.assembly.kernels import kernel

MIN_PIVOT_RATIO = 0.1  # of the largest entry of the column: a smaller diagonal is exchanged
PANEL_COLUMNS = 4  # columns that are eliminated from the others at once


@kernel
def factor(band, half_bandwidth, pivots):
    """LU of a flat band in place, with threshold pivoting; returns 0 or the number of the zero pivot.

    A row is exchanged only where the diagonal is below `MIN_PIVOT_RATIO` times the largest entry of its column.
    Stiffness matrices are nearly definite and seldom need it; without exchanges U keeps the band of the matrix, which
    halves the work. pivots (n,) int32: the row that each row was exchanged with, from 0.
    """
    kl, n = half_bandwidth, pivots.shape[0]
    panel = np.zeros((PANEL_COLUMNS, kl + 1))
    j, last = 0, 0  # last: the column that the rows of U reach so far
    while j < n:
        done, exchange = 0, 0
        while done < min(PANEL_COLUMNS, n - j):
            eliminate(band, kl, n, j, done, j + done, j + done)
            exchange = wanted_exchange(band, kl, n, j + done)
            if exchange < 0:
                return j + done + 1
            if exchange > 0:
                break
            pivots[j + done] = j + done
            divide(band, kl, n, j + done)
            done += 1
        if done > 0:
            last = max(last, min(j + done - 1 + kl, n - 1))
        if done == PANEL_COLUMNS and kl >= PANEL_COLUMNS:
            eliminate_panel(band, kl, n, j, last, panel)
        else:
            eliminate(band, kl, n, j, done, j + done + (1 if exchange > 0 else 0), last)
        j += done
        if exchange > 0:
            pivots[j] = j + exchange
            last = max(last, min(j + kl + exchange, n - 1))
            for c in range(j, last + 1):
                k = c * (3 * kl + 1) + 2 * kl + j - c
                band[k], band[k + exchange] = band[k + exchange], band[k]
            divide(band, kl, n, j)
            eliminate(band, kl, n, j, 1, j + 1, last)
            j += 1
    return 0


@kernel
def wanted_exchange(band, kl, n, j):
    """How far below the diagonal the pivot of column j is to be taken from: 0 where it may stay, -1: it is zero."""
    at = j * (3 * kl + 1) + 2 * kl
    column = band[at:at + 1 + min(kl, n - 1 - j)]
    largest = 0.0
    for i in range(column.shape[0]):
        largest = max(largest, abs(column[i]))
    if largest == 0.0:
        return -1
    if abs(column[0]) >= MIN_PIVOT_RATIO * largest:
        return 0
    place = 0
    for i in range(column.shape[0]):
        if abs(column[i]) > abs(column[place]):
            place = i
    return place


@kernel
def divide(band, kl, n, j):
    """Column j of L: what is below the diagonal over the pivot."""
    at = j * (3 * kl + 1) + 2 * kl
    column = band[at + 1:at + 1 + min(kl, n - 1 - j)]
    column /= band[at]


@kernel
def eliminate(band, kl, n, j, count, first, last):
    """Take the pivots j, j + 1, ... (`count` of them) out of the columns first ... last, one by one."""
    stride = 3 * kl + 1
    for pivot in range(j, j + count):
        below = min(kl, n - 1 - pivot)
        source = band[pivot * stride + 2 * kl + 1:pivot * stride + 2 * kl + 1 + below]
        for c in range(first, min(last, pivot + 2 * kl) + 1):  # beyond, nothing is stored of the pivot's row
            k = c * stride + 2 * kl + pivot - c
            factor_ = band[k]
            if factor_ != 0.0:
                other = band[k + 1:k + 1 + below]
                for i in range(below):
                    other[i] -= source[i] * factor_


@kernel
def eliminate_panel(band, kl, n, j, last, panel):
    """Take the pivots j ... j + 3 out of the columns beyond, up to `last`, all four in one pass over each column.

    panel (4, kl + 1): room for the four columns of L from row j + 4 on, zero where they end earlier.
    """
    stride = 3 * kl + 1
    panel[:] = 0.0
    for q in range(PANEL_COLUMNS):
        start = (j + q) * stride + 2 * kl + PANEL_COLUMNS - q
        for i in range(min(kl, n - 1 - j - q) - PANEL_COLUMNS + 1 + q):
            panel[q, i] = band[start + i]
    at0, at1, at2 = (j * stride + 2 * kl, (j + 1) * stride + 2 * kl, (j + 2) * stride + 2 * kl)
    l10, l20, l30 = band[at0 + 1], band[at0 + 2], band[at0 + 3]
    l21, l31, l32 = band[at1 + 1], band[at1 + 2], band[at2 + 1]
    p0, p1, p2, p3 = panel[0], panel[1], panel[2], panel[3]
    for c in range(j + PANEL_COLUMNS, last + 1):
        k = c * stride + 2 * kl + j - c
        f0 = band[k]
        f1 = band[k + 1] - l10 * f0
        f2 = band[k + 2] - l20 * f0 - l21 * f1
        f3 = band[k + 3] - l30 * f0 - l31 * f1 - l32 * f2
        band[k + 1], band[k + 2], band[k + 3] = f1, f2, f3
        other = band[k + PANEL_COLUMNS:k + PANEL_COLUMNS + kl + 1]  # to row j + 4 + kl, stored by column c >= j + 4
        for i in range(kl + 1):
            other[i] -= p0[i] * f0 + p1[i] * f1 + p2[i] * f2 + p3[i] * f3


@kernel
def solve(lu, half_bandwidth, pivots, x):
    """Replace the right-hand sides, the rows of x (m, n), by the solutions; lu flat, as `factor` leaves it."""
    kl, n = half_bandwidth, pivots.shape[0]
    stride, above = 3 * kl + 1, 0
    for j in range(n):
        above = max(above, kl + pivots[j] - j)  # rows of U over the diagonal: kl without exchanges
    for j in range(n):
        p = pivots[j]
        below, at = min(kl, n - 1 - j), j * stride + 2 * kl + 1
        column = lu[at:at + below]
        for r in range(x.shape[0]):
            value = x[r, p]
            if p != j:
                x[r, p] = x[r, j]
                x[r, j] = value
            rest = x[r, j + 1:j + 1 + below]
            for i in range(below):
                rest[i] -= column[i] * value
    for j in range(n - 1, -1, -1):
        at, over = j * stride + 2 * kl, min(above, j)
        column = lu[at - over:at]
        for r in range(x.shape[0]):
            value = x[r, j] / lu[at]
            x[r, j] = value
            rest = x[r, j - over:j]
            for i in range(over):
                rest[i] -= column[i] * value
