"""Strain from the deformation gradient F, and tensors in other axes.

    green_lagrange   E = (C - 1) / 2          C = F^T F
    hencky           H = ln(C) / 2            the logarithm of the stretch: of the length of fibres of the reference
    small            e = (F + F^T) / 2 - 1    for small rotations only

E and H are zero for every rotation, and refer to directions of the undeformed specimen (Holzapfel, Nonlinear Solid
Mechanics, 2000, section 2.5). NaN stays NaN.
"""

from __future__ import annotations

import numpy as np

from idic.errors import InputError

MEASURES = {"green_lagrange": "Green-Lagrange strain", "hencky": "Hencky (logarithmic) strain", "small": "small strain"}


def strain(F: np.ndarray, measure: str = "green_lagrange") -> np.ndarray:
    """A strain tensor of deformation gradients.

    Parameters
    ----------
    F : (..., d, d)
    measure : "green_lagrange" | "hencky" | "small"

    Returns
    -------
    (..., d, d)

    Raises
    ------
    InputError
        An unknown measure.
    """
    if measure not in MEASURES:
        raise InputError("no such strain", key="measure", expected=", ".join(MEASURES), found=str(measure),
                         remedy="write one of these names")
    identity = np.eye(F.shape[-1])
    if measure == "small":
        return (F + np.swapaxes(F, -1, -2)) / 2.0 - identity
    C = np.swapaxes(F, -1, -2) @ F
    if measure == "green_lagrange":
        return (C - identity) / 2.0
    squares, directions = _eigen(C)
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(squares) / 2.0
    return np.einsum("...ik,...k,...jk->...ij", directions, logs, directions)


def rotated(tensor: np.ndarray, angle_deg: float) -> np.ndarray:
    """Components in axes that are turned counter-clockwise about z  # (..., d, d) -> (..., d, d)"""
    turn = np.eye(tensor.shape[-1])
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn[:2, :2] = [[c, s], [-s, c]]
    return turn @ tensor @ turn.T


def principal(tensor: np.ndarray) -> np.ndarray:
    """Principal values, the largest first  # (..., d, d) -> (..., d)"""
    return _eigen(tensor)[0][..., ::-1]


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Equivalent stress of a plane or a spatial stress tensor; a plane one has no stress along z  # (..., d, d) ->
    (...)"""
    trace = np.trace(stress, axis1=-2, axis2=-1)
    squares = (stress**2).sum(axis=(-2, -1))
    return np.sqrt(np.maximum(1.5 * (squares - trace**2 / 3.0), 0.0))


def _eigen(tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues in ascending order and eigenvectors of symmetric tensors; NaN where an entry is not finite."""
    finite = np.isfinite(tensor).all(axis=(-2, -1))
    values, vectors = np.linalg.eigh(np.where(finite[..., None, None], tensor, np.eye(tensor.shape[-1])))
    return np.where(finite[..., None], values, np.nan), np.where(finite[..., None, None], vectors, np.nan)
