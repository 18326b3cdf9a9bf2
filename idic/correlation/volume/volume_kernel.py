"""The volume kernel: motion of the nodes -> position in the scan -> spline value -> residual -> sums over the element.

    r = f - g(x + u)

Voxels run through it element by element in buffers of 256, row by row; those of hex8 and tet4 with straight edges
inside the scan in pieces of eight (`idic.correlation.volume.eight_voxels`). Neighbours along a row whose motion has the
same whole part read neighbouring coefficients: eight of them at a time are one vector, and the 64 taps of the cubic
spline are 64 loads without a gather. The sums of an element are those of the monomials of its cell
(`idic.correlation.volume.solid_cells`) times grad f times r; float32 within a buffer, float64 across buffers. The
kernel is serial and free of the interpreter lock.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.correlation.image_equations.image_kernel import drop_lost
from idic.correlation.volume.solid_cells import N_TERMS, fill_monomials, local_places
from idic.correlation.volume.eight_taps import LANES, eight_cubic, eight_quintic
from idic.correlation.volume.eight_voxels import N_BRICK, ROW, compare_eight, fetch_early, place_eight

BUFFER = 256  # voxels
_MAX_MOTION = np.float32(1e6)  # voxels; keeps integers small
_MAX_PLACE = 1.02  # of a voxel in its cell, along each of its axes
_FAST = {"contract", "reassoc", "nsz"}  # not nnan: the meaning of nan is kept
_INT = np.int32
_ZERO = np.float32(0.0)


@njit(cache=True, nogil=True)
def _positions(x, y, z, u, steps, box, low, high, fraction, base, lost):
    """First tap and fractions of every voxel of a buffer; clamped and marked lost beyond the borders.

    x, y, z: int32 (n,); u: float32 (3, n), motion less its whole part `steps` (3,) int32; box: int32 (8,), first
    column, row and slice that have all taps, number of such columns, rows and slices, entries of a row and of a slice;
    low, high: int32 (3,), the first and last place that counts as inside.
    """
    first_x, first_y, first_z, nx, ny, nz, row, plane = box[0], box[1], box[2], box[3], box[4], box[5], box[6], box[7]
    low_x, low_y, low_z = max(low[0], first_x), max(low[1], first_y), max(low[2], first_z)
    end_x, end_y, end_z = min(high[0], first_x + nx - 1), min(high[1], first_y + ny - 1), min(high[2], first_z + nz - 1)
    low_x, low_y, low_z = _INT(low_x), _INT(low_y), _INT(low_z)
    end_x, end_y, end_z = _INT(end_x), _INT(end_y), _INT(end_z)
    whole_x, whole_y, whole_z = steps[0], steps[1], steps[2]
    for k in range(x.size):
        ux = min(max(u[0, k], -_MAX_MOTION), _MAX_MOTION)
        uy = min(max(u[1, k], -_MAX_MOTION), _MAX_MOTION)
        uz = min(max(u[2, k], -_MAX_MOTION), _MAX_MOTION)
        fx, fy, fz = np.floor(ux), np.floor(uy), np.floor(uz)
        tx, ty, tz = ux - fx, uy - fy, uz - fz
        px, py, pz = _INT(x[k] + whole_x + _INT(fx)), _INT(y[k] + whole_y + _INT(fy)), _INT(z[k] + whole_z + _INT(fz))
        outside = (px < low_x) | (px > end_x) | (py < low_y) | (py > end_y) | (pz < low_z) | (pz > end_z)
        outside = outside | ((px == end_x) & (tx > 0)) | ((py == end_y) & (ty > 0)) | ((pz == end_z) & (tz > 0))
        lost[k] = _INT(outside)
        px, py, pz = min(max(px, low_x), end_x), min(max(py, low_y), end_y), min(max(pz, low_z), end_z)
        fraction[0, k], fraction[1, k], fraction[2, k] = tx, ty, tz
        base[k] = _INT(_INT(px - first_x) + _INT(py - first_y) * row + _INT(pz - first_z) * plane)


@njit(cache=True, nogil=True)
def spline_buffer(c, base, n, row, plane, degree, fraction, out):
    """Values of the scan at the positions of a buffer; `base` has LANES - 1 entries beyond n."""
    k = 0
    while k < n:
        first = base[k]
        m = 1
        while m < LANES and k + m < n and base[k + m] == first + m:
            m += 1
        if degree == 3:
            eight_cubic(c, first, row, plane, fraction[0], fraction[1], fraction[2], k, out)
        else:
            eight_quintic(c, first, row, plane, fraction[0], fraction[1], fraction[2], k, out)
        k += m


@njit(cache=True, nogil=True)
def _motion(coefficients, powers, n_terms, n, u):
    """Motion of the voxels of a buffer  # coefficients (3, n_terms) float32, powers (n_terms, BUFFER) -> u (3, n)"""
    for d in range(3):
        a0, a1, a2, a3 = coefficients[d, 0], coefficients[d, 1], coefficients[d, 2], coefficients[d, 3]
        for k in range(n):
            u[d, k] = a0 + a1 * powers[1, k] + a2 * powers[2, k] + a3 * powers[3, k]
        for m in range(4, n_terms, 4):  # coefficients beyond the terms of the cell are zero
            a0, a1, a2, a3 = coefficients[d, m], coefficients[d, m + 1], coefficients[d, m + 2], coefficients[d, m + 3]
            for k in range(n):
                u[d, k] += (a0 * powers[m, k] + a1 * powers[m + 1, k] + a2 * powers[m + 2, k]
                            + a3 * powers[m + 3, k])


