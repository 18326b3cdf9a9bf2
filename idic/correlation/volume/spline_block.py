"""Spline coefficients of a block of a volume, by the recursive filter along its three axes, and slopes at its voxels.

    c+_i = lambda s_i + z c+_{i-1},     c_i = z (c_{i+1} - c+_i)          Unser 1999, doi:10.1109/79.799930

Of a pole z the filter forgets what is k voxels away by z^k: a block that is wider than wanted by `REACH` voxels has the
coefficients of the whole volume in its middle, to single precision. Where the volume itself ends, the block may end,
too: the filter mirrors there. Lines pass through strips that stay in the cache; lines along the columns are turned
round, eight by eight, on the way into their strip and out of it.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from idic.images import POLES, filter_block, weight_polynomials

_TILE = 8  # lines and columns that are turned round together
_ACROSS, _COLUMNS, _ROWS = 128, 64, 32  # lines of a strip along slices, along rows' direction, along columns
_U = np.uint64
_FILTERED = (np.uint8, np.uint16, np.float32)  # grey values that the filter takes as they are stored


def coefficients_in(block: np.ndarray, level: float, degree: int, begin: tuple[int, int, int],
                    shape: tuple[int, int, int], room: int) -> np.ndarray:
    """Coefficients of a part of a block, row by row, and `room` zeros behind them.

    block : (nz, ny, nx) grey values; level : subtracted from them; begin, shape : of the part, (z, y, x)
    # -> flat float32
    """
    block, poles = _as_filtered(block), np.array(POLES[degree])
    (_, ny, nx), n = block.shape, int(np.prod(shape))
    planes = np.empty(shape[0] * ny * nx + _TILE, dtype=np.float32)
    flat = np.empty(n + room, dtype=np.float32)
    flat[n:] = 0.0
    _along_slices(block.reshape(-1), block.shape, np.float32(level), poles, begin[0], shape[0], planes)
    _in_planes(planes, shape[0], ny, nx, poles, (begin[1], begin[2]), (shape[1], shape[2]), flat)
    return flat


def slopes_in(block: np.ndarray, level: float, degree: int, begin: tuple[int, int, int], shape: tuple[int, int, int]
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slopes of the spline at the voxels of a part of a block, along column, row and slice  # three of `shape` float32

    Arguments as of `coefficients_in`. Between voxels of a line the spline is that of the line alone, so that each axis
    has its own filter.
    """
    block, poles = _as_filtered(block), np.array(POLES[degree])
    at_voxel = weight_polynomials(degree)[1]  # derivatives of the weights of the taps at fraction 0
    middle = (degree - 1) // 2
    weights = np.array([at_voxel[middle + 1], at_voxel[middle + 2] if degree > 3 else 0.0], dtype=np.float32)
    along_x, along_y, along_z = (np.empty(shape, dtype=np.float32) for _ in range(3))
    _slopes(block.reshape(-1), block.shape, np.float32(level), poles, weights, begin, shape, along_x.reshape(-1),
            along_y.reshape(-1), along_z.reshape(-1))
    return along_x, along_y, along_z


def _as_filtered(block: np.ndarray) -> np.ndarray:
    if block.dtype.type in _FILTERED and block.flags.c_contiguous:
        return block
    return np.ascontiguousarray(block, dtype=np.float32)


@njit(cache=True, nogil=True)
def _strips(n, most):
    """Number and width of the strips of n lines."""
    count = (n + most - 1) // most
    width = (n + count - 1) // count
    return count, (width + _TILE - 1) // _TILE * _TILE


@njit(cache=True, nogil=True)
def _along_slices(block, size, level, poles, begin, n_out, planes):
    n, width = size[0], size[1] * size[2]
    count, most = _strips(width, _ACROSS)
    strip = np.empty(n * most, dtype=np.float32)
    for number in range(count):
        first = number * most
        m = min(most, width - first)
        if m <= 0:
            break
        _fill_strip(block, first, width, level, n, m, strip)
        filter_block(strip, n, m, poles)
        for i in range(n_out):
            to, source = _U(i * width + first), _U((i + begin) * m)
            for j in range(m):
                planes[to + _U(j)] = strip[source + _U(j)]


@njit(cache=True, nogil=True)
def _in_planes(planes, nz, ny, nx, poles, begin, shape, flat):
    """Along the rows' direction and the columns' of every slice."""
    rows, columns = shape
    plane = np.empty(rows * nx + _TILE, dtype=np.float32)
    count, most = _strips(nx, _COLUMNS)
    n_lines, lines = _strips(rows, _ROWS)
    strip = np.empty(max(ny * most, (nx + _TILE) * lines), dtype=np.float32)
    for k in range(nz):
        for number in range(count):
            first = number * most
            m = min(most, nx - first)
            if m <= 0:
                break
            for i in range(ny):
                to, source = _U(i * m), _U((k * ny + i) * nx + first)
                for j in range(m):
                    strip[to + _U(j)] = planes[source + _U(j)]
            filter_block(strip, ny, m, poles)
            for i in range(rows):
                to, source = _U(i * nx + first), _U((i + begin[0]) * m)
                for j in range(m):
                    plane[to + _U(j)] = strip[source + _U(j)]
        for number in range(n_lines):
            first = number * lines
            m = min(lines, rows - first)
            if m <= 0:
                break
            _turned(plane, first * nx, nx, m, nx, strip, 0, m)
            filter_block(strip, nx, m, poles)
            _turned(strip, begin[1] * m, m, columns, m, flat, (k * rows + first) * columns, columns)


