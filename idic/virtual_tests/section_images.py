"""Height images of a cross-section seen from above without any interpolation error.

    g(X + u(X), y) = f(X, y) + h(X)

The roughness f is a sum of Fourier modes, so it has a value anywhere. For every image column the material point X that
has moved there is found on the deformed edge itself (Newton on its isoparametric map); as the motion depends on X only,
a frame is then one product (rows x modes)(modes x columns). Nothing of `idic.correlation` or `idic.images` is used.
Lengths and heights have the same unit (um in the examples).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh

NEWTON_STEPS = 30


@dataclass(frozen=True)
class Roughness:
    """f(X, y) = sum_m amplitude cos(k_m . (X, y) + phase_m), wave : (m, 2), phase : (m,).
    """

    wave: np.ndarray
    amplitude: float
    phase: np.ndarray

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """f on the grid of rows y and places x  # x (n,), y (m,) -> (m, n)"""
        along = np.multiply.outer(self.wave[:, 0], x) + self.phase[:, None]  # (modes, n)
        across = np.multiply.outer(y, self.wave[:, 1])  # (m, modes)
        rows = np.concatenate([np.cos(across), -np.sin(across)], axis=1)
        return self.amplitude * (rows @ np.concatenate([np.cos(along), np.sin(along)]))


def roughness(rng: np.random.Generator, rms: float, length: float, modes: int = 300) -> Roughness:
    """Random roughness with the autocorrelation exp(-(r / length)^2)."""
    wave = rng.normal(0.0, np.sqrt(2.0) / length, (modes, 2))
    return Roughness(wave, rms * np.sqrt(2.0 / modes), rng.uniform(0.0, 2.0 * np.pi, modes))


@dataclass(frozen=True)
class Section:
    """The seen edges of a section: places x and displacements u along it and h upwards of their three nodes.

    x, u, h : (n_edges, 3) end, end, middle, with x increasing from edge to edge.
    mirrored : the edges are the half x >= 0, the other half is its mirror image.
    """

    x: np.ndarray
    u: np.ndarray
    h: np.ndarray
    mirrored: bool = True


def seen_section(mesh: Mesh, surface: str, u: np.ndarray, scale: float, rise: float, mirrored: bool) -> Section:
    """The edges of a set under a displacement u (n_nodes, 2) mm.

    scale : lengths of the section per mm; rise : heights per mm of u_y, negative where the camera looks from below.
    """
    conn = np.array([mesh.face_nodes(face) for face in mesh.edge_sets[surface]])
    if conn.shape[1] == 2:
        raise InputError("height images of a section need quadratic elements", key="options.element_order",
                         expected="quad8 or tri6 cells", found="edges of two nodes",
                         remedy='element_order = "quadratic"')
    conn = conn[mesh.nodes[conn[:, 0], 0] != mesh.nodes[conn[:, 1], 0]]  # upright ones are not seen
    backwards = mesh.nodes[conn[:, 0], 0] > mesh.nodes[conn[:, 1], 0]
    conn[backwards] = conn[backwards][:, [1, 0, 2]]
    conn = conn[np.argsort(mesh.nodes[conn[:, 2], 0])]
    return Section(scale * mesh.nodes[conn, 0], scale * u[conn, 0], rise * u[conn, 1], mirrored)


def material_places(section: Section, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The material places X seen at `places` = X + u(X), and the heights h(X) they have risen, NaN beside the section

    # (n,) each
    """
    target = np.abs(places) if section.mirrored else np.asarray(places, float)
    moved = section.x + section.u  # (n_edges, 3)
    edge = np.clip(np.searchsorted(moved[:, 1], target), 0, len(moved) - 1)
    a, b, c = moved[edge].T
    xi = np.zeros(len(places))
    for _ in range(NEWTON_STEPS):
        error = 0.5 * xi * (xi - 1) * a + 0.5 * xi * (xi + 1) * b + (1 - xi**2) * c - target
        xi -= error / ((xi - 0.5) * a + (xi + 0.5) * b - 2.0 * xi * c)
        if np.abs(error).max() < 1e-14 * np.abs(moved).max():
            break
    shape = np.stack([0.5 * xi * (xi - 1), 0.5 * xi * (xi + 1), 1 - xi**2], axis=1)  # (n, 3)
    place, rise = ((shape * field[edge]).sum(axis=1) for field in (section.x, section.h))
    if section.mirrored:
        outside = target > moved[-1, 1]
        place = np.where(places < 0, -place, place)
    else:
        outside = (target > moved[-1, 1]) | (target < moved[0, 0])
    return np.where(outside, np.nan, place), np.where(outside, np.nan, rise)


def height_image(section: Section, pattern: Roughness, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """One height image  # column (nx,): where along the section; row (ny,): where across -> (ny, nx) float64"""
    place, rise = material_places(section, column)
    return pattern.heights(place, row) + rise


@dataclass(frozen=True, eq=False)
class SectionImages:
    """The height images of a moving section, rendered when asked for: a stack.

    mesh, surface : the section (the half x >= 0 of it); u : (n_frames, n_nodes, 2) mm; column (nx,), row (ny,) : places
    of the pixels along and across the section; scale : their unit per mm, and that of the heights.
    """

    mesh: Mesh
    surface: str
    u: np.ndarray
    pattern: Roughness
    column: np.ndarray
    row: np.ndarray
    scale: float

    @property
    def n_frames(self) -> int:
        return len(self.u)

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.row), len(self.column)

    def heights(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float64"""
        section = seen_section(self.mesh, self.surface, self.u[k], self.scale, self.scale, True)
        return height_image(section, self.pattern, self.column, self.row)

    def frame(self, k: int) -> np.ndarray:
        """Frame `k` as an instrument stores it  # (ny, nx) float32"""
        return self.heights(k).astype(np.float32)
