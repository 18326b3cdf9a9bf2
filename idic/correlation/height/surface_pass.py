"""The image kernel of height images: displacement and rise of the nodes -> residual -> sums over the element.

    r = f + h - g(x + u)

The blocks of 256 pixels, the integer pixel plus float32 fraction and the splines are those of grey images
(`idic.correlation.image_equations.image_kernel`). New are the rise h, the sums against it, and frames with gaps.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.correlation.image_equations.image_kernel import (_FAST, _INT, _ZERO, _cubic_residuals, drop_lost, _positions,
                                           _quintic_residuals, _split_motion)
from idic.images import MIRROR_PAD_PX

N_HEIGHT_SUMS = 25  # 8 monomials x fx r, 8 x fy r, 8 x r, r^2
_PIXELS_PER_BLOCK = 256


@njit(cache=True, nogil=True, fastmath=_FAST)
def _raised(f, a, b, h, out):
    """f + h of a block; h: monomial coefficients (8,) float32."""
    h0, h1, h2, h3, h4, h5, h6, h7 = h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7]
    for k in range(f.size):
        p, q = a[k], b[k]
        out[k] = f[k] + (h0 + p * (h1 + p * h4) + q * (h2 + p * (h3 + p * h6) + q * (h5 + p * h7)))


@njit(cache=True, nogil=True)
def _drop_gaps(base, gap_windows, lost):
    """Mark positions whose taps reach into a gap of the frame."""
    for k in range(lost.size):
        lost[k] |= _INT(gap_windows[base[k]])


@njit(cache=True, nogil=True, fastmath=_FAST)
def _weighted_sums(a, b, weight, r, out):
    """Sums of the eight monomials times weight times r."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = _ZERO
    for k in range(r.size):
        p, q, s = a[k], b[k], weight[k] * r[k]
        sp, sq = s * p, s * q
        s0 += s
        s1 += sp
        s2 += sq
        s3 += sp * q
        s4 += sp * p
        s5 += sq * q
        s6 += sp * p * q
        s7 += sp * q * q
    out[0] += s0
    out[1] += s1
    out[2] += s2
    out[3] += s3
    out[4] += s4
    out[5] += s5
    out[6] += s6
    out[7] += s7


@njit(cache=True, nogil=True, fastmath=_FAST)
def _squares(r):
    total = _ZERO
    for k in range(r.size):
        total += r[k] * r[k]
    return total