@njit(cache=True, nogil=True)
def _slopes(block, size, level, poles, weights, begin, shape, along_x, along_y, along_z):
    nz, ny, nx = size
    pz, py, px = begin
    mz, my, mx = shape
    count, most = _strips(mx, _COLUMNS)
    n_lines, lines = _strips(my, _ROWS)
    strip = np.empty(max(max(nz, ny) * most, (nx + _TILE) * lines), dtype=np.float32)
    rows, changes = np.empty(lines * nx + _TILE, dtype=np.float32), np.empty(mx * lines, dtype=np.float32)
    for j in range(my):
        for number in range(count):
            first = number * most
            m = min(most, mx - first)
            if m > 0:
                _fill_strip(block, ((py + j) * nx + px + first), ny * nx, level, nz, m, strip)
                filter_block(strip, nz, m, poles)
                _differences(strip, pz, mz, m, weights, along_z, j * mx + first, my * mx)
    for k in range(mz):
        for number in range(count):
            first = number * most
            m = min(most, mx - first)
            if m > 0:
                _fill_strip(block, (pz + k) * ny * nx + px + first, nx, level, ny, m, strip)
                filter_block(strip, ny, m, poles)
                _differences(strip, py, my, m, weights, along_y, k * my * mx + first, mx)
        for number in range(n_lines):
            first = number * lines
            m = min(lines, my - first)
            if m > 0:
                _fill_strip(block, ((pz + k) * ny + py + first) * nx, nx, level, m, nx, rows)
                _turned(rows, 0, nx, m, nx, strip, 0, m)
                filter_block(strip, nx, m, poles)
                _differences(strip, px, mx, m, weights, changes, 0, m)
                _turned(changes, 0, m, mx, m, along_x, (k * my + first) * mx, mx)


@njit(cache=True, nogil=True)
def _fill_strip(block, begin, stride, level, n, m, strip):
    """n lines of m entries from `begin` on, less `level`"""
    for i in range(n):
        to, source = _U(i * m), _U(begin + i * stride)
        for j in range(m):
            strip[to + _U(j)] = np.float32(block[source + _U(j)]) - level


@njit(cache=True, nogil=True)
def _differences(strip, begin, n, m, weights, out, to, stride):
    """Slopes of n lines of m entries, from line `begin` of the strip on."""
    of_neighbours, of_second = weights
    w = _U(m)
    for i in range(n):
        line, target = _U((begin + i) * m), _U(to + i * stride)
        if of_second == 0.0:
            for j in range(m):
                at = line + _U(j)
                out[target + _U(j)] = of_neighbours * (strip[at + w] - strip[at - w])
        else:
            for j in range(m):
                at = line + _U(j)
                out[target + _U(j)] = (of_neighbours * (strip[at + w] - strip[at - w])
                                       + of_second * (strip[at + w + w] - strip[at - w - w]))


@njit(cache=True, nogil=True)
def _turned(source, begin, stride, n_rows, n_columns, target, to, to_stride):
    """target[to + j to_stride + i] = source[begin + i stride + j] for i < n_rows, j < n_columns; tile by tile"""
    whole_rows, whole_columns = n_rows // _TILE * _TILE, n_columns // _TILE * _TILE
    for i in range(0, whole_rows, _TILE):
        for j in range(0, whole_columns, _TILE):
            _turn_tile(source, begin + i * stride + j, stride, target, to + j * to_stride + i, to_stride)
        for j in range(whole_columns, n_columns):
            for row in range(i, i + _TILE):
                target[_U(to + j * to_stride + row)] = source[_U(begin + row * stride + j)]
    for i in range(whole_rows, n_rows):
        for j in range(n_columns):
            target[_U(to + j * to_stride + i)] = source[_U(begin + i * stride + j)]


@intrinsic
def _turn_tile(typing, source, begin, stride, target, to, to_stride):
    """Eight rows of eight entries -> eight columns; flat float32 arrays, first entries and strides."""
    vector = types.Array(types.float32, 1, "C")
    signature = types.void(vector, types.int64, types.int64, vector, types.int64, types.int64)

    def emit(context, builder, signature, arguments):
        data, out = (cgutils.create_struct_proxy(signature.args[i])(context, builder, value=arguments[i]).data
                     for i in (0, 3))
        eight, long = ir.VectorType(ir.FloatType(), _TILE), ir.IntType(64)
        pick = ir.VectorType(ir.IntType(32), _TILE)

        def place(pointer, begin, stride, i):
            entry = builder.add(begin, builder.mul(stride, ir.Constant(long, i)))
            return builder.bitcast(builder.gep(pointer, [entry]), eight.as_pointer())

        def merged(a, b, order):
            return builder.shuffle_vector(a, b, ir.Constant(pick, order))

        rows = [builder.load(place(data, arguments[1], arguments[2], i), align=4) for i in range(_TILE)]
        pairs = []  # halves of four columns each: single entries, then pairs, then halves change places
        for i in range(0, _TILE, 2):
            pairs += [merged(rows[i], rows[i + 1], [0, 8, 1, 9, 4, 12, 5, 13]),
                      merged(rows[i], rows[i + 1], [2, 10, 3, 11, 6, 14, 7, 15])]
        fours = []
        for i in (0, 4):
            for j in (0, 1):
                fours += [merged(pairs[i + j], pairs[i + j + 2], [0, 1, 8, 9, 4, 5, 12, 13]),
                          merged(pairs[i + j], pairs[i + j + 2], [2, 3, 10, 11, 6, 7, 14, 15])]
        for column in range(4):
            low = merged(fours[column], fours[column + 4], [0, 1, 2, 3, 8, 9, 10, 11])
            high = merged(fours[column], fours[column + 4], [4, 5, 6, 7, 12, 13, 14, 15])
            builder.store(low, place(out, arguments[4], arguments[5], column), align=4)
            builder.store(high, place(out, arguments[4], arguments[5], column + 4), align=4)
        return context.get_dummy_value()

    return signature, emit
