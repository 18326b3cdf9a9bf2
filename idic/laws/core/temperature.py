"""Parameters of a law that depend on the temperature: factors that are 1 at the reference temperature.

    linear         1 + slope (T - T0)
    johnson_cook   1 - ((T - T0) / (melting - T0))^m  above T0, 1 below; Johnson & Cook, Eng. Fract. Mech. 21
                   (1985) 31, doi:10.1016/0013-7944(85)90052-9
    arrhenius      exp(activation (1/T - 1/T0)), T in K, activation = energy / gas constant

A point has the parameters of its temperature at the end of an increment (backward Euler): laws keep strains, not
stresses, in their state, so an elastic modulus that changes leaves no stress behind. Temperatures are in °C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LINEAR, JOHNSON_COOK, ARRHENIUS = 1, 2, 3
KELVIN = 273.15  # °C
STEP = 1e-30  # of the complex step, as in kernels.py


def factor(kind: int, term_params: Sequence | np.ndarray, reference, T: np.ndarray) -> np.ndarray:
    """The factor at temperatures T (n,), real or complex; term_params : of the term  # (n,)"""
    if kind == LINEAR:
        return 1.0 + term_params[0] * (T - reference)
    if kind == ARRHENIUS:
        return np.exp(term_params[0] * (1.0 / (T + KELVIN) - 1.0 / (reference + KELVIN)))
    share = (T - reference) / (term_params[1] - reference)
    warm = share.real > 0.0
    return np.where(warm, 1.0 - np.where(warm, share, 1.0) ** term_params[0], 1.0)


@dataclass(frozen=True)
class Factor:
    """One factor: its kind, the place of its first parameter, and the places of the parameters that it multiplies."""

    kind: int
    first: int
    targets: tuple[int, ...]


@dataclass(frozen=True)
class TemperatureDependence:
    """The factors of a law; ``reference`` is the place of the reference temperature (°C) among its parameters."""

    factors: tuple[Factor, ...]
    reference: int

    def values(self, params: np.ndarray, T: np.ndarray) -> np.ndarray:
        """The parameters at temperatures T (n,) °C; params (n_params,)  # (n, n_params)"""
        scaled = np.tile(params, (len(T), 1)).astype(np.result_type(params, T))
        for term in self.factors:
            by = factor(term.kind, params[term.first:term.first + 2], params[self.reference], T)
            for place in term.targets:
                scaled[:, place] *= by
        return scaled

    def changes(self, params: np.ndarray, T: np.ndarray, dparams: np.ndarray | None, dT: np.ndarray | None, nd: int,
                ) -> np.ndarray | None:
        """Change of `values` along nd directions; None: none concerns them.

        dparams : (nd, n_params) or None (zero); dT : (n, nd) K or None (zero)

        Returns
        -------
        (n, nd, n_params)
        """
        if dparams is None and dT is None:
            return None
        out = np.zeros((len(T), nd, len(params)))
        for k in range(nd):
            moved = params if dparams is None else params + 1j * STEP * dparams[k]
            warmed = T if dT is None else T + 1j * STEP * dT[:, k]
            if np.iscomplexobj(moved) or np.iscomplexobj(warmed):
                out[:, k] = self.values(moved, warmed).imag / STEP
        return out

    def trouble(self, params: np.ndarray, T: np.ndarray) -> str:
        """Empty, or why the law cannot be used at these temperatures."""
        for term in self.factors:
            by = factor(term.kind, params[term.first:term.first + 2], params[self.reference], T)
            worst = int(np.argmin(by))
            if not by[worst] > 0.0:
                return f"a parameter of the law would be multiplied by {by[worst]:.3g} at {T[worst]:.4g} °C"
        return ""