@njit(cache=True, nogil=True, fastmath=_FAST)
def _dots3(p, x, y, z):
    a = b = c = _ZERO
    for k in range(p.size):
        a += p[k] * x[k]
        b += p[k] * y[k]
        c += p[k] * z[k]
    return a, b, c


@njit(cache=True, nogil=True)
def _weighted(r, gx, gy, gz, out):
    for k in range(r.size):
        out[0, k], out[1, k], out[2, k] = r[k] * gx[k], r[k] * gy[k], r[k] * gz[k]


@njit(cache=True, nogil=True)
def _residuals(f, value, n, r):
    for k in range(n):
        r[k] = f[k] - value[k]


@njit(cache=True, nogil=True)
def volume_pass(elements, kind, n_terms, run_start, run, voxel_start, affine, middle, places, table_start, table,
                f, gx, gy, gz, mean, motion, c, degree,
                box, low, high, valid, keep_residual, residual, fractions, sums, n_lost):
    """Sums of the elements of a block over their voxels that are inside the scan.

    elements (n,): numbers of the elements; kind, run_start, voxel_start, affine, middle, places, table_start, mean,
    motion, sums, n_lost: of all elements; run (n_runs, 4) int16|int32: column, row, slice, length;
    f, gx, gy, gz, valid, residual, fractions: of the voxels of the block, which begin at voxel_start[elements[0]];
    motion (n_elements, 3, n_terms): monomial coefficients of the displacement, voxels; c: flat float32 coefficients of
    the scan; valid: ones, set to zero where a voxel leaves the scan;
    sums (n_elements, 3 n_terms + 3): monomials times gx r, gy r, gz r; r^2, r, r (f - mean).
    """
    begin = voxel_start[elements[0]]
    n_max = motion.shape[2]
    powers = np.zeros((N_TERMS, BUFFER), np.float32)
    x, y, z = np.empty(BUFFER, np.int32), np.empty(BUFFER, np.int32), np.empty(BUFFER, np.int32)
    u, fraction = np.empty((3, BUFFER), np.float32), np.zeros((3, BUFFER + LANES), np.float32)
    base, lost = np.zeros(BUFFER + LANES, np.int32), np.empty(BUFFER, np.int32)
    value, r = np.empty(BUFFER + LANES, np.float32), np.empty(BUFFER, np.float32)
    weighted, place = np.empty((3, BUFFER), np.float32), np.empty((3, BUFFER), np.float32)
    steps, coefficients = np.empty(3, np.int32), np.zeros((3, N_TERMS), np.float32)
    row, plane = box[6], box[7]
    brick_motion, start, slope = np.empty(3 * N_BRICK, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    terms, fractions_of, bases = np.ones(N_BRICK * ROW, np.float32), np.zeros(3 * ROW, np.float32), np.zeros(ROW, _INT)
    values, products = np.zeros(ROW, np.float32), np.zeros(5 * ROW, np.float32)
    pieces = np.empty((BUFFER // LANES, 3), np.int64)
    for index in range(elements.size):
        e = elements[index]
        n = n_terms[kind[e]]
        if affine[e] and n <= N_BRICK and _is_inside(run, run_start[e], run_start[e + 1], motion[e], n, box, low, high):
            _brick(e, n, run_start, run, voxel_start[e] - begin, middle[e], places[e], f, gx, gy, gz, mean[e],
                   motion[e], c, degree, box, keep_residual, residual, fractions, sums, brick_motion, start, slope,
                   terms, fractions_of, bases, values, products, pieces)
            n_lost[e] = 0
            continue
        for d in range(3):
            shift = np.rint(min(max(motion[e, d, 0], -1e6), 1e6))
            steps[d] = _INT(shift)
            for m in range(n):
                coefficients[d, m] = np.float32(motion[e, d, m])
            for m in range(n, N_TERMS):
                coefficients[d, m] = _ZERO
            coefficients[d, 0] = np.float32(motion[e, d, 0] - shift)
        for m in range(sums.shape[1]):
            sums[e, m] = 0.0
        n_lost[e] = 0
        j, passed = run_start[e], 0  # run, voxels of it that are through
        s = voxel_start[e]
        while s < voxel_start[e + 1]:
            t = min(s + BUFFER, voxel_start[e + 1])
            size = t - s
            j, passed = fill_places(run, j, passed, size, x, y, z)
            local_places(affine[e], middle[e], places[e], table, table_start[e] + s - voxel_start[e], size, x, y, z,
                         place)
            fill_monomials(kind[e], place, size, powers)
            _motion(coefficients, powers, n, size, u)
            first, end = s - begin, t - begin
            _positions(x[:size], y[:size], z[:size], u, steps, box, low, high, fraction, base, lost)
            spline_buffer(c, base, size, row, plane, degree, fraction, value)
            _residuals(f[first:end], value, size, r)
            n_lost[e] += drop_lost(lost[:size], valid[first:end], r)
            _weighted(r[:size], gx[first:end], gy[first:end], gz[first:end], weighted)
            for m in range(n):
                a, b, d = _dots3(powers[m, :size], weighted[0, :size], weighted[1, :size], weighted[2, :size])
                sums[e, m] += a
                sums[e, n_max + m] += b
                sums[e, 2 * n_max + m] += d
            rr, r1, rf = _grey_sums(r[:size], f[first:end], mean[e])
            sums[e, 3 * n_max] += rr
            sums[e, 3 * n_max + 1] += r1
            sums[e, 3 * n_max + 2] += rf
            if keep_residual:
                for k in range(size):
                    residual[first + k] = r[k]
                    for d in range(3):
                        fractions[d, first + k] = fraction[d, k]
            s = t


@njit(cache=True, nogil=True)
def _is_inside(run, begin, end, motion, n, box, low, high):
    """Whether all voxels of an element are inside the scan after any motion within its bounds."""
    for d in range(3):
        low_px, high_px = run[begin, d], run[begin, d]
        for j in range(begin, end):
            low_px = min(low_px, run[j, d])
            high_px = max(high_px, run[j, d] + (run[j, 3] - 1 if d == 0 else 0))
        spread = 0.0
        for m in range(1, n):
            spread += abs(motion[d, m])
        spread = _MAX_PLACE * spread + 1e-3
        if not spread < _MAX_MOTION:
            return False
        if not (low_px + motion[d, 0] - spread > max(low[d], box[d])
                and high_px + motion[d, 0] + spread < min(high[d], box[d] + box[3 + d] - 1)):
            return False
    return True


@njit(cache=True, nogil=True)
def _brick(e, n, run_start, run, voxel, middle, inverse, f, gx, gy, gz, mean, motion, c, degree, box, keep_residual,
           residual, fractions, sums, coefficients, start, slope, powers, fraction, base, value, weighted, pieces):
    """`volume_pass` of an element of hex8 or tet4 with straight edges that is inside the scan: runs in pieces of eight
    voxels, beyond whose end the residual is zero. From `coefficients` on: room to work in."""
    n_max, row, plane = motion.shape[1], np.int64(box[6]), np.int64(box[7])
    shift = 0
    for d in range(3):
        steps = np.int64(np.rint(motion[d, 0]))
        for m in range(N_BRICK):
            coefficients[d * N_BRICK + m] = np.float32(motion[d, m]) if m < n else _ZERO
        coefficients[d * N_BRICK] = np.float32(motion[d, 0] - steps)
        slope[d] = inverse[d, 0]
        shift += (steps - box[d]) * (1 if d == 0 else row if d == 1 else plane)
    for m in range(sums.shape[1]):
        sums[e, m] = 0.0
    k = 0
    for j in range(run_start[e], run_start[e + 1]):
        x, y, z = (np.float32(run[j, 0] - middle[0]), np.float32(run[j, 1] - middle[1]),
                   np.float32(run[j, 2] - middle[2]))
        for d in range(3):
            start[d] = inverse[d, 3] + inverse[d, 0] * x + inverse[d, 1] * y + inverse[d, 2] * z
        first = run[j, 0] + run[j, 1] * row + run[j, 2] * plane + shift
        length, i = np.int64(run[j, 3]), 0
        while i < length:
            piece = k // LANES
            pieces[piece, 0], pieces[piece, 1] = voxel, min(LANES, length - i)
            pieces[piece, 2] = place_eight(start, slope, coefficients, first + i, row, plane, k, powers, fraction, base)
            for d in range(degree + 1):  # the other rows of taps are those of the rows of voxels before
                fetch_early(c, first + i + degree * row + d * plane)
            for d in range(3):
                start[d] += np.float32(LANES) * slope[d]
            voxel += pieces[piece, 1]
            k += LANES
            i += LANES
            if k == BUFFER:
                _compare_pieces(pieces, k, c, degree, row, plane, f, gx, gy, gz, fraction, base, value, weighted,
                                keep_residual, residual, fractions)
                _add_products(powers, weighted, n, k, n_max, mean, sums[e])
                k = 0
    if k:
        _compare_pieces(pieces, k, c, degree, row, plane, f, gx, gy, gz, fraction, base, value, weighted,
                        keep_residual, residual, fractions)
        end = (k + 31) // 32 * 32
        for m in range(5):
            weighted[m * ROW + k:m * ROW + end] = _ZERO
        _add_products(powers, weighted, n, end, n_max, mean, sums[e])


@njit(cache=True, nogil=True)
def _compare_pieces(pieces, end, c, degree, row, plane, f, gx, gy, gz, fraction, base, value, weighted, keep_residual,
                    residual, fractions):
    """Values and residuals of the pieces of a buffer; pieces (n, 3): first voxel, voxels, how many have neighbouring
    taps from the first on."""
    fraction_x, fraction_y, fraction_z = fraction[:ROW], fraction[ROW:2 * ROW], fraction[2 * ROW:]
    for k in range(0, end, LANES):
        at, stop, together = k, k + pieces[k // LANES, 1], pieces[k // LANES, 2]
        while True:
            if degree == 3:
                eight_cubic(c, base[at], row, plane, fraction_x, fraction_y, fraction_z, at, value)
            else:
                eight_quintic(c, base[at], row, plane, fraction_x, fraction_y, fraction_z, at, value)
            at += together
            if at >= stop:
                break
            together = 1
            while at + together < stop and base[at + together] == base[at] + together:
                together += 1
    for k in range(0, end, LANES):
        voxel, size = pieces[k // LANES, 0], pieces[k // LANES, 1]
        compare_eight(f, gx, gy, gz, voxel, size, value, k, weighted)
        if keep_residual:
            for m in range(size):
                residual[voxel + m] = weighted[3 * ROW + k + m]
                for d in range(3):
                    fractions[d, voxel + m] = fraction[d * ROW + k + m]


@njit(cache=True, nogil=True)
def _add_products(powers, weighted, n, size, n_max, mean, sums):
    """The terms of a buffer times the products of gradient and residual, added to the sums of an element."""
    x, y, z = weighted[:size], weighted[ROW:ROW + size], weighted[2 * ROW:2 * ROW + size]
    for m in range(n):
        a, b, d = _dots3(powers[m * ROW:m * ROW + size], x, y, z)
        sums[m] += a
        sums[n_max + m] += b
        sums[2 * n_max + m] += d
    rr, r1, rf = _grey_sums(weighted[3 * ROW:3 * ROW + size], weighted[4 * ROW:4 * ROW + size], mean)
    sums[3 * n_max] += rr
    sums[3 * n_max + 1] += r1
    sums[3 * n_max + 2] += rf


@njit(cache=True, nogil=True)
def sums_of_values(elements, kind, n_terms, run_start, run, voxel_start, affine, middle, places, table_start, table,
                   values, f, gx, gy, gz, mean, sums):
    """Sums of the elements of a block as those of `volume_pass`, of given values in the place of a residual.

    values, f, gx, gy, gz: of the voxels of the block, which begin at voxel_start[elements[0]]
    """
    begin, n_max = voxel_start[elements[0]], (sums.shape[1] - 3) // 3
    powers = np.zeros((N_TERMS, BUFFER), np.float32)
    x, y, z = np.empty(BUFFER, np.int32), np.empty(BUFFER, np.int32), np.empty(BUFFER, np.int32)
    weighted, place = np.empty((3, BUFFER), np.float32), np.empty((3, BUFFER), np.float32)
    for e in elements:
        n = n_terms[kind[e]]
        sums[e] = 0.0
        j, passed, s = run_start[e], 0, voxel_start[e]
        while s < voxel_start[e + 1]:
            t = min(s + BUFFER, voxel_start[e + 1])
            size, first, end = t - s, s - begin, t - begin
            j, passed = fill_places(run, j, passed, size, x, y, z)
            local_places(affine[e], middle[e], places[e], table, table_start[e] + s - voxel_start[e], size, x, y, z,
                         place)
            fill_monomials(kind[e], place, size, powers)
            r = values[first:end]
            _weighted(r, gx[first:end], gy[first:end], gz[first:end], weighted)
            for m in range(n):
                a, b, d = _dots3(powers[m, :size], weighted[0, :size], weighted[1, :size], weighted[2, :size])
                sums[e, m] += a
                sums[e, n_max + m] += b
                sums[e, 2 * n_max + m] += d
            rr, r1, rf = _grey_sums(r, f[first:end], mean[e])
            sums[e, 3 * n_max] += rr
            sums[e, 3 * n_max + 1] += r1
            sums[e, 3 * n_max + 2] += rf
            s = t


@njit(cache=True, nogil=True, fastmath=_FAST)
def _grey_sums(r, f, mean):
    rr = r1 = rf = _ZERO
    for k in range(r.size):
        rr += r[k] * r[k]
        r1 += r[k]
        rf += r[k] * (f[k] - mean)
    return rr, r1, rf


@njit(cache=True, nogil=True)
def fill_places(run, j, passed, size, x, y, z):
    """Column, row and slice of the next `size` voxels; the run to go on with, and the voxels of it that are through."""
    k = 0
    while k < size:
        x0, length = run[j, 0] + passed, run[j, 3] - passed
        m = min(length, size - k)
        y0, z0 = run[j, 1], run[j, 2]
        for i in range(m):
            x[k + i] = x0 + i
            y[k + i] = y0
            z[k + i] = z0
        k += m
        if m == length:
            j += 1
            passed = 0
        else:
            passed += m
    return j, passed
