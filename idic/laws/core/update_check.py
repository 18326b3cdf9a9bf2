"""The first use of a law that is not of this package: whether its functions keep the rules of docs/add-a-law.md.

Machine code checks no index and keeps what was in the memory before: a law that reads beyond its parameters, or leaves
an entry of P as it was, would return any numbers. Its functions are therefore compiled once with checks and called at
points of a few random paths, elastic and far beyond; what they return is compared with difference quotients.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from idic.errors import InputError
from idic.laws.core.law import LawParameter, LawSpec

SIZES = (1e-3, 1e-2, 1e-1)  # of F - 1
POINTS = 4  # paths of every size
STEPS = (1e-3, 1e-4)  # of a difference quotient, relative to SIZES, parameters and changes of the state
SMOOTH = 1e-3  # quotients of both steps that agree within this are compared: no kink, no rounding
ASYMMETRY = 1e-6  # of the largest entry: rounding is 1e-8 where a bulk modulus is large
NONLINEARITY = 1e-6  # of the stress: rounding is 1e-13 at the smallest size
MAX_BEND = 0.1  # of the quotient: quotients of both sides that differ by more show a kink at the point itself
WRONG = 1e-2  # a derivative that differs by more than this from them is another one
MIN_WRONG = 2  # points with a wrong derivative: one alone may be a kink
COMPLEX_STEP = 1e-30
MARKS = (1.25e270, -2.5e260)  # left in the outputs; no law returns both
DT = 1.0  # s
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_PAGE = "docs/add-a-law.md"


@dataclass(frozen=True)
class _Law:
    """A law's functions for one kinematics, compiled with checks; derivative : linearise, or update for complex
    numbers."""

    spec: LawSpec
    update: Callable
    derivative: Callable
    by_hand: bool

    def refuse(self, fault: str, expected: str, finding: str, remedy: str,
               function: Callable | None = None) -> InputError:
        plain = (function or self.update).py_func  # type: ignore[attr-defined]
        return InputError(f"law {self.spec.name}: {fault}", file=plain.__code__.co_filename, key=plain.__name__,
                          expected=expected, found=finding, remedy=remedy)


def check_update(spec: LawSpec, kinematics: str, by_hand: bool, signatures: tuple) -> None:
    """Refuse a law whose functions break the rules.

    Parameters
    ----------
    by_hand : whether derivatives come from its ``linearise``
    signatures : numba's, of update and of what the derivative comes from

    Raises
    ------
    InputError
        It cannot be compiled, reads or writes beyond its arrays, writes into its inputs, leaves an output as it was,
        has an unsymmetric stress, is declared linear and is not, or its derivative is not that of its stress.
    """
    functions = (spec.updates[kinematics], spec.linearise[kinematics] if by_hand else spec.updates[kinematics])
    update, derivative = (_checked(spec, *pair) for pair in zip(functions, signatures, strict=True))
    law = _Law(spec, update, derivative, by_hand)
    params = np.array([_typical(p) for p in spec.parameters])
    rng = np.random.default_rng(0)
    wrong: dict[str, list[bool]] = {}
    for number, size in enumerate(np.repeat(SIZES, POINTS)):
        first, second = rng.standard_normal((2, 3, 3))
        second = -first if number % 2 else second  # every other path turns back
        state = np.array(spec.initial_state, dtype=float)
        middle = np.eye(3) + 0.5 * size * first / np.linalg.norm(first)
        P, state_new = _called(law, middle, state, params)
        if P is None or not np.isfinite(state_new).all():
            continue
        _check_symmetry(law, P if kinematics == "small" else P @ middle.T)
        if spec.linear and kinematics == "small":
            _check_linearity(law, P, _called(law, 2.0 * middle - np.eye(3), state_new, params)[0])
        F = middle + 0.3 * size * second / np.linalg.norm(second)
        for quantity, dF, dstate, dparams in _directions(spec, rng, size, state_new - state, params):
            wrong.setdefault(quantity, []).extend(_differs(law, (F, state_new, params), (dF, dstate, dparams)))
    for quantity, verdicts in wrong.items():
        if sum(verdicts) >= MIN_WRONG:
            raise law.refuse(
                f"its derivative with respect to {quantity} is wrong", "that of the stress and the new state",
                f"another one than the difference quotient at {sum(verdicts)} of {len(verdicts)} points",
                f"correct linearise, or leave it out ({_PAGE})" if by_hand else
                f"take no abs, max or min of what depends on F, state or parameters, and end an inner iteration with "
                f"one more step in complex numbers ({_PAGE})", law.derivative)


def compiled_or_refused(spec: LawSpec, compiler: Callable, function: Callable, signature):
    """compiler(function, signature).

    Raises
    ------
    InputError
        It cannot be compiled.
    """
    try:
        return compiler(function, signature)
    except (numba.core.errors.NumbaError, NotImplementedError, TypeError, ValueError) as problem:
        lines = [line.strip() for line in _COLOURS.sub("", str(problem)).splitlines() if line.strip()]
        messages = [line for line in lines if not line.startswith(("Failed in", "File ", "During", "def ", "<source"))]
        reason = (messages or lines or [type(problem).__name__])[0]
        line_match = re.search(r'\bline (\d+)|\.py \((\d+)\)', _COLOURS.sub("", str(problem)))
        plain = getattr(function, "py_func", function)
        place = f"{plain.__name__}, line {line_match[1] or line_match[2]}" if line_match else plain.__name__
        raise InputError(f"law {spec.name} cannot be compiled", file=plain.__code__.co_filename, key=place,
                         expected="Python that numba compiles for real and for complex numbers, and that returns 0 or "
                         "1", found=reason, remedy="correct it; compare real parts only (x.real > 0.0), without abs, "
                         f"max and min: {_PAGE}") from problem


def _checked(spec: LawSpec, function: Callable, signature) -> Callable:
    def compiler(plain, types):
        dispatcher = numba.njit(error_model="numpy", boundscheck=True)(getattr(plain, "py_func", plain))
        dispatcher.compile(types)
        return dispatcher

    return compiled_or_refused(spec, compiler, function, signature)


def _typical(p: LawParameter) -> float:
    if p.default is not None:
        return p.default
    return float(np.clip(1.0, *p.bounds))


def _called(law: _Law, F: np.ndarray, state: np.ndarray, params: np.ndarray) -> tuple:
    """(P, state_new) of update; (None, None) where it says that there is no solution, or gives NaN."""
    outputs = []
    for mark in MARKS:
        inputs = (F.copy(), state.copy(), params.copy())
        P, state_new = np.full((3, 3), mark), np.full(len(state), mark)
        if _guarded(law, law.update, (*inputs, DT, P, state_new)) != 0:
            return None, None
        for name, original, passed in zip(("F", "state", "params"), (F, state, params), inputs, strict=True):
            if not np.array_equal(original, passed):
                raise law.refuse(f"it writes into {name}", "inputs that are read only",
                                 f"another {name} after the call", f"write to a copy, as {name}.copy()")
        outputs.append((P, state_new))
    for name, (first_output, second_output) in zip(("P", "state_new"), zip(*outputs, strict=True), strict=True):
        unwritten = (first_output == MARKS[0]) & (second_output == MARKS[1])
        if unwritten.any():
            entry = ", ".join(map(str, np.argwhere(unwritten)[0]))
            raise law.refuse(f"it does not write all of {name}", f"every entry of {name}, also those that are zero",
                             f"nothing in {name}[{entry}]", "write it on every path")
    P, state_new = outputs[0]
    return (P, state_new) if np.isfinite(P).all() else (None, None)


def _check_symmetry(law: _Law, kirchhoff: np.ndarray) -> None:
    """kirchhoff : P F^T, of small strain P  # (3, 3) MPa"""
    skew = np.abs(kirchhoff - kirchhoff.T)
    if skew.max() > ASYMMETRY * np.abs(kirchhoff).max():
        i, j = np.unravel_index(skew.argmax(), skew.shape)
        raise law.refuse("its stress is not symmetric", "a symmetric P F^T (small strain: a symmetric P)",
                         f"{kirchhoff[i, j]:g} and {kirchhoff[j, i]:g} MPa in [{i}, {j}] and [{j}, {i}]",
                         "look for exchanged indices: P[i, j] takes F[i, j] and, of the inverse, Fi[j, i]")


