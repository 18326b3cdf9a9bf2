"""Eight neighbours along a row of an element with straight edges, as vectors of eight.

`place_eight` has where they are in the scan, `compare_eight` their residual and its products with the gradient. The
buffers hold rows of `ROW` entries one behind the other; the terms are those of hex8 and tet4
(`idic.correlation.volume.solid_cells`).
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from idic.correlation.volume.eight_taps import LANES

ROW = 288  # entries: 256 voxels, and what vectors may write beyond them
N_BRICK = 8  # terms of a hex8
FLOATS = types.Array(types.float32, 1, "C")
INTEGERS = types.Array(types.int32, 1, "C")
_FLAGS = ("contract", "reassoc", "nsz")
_FLOAT, _INT, _LONG = ir.FloatType(), ir.IntType(32), ir.IntType(64)
_FLOAT_VECTOR, _INT_VECTOR = ir.VectorType(_FLOAT, LANES), ir.VectorType(_INT, LANES)


class _Emitter:
    """Writes vector code; arguments : of the compiled function, by name"""

    def __init__(self, context, builder, signature, names, arguments):
        self.builder = builder
        self.values = {}
        for name, kind, value in zip(names, signature.args, arguments, strict=True):
            is_array = isinstance(kind, types.Array)
            self.values[name] = cgutils.create_struct_proxy(kind)(context, builder, value=value).data if is_array \
                else value

    def pointer(self, name: str, index: int = 0, at=None):
        """Of an entry; at : added to the index"""
        offset = ir.Constant(_LONG, index)
        return self.builder.gep(self.values[name], [offset if at is None else self.builder.add(at, offset)])

    def load(self, name: str, index: int = 0, at=None):
        """Eight entries."""
        pointer = self.builder.bitcast(self.pointer(name, index, at), _FLOAT_VECTOR.as_pointer())
        return self.builder.load(pointer, align=4)

    def store(self, vector, name: str, index: int, at) -> None:
        pointer = self.builder.bitcast(self.pointer(name, index, at), vector.type.as_pointer())
        self.builder.store(vector, pointer, align=4)

    def splat(self, scalar, kind):
        """One value in all lanes."""
        undefined = ir.Constant(kind, ir.Undefined)
        vector = self.builder.insert_element(undefined, scalar, ir.Constant(_INT, 0))
        return self.builder.shuffle_vector(vector, undefined, ir.Constant(_INT_VECTOR, [0] * LANES))

    def each(self, name: str, index: int):
        """One entry in all lanes."""
        return self.splat(self.builder.load(self.pointer(name, index)), _FLOAT_VECTOR)

    def product(self, a, b):
        return self.builder.fmul(a, b, flags=_FLAGS)

    def added(self, total, a, b):
        """total + a b"""
        return self.builder.fadd(total, self.builder.fmul(a, b, flags=_FLAGS), flags=_FLAGS)

    def lanes(self, kind):
        return ir.Constant(kind, list(range(LANES)))


@intrinsic
def place_eight(typing, start, slope, motion, first, row, plane, k, powers, fraction, base):
    """Terms, fractions and first taps of eight voxels; how many from the first on have neighbouring taps.

    start, slope: float32 (3,), place of the first in its cell, and from one to the next; motion: float32
    (3 N_BRICK,), its coefficients without whole voxels; first: entry of the first tap at rest; row, plane: entries from
    one row, one slice to the next; powers (N_BRICK ROW,), fraction (3 ROW,), base (ROW,) int32: written from k on
    """
    names = ("start", "slope", "motion", "first", "row", "plane", "k", "powers", "fraction", "base")
    signature = types.int64(FLOATS, FLOATS, FLOATS, types.int64, types.int64, types.int64, types.int64, FLOATS, FLOATS,
                            INTEGERS)

    def emit(context, builder, signature, arguments):
        to = _Emitter(context, builder, signature, names, arguments)
        k, lanes = to.values["k"], to.lanes(_FLOAT_VECTOR)
        a, b, c = (to.added(to.each("start", d), to.each("slope", d), lanes) for d in range(3))
        ab, bc, ac = to.product(a, b), to.product(b, c), to.product(a, c)
        terms = [a, b, c, ab, bc, ac, to.product(ab, c)]
        for number, term in enumerate(terms, 1):
            to.store(term, "powers", number * ROW, k)
        floor = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_FLOAT_VECTOR, [_FLOAT_VECTOR]), f"llvm.floor.v{LANES}f32")
        steps = []
        for d in range(3):
            u = to.each("motion", d * N_BRICK)
            for number, term in enumerate(terms, 1):
                u = to.added(u, to.each("motion", d * N_BRICK + number), term)
            voxels = builder.call(floor, [u])
            to.store(builder.fsub(u, voxels), "fraction", d * ROW, k)
            steps.append(builder.fptosi(voxels, _INT_VECTOR))
        row, plane, first = (to.splat(builder.trunc(to.values[name], _INT), _INT_VECTOR)
                             for name in ("row", "plane", "first"))
        shift = builder.add(steps[0], builder.add(builder.mul(steps[1], row), builder.mul(steps[2], plane)))
        to.store(builder.add(builder.add(first, to.lanes(_INT_VECTOR)), shift), "base", 0, k)
        of_first = builder.shuffle_vector(shift, shift, ir.Constant(_INT_VECTOR, [0] * LANES))
        differs = builder.bitcast(builder.icmp_signed("!=", shift, of_first), ir.IntType(LANES))
        return builder.zext(builder.cttz(differs, ir.Constant(ir.IntType(1), 0)), _LONG)

    return signature, emit


@intrinsic
def compare_eight(typing, f, gx, gy, gz, at, n, value, k, weighted):
    """Residual of the first n of eight voxels, zero for the others, times the gradient, and their grey values.

    f, gx, gy, gz: float32, from `at` on; value: of the scan, from k on; weighted (5 ROW,): r gx, r gy, r gz, r, f
    """
    names = ("f", "gx", "gy", "gz", "at", "n", "value", "k", "weighted")
    signature = types.void(FLOATS, FLOATS, FLOATS, FLOATS, types.int64, types.int64, FLOATS, types.int64, FLOATS)

    def emit(context, builder, signature, arguments):
        to = _Emitter(context, builder, signature, names, arguments)
        k, at = to.values["k"], to.values["at"]
        f = to.load("f", 0, at)
        number = to.splat(builder.trunc(to.values["n"], _INT), _INT_VECTOR)
        r = builder.select(builder.icmp_signed("<", to.lanes(_INT_VECTOR), number),
                           builder.fsub(f, to.load("value", 0, k)), ir.Constant(_FLOAT_VECTOR, [0.0] * LANES))
        for number, name in enumerate(("gx", "gy", "gz")):
            to.store(to.product(r, to.load(name, 0, at)), "weighted", number * ROW, k)
        to.store(r, "weighted", 3 * ROW, k)
        to.store(f, "weighted", 4 * ROW, k)
        return context.get_dummy_value()

    return signature, emit


@intrinsic
def copy_eight(typing, source, begin, target, to):
    """Copy eight entries of a float32 array."""
    signature = types.void(FLOATS, types.int64, FLOATS, types.int64)

    def emit(context, builder, signature, arguments):
        code = _Emitter(context, builder, signature, ("source", "begin", "target", "to"), arguments)
        code.store(code.load("source", 0, code.values["begin"]), "target", 0, code.values["to"])
        return context.get_dummy_value()

    return signature, emit


@intrinsic
def fetch_early(typing, values, index):
    """Ask for an entry of a float32 array that is read soon: it comes into the second cache meanwhile."""
    signature = types.void(FLOATS, types.int64)

    def emit(context, builder, signature, arguments):
        to = _Emitter(context, builder, signature, ("values", "index"), arguments)
        place = builder.bitcast(to.pointer("values", 0, to.values["index"]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [place.type, _INT, _INT, _INT])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8"),
                     [place, *(ir.Constant(_INT, value) for value in (0, 3, 1))])  # to read; keep; data
        return context.get_dummy_value()

    return signature, emit
