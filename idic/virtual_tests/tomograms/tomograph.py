"""Virtual scans of a deformed body: the grey value of its material in every voxel, plane by plane.

A voxel is the mean of the material at points inside it. The pose of the specimen and the magnification of a scan belong
to the scan; noise, rings and drift of the grey values come after.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from idic.fe import Mesh
from idic.virtual_tests.tomograms.material_points import Lattice, material_points
from idic.virtual_tests.tomograms.reconstruction import GreyDrift, IndependentNoise, ReconstructionNoise, Rings

MAX_SLAB_BYTES = 64 * 2**20  # of the material points that are held at a time
DEPTHS = {8: np.uint8, 12: np.uint16, 16: np.uint16}


@dataclass(frozen=True)
class Pose:
    """Where a scan sees the specimen: W(x) = c + (1 + magnification) R(turn) (x - c) + shift, about its middle c.

    turn_deg : (3,) rotation vector; shift_mm : (3,); mesh axes
    """

    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    magnification: float = 0.0

    def placed(self, points: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """W of points  # (n, 3) mm -> (n, 3) mm"""
        turn = np.radians(self.turn_deg)
        angle = float(np.linalg.norm(turn))
        arms = points - middle
        if angle > 0.0:  # Rodrigues
            axis = turn / angle
            along = np.outer(arms @ axis, axis)
            arms = along + np.cos(angle) * (arms - along) + np.sin(angle) * np.cross(axis, arms)
        return middle + (1.0 + self.magnification) * arms + np.asarray(self.shift_mm)


@dataclass(frozen=True, eq=False)
class Tomograph:
    """A scanner whose columns, rows and planes run along x, y and z.

    shape : (nz, ny, nx); voxel_mm : (3,) along x, y, z; origin_px : column, row and plane of the mesh origin;
    supersampling : points per voxel and direction; bits : 8, 12 or 16; air_gv : beside the specimen
    """

    shape: tuple[int, int, int]
    voxel_mm: np.ndarray
    origin_px: np.ndarray
    supersampling: int = 2
    bits: int = 8
    air_gv: float = 25.0
    noise: ReconstructionNoise | IndependentNoise = field(default_factory=lambda: ReconstructionNoise(0.0))
    rings: Rings | None = None

    @property
    def dtype(self) -> np.dtype:
        """Of the stored grey values."""
        return np.dtype(DEPTHS[self.bits])

    def clean(self, mesh: Mesh, u: np.ndarray, texture: Callable[[np.ndarray], np.ndarray], pose: Pose | None = None
              ) -> Iterator[np.ndarray]:
        """The planes of a scan without noise  # u (n_nodes, 3) mm -> (ny, nx) grey values

        texture : grey value of material points (n, 3) mm
        """
        middle = 0.5 * (mesh.nodes.min(axis=0) + mesh.nodes.max(axis=0))
        nodes = mesh.nodes + u
        moved = (nodes if pose is None else pose.placed(nodes, middle)) - mesh.nodes
        nz, ny, nx = self.shape
        n = self.supersampling
        step = np.asarray(self.voxel_mm, float) / n
        first = -np.asarray(self.voxel_mm) * self.origin_px - (n - 1) / 2 * step
        at_a_time = max(1, MAX_SLAB_BYTES // (24 * ny * nx * n**3))
        for k in range(0, nz, at_a_time):
            planes = min(at_a_time, nz - k)
            lattice = Lattice(first + [0.0, 0.0, k * n * step[2]], step, (planes * n, ny * n, nx * n))
            points = material_points(mesh, moved, lattice)
            values = np.full(points.shape[:3], float(self.air_gv))
            is_inside = ~np.isnan(points[..., 0])
            values[is_inside] = texture(points[is_inside])
            yield from values.reshape(planes, n, ny, n, nx, n).mean(axis=(1, 3, 5))

    def scan(self, mesh: Mesh, u: np.ndarray, texture: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator,
             pose: Pose | None = None, drift: GreyDrift | None = None) -> Iterator[np.ndarray]:
        """The planes of a scan as it is stored  # (ny, nx) uint8 | uint16"""
        _, ny, nx = self.shape
        noise = self.noise.planes(rng, self.shape)
        for k, (plane, added) in enumerate(zip(self.clean(mesh, u, texture, pose), noise, strict=True)):
            values = (drift or GreyDrift()).applied(plane) + added
            if self.rings is not None:
                values += self.rings.plane(k, ny, nx)
            yield np.clip(np.rint(values), 0, 2**self.bits - 1).astype(self.dtype)
