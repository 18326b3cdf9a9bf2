"""Stress that varies over the body: a factor on the stress of the points of one section, smooth in space.

    spot       1 + (amount - 1) w,   w = (1 - tanh((|X - centre| / radius - 1) / TRANSITION_HALF_WIDTH)) / 2
    gradient   1 + sum_i along_i (X_i - middle_i) / half_i

It multiplies what a point contributes to forces and stiffness, i.e. its weight: a thickness that varies, or a modulus
that does where the stress is proportional to it. In a plane model the two are one and the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.errors import NotConverged

TRANSITION_HALF_WIDTH = 0.2  # of the radius: half the width of the transition, so that place and size have derivatives
AXES = "xyz"
MIN_STIFFNESS_FACTOR = 1e-6  # of the nominal stiffness: less and the equations are singular


@dataclass(frozen=True)
class Variation:
    """One factor field.

    Attributes
    ----------
    section : name of the section
    kind : "spot" (values amount, x, y, (z), radius; without z a column through the thickness) or "gradient" (values
        along_x, along_y, (along_z): relative change from the middle to either end)
    values : mm, mm per mm
    middle, half : (d,) mm, of the body, for a gradient
    """

    section: str
    kind: str
    values: Mapping[str, float]
    middle: np.ndarray | None = None
    half: np.ndarray | None = None

    def factor(self, points: np.ndarray) -> np.ndarray:
        """The factor at points (n, d) mm  # (n,)

        Raises
        ------
        NotConverged
            If nothing of the body would be left somewhere.
        """
        if self.kind == "spot":
            factor = 1.0 + (self.values["amount"] - 1.0) * self._weight(points)[0]
        else:
            factor = 1.0 + sum(value * self._along(points, name) for name, value in self.values.items())
        if len(factor) and not factor.min() > MIN_STIFFNESS_FACTOR:
            raise NotConverged(f"a stiffness of {factor.min():.3g} times its own in {self.section}")
        return factor  # type: ignore[return-value]

    def slope(self, points: np.ndarray, name: str) -> np.ndarray:
        """Derivative of the factor by one of `values`  # (n,)"""
        if self.kind == "gradient":
            return self._along(points, name)
        weight, distance, fall, away = self._weight(points)
        if name == "amount":
            return weight
        radius, change = self.values["radius"], self.values["amount"] - 1.0
        if name == "radius":
            return -change * fall * distance / radius
        direction = away[:, AXES.index(name)] / np.maximum(distance * radius, 1e-300)  # of X - centre
        return -change * fall * direction / radius

    def _along(self, points: np.ndarray, name: str) -> np.ndarray:
        axis = AXES.index(name[-1])
        return (points[:, axis] - self.middle[axis]) / self.half[axis]

    def _weight(self, points: np.ndarray):
        """Weight, distance in radii, derivative of the weight by it, and the way from the centre."""
        axes = [axis for axis in range(points.shape[1]) if AXES[axis] in self.values]
        away = points[:, axes] - np.array([self.values[AXES[axis]] for axis in axes])
        distance = np.linalg.norm(away, axis=1) / self.values["radius"]
        step = np.tanh((distance - 1.0) / TRANSITION_HALF_WIDTH)
        return 0.5 * (1.0 - step), distance, -0.5 * (1.0 - step**2) / TRANSITION_HALF_WIDTH, away


def factor_of(variations: tuple[Variation, ...], section: str, points: np.ndarray) -> np.ndarray | None:
    """Product of all factors of a section at its points; None where none concerns it  # (n,)"""
    own = [variation for variation in variations if variation.section == section]
    return np.prod([variation.factor(points) for variation in own], axis=0) if own else None
