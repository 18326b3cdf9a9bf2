"""BLAS and LAPACK on arrays stored column by column, in place; other threads go on meanwhile.

SciPy's own wrappers keep the interpreter's lock, so that threads would wait for each other. Rows of a larger array are
taken without a copy: the leading dimension is that of the array.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numba.extending import get_cython_function_address


def _routine(library: str, name: str, n_arguments: int):
    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * n_arguments)(address)


_dgemm, _dgemv = _routine("blas", "dgemm", 13), _routine("blas", "dgemv", 11)
_dtrsm, _dtrsv = _routine("blas", "dtrsm", 11), _routine("blas", "dtrsv", 8)
_dgetrf, _dlaswp = _routine("lapack", "dgetrf", 6), _routine("lapack", "dlaswp", 7)
# by the bytes of a number
_trsm, _trsv = {4: _routine("blas", "strsm", 11), 8: _dtrsm}, {4: _routine("blas", "strsv", 8), 8: _dtrsv}
_gemm, _gemv = {4: _routine("blas", "sgemm", 13), 8: _dgemm}, {4: _routine("blas", "sgemv", 11), 8: _dgemv}
_syrk = {4: _routine("blas", "ssyrk", 10), 8: _routine("blas", "dsyrk", 10)}
_potrf = {4: _routine("lapack", "spotrf", 5), 8: _routine("lapack", "dpotrf", 5)}

_kept_letters = {letter: ctypes.c_char(letter.encode()) for letter in "LRUNT"}
_letter = {letter: ctypes.addressof(stored) for letter, stored in _kept_letters.items()}
_kept_numbers = (ctypes.c_double * 3)(1.0, -1.0, 0.0)
_ONE, _MINUS_ONE, _ZERO = (ctypes.addressof(_kept_numbers) + 8 * k for k in range(3))
_kept_singles = (ctypes.c_float * 3)(1.0, -1.0, 0.0)
_plus = {4: ctypes.addressof(_kept_singles), 8: _ONE}
_minus = {4: ctypes.addressof(_kept_singles) + 4, 8: _MINUS_ONE}
_nothing = {4: ctypes.addressof(_kept_singles) + 8, 8: _ZERO}
_kept_step = ctypes.c_int(1)
_STEP = ctypes.addressof(_kept_step)
_L, _R, _U, _N = (_letter[letter] for letter in "LRUN")


def _leading(matrix: np.ndarray) -> int:
    """Entries from one column to the next."""
    return max(1, matrix.strides[1] // matrix.itemsize if matrix.shape[1] > 1 else matrix.shape[0])


def solve_triangle(triangle: np.ndarray, block: np.ndarray, *, right: bool, lower: bool, unit: bool,
                   transposed: bool = False) -> None:
    """Overwrite a block (m, n) by the solution with a triangle, both float64 or both float32.

    Parameters
    ----------
    triangle : (k, k); lower : its lower part, else its upper part; unit : with ones on the diagonal
    right : X T = block, else T X = block; transposed : with T^T in place of T
    """
    m, n = block.shape
    sizes = (ctypes.c_int * 4)(m, n, _leading(triangle), _leading(block))
    at = ctypes.addressof(sizes)
    part, turned, diagonal = _letter["L" if lower else "U"], _letter["T" if transposed else "N"], _letter[
        "U" if unit else "N"]
    width = block.itemsize
    if n == 1 and not right:
        _trsv[width](part, turned, diagonal, at, triangle.ctypes.data, at + 8, block.ctypes.data, _STEP)
    else:
        _trsm[width](_letter["R" if right else "L"], part, turned, diagonal, at, at + 4, _plus[width],
                     triangle.ctypes.data, at + 8, block.ctypes.data, at + 12)


def product(a: np.ndarray, b: np.ndarray, transposed: bool = False) -> np.ndarray:
    """a b, or a^T b, both float64 or both float32  # (rows of a or of a^T, columns of b)"""
    rows, inner = a.shape[::-1] if transposed else a.shape
    out, width = np.empty((rows, b.shape[1]), dtype=a.dtype, order="F"), a.itemsize
    turned = _letter["T" if transposed else "N"]
    sizes = (ctypes.c_int * 6)(rows, b.shape[1], inner, _leading(a), _leading(b), max(1, rows))
    at = ctypes.addressof(sizes)
    if b.shape[1] == 1:
        shape = (ctypes.c_int * 2)(*a.shape)
        by = ctypes.addressof(shape)
        _gemv[width](turned, by, by + 4, _plus[width], a.ctypes.data, at + 12, b.ctypes.data, _STEP, _nothing[width],
                     out.ctypes.data, _STEP)
    else:
        _gemm[width](turned, _letter["N"], at, at + 4, at + 8, _plus[width], a.ctypes.data, at + 12, b.ctypes.data,
                     at + 16, _nothing[width], out.ctypes.data, at + 20)
    return out


