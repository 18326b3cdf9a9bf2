"""Stress that varies over the body: a factor on the stress of the points of one section, smooth in space.

    spot       1 + (amount - 1) w,   w = (1 - tanh((|X - centre| / radius - 1) / TRANSITION_HALF_WIDTH)) / 2
    gradient   1 + sum_i along_i (X_i - middle_i) / half_i
    field      exp(sum_k value_k hat_k(X)),   bilinear (3D: trilinear) hats on a regular grid over the box
    layers     ratio^(s / 2),   s = tanh((cos(phase) - cos(pi share)) / LAYER_EDGE),
               phase = 2 pi ((X - middle) . n - offset) / period,   n = (cos direction, sin direction)

It multiplies what a point contributes to forces and stiffness, i.e. its weight: a thickness that varies, or a modulus
that does where the stress is proportional to it. In a plane model the two are one and the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array

from idic.errors import NotConverged

TRANSITION_HALF_WIDTH = 0.2  # of the radius: half the width of the transition, so that place and size have derivatives
LAYER_EDGE = 0.25  # of the cosine of the phase: a layer changes to the next one within 0.08 of the period
AXES = "xyz"
MIN_STIFFNESS_FACTOR = 1e-6  # of the nominal stiffness: less and the equations are singular


@dataclass(frozen=True)
class Variation:
    """One factor field.

    Attributes
    ----------
    section : name of the section
    kind : "spot" (values amount, x, y, (z), radius; without z a column through the thickness), "gradient" (values
        along_x, along_y, (along_z): relative change from the middle to either end) or "layers" (values stiffness_ratio,
        of stiff over soft; period, offset of the middle of a stiff layer from that of the body; direction across the
        layers, from x to y; share of the stiff layers; the nominal stiffness is the geometric mean of both layers);
        "field" (values "0", "1", … of the grid points, the last axis fastest)
    values : mm, mm per mm, degrees
    middle, half : (d,) mm, of the body, for a gradient, layers or a field
    cells : per axis, of the grid of a field
    """

    section: str
    kind: str
    values: Mapping[str, float]
    middle: np.ndarray | None = None
    half: np.ndarray | None = None
    cells: tuple[int, ...] = ()

    def factor(self, points: np.ndarray) -> np.ndarray:
        """The factor at points (n, d) mm  # (n,)

        Raises
        ------
        NotConverged
            If nothing of the body would be left somewhere.
        """
        if self.kind == "spot":
            factor = 1.0 + (self.values["amount"] - 1.0) * self._weight(points)[0]
        elif self.kind == "field":
            number, hats = self.hats(points)
            values = np.array([self.values[str(k)] for k in range(len(self.values))])
            factor = np.exp((values[number] * hats).sum(axis=1))
        elif self.kind == "layers":
            factor = self.values["stiffness_ratio"] ** (0.5 * self._layer(points)[0])
        else:
            factor = 1.0 + sum((value * self._along(points, name) for name, value in self.values.items()),
                               start=np.zeros(len(points)))
        if len(factor) and not factor.min() > MIN_STIFFNESS_FACTOR:
            raise NotConverged(f"a stiffness of {factor.min():.3g} times its own in {self.section}")
        return factor

    def slope(self, points: np.ndarray, name: str) -> np.ndarray:
        """Derivative of the factor by one of `values`  # (n,)"""
        if self.kind == "gradient":
            return self._along(points, name)
        if self.kind == "layers":
            return self._slope_of_layers(points, name)
        if self.kind == "field":
            return self.relative_slopes(points, [name]).toarray()[:, 0] * self.factor(points)
        weight, distance, fall, away = self._weight(points)
        if name == "amount":
            return weight
        radius, change = self.values["radius"], self.values["amount"] - 1.0
        if name == "radius":
            return -change * fall * distance / radius
        direction = away[:, AXES.index(name)] / np.maximum(distance * radius, 1e-300)  # of X - centre
        return -change * fall * direction / radius

    def relative_slopes(self, points: np.ndarray, names: Sequence[str]) -> csc_array:
        """Derivatives of the logarithm of the factor by some of `values`  # (n, m)"""
        if self.kind != "field":
            factor = self.factor(points)
            return csc_array(np.stack([self.slope(points, name) / factor for name in names], axis=1))
        number, hats = self.hats(points)
        shape = (len(points), len(self.values))
        rows = np.repeat(np.arange(len(points)), hats.shape[1])
        return csc_array(coo_array((hats.ravel(), (rows, number.ravel())), shape=shape))[:, [int(n) for n in names]]

    def hats(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Grid points around points (n, d) mm and the hats of these there  # (n, 2^d) int, (n, 2^d)"""
        cells = np.asarray(self.cells)
        at = np.clip((points - self.middle + self.half) / (2.0 * self.half), 0.0, 1.0) * cells
        low = np.minimum(at.astype(int), cells - 1)
        corners = np.indices((2,) * len(cells)).reshape(len(cells), -1).T
        hats = np.prod(np.where(corners == 1, (at - low)[:, None], 1.0 - (at - low)[:, None]), axis=2)
        return np.ravel_multi_index(np.moveaxis(low[:, None] + corners, 2, 0), cells + 1), hats

    def _along(self, points: np.ndarray, name: str) -> np.ndarray:
        axis = AXES.index(name[-1])
        return (points[:, axis] - self.middle[axis]) / self.half[axis]

    def _layer(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """s from soft (-1) to stiff (1), its derivative by the cosine, phase, and way across and along the layers."""
        turn = np.radians(self.values["direction"])
        across, along = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        ways = (points[:, :2] - self.middle[:2]) @ np.column_stack([across, along])
        phase = 2.0 * np.pi * (ways[:, 0] - self.values["offset"]) / self.values["period"]
        s = np.tanh((np.cos(phase) - np.cos(np.pi * self.values["share"])) / LAYER_EDGE)
        return s, (1.0 - s**2) / LAYER_EDGE, phase, ways

    def _slope_of_layers(self, points: np.ndarray, name: str) -> np.ndarray:
        s, steep, phase, ways = self._layer(points)
        ratio, period = self.values["stiffness_ratio"], self.values["period"]
        factor = ratio ** (0.5 * s)
        if name == "stiffness_ratio":
            return 0.5 * s * factor / ratio
        if name == "share":
            change = np.pi * np.sin(np.pi * self.values["share"])
        else:
            by_way = 2.0 * np.pi / period
            of_phase = {"period": -phase / period, "offset": -by_way,
                        "direction": by_way * ways[:, 1] * np.pi / 180.0}[name]
            change = -np.sin(phase) * of_phase
        return 0.5 * np.log(ratio) * factor * steep * change

    def _weight(self, points: np.ndarray):
        """Weight, distance in radii, derivative of the weight by it, and the way from the centre."""
        axes = [axis for axis in range(points.shape[1]) if AXES[axis] in self.values]
        away = points[:, axes] - np.array([self.values[AXES[axis]] for axis in axes])
        distance = np.linalg.norm(away, axis=1) / self.values["radius"]
        step = np.tanh((distance - 1.0) / TRANSITION_HALF_WIDTH)
        return 0.5 * (1.0 - step), distance, -0.5 * (1.0 - step**2) / TRANSITION_HALF_WIDTH, away


def factor_of(variations: tuple[Variation, ...], section: str, points: np.ndarray) -> np.ndarray | None:
    """Product of all factors of a section at its points; None where none concerns it  # (n,)"""
    section_variations = [variation for variation in variations if variation.section == section]
    return np.prod([variation.factor(points) for variation in section_variations],
                   axis=0) if section_variations else None
