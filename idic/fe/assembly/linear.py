"""Laws that are linear in the strain: one tangent for all points and all times of a simulation.

    P = C (F - I),     dP = (dC/dlambda) (F - I),     Ke of an element once

A long test of such a law then takes a product and a solution per frame; the law is not evaluated again. Small strain,
no memory, no temperature, no mean dilatation (which changes the tangent of every point).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idic.fe.assembly import kernels, kernels_solid
from idic.laws import CompiledLaw, directional_stresses

STRAIN = 2.0**-10  # of the unit changes: 1 + STRAIN and its difference to 1 are exact


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """The response of the points of a group, all alike.

    C : (d*d, d*d) MPa, dP/dF; thinning : (d*d,) dF33/dF of plane stress, else None; grads, weights, n_elements : of the
    group
    """

    C: np.ndarray
    thinning: np.ndarray | None
    grads: np.ndarray
    weights: np.ndarray
    n_elements: int

    @cached_property
    def tangent(self) -> tuple[np.ndarray, np.ndarray]:
        """C of every point (n_points, d*d, d*d) MPa, and the element matrices (n_el, nn d, nn d) N/mm."""
        d, size = self.grads.shape[2], self.grads.shape[1] * self.grads.shape[2]
        A = np.ascontiguousarray(np.broadcast_to(self.C, (len(self.weights), *self.C.shape)))
        Ke = np.empty((self.n_elements, size, size))
        stiffness = kernels_solid.element_stiffness if d == 3 else kernels.element_stiffness_plane
        stiffness(self.grads, self.weights, A, Ke)
        return A, Ke

    def stress(self, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """P (n, d, d) and the state, F33 in plane stress (n, 0|1), at F (n, d, d)."""
        strain = _strain(F)
        state = np.empty((len(F), 0)) if self.thinning is None else 1.0 + (strain @ self.thinning)[:, None]
        return (strain @ self.C.T).reshape(F.shape), state


class KeptResponse:
    """The last response of one group of elements, kept for the next call with the same parameters."""

    def __init__(self, law: CompiledLaw, mode: int, grads: np.ndarray, weights: np.ndarray, n_elements: int) -> None:
        self._law, self._mode, self._n_elements = law, mode, n_elements
        self._grads, self._weights = grads, weights
        self._last: tuple[np.ndarray, LinearResponse] | None = None

    def of(self, params: np.ndarray) -> LinearResponse | None:
        """The response; None where the law has no answer for these parameters  # params (n_params,)"""
        latest = self._last  # one look: threads share it
        if latest is None or not np.array_equal(latest[0], params):
            response = self._computed(params)
            if response is None:
                return None
            latest = self._last = params.copy(), response
        return latest[1]

    def changes(self, params: np.ndarray, dparams: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Change of the stress at F along changes of the parameters  # dparams (nd, n_params) -> (n, nd, d, d) MPa"""
        dP, _ = self._at_unit_strains(params, None, dparams)
        d = F.shape[1]
        slopes = np.moveaxis(dP.reshape(d * d, len(dparams), d * d), 0, 2) / STRAIN  # (nd, d*d, d*d)
        return np.ascontiguousarray(np.moveaxis(slopes @ _strain(F).T, 2, 0)).reshape(len(F), -1, d, d)

    def _computed(self, params: np.ndarray) -> LinearResponse | None:
        d = self._grads.shape[2]
        dP, dstate = self._at_unit_strains(params, np.eye(d * d).reshape(1, d * d, d, d), None)
        if dP is None:
            return None
        C = np.ascontiguousarray(dP[0].reshape(d * d, d * d).T)
        thinning = dstate[0, :, -1].copy() if self._mode == 2 else None
        return LinearResponse(C, thinning, self._grads, self._weights, self._n_elements)

    def _at_unit_strains(self, params: np.ndarray, dF: np.ndarray | None, dparams: np.ndarray | None):
        """Derivatives at rest along dF (1, nd, d, d), or at small unit strains (d*d of them) along the parameters."""
        d, law, mode = self._grads.shape[2], self._law, self._mode
        n = 1 if dparams is None else d * d
        F = np.tile(np.eye(d), (n, 1, 1))
        if dparams is not None:
            F += STRAIN * np.eye(d * d).reshape(-1, d, d)
            dF = np.zeros((n, len(dparams), d, d))
        state = np.tile(law.initial_state(mode), (n, 1))
        dP, dstate, ok = directional_stresses(law, mode, F, state, params, 0.0, dF, None, dparams)
        return (dP, dstate) if ok else (None, None)


def kept_response(law: CompiledLaw, mode: int, grads: np.ndarray, weights: np.ndarray, n_elements: int,
                  mean_dilatation: bool) -> KeptResponse | None:
    """Of a group of elements whose law is linear; None where it is not."""
    if not (law.small and law.spec.linear) or mean_dilatation:
        return None
    return KeptResponse(law, mode, grads, weights, n_elements)


def _strain(F: np.ndarray) -> np.ndarray:
    return (F - np.eye(F.shape[1])).reshape(len(F), -1)
