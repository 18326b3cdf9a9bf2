"""The image kernel: motion of the nodes -> position in the frame -> spline value -> residual -> sums over the element.

Where an element is stretched, the residual is that of the reference with the blur of the frame (docs/method.md,
equation 1.10): eight more products per pixel.

The sums of an element are those of the eight monomials m_k (docs/method.md, equation 3.6) times grad f times r, from
which `frame` makes H and q. Within an element, blocks of 256 pixels run through three short loops that the compiler
vectorises: positions, spline values, sums; float32 within a block, float64 across blocks. A position is an integer
pixel plus a float32 fraction, relative to a whole-pixel motion of the element: no digits are lost on large images. The
kernel is serial and free of the interpreter lock: one frame per Python thread.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.images import MIRROR_PAD_PX, cubic_value, quintic_value

N_SUMS = 19  # 8 monomials x fx r, 8 x fy r, r^2, r, r f_centred
_PIXELS_PER_BLOCK = 256  # pixels that pass the three loops together
_MAX_MOTION_PX = np.float32(1e6)  # keeps integers small; such a pixel is outside any image
_INT = np.int32
_ZERO = np.float32(0.0)
_FAST = {"contract", "reassoc", "nsz"}  # not nnan: the meaning of nan is kept


@njit(cache=True, nogil=True, fastmath=_FAST)
def _positions(ix, iy, a, b, u, v, shift_x, shift_y, last_x, last_y, border, stride, first_tap, fraction_x, fraction_y,
               base, lost):
    """First tap and fractions of every pixel of a block; clamped and marked lost beyond the borders."""
    u0, u1, u2, u3, u4, u5, u6, u7 = u[0], u[1], u[2], u[3], u[4], u[5], u[6], u[7]
    v0, v1, v2, v3, v4, v5, v6, v7 = v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]
    n_lost = _INT(0)
    end_x, end_y = _INT(last_x - border), _INT(last_y - border)
    for k in range(a.size):
        p, q = a[k], b[k]
        du = u0 + p * (u1 + p * u4) + q * (u2 + p * (u3 + p * u6) + q * (u5 + p * u7))
        dv = v0 + p * (v1 + p * v4) + q * (v2 + p * (v3 + p * v6) + q * (v5 + p * v7))
        du, dv = min(max(du, -_MAX_MOTION_PX), _MAX_MOTION_PX), min(max(dv, -_MAX_MOTION_PX), _MAX_MOTION_PX)
        whole_x, whole_y = np.floor(du), np.floor(dv)
        tx, ty = du - whole_x, dv - whole_y
        x, y = _INT(ix[k] + shift_x + _INT(whole_x)), _INT(iy[k] + shift_y + _INT(whole_y))
        outside = (x < border) | (x > end_x) | (y < border) | (y > end_y)
        outside = outside | ((x == end_x) & (tx > 0)) | ((y == end_y) & (ty > 0))
        lost[k] = _INT(outside)
        n_lost = _INT(n_lost + _INT(outside))
        x, y = min(max(x, _INT(0)), last_x), min(max(y, _INT(0)), last_y)
        fraction_x[k], fraction_y[k] = tx, ty
        base[k] = _INT(_INT(y + first_tap) * stride + _INT(x + first_tap))
    return n_lost


@njit(cache=True, nogil=True, fastmath=_FAST)
def _cubic_residuals(f, c, base, stride, fraction_x, fraction_y, r):
    for k in range(f.size):
        r[k] = f[k] - cubic_value(c, np.uint64(base[k]), stride, fraction_x[k], fraction_y[k])


@njit(cache=True, nogil=True, fastmath=_FAST)
def _quintic_residuals(f, c, base, stride, fraction_x, fraction_y, r):
    for k in range(f.size):
        r[k] = f[k] - quintic_value(c, np.uint64(base[k]), stride, fraction_x[k], fraction_y[k])


@njit(cache=True, nogil=True, fastmath=_FAST)
def _add_sums(a, b, f, fx, fy, mean, r, out):
    x0 = x1 = x2 = x3 = x4 = x5 = x6 = x7 = _ZERO
    y0 = y1 = y2 = y3 = y4 = y5 = y6 = y7 = _ZERO
    rr = r1 = rf = _ZERO
    for k in range(a.size):
        p, q, s = a[k], b[k], r[k]
        pq = p * q
        dx, dy = s * fx[k], s * fy[k]
        xa, xb, ya, yb = dx * p, dx * q, dy * p, dy * q
        rr += s * s
        r1 += s
        rf += s * (f[k] - mean)
        x0 += dx
        x1 += xa
        x2 += xb
        x3 += xa * q
        x4 += xa * p
        x5 += xb * q
        x6 += xa * pq
        x7 += xb * pq
        y0 += dy
        y1 += ya
        y2 += yb
        y3 += ya * q
        y4 += ya * p
        y5 += yb * q
        y6 += ya * pq
        y7 += yb * pq
    out[0] += x0
    out[1] += x1
    out[2] += x2
    out[3] += x3
    out[4] += x4
    out[5] += x5
    out[6] += x6
    out[7] += x7
    out[8] += y0
    out[9] += y1
    out[10] += y2
    out[11] += y3
    out[12] += y4
    out[13] += y5
    out[14] += y6
    out[15] += y7
    out[16] += rr
    out[17] += r1
    out[18] += rf


@njit(cache=True, nogil=True)
def _split_motion(motion, u):
    """Whole-pixel part of an element's displacement; the rest as float32 polynomial coefficients."""
    shift = np.rint(min(max(motion[0], -1e6), 1e6))
    for k in range(8):
        u[k] = np.float32(motion[k])
    u[0] = np.float32(motion[0] - shift)
    return _INT(shift)


