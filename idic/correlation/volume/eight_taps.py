"""The value of a cubic B-spline of a volume at eight neighbours along a row, as vectors of eight.

    g(x) = sum_j c_j beta(x - j)            docs/method.md, equation 1.7

The eight places differ in their fractions only: their taps lie one beside the other, so that each of the 64 products is
one load and one multiplication for all eight. The compiler does not find this form by itself, hence the intrinsic.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from idic.images import weight_polynomials

LANES = 8
_FLOAT, _LONG = ir.FloatType(), ir.IntType(64)
_VECTOR = ir.VectorType(_FLOAT, LANES)
_FLAGS = ("contract", "reassoc", "nsz")


def _splat(value: float) -> ir.Constant:
    return ir.Constant(_VECTOR, [float(value)] * LANES)


def _load(builder, pointer, offset):
    """Eight entries from an entry on."""
    place = builder.bitcast(builder.gep(pointer, [offset]), _VECTOR.as_pointer())
    return builder.load(place, align=4)


def _weights(builder, fraction, degree: int):
    """The weights of all taps of a direction: polynomials in the fraction."""
    table, weights = weight_polynomials(degree), []
    for tap in range(degree + 1):
        total = _splat(table[degree, tap])
        for power in range(degree - 1, -1, -1):
            total = builder.fadd(builder.fmul(total, fraction, flags=_FLAGS), _splat(table[power, tap]), flags=_FLAGS)
        weights.append(total)
    return weights


def _combined(builder, weights, parts):
    total = builder.fmul(weights[0], parts[0], flags=_FLAGS)
    for weight, part in zip(weights[1:], parts[1:], strict=True):
        total = builder.fadd(total, builder.fmul(weight, part, flags=_FLAGS), flags=_FLAGS)
    return total


def _eight_values(degree: int):
    taps = degree + 1

    def build(typing, c, first, row, plane, fraction_x, fraction_y, fraction_z, k, out):
        vector = types.Array(types.float32, 1, "C")
        signature = types.void(c, types.int64, types.int64, types.int64, vector, vector, vector, types.int64, out)

        def emit(context, builder, signature, arguments):
            arrays = [cgutils.create_struct_proxy(kind)(context, builder, value=argument).data
                      for kind, argument in ((signature.args[i], arguments[i]) for i in (0, 4, 5, 6, 8))]
            data, places, target = arrays[0], arrays[1:4], arrays[4]
            first, row, plane, k = arguments[1], arguments[2], arguments[3], arguments[7]
            wx, wy, wz = (_weights(builder, _load(builder, place, k), degree) for place in places)
            slices = []
            for j in range(taps):
                of_slice = builder.add(first, builder.mul(plane, ir.Constant(_LONG, j)))
                rows = []
                for i in range(taps):
                    begin = builder.add(of_slice, builder.mul(row, ir.Constant(_LONG, i)))
                    loads = [_load(builder, data, builder.add(begin, ir.Constant(_LONG, tap))) for tap in range(taps)]
                    rows.append(_combined(builder, wx, loads))
                slices.append(_combined(builder, wy, rows))
            place = builder.bitcast(builder.gep(target, [k]), _VECTOR.as_pointer())
            builder.store(_combined(builder, wz, slices), place, align=4)
            return context.get_dummy_value()

        return signature, emit

    return build


@intrinsic
def eight_cubic(typing, c, first, row, plane, fraction_x, fraction_y, fraction_z, k, out):
    """Write the values at eight places to ``out[k:k + 8]``.

    c: flat float32 coefficients; first: entry of the first tap of the first place; row, plane: entries from one row,
    one slice to the next; fraction_x, fraction_y, fraction_z, out: contiguous float32, from k on.
    """
    return _eight_values(3)(typing, c, first, row, plane, fraction_x, fraction_y, fraction_z, k, out)


@intrinsic
def eight_quintic(typing, c, first, row, plane, fraction_x, fraction_y, fraction_z, k, out):
    """The same of the quintic spline."""
    return _eight_values(5)(typing, c, first, row, plane, fraction_x, fraction_y, fraction_z, k, out)
