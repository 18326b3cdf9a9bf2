"""Viscoelasticity with a free relaxation spectrum: weights on a fixed grid of relaxation times, ``free_relaxation(8)``.

The body of ``maxwell.py`` with n branches, whose times are evenly spread over their logarithm:

    tau_k = shortest (longest / shortest)^((k - 1) / (n - 1)),   G(t) = G (1 - sum g_k (1 - exp(-t / tau_k)))

The weights g_k are no less than zero, and their sum stays below 1. They are identified; the two ends of the grid are
chosen. Discrete spectra: Ferry, Viscoelastic Properties of Polymers (1980); regularised: Honerkamp & Weese, Rheol. Acta
32 (1993) 65, doi:10.1007/BF00396678.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS
from idic.laws.plasticity.elastoplastic import shear_and_bulk
from idic.laws.rate.maxwell import (
    COMPONENTS, add_branch, begin_tangent, end_tangent, keep_tensor, plus_identity, relaxed)

FREE_RELAXATION = "free_relaxation"
DEFAULT_TIMES, TIMES = 8, (3, 24)  # of the grid; fewest and most
SHORTEST, LONGEST, WEIGHTS = 2, 3, 4  # places of the parameters
DEFAULT_SHARE = 0.5  # of the shear modulus that relaxes, in curves and tests
FEWEST = ("3",)  # of the law without a number


@inner
def update(n, F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = shear_and_bulk(params[0], params[1])
    f = tensors.load(F)
    J, fi = tensors.inverse(f)
    if not (J.real > 0.0 and params[SHORTEST].real > 0.0 and params[LONGEST].real > params[SHORTEST].real):
        return 1
    shrink = J ** (-2.0 / 3.0)
    identity = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    transposed = (f[0], f[3], f[6], f[1], f[4], f[7], f[2], f[5], f[8])
    C_old, C_new = plus_identity(state, 0), tensors.scaled(shrink, tensors.congruence(transposed, identity), 0.0)
    keep_tensor(C_new, state_new, 0)
    remaining, tau = G, params[SHORTEST]
    step = (params[LONGEST] / params[SHORTEST]) ** (1.0 / (n - 1.0))
    total = tensors.scaled(0.0 * G, C_new, 0.0)
    for k in range(n):
        weight, adjugate = relaxed(tau, dt, state, 6 + 6 * k, C_old, C_new, state_new)
        g = params[WEIGHTS + k]
        remaining -= g * G
        total = tensors.combine(1.0, total, g * G * shrink * weight, adjugate, 0.0)
        tau = tau * step
    if not remaining.real > 0.0:
        return 1  # the long-term body has no stiffness
    total = tensors.scaled(1.0, total, remaining * shrink)
    _, dev = tensors.deviator(tensors.congruence(f, total))
    tensors.store(tensors.times_transposed(tensors.scaled(1.0, dev, kappa * (J - 1.0) * J), fi), P)
    return 0


@inner
def tangent(n, F, state, params, dt, P, state_new, A, work):
    """`update` and its tangent, real."""
    G, kappa = shear_and_bulk(params[0], params[1])
    begin = begin_tangent(F, state, work[1], state_new)
    if not (begin[1] > 0.0 and params[SHORTEST] > 0.0 and params[LONGEST] > params[SHORTEST]):
        return 1
    zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    remaining, tau, total, crossing = G, params[SHORTEST], zero, zero
    step = (params[LONGEST] / params[SHORTEST]) ** (1.0 / (n - 1.0))
    for k in range(n):
        g = params[WEIGHTS + k]
        remaining -= g * G
        total, crossing = add_branch(g * G, tau, dt, state, 6 + 6 * k, begin[4], begin[5], total, crossing, work[1],
                                     state_new)
        tau = tau * step
    if not remaining > 0.0:
        return 1
    end_tangent(begin, tensors.scaled(1.0, total, remaining), crossing, work[1], work[0], kappa, P, A)
    return 0


def times_of(law: str) -> int:
    """The number of relaxation times in a law's name; 0 of another law."""
    if law == FREE_RELAXATION:
        return int(FEWEST[0])
    match = re.fullmatch(rf"{FREE_RELAXATION}\((\d+)\)", law)
    return int(match[1]) if match else 0


def weight_names(n: int) -> tuple[str, ...]:
    """The parameters that are the weights of n relaxation times."""
    return tuple(f"g_{k}" for k in range(1, n + 1))


def grid(shortest: float, longest: float, n: int) -> np.ndarray:
    """Relaxation times, s  # (n,)"""
    return np.geomspace(shortest, longest, n)


def relaxing(times: np.ndarray, taus: np.ndarray) -> np.ndarray:
    """Loss of the modulus at times (m,) s per unit of the weight of every relaxation time (n,) s  # (m, n)"""
    return -np.expm1(-np.asarray(times)[:, None] / np.asarray(taus))


def spectrum(law: str, values: Mapping[str, float]) -> list[tuple[float, float]] | None:
    """(weight, relaxation time in s) of the branches of ``maxwell`` or a free spectrum; None of another law."""
    n = times_of(law)
    if n:
        taus = grid(values["shortest"], values["longest"], n)
        return [(values[name], float(tau)) for name, tau in zip(weight_names(n), taus, strict=True)]
    if law != "maxwell":
        return None
    return [(values[f"g_{i}"], values[f"tau_{i}"]) for i in (1, 2, 3) if values[f"tau_{i}"] > 0.0]


def compose(kinds: Sequence[str]) -> LawSpec:
    """The law with this number of relaxation times.

    Raises
    ------
    InputError
        Not one number within `TIMES`.
    """
    if len(kinds) != 1 or not kinds[0].isdecimal() or not TIMES[0] <= int(kinds[0]) <= TIMES[1]:
        raise InputError(f"{FREE_RELAXATION} needs its number of relaxation times", key="law",
                         expected=f"{FREE_RELAXATION}(8), {TIMES[0]} to {TIMES[1]}", found=repr("+".join(kinds)),
                         remedy="correct the number")
    n = int(kinds[0])

    def update_of(F, state, params, dt, P, state_new):
        return update(n, F, state, params, dt, P, state_new)

    def tangent_of(F, state, params, dt, P, state_new, A, work):
        return tangent(n, F, state, params, dt, P, state_new, A, work)

    ends = (LawParameter("shortest", "s", "shortest relaxation time; chosen, locked", default=1.0),
            LawParameter("longest", "s", "longest relaxation time; chosen, locked", default=100.0))
    weights = (LawParameter(name, "-", f"share of the shear modulus that relaxes with time {k} of {n}",
                            default=DEFAULT_SHARE / n, null=0.0, positive=False, bounds=(0.0, 1.0))
               for k, name in enumerate(weight_names(n), 1))
    tensors_of_state = ("c", *(f"ci{k}_" for k in range(1, n + 1)))
    return LawSpec(
        name=f"{FREE_RELAXATION}({n})", parameters=(*ELASTIC_PARAMETERS, *ends, *weights),
        updates={"finite": update_of}, tangents={"finite": tangent_of},
        state_names=tuple(f"{tensor}{c}" for tensor in tensors_of_state for c in COMPONENTS), compose=compose,
        alternatives=ELASTIC_ALTERNATIVES, time_order=2,
        reference="maxwell with weights g_k on n fixed relaxation times from shortest to longest, evenly over their "
                  "logarithm; Honerkamp & Weese, Rheol. Acta 32 (1993) 65, doi:10.1007/BF00396678")


LAW = register(replace(compose(FEWEST), name=FREE_RELAXATION))
