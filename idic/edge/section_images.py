"""Height images of a bulging section without any interpolation error, by code of its own.

    g(X + u(X), y) = f(X, y) + h(X)

The roughness f is a sum of Fourier modes, so it has a value anywhere. For every image column the material point X that
has moved there is found on the deformed edge itself (Newton on its isoparametric map); as the motion depends on X only,
a frame is then one product (rows x modes)(modes x columns). Nothing of `idic.correlation` or `idic.images` is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEWTON_STEPS = 30


@dataclass(frozen=True)
class Roughness:
    """f(X, y) = sum_m amplitude cos(k_m . (X, y) + phase_m), lengths in um.

    wave : (m, 2) 1/um, amplitude : um, phase : (m,).
    """

    wave: np.ndarray
    amplitude: float
    phase: np.ndarray

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """f on the grid of rows y and places x  # x (n,), y (m,) um -> (m, n) um"""
        along = np.multiply.outer(self.wave[:, 0], x) + self.phase[:, None]  # (modes, n)
        across = np.multiply.outer(y, self.wave[:, 1])  # (m, modes)
        rows = np.concatenate([np.cos(across), -np.sin(across)], axis=1)
        return self.amplitude * (rows @ np.concatenate([np.cos(along), np.sin(along)]))


def roughness(rng: np.random.Generator, rms_um: float, length_um: float, modes: int = 300) -> Roughness:
    """Random roughness with the autocorrelation exp(-(r / length)^2)."""
    wave = rng.normal(0.0, np.sqrt(2.0) / length_um, (modes, 2))
    return Roughness(wave, rms_um * np.sqrt(2.0 / modes), rng.uniform(0.0, 2.0 * np.pi, modes))


@dataclass(frozen=True)
class Section:
    """The seen edges of half a symmetric section: places x and displacements (u, h) of their three nodes, in um.

    x : (n_edges, 3) end, end, middle, with x increasing from edge to edge; u, h : (n_edges, 3).
    """

    x: np.ndarray
    u: np.ndarray
    h: np.ndarray


def material_places(section: Section, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The material places X seen at `seen` = X + u(X), and the heights h(X) they have risen  # (n,) um each

    The negative half is the mirror image of the positive one.
    """
    target = np.abs(seen)
    moved = section.x + section.u  # (n_edges, 3)
    edge = np.clip(np.searchsorted(moved[:, 1], target), 0, len(moved) - 1)
    a, b, c = moved[edge].T
    xi = np.zeros(len(seen))
    for _ in range(NEWTON_STEPS):
        error = 0.5 * xi * (xi - 1) * a + 0.5 * xi * (xi + 1) * b + (1 - xi**2) * c - target
        xi -= error / ((xi - 0.5) * a + (xi + 0.5) * b - 2.0 * xi * c)
        if np.abs(error).max() < 1e-12:
            break
    shape = np.stack([0.5 * xi * (xi - 1), 0.5 * xi * (xi + 1), 1 - xi**2], axis=1)  # (n, 3)
    return np.sign(seen) * (shape * section.x[edge]).sum(axis=1), (shape * section.h[edge]).sum(axis=1)


def height_image(section: Section, pattern: Roughness, shape: tuple[int, int], pixel_um: float) -> np.ndarray:
    """One height image, centred on the axis of symmetry  # (ny, nx) float64 um"""
    column = (np.arange(shape[1]) - 0.5 * (shape[1] - 1)) * pixel_um
    row = (0.5 * (shape[0] - 1) - np.arange(shape[0])) * pixel_um
    place, rise = material_places(section, column)
    return pattern.heights(place, row) + rise
