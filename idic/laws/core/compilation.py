"""From a registered law to machine code: compiled on first use, kept on disk, never at import."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numba
import numpy as np
from numba import types
from numba.core.types import WrapperAddressProtocol

from idic.errors import InputError
from idic.laws.core.law import LawSpec, get_law
from idic.laws.core.outside_values import outside_values
from idic.laws.core.update_check import check_update

MODES = {"solid": 0, "plane_strain": 1, "plane_stress": 2}


def c_array(dtype, ndim: int) -> types.Array:
    """numba's type of a C-contiguous array."""
    return types.Array(dtype, ndim, "C")


def _update_signature(dtype):
    matrix, vector = c_array(dtype, 2), c_array(dtype, 1)
    return types.int64(matrix, vector, vector, types.float64, matrix, vector)


_F1, _F2, _F3 = (c_array(types.float64, ndim) for ndim in (1, 2, 3))
UPDATE = _update_signature(types.float64)
UPDATE_COMPLEX = _update_signature(types.complex128)
TANGENT = types.int64(_F2, _F1, _F1, types.float64, _F2, _F1, _F2, _F3)
LINEARISE = types.int64(_F2, _F1, _F1, types.float64, _F3, _F2, _F2, _F2, _F1, _F3, _F2)


@lru_cache(maxsize=1)
def _sources_stamp() -> tuple:
    """Age and size of every file of this package: after a change in a shared file an old cache is not used."""
    stats = [(path.name, path.stat()) for path in sorted(Path(__file__).parents[1].rglob("*.py"))]
    return tuple((name, s.st_mtime, s.st_size) for name, s in stats)


class _Pointer(WrapperAddressProtocol):
    """A compiled function as numba takes it fastest: its address, looked up once."""

    def __init__(self, function):
        compiled = next(iter(function.overloads.values()))
        self._function, self._signature = function, compiled.signature  # the function keeps its code alive
        self._address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self):
        return self._signature


pointer = lru_cache(maxsize=None)(_Pointer)


def compile_cached(function: Callable, signature):
    """Compile `function` for one signature: serial, nogil, with numba's disk cache where there is a place for it.

    Its address is looked up at once. numba looks it up by a name that counts the functions of a process: code on disk
    of another law, compiled first in another process as well, has the same, and hides this one as soon as it is loaded.
    """
    dispatcher = _dispatcher(function)
    dispatcher.compile(signature)
    dispatcher.disable_compile()
    pointer(dispatcher)
    return dispatcher


def is_kept(function: Callable) -> bool:
    """Whether numba's disk cache holds machine code of `function` that `compile_cached` would take."""
    return has_code_on_disk(_dispatcher(function))


def has_code_on_disk(dispatcher) -> bool:
    """Whether numba's disk cache holds machine code of a function with a cache."""
    try:
        return bool(dispatcher._cache._cache_file._load_index())
    except (OSError, AttributeError):
        return False


def _dispatcher(function: Callable):
    function = getattr(function, "py_func", function)  # decorated by its author
    counts_references = not _is_own(function) or getattr(function, "makes_arrays", False)
    dispatcher = numba.njit(nogil=True, error_model="numpy", _nrt=counts_references)(function)
    try:
        dispatcher.enable_caching()
        # numba notices only changes of the file that holds `function`, not of files it takes helpers and tables from;
        # what it keeps names the module, and a file may be imported under another name the next time
        cache_file, outside = dispatcher._cache._cache_file, () if _is_own(function) else (outside_values(function),)
        cache_file._source_stamp = (cache_file._source_stamp, _sources_stamp(), function.__module__, *outside)
    except (RuntimeError, AttributeError):  # typed at a prompt, or nowhere to write: compile without cache
        pass
    return dispatcher


def _is_own(function: Callable) -> bool:
    """Whether a function is of this package, whose tests check it and whose files `_sources_stamp` watches."""
    return function.__module__.partition(".")[0] == "idic"


def _no_complex_update(F, state, params, dt, P, state_new):
    return 1


def _no_linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    return 1


def _no_tangent(F, state, params, dt, P, state_new, A, work):
    return 1


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """A law compiled for one kinematics; made by `compile`, taken by the functions of ``points.py``.

    Attributes
    ----------
    by_hand : bool
        True: derivatives come from the law's ``linearise``; False: from the complex step.
    update, linearise, update_complex : numba functions
        Of the last two only the one that is in use does anything.
    closed : bool
        True: the tangent comes from the law's ``tangent``.
    tangent : numba function
    """

    spec: LawSpec
    kinematics: str
    by_hand: bool
    update: Callable
    linearise: Callable
    update_complex: Callable
    closed: bool
    tangent: Callable
    derivative: str = "auto"

    @property
    def small(self) -> bool:
        return self.kinematics == "small"

    def __reduce__(self):  # crosses process boundaries by name: the other side takes it from its own cache
        return compile, (self.spec.name, self.kinematics, self.derivative)

    def n_state(self, mode: int) -> int:
        """Length of a point's state; plane stress (mode 2) keeps F33 behind the law's own."""
        return self.spec.n_state + (mode == 2)

    def initial_state(self, mode: int) -> np.ndarray:
        """State at rest  # (n_state(mode),)"""
        return np.array([*self.spec.initial_state, *([1.0] if mode == 2 else [])], dtype=float)


def compile(law: str, kinematics: str | None = None, derivative: str = "auto") -> CompiledLaw:  # noqa: A001
    """Compile a registered law (from the disk cache where possible).

    Parameters
    ----------
    law : str
        Registered name.
    kinematics : {"small", "finite"}, optional
        Default: the law's own first.
    derivative : {"auto", "complex_step"}
        "auto" takes the law's hand-written ``linearise`` where there is one.

    Raises
    ------
    InputError
        Unknown law, or kinematics that it does not offer; a law of another package that cannot be compiled or breaks
        the rules (`idic.laws.core.update_check`).
    """
    spec = get_law(law)
    kinematics = kinematics or spec.kinematics[0]
    if kinematics not in spec.updates:
        raise InputError(f"law {law} does not offer these kinematics", key="kinematics",
                         expected=" or ".join(spec.kinematics), found=repr(kinematics),
                         remedy="choose one of these, or another law")
    by_hand = derivative == "auto" and kinematics in spec.linearise
    return _compile(spec.name, kinematics, by_hand, derivative == "auto" and _is_own(spec.updates[kinematics]),
                    spec.updates[kinematics])


@cache
def _compile(name: str, kinematics: str, by_hand: bool, with_tangent: bool, update: Callable) -> CompiledLaw:
    spec = get_law(name)
    linearise = spec.linearise[kinematics] if by_hand else _no_linearise
    if not _is_own(update) and not (is_kept(update) and is_kept(linearise)):
        check_update(spec, kinematics, by_hand, (UPDATE, LINEARISE if by_hand else UPDATE_COMPLEX))
    closed = with_tangent and kinematics in spec.tangents
    return CompiledLaw(
        spec, kinematics, by_hand,
        compile_cached(update, UPDATE),
        compile_cached(linearise, LINEARISE),
        compile_cached(_no_complex_update if by_hand else update, UPDATE_COMPLEX),
        closed,
        compile_cached(spec.tangents[kinematics] if closed else _no_tangent, TANGENT),
        "auto" if with_tangent or by_hand else "complex_step",
    )
