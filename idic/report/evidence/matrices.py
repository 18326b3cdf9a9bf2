"""Matrices and sensitivity maps of a report: eliminated boundary modes, the step of a parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.model import is_mode
from idic.parameters import Parameter

_SHOWN_CHANGE = 0.01  # relative change of a parameter that a sensitivity map shows
_MIN_INVERTED_EIGENVALUE = 1e-12  # eigenvalue of the modes' block, relative to the largest


def without_modes(M: Mapping) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Names and matrix M of the other unknowns, the amplitudes of virtual boundaries eliminated (Schur complement)."""
    names = list(M.get("names", ()))
    if not names:
        return (), None
    matrix = np.array(M["matrix"])
    others_at = [i for i, name in enumerate(names) if not is_mode(name)]
    modes = [i for i, name in enumerate(names) if is_mode(name)]
    if modes:
        cross = matrix[np.ix_(others_at, modes)]
        inner = np.linalg.pinv(matrix[np.ix_(modes, modes)], rcond=_MIN_INVERTED_EIGENVALUE, hermitian=True)
        matrix = matrix[np.ix_(others_at, others_at)] - cross @ inner @ cross.T
    return tuple(names[i] for i in others_at), matrix


def shown_step(parameter: Parameter) -> tuple[float, str]:
    """The change that a sensitivity map stands for: internal size, and the title of the map."""
    position = parameter.name.startswith("geometry.hole_")  # its zero means nothing: 1 % of the radius, its scale
    if parameter.value and not position:
        return _SHOWN_CHANGE * abs(parameter.value), "1 %"
    if position:
        parameter = replace(parameter, scale=_SHOWN_CHANGE * parameter.scale)
    unit = f" {parameter.unit}" if parameter.unit and parameter.unit != "-" else ""
    return parameter.scale, f"{parameter.scale / parameter.factor:.3g}{unit}"