def _check_linearity(law: _Law, once: np.ndarray, twice: np.ndarray | None) -> None:
    """once, twice : stress of a strain and of twice the strain after it  # (3, 3) MPa"""
    if twice is not None and np.abs(twice - 2.0 * once).max() > NONLINEARITY * np.abs(twice).max():
        grown = np.abs(twice).max() / np.abs(once).max()
        raise law.refuse("it is declared linear and is not", "twice the stress at twice the strain, whatever happened "
                         "before: its tangent is computed once", f"{grown:.4g} times the stress",
                         "take linear=True out of its LawSpec")


def _guarded(law: _Law, function: Callable, arguments: tuple) -> int:
    try:
        return function(*arguments)
    except IndexError as problem:
        sizes = f"params has {len(law.spec.parameters)} entries, state and state_new have {law.spec.n_state}"
        raise law.refuse("an index is out of bounds", f"F and P are 3 x 3, {sizes}", str(problem), "correct the index, "
                         "or declare the parameter or the name in state_names", function) from problem


def _directions(spec: LawSpec, rng: np.random.Generator, size: float, change: np.ndarray, params: np.ndarray):
    """(what, dF, dstate, dparams): a deformation, every parameter, and the change of the state."""
    no_F, no_state, none = np.zeros((3, 3)), np.zeros(len(change)), np.zeros(len(params))
    yield "F", size * rng.standard_normal((3, 3)), no_state, none
    if change.any():
        yield "state", no_F, change, none
    for k, (p, value) in enumerate(zip(spec.parameters, params, strict=True)):
        low, high = p.bounds
        step = abs(value) or 1.0
        if low <= value - STEPS[0] * step and value + STEPS[0] * step <= high:
            yield p.name, no_F, no_state, step * np.eye(len(params))[k]


