"""Paths of deformation with a known answer: the same strain in two directions, simple shear."""

from __future__ import annotations

import numpy as np

from idic.laws import CompiledLaw, point


def equibiaxial(law: CompiledLaw, params, strain, *, mode: int = 2, times=None) -> point.Curve:
    """F11 = F22 = 1 + ``strain`` (m,), no shear strain; the third direction free of stress (F33 = 1 in mode 1)."""
    F = _path(strain, mode, lambda e, d: e * np.diag([1.0, 1.0, 0.0][:d]))
    driven = np.ones(F.shape[1:], bool)
    if mode == 0:
        driven[2, 2] = False
    return point.drive(law, params, F, mode=mode, driven=driven, times=times)


def simple_shear(law: CompiledLaw, params, shear, *, mode: int = 0, times=None) -> point.Curve:
    """F12 = ``shear`` (m,), every other component as at rest (plane stress: F33 free)."""
    F = _path(shear, mode, lambda e, d: e * np.eye(1, d * d, 1)[0].reshape(d, d))
    return point.drive(law, params, F, mode=mode, times=times)


def _path(values, mode: int, gradient) -> np.ndarray:
    d = 3 if mode == 0 else 2
    return np.array([np.eye(d) + gradient(value, d) for value in np.asarray(values, dtype=float)])