def subtract_square(a: np.ndarray, out: np.ndarray) -> None:
    """Lower triangle of out (m, m) less a a^T, both float64 or both float32."""
    sizes = (ctypes.c_int * 4)(len(out), a.shape[1], _leading(a), _leading(out))
    at = ctypes.addressof(sizes)
    width = out.itemsize
    _syrk[width](_letter["L"], _letter["N"], at, at + 4, _minus[width], a.ctypes.data, at + 8, _plus[width],
                 out.ctypes.data, at + 12)


def factorise_lower(matrix: np.ndarray) -> bool:
    """Overwrite the lower triangle of a matrix (n, n), float64 or float32, by its Cholesky factor.

    False: it is not positive definite.
    """
    sizes = (ctypes.c_int * 3)(len(matrix), _leading(matrix), 0)
    at = ctypes.addressof(sizes)
    _potrf[matrix.itemsize](_letter["L"], at, matrix.ctypes.data, at + 4, at + 8)
    return sizes[2] == 0


class LUOfFront:
    """A front's factors where they are in memory: small fronts are many, and a view of each block takes longer than
    the work on it.

    s, b : pivots and boundary
    blocks : (s (s + 2 b),) float64; F11 (s, s), F21 (b, s) and F12 (s, b), each column by column, then their factors
    """

    __slots__ = ("at", "b", "blocks", "lower", "lu", "numbers", "pivots", "s", "upper")

    def __init__(self, s: int, b: int, blocks: np.ndarray):
        self.s, self.b, self.blocks = s, b, blocks
        self.numbers = np.empty(s + 3, dtype=np.int32)  # s, b, what LAPACK says, row exchanges from 1
        self.numbers[:3] = s, b, 0
        self.at = self.numbers.ctypes.data
        self.pivots = self.at + 12
        self.lu = blocks.ctypes.data
        self.lower, self.upper = self.lu + 8 * s * s, self.lu + 8 * s * (s + b)

    def eliminate(self, update: np.ndarray) -> bool:
        """P F11 = L U; F12 becomes L^-1 P F12, F21 F21 U^-1, update (b b,) less their product; False: singular."""
        s, b = self.at, self.at + 4
        _dgetrf(s, s, self.lu, s, self.pivots, self.at + 8)
        if self.numbers[2]:
            return False
        if self.b:
            _dlaswp(b, self.upper, s, _STEP, s, self.pivots, _STEP)
            if self.b == 1:
                _dtrsv(_L, _N, _U, s, self.lu, s, self.upper, _STEP)
            else:
                _dtrsm(_L, _L, _N, _U, s, b, _ONE, self.lu, s, self.upper, s)
            _dtrsm(_R, _U, _N, _N, b, s, _ONE, self.lu, s, self.lower, b)
            _dgemm(_N, _N, b, b, s, _MINUS_ONE, self.lower, b, self.upper, s, _ONE, update.ctypes.data, b)
        return True

    def forward(self, x: int, share: int) -> None:
        """x (s,) becomes L^-1 P x, share (b,) F21 U^-1 x; the addresses of both."""
        s, b = self.at, self.at + 4
        _dlaswp(_STEP, x, s, _STEP, s, self.pivots, _STEP)
        _dtrsv(_L, _N, _U, s, self.lu, s, x, _STEP)
        if self.b:
            _dgemv(_N, b, s, _ONE, self.lower, b, x, _STEP, _ZERO, share, _STEP)

    def carried(self, beyond: int, share: int) -> None:
        """share (s,) becomes L^-1 P F12 beyond, beyond (b,); the addresses of both; b > 0."""
        s, b = self.at, self.at + 4
        _dgemv(_N, s, b, _ONE, self.upper, s, beyond, _STEP, _ZERO, share, _STEP)

    def backward(self, x: int) -> None:
        """x (s,) becomes U^-1 x; its address."""
        _dtrsv(_U, _N, _N, self.at, self.lu, self.at, x, _STEP)