def _differs(law: _Law, at: tuple, along: tuple) -> list[bool]:
    """Whether the derivative of the law is not the difference quotient; empty where there is none."""
    outputs, derivatives = _called(law, *at), _derivative(law, at, along)
    if outputs[0] is None or derivatives is None:
        return []
    quotients, bends = [], []
    for h in STEPS:
        ends = [_called(law, *(x + s * h * dx for x, dx in zip(at, along, strict=True))) for s in (1.0, -1.0)]
        if any(P is None for P, _ in ends):
            return []
        quotients.append([(ahead - back) / (2.0 * h) for ahead, back in zip(*ends, strict=True)])
        bends = [np.abs(ahead - 2.0 * middle + back).max(initial=0.0) / h
                 for ahead, back, middle in zip(*ends, outputs, strict=True)]
    answers = []
    for coarse, fine, bend, derivative, value in zip(*quotients, bends, derivatives, outputs, strict=True):
        scale = np.abs(fine).max(initial=0.0)
        rounding = 1e-13 * np.abs(value).max(initial=0.0) / STEPS[-1]
        smooth = np.abs(coarse - fine).max(initial=0.0) <= SMOOTH * scale and bend <= MAX_BEND * scale
        if smooth and scale > 1e3 * rounding:
            answers.append(not np.abs(derivative - fine).max(initial=0.0) <= WRONG * scale)
    return [any(answers)] if answers else []


def _derivative(law: _Law, at: tuple, along: tuple) -> tuple | None:
    (F, state, params), (dF, dstate, dparams) = at, along
    if law.by_hand:
        P, state_new, dP, dnew = np.zeros((3, 3)), np.zeros(len(state)), np.zeros((1, 3, 3)), np.zeros((1, len(state)))
        status = _guarded(law, law.derivative, (F.copy(), state.copy(), params.copy(), DT, dF[None], dstate[None],
                                                dparams[None], P, state_new, dP, dnew))
        return None if status else (dP[0], dnew[0])
    P, state_new = np.zeros((3, 3), complex), np.zeros(len(state), complex)
    moved = [x + 1j * COMPLEX_STEP * dx for x, dx in zip(at, along, strict=True)]
    status = _guarded(law, law.derivative, (*moved, DT, P, state_new))
    return None if status else (P.imag / COMPLEX_STEP, state_new.imag / COMPLEX_STEP)