@njit(cache=True, nogil=True)
def height_pass(start, ix, iy, a, b, f, fx, fy, motion, coefficients, width, degree, gap_windows, valid, sums, n_lost):
    """Sums of every element over its pixels that are inside the image, on no gap, and valid on entry.

    start (nel + 1,); ix, iy int32, a, b, f, fx, fy float32 (n_px,); motion (nel, 3, 8): monomial coefficients of the
    displacement (px, px) and of the rise (height units); coefficients, gap_windows: flat, rows `width` long
    (gap_windows may be empty); valid (n_px,) uint8: set to 0 where a pixel is lost; sums (nel, N_HEIGHT_SUMS), n_lost
    (nel,): results.
    """
    stride = np.uint64(width)
    last_x, last_y = _INT(width - 2 * MIRROR_PAD_PX - 1), _INT(coefficients.size // width - 2 * MIRROR_PAD_PX - 1)
    first_tap = _INT(MIRROR_PAD_PX - (degree - 1) // 2)
    fraction_x, fraction_y = np.empty(_PIXELS_PER_BLOCK, np.float32), np.empty(_PIXELS_PER_BLOCK, np.float32)
    r = np.empty(_PIXELS_PER_BLOCK, np.float32)
    raised, ones = np.empty(_PIXELS_PER_BLOCK, np.float32), np.ones(_PIXELS_PER_BLOCK, np.float32)
    base, lost = np.empty(_PIXELS_PER_BLOCK, np.int32), np.empty(_PIXELS_PER_BLOCK, np.int32)
    u, v, h = np.empty(8, np.float32), np.empty(8, np.float32), np.empty(8, np.float32)
    for e in range(start.size - 1):
        shift_x, shift_y = _split_motion(motion[e, 0], u), _split_motion(motion[e, 1], v)
        for k in range(8):  # not h[:]: that takes three seconds to compile
            h[k] = motion[e, 2, k]
        sums[e, :] = 0.0
        n_lost[e] = 0
        for s in range(start[e], start[e + 1], _PIXELS_PER_BLOCK):
            t = min(s + _PIXELS_PER_BLOCK, start[e + 1])
            n = t - s
            _positions(ix[s:t], iy[s:t], a[s:t], b[s:t], u, v, shift_x, shift_y, last_x, last_y, _INT(0), _INT(width),
                       first_tap, fraction_x, fraction_y, base, lost)
            _raised(f[s:t], a[s:t], b[s:t], h, raised)
            if degree == 3:
                _cubic_residuals(raised[:n], coefficients, base, stride, fraction_x, fraction_y, r)
            else:
                _quintic_residuals(raised[:n], coefficients, base, stride, fraction_x, fraction_y, r)
            if gap_windows.size:
                _drop_gaps(base, gap_windows, lost[:n])
            n_lost[e] += drop_lost(lost[:n], valid[s:t], r)
            _weighted_sums(a[s:t], b[s:t], fx[s:t], r[:n], sums[e, :8])
            _weighted_sums(a[s:t], b[s:t], fy[s:t], r[:n], sums[e, 8:16])
            _weighted_sums(a[s:t], b[s:t], ones[:n], r[:n], sums[e, 16:24])
            sums[e, 24] += _squares(r[:n])


@njit(cache=True, nogil=True)
def height_residuals(start, ix, iy, a, b, f, motion, coefficients, width, degree, gap_windows, valid, residual,
                     fraction_x, fraction_y):
    """Residual and sub-pixel fractions of every pixel (float32, (n_px,)); same arguments as `height_pass`."""
    stride = np.uint64(width)
    last_x, last_y = _INT(width - 2 * MIRROR_PAD_PX - 1), _INT(coefficients.size // width - 2 * MIRROR_PAD_PX - 1)
    first_tap = _INT(MIRROR_PAD_PX - (degree - 1) // 2)
    raised = np.empty(_PIXELS_PER_BLOCK, np.float32)
    base, lost = np.empty(_PIXELS_PER_BLOCK, np.int32), np.empty(_PIXELS_PER_BLOCK, np.int32)
    u, v, h = np.empty(8, np.float32), np.empty(8, np.float32), np.empty(8, np.float32)
    for e in range(start.size - 1):
        shift_x, shift_y = _split_motion(motion[e, 0], u), _split_motion(motion[e, 1], v)
        for k in range(8):  # not h[:]: that takes three seconds to compile
            h[k] = motion[e, 2, k]
        for s in range(start[e], start[e + 1], _PIXELS_PER_BLOCK):
            t = min(s + _PIXELS_PER_BLOCK, start[e + 1])
            n = t - s
            _positions(ix[s:t], iy[s:t], a[s:t], b[s:t], u, v, shift_x, shift_y, last_x, last_y, _INT(0), _INT(width),
                       first_tap, fraction_x[s:t], fraction_y[s:t], base, lost)
            _raised(f[s:t], a[s:t], b[s:t], h, raised)
            if degree == 3:
                _cubic_residuals(raised[:n], coefficients, base, stride, fraction_x[s:t], fraction_y[s:t],
                                 residual[s:t])
            else:
                _quintic_residuals(raised[:n], coefficients, base, stride, fraction_x[s:t], fraction_y[s:t],
                                   residual[s:t])
            if gap_windows.size:
                _drop_gaps(base, gap_windows, lost[:n])
            drop_lost(lost[:n], valid[s:t], residual[s:t])
