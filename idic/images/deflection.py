"""A sheet that bends out of its plane before one camera: its shapes, and what the camera sees of them.

A point nearer by w to a camera at the distance Z is seen farther from the optical axis (Sutton et al. 2008, doi
10.1016/j.optlaseng.2008.05.005), on a face that turns about the middle plane of the sheet, thickness t:

    d = w / Z = sum of amplitudes times shapes s(xi),    xi = (x - middle) / half, +-1 at the ends of the sheet
    p = centre + (1 + d) (p0(X - lever grad d) - centre),    lever = Z t / 2; 0 where Z is unknown

d is what the images determine. The shortening of the middle plane by (grad w)^2 / 2 is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Shape:
    """A deflection along one axis of the mesh, largest value 1; xi : (n,) place between the ends.

    words : what the sheet does; value, slope, curvature : of xi, derivatives by xi
    """

    axis: int
    words: str
    value: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    curvature: Callable[[np.ndarray], np.ndarray]


_HALF = 0.5 * np.pi
_FORMS: dict[str, tuple[str, Callable, Callable, Callable]] = {
    "bow": ("bends along {}, evenly curved", lambda xi: 1.0 - xi**2, lambda xi: -2.0 * xi,
            lambda xi: np.full_like(xi, -2.0)),
    "arch": ("bends along {} between hinged ends", lambda xi: np.cos(_HALF * xi),
             lambda xi: -_HALF * np.sin(_HALF * xi), lambda xi: -_HALF**2 * np.cos(_HALF * xi)),
    "buckle": ("bends along {} between clamped ends", lambda xi: 0.5 + 0.5 * np.cos(np.pi * xi),
               lambda xi: -_HALF * np.sin(np.pi * xi), lambda xi: -_HALF * np.pi * np.cos(np.pi * xi)),
    "lean": ("leans along {}", lambda xi: xi, np.ones_like, np.zeros_like),
}
SHAPES: dict[str, Shape] = {f"{form}_{axis}": Shape(number, words.format(axis), *functions)
                            for number, axis in enumerate("xy") for form, (words, *functions) in _FORMS.items()}


@dataclass(frozen=True, eq=False)
class Sheet:
    """Where the shapes lie.

    middle, half : (2,) mm, of the mesh along x and y; lever : mm^2, distance of the camera times half the thickness
    """

    middle: np.ndarray
    half: np.ndarray
    lever: float = 0.0


@dataclass(frozen=True, eq=False)
class Deflection:
    """The deflection of a sheet in one frame; amplitudes : d per shape."""

    sheet: Sheet
    amplitudes: dict[str, float]

    def ratio(self, x: np.ndarray) -> np.ndarray:
        """d  # (n, 2) mm -> (n,)"""
        return np.asarray(sum(a * _value(name, self.sheet, x) for name, a in self.amplitudes.items()))

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """d by x and y  # (n, 2) mm -> (n, 2) 1/mm"""
        return np.asarray(sum(a * _gradient(name, self.sheet, x) for name, a in self.amplitudes.items()))

    def face(self, x: np.ndarray) -> np.ndarray:
        """Where the seen face is  # (n, 2) mm"""
        return x - self.sheet.lever * self.gradient(x)

    def face_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivative of `face`; no shape bends along both axes  # (n, 2, 2)"""
        jacobian = np.tile(np.eye(2), (len(x), 1, 1))
        for name, amplitude in self.amplitudes.items():
            axis, half = SHAPES[name].axis, self.sheet.half[SHAPES[name].axis]
            bent = SHAPES[name].curvature(_place(name, self.sheet, x)) / half**2
            jacobian[:, axis, axis] -= self.sheet.lever * amplitude * bent
        return jacobian

    def change(self, name: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `ratio` and `face` by an amplitude  # (n,), (n, 2) mm"""
        return _value(name, self.sheet, x), -self.sheet.lever * _gradient(name, self.sheet, x)


def _place(name: str, sheet: Sheet, x: np.ndarray) -> np.ndarray:
    axis = SHAPES[name].axis
    return (x[:, axis] - sheet.middle[axis]) / sheet.half[axis]


def _value(name: str, sheet: Sheet, x: np.ndarray) -> np.ndarray:
    return SHAPES[name].value(_place(name, sheet, x))


def _gradient(name: str, sheet: Sheet, x: np.ndarray) -> np.ndarray:
    gradient, axis = np.zeros_like(x), SHAPES[name].axis
    gradient[:, axis] = SHAPES[name].slope(_place(name, sheet, x)) / sheet.half[axis]
    return gradient
