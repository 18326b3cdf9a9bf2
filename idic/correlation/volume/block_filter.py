"""A block of a volume and its low-pass.

The recursive filter of a B-spline decays by 0.27 (cubic) or 0.43 (quintic) per voxel: of the volume around it a block
needs no more than `REACH` voxels. At the borders of the volume the grey values are mirrored (d c b | a b c d | c b a).
"""

from __future__ import annotations

import numpy as np
from numba import njit

REACH = {3: 12, 5: 20}  # voxels, by degree: what is cut off is below 1e-6
_STRIP = 2048  # entries of a row that pass all taps together: they stay in the first cache


def filtered(block: np.ndarray, taps: np.ndarray, axis: int) -> np.ndarray:
    """Correlate a block with a kernel along one axis; it becomes shorter by the reach of the kernel at both ends.

    block : (nz, ny, nx); taps : (2 r + 1,) float32, symmetric
    """
    if len(taps) == 1:
        return block if taps[0] == 1.0 else block * taps[0]
    reach = len(taps) // 2
    shape = list(block.shape)
    shape[axis] -= 2 * reach
    out = np.empty(shape, dtype=np.float32)
    block = np.ascontiguousarray(block, dtype=np.float32)
    if axis == 2:
        _along_rows(block.reshape(-1, block.shape[2]), taps, out.reshape(-1, shape[2]))
    else:
        outer = int(np.prod(shape[:axis]))
        inner = int(np.prod(shape[axis + 1:]))
        _across_rows(block.reshape(outer, block.shape[axis], inner), taps, out.reshape(outer, shape[axis], inner))
    return out


def mirrored_block(read, shape: tuple[int, int, int], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A block that may reach beyond the volume, mirrored there  # (nz, ny, nx), grey values as they are stored

    read : (slices of z, y, x) -> array; shape : of the volume; low, high : first voxel and the one after the last
    """
    axes = [_mirrored(np.arange(first, end), n) for first, end, n in zip(low, high, shape, strict=True)]
    inside = tuple(slice(int(axis.min()), int(axis.max()) + 1) for axis in axes)
    block = np.asarray(read(*inside))
    for k, axis in enumerate(axes):
        if len(axis) != block.shape[k] or axis[0] != inside[k].start or axis[-1] != inside[k].stop - 1:
            block = np.take(block, axis - inside[k].start, axis=k)
    return np.ascontiguousarray(block)


def _mirrored(index: np.ndarray, n: int) -> np.ndarray:
    if n == 1:
        return np.zeros_like(index)
    index = np.abs(index) % (2 * n - 2)
    return np.where(index >= n, 2 * n - 2 - index, index)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _along_rows(block, taps, out):
    reach, n = taps.size // 2, out.shape[1]
    for i in range(block.shape[0]):
        row, target = block[i], out[i]
        middle = taps[reach]
        for j in range(n):
            target[j] = middle * row[j + reach]
        for k in range(1, reach + 1, 3):
            k1, k2 = min(k + 1, reach), min(k + 2, reach)
            w0 = taps[reach + k]
            w1 = taps[reach + k1] if k + 1 <= reach else np.float32(0.0)
            w2 = taps[reach + k2] if k + 2 <= reach else np.float32(0.0)
            a0, a1, a2 = row[reach + k:reach + k + n], row[reach + k1:reach + k1 + n], row[reach + k2:reach + k2 + n]
            b0, b1, b2 = row[reach - k:reach - k + n], row[reach - k1:reach - k1 + n], row[reach - k2:reach - k2 + n]
            _add_taps(target, w0, w1, w2, a0, a1, a2, b0, b1, b2)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _add_taps(target, w0, w1, w2, a0, a1, a2, b0, b1, b2):
    for j in range(target.size):
        target[j] += w0 * (a0[j] + b0[j]) + w1 * (a1[j] + b1[j]) + w2 * (a2[j] + b2[j])


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _across_rows(block, taps, out):
    reach, n, width = taps.size // 2, out.shape[1], out.shape[2]
    for a in range(block.shape[0]):
        for s in range(0, width, _STRIP):
            t = min(s + _STRIP, width)
            for i in range(n):
                target, row = out[a, i, s:t], block[a, i + reach, s:t]
                w = taps[reach]
                for j in range(target.size):
                    target[j] = w * row[j]
                for k in range(1, reach + 1, 3):
                    k1, k2 = min(k + 1, reach), min(k + 2, reach)
                    w0 = taps[reach + k]
                    w1 = taps[reach + k1] if k + 1 <= reach else np.float32(0.0)
                    w2 = taps[reach + k2] if k + 2 <= reach else np.float32(0.0)
                    at = i + reach
                    _add_taps(target, w0, w1, w2, block[a, at + k, s:t], block[a, at + k1, s:t],
                              block[a, at + k2, s:t], block[a, at - k, s:t], block[a, at - k1, s:t],
                              block[a, at - k2, s:t])
