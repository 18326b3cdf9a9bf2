"""Shape of a grip: the set moves by a Legendre polynomial along its longest extent, in proportion to the motion.

``shape0`` as a whole, ``shape1`` linear, ``shape2`` bent, ...; mm at the largest motion. It is no candidate of the
diagnosis.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

from idic.fe import Mesh
from idic.model.records.parts import Column, Correction
from idic.model.terms.corrections.correction_term import (
    CorrectedMotion, CorrectionTerm, Key, Required, follows_motion, in_length, in_proportion,
)


def course(motion: CorrectedMotion) -> np.ndarray:
    values = in_proportion(motion, "shape")
    if follows_motion(motion) and isinstance(motion.drive, Column):
        values = values - values[motion.reference]
        return values / (np.abs(values).max() or 1.0)
    return values


def pattern(correction: Correction, mesh: Mesh, nodes: np.ndarray, component: str) -> tuple[str, np.ndarray]:
    return component, legendre.legval(_places(mesh, nodes), np.eye(correction.keys["degree"] + 1)[-1])


def _places(mesh: Mesh, nodes: np.ndarray) -> np.ndarray:
    """Along the axis of the longest extent of a set, -1 and 1 at its outermost nodes  # (n,)"""
    at = mesh.nodes[nodes]
    along = at[:, int(np.argmax(np.ptp(at, axis=0)))]
    half = 0.5 * float(np.ptp(along))
    return (along - along.min()) / half - 1.0 if half > 0.0 else np.zeros(len(nodes))


SHAPE = CorrectionTerm(
    "shape", course, in_length, pattern=pattern, is_timed=True, is_logged=True,
    keys=(Key("degree", int, least=0, most=9),), number="degree",
    required=Required(("degree",), "a shape without its degree", "the degree of the polynomial along the set",
                      '{ kind = "shape", degree = 2 }'))