@njit(cache=True, nogil=True, fastmath=_FAST)
def _matched(f, maps, first, weights, out):
    """f and its derivatives from pixel `first` on, weighed: a block of the reference with the blur of the frame."""
    w0, w1, w2, w3, w4, w5, w6, w7 = (weights[0], weights[1], weights[2], weights[3], weights[4], weights[5],
                                      weights[6], weights[7])
    end = first + f.size
    d0, d1, d2, d3 = maps[0, first:end], maps[1, first:end], maps[2, first:end], maps[3, first:end]
    d4, d5, d6, d7 = maps[4, first:end], maps[5, first:end], maps[6, first:end], maps[7, first:end]
    for k in range(f.size):
        out[k] = (f[k] + w0 * d0[k] + w1 * d1[k] + w2 * d2[k] + w3 * d3[k] + w4 * d4[k] + w5 * d5[k] + w6 * d6[k]
                  + w7 * d7[k])


@njit(cache=True, nogil=True)
def _is_matched(weights, e):
    """Whether the blur of the frame differs from that of the reference in an element."""
    return weights.shape[0] > 0 and (weights[e, 0] != 0 or weights[e, 1] != 0 or weights[e, 2] != 0)


@njit(cache=True, nogil=True)
def image_pass(start, ix, iy, a, b, f, fx, fy, maps, weights, means, motion, coefficients, width, degree, border, valid,
               sums, n_lost):
    """Sums of every element over its pixels that are inside the image and valid on entry.

    start (nel + 1,); ix, iy int32, a, b, f, fx, fy float32 (n_px,); maps (8, n_px), weights (nel, 8) float32: what
    matches the blur of the reference (`idic.images.matched_blur`), or both empty;
    means (nel,) float32: grey value r f is centred on;
    motion (nel, 2, 8): monomial coefficients of the displacement, px; coefficients: flat float32, rows `width` long;
    border: int32, pixels along the borders of the image that count as outside;
    valid (n_px,) uint8: 0 on entry leaves a pixel out, set to 0 where a pixel left the image;
    sums (nel, N_SUMS) and n_lost (nel,): results.
    """
    stride = np.uint64(width)
    last_x, last_y = _INT(width - 2 * MIRROR_PAD_PX - 1), _INT(coefficients.size // width - 2 * MIRROR_PAD_PX - 1)
    first_tap = _INT(MIRROR_PAD_PX - (degree - 1) // 2)
    fraction_x, fraction_y = np.empty(_PIXELS_PER_BLOCK, np.float32), np.empty(_PIXELS_PER_BLOCK, np.float32)
    r, matched = np.empty(_PIXELS_PER_BLOCK, np.float32), np.empty(_PIXELS_PER_BLOCK, np.float32)
    base, lost = np.empty(_PIXELS_PER_BLOCK, np.int32), np.empty(_PIXELS_PER_BLOCK, np.int32)
    u, v = np.empty(8, np.float32), np.empty(8, np.float32)
    for e in range(start.size - 1):
        shift_x, shift_y = _split_motion(motion[e, 0], u), _split_motion(motion[e, 1], v)
        sums[e, :] = 0.0
        n_lost[e] = 0
        for s in range(start[e], start[e + 1], _PIXELS_PER_BLOCK):
            t = min(s + _PIXELS_PER_BLOCK, start[e + 1])
            n = t - s
            _positions(ix[s:t], iy[s:t], a[s:t], b[s:t], u, v, shift_x, shift_y, last_x, last_y, border, _INT(width),
                       first_tap, fraction_x, fraction_y, base, lost)
            still = f[s:t]
            if _is_matched(weights, e):
                still = matched[:n]
                _matched(f[s:t], maps, s, weights[e], still)
            if degree == 3:
                _cubic_residuals(still, coefficients, base, stride, fraction_x, fraction_y, r)
            else:
                _quintic_residuals(still, coefficients, base, stride, fraction_x, fraction_y, r)
            n_lost[e] += drop_lost(lost[:n], valid[s:t], r)
            _add_sums(a[s:t], b[s:t], f[s:t], fx[s:t], fy[s:t], means[e], r, sums[e])


@njit(cache=True, nogil=True)
def drop_lost(lost, valid, r):
    """Exact exclusion: the residual of a lost pixel or voxel is 0 in every sum; counted and marked."""
    count = _INT(0)
    for k in range(lost.size):
        count = _INT(count + (lost[k] | _INT(valid[k] == 0)))
    if count:
        for k in range(lost.size):
            if lost[k] or valid[k] == 0:
                valid[k] = 0
                r[k] = _ZERO
    return count


@njit(cache=True, nogil=True)
def residual_pass(start, ix, iy, a, b, f, maps, weights, motion, coefficients, width, degree, border, valid, residual,
                  fraction_x, fraction_y):
    """Residual and sub-pixel fractions of every pixel (float32, (n_px,)); same arguments as `image_pass`."""
    stride = np.uint64(width)
    last_x, last_y = _INT(width - 2 * MIRROR_PAD_PX - 1), _INT(coefficients.size // width - 2 * MIRROR_PAD_PX - 1)
    first_tap = _INT(MIRROR_PAD_PX - (degree - 1) // 2)
    base, lost = np.empty(_PIXELS_PER_BLOCK, np.int32), np.empty(_PIXELS_PER_BLOCK, np.int32)
    matched = np.empty(_PIXELS_PER_BLOCK, np.float32)
    u, v = np.empty(8, np.float32), np.empty(8, np.float32)
    for e in range(start.size - 1):
        shift_x, shift_y = _split_motion(motion[e, 0], u), _split_motion(motion[e, 1], v)
        for s in range(start[e], start[e + 1], _PIXELS_PER_BLOCK):
            t = min(s + _PIXELS_PER_BLOCK, start[e + 1])
            _positions(ix[s:t], iy[s:t], a[s:t], b[s:t], u, v, shift_x, shift_y, last_x, last_y, border, _INT(width),
                       first_tap, fraction_x[s:t], fraction_y[s:t], base, lost)
            still = f[s:t]
            if _is_matched(weights, e):
                still = matched[:t - s]
                _matched(f[s:t], maps, s, weights[e], still)
            if degree == 3:
                _cubic_residuals(still, coefficients, base, stride, fraction_x[s:t], fraction_y[s:t], residual[s:t])
            else:
                _quintic_residuals(still, coefficients, base, stride, fraction_x[s:t], fraction_y[s:t], residual[s:t])
            drop_lost(lost[: t - s], valid[s:t], residual[s:t])
