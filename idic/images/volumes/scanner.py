"""The scanner: from a point of the mesh to (column, row, slice) in a volume, and its drift from scan to scan.

    W(X) = c + (1 + m) R(phi) (X - c) + s          rigid motion and magnification of a scan, mesh axes
    p    = origin + matrix W(X)                    voxels; centres are at integers

phi (deg), s (mm) and m are sums of unknown amplitudes times known courses, zero at the reference scan. c is the middle
of the mesh.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from idic.errors import InputError
from idic.images.rigid_motion import RigidMotion, displaced, rigid_slope

SCANNER = "scanner"  # first word of its degrees of freedom
MAGNIFIED = "magnification"
VOXEL_AXES = {sign + name: value * np.eye(3)[k] for k, name in enumerate(("col", "row", "slice"))
              for sign, value in (("+", 1.0), ("-", -1.0))}


class ScannerMotion(RigidMotion):
    """Amplitudes and courses of rigid motion and magnification."""

    units = {**RigidMotion.units, MAGNIFIED: ""}


@dataclass(frozen=True, eq=False)
class Scanner:
    """Projection of mesh points (mm) into a volume (voxels).

    Attributes
    ----------
    matrix : array (3, 3), voxels per mm
    origin_px : array (3,)
        (column, row, slice) of the mesh origin.
    pivot_mm : array (3,)
        Point about which a scan turns and grows.
    motion : ScannerMotion, optional
        `at` gives the scanner of a scan.
    frame : int, optional
        That this is the scanner of; None: the reference.
    """

    matrix: np.ndarray
    origin_px: np.ndarray
    pivot_mm: np.ndarray = field(default_factory=partial(np.zeros, 3))
    motion: ScannerMotion | None = None
    frame: int | None = None
    is_affine = True

    @classmethod
    def from_table(cls, voxel_mm, origin_px, axes) -> Scanner:
        """Of voxel sides (mm) along column, row, slice, the place of the mesh origin, and the image axes of x, y, z.

        Raises
        ------
        InputError
            Axes that are not three different directions.
        """
        if len({axis[1:] for axis in axes}) != 3:
            raise InputError("two mesh axes along one axis of the volume", key="scanner.axes",
                             expected='one along the columns, one along the rows, one along the slices',
                             found=str(list(axes)), remedy='correct them, e.g. ["+col", "+row", "+slice"]')
        directions = np.column_stack([VOXEL_AXES[axis] for axis in axes])
        return cls(directions / np.asarray(voxel_mm, float)[:, None], np.asarray(origin_px, float))

    def at(self, frame: int) -> Scanner:
        """The scanner of a scan; itself where it does not drift."""
        return self if self.motion is None else replace(self, frame=frame)

    @property
    def _moved(self) -> np.ndarray:
        """Rigid motion and magnification of this scan  # (7,)"""
        return np.zeros(7) if self.motion is None or self.frame is None else self.motion.at(self.frame)

    def _linear(self) -> np.ndarray:
        """d W / d X  # (3, 3)"""
        seven = self._moved
        return (1.0 + seven[6]) * (displaced(np.eye(3), seven[:6], np.zeros(3)) - seven[3:6]).T

    def project(self, points: np.ndarray) -> np.ndarray:
        """(column, row, slice) of mesh points  # (n, 3) mm -> (n, 3) voxels"""
        seven = self._moved
        placed = self.pivot_mm + (points - self.pivot_mm) @ self._linear().T + seven[3:6]
        return self.origin_px + placed @ self.matrix.T

    def inverse(self, voxels: np.ndarray) -> np.ndarray:
        """Mesh points at places of the reference scan  # (n, 3) voxels -> (n, 3) mm"""
        return np.linalg.solve(self.matrix, (np.asarray(voxels, float) - self.origin_px).T).T

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """d (column, row, slice) / d (x, y, z)  # (n, 3) mm -> (n, 3, 3) voxels/mm"""
        return np.tile(self.matrix @ self._linear(), (len(points), 1, 1))

    def motion_slope(self, points: np.ndarray, name: str) -> np.ndarray:
        """d (column, row, slice) of mesh points by an amplitude of the drift  # (n, 3) mm -> (n, 3) voxels per unit"""
        assert self.motion is not None and self.frame is not None  # of a scan
        number, course = self.motion.course(name, self.frame)
        seven, centred = self._moved, points - self.pivot_mm
        if number == 6:
            moved = centred @ self._linear().T / (1.0 + seven[6])
        else:
            moved = rigid_slope(centred, seven[:6], np.zeros(3), number) * (1.0 + seven[6] if number < 3 else 1.0)
        return course * moved @ self.matrix.T

    @property
    def pixel_size(self) -> float:
        """mm per voxel: the side of the cube that has the size of one voxel."""
        return float(abs(np.linalg.det(self.matrix)) ** (-1.0 / 3.0))

    @property
    def voxel_mm(self) -> np.ndarray:
        """Sides of a voxel along column, row and slice  # (3,) mm"""
        return 1.0 / np.abs(self.matrix).max(axis=1)

    def values(self) -> Mapping[str, float]:
        """What decides where the voxels of the reference lie in the mesh, by name."""
        return {f"matrix{k}": float(value) for k, value in enumerate((*self.matrix.ravel(), *self.origin_px))}

    @property
    def key(self) -> tuple:
        """The same; hashable."""
        return self.matrix.tobytes(), self.origin_px.tobytes()
