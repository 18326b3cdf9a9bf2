"""Residuals of a pose of the mesh: rims of holes, edges, clicked points, measured points of the surface.

    hole      |P - c - s / m| - r - d / m    P: where the ray of a pixel meets the plane of the rim; m: px per mm
    edge      (P - a) . e - (d + w t) / m    e: in the plane, across the edge; t: along it, -1 … 1
    point     projection - pixel
    surface   (x - X) . n - d g              x: measured point in the mesh frame; X and n of the mesh; g: mm per px

The offsets d, s and w are unknown, with the standard deviations of what no scatter shows: the grey value at half of a
step is not just where the material ends, light and wall differ around a hole, matches have a common error. The offset d
of a hole without a radius is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idic.experiment_file.placing.contours import Contour
from idic.experiment_file.placing.surface_points import SurfacePoints
from idic.errors import InputError
from idic.images import PlacedCamera, rotation_of

CLICK_STD_PX = 1.0
OFFSET_STD_PX = 0.25    # of a contour, outwards
SHIFT_STD_PX = 0.1      # of a rim of a hole, aside; of an edge, at its ends against each other
MATCH_STD_PX = 0.02     # common to all matches
PIECE_PX = 16.0         # of a contour: points closer than this share dots of the speckle
DIFFERENCE = 1e-4        # of the pose, px
FAR_PX = 1e4            # residual of a pose that puts the mesh behind a camera


@dataclass(frozen=True, eq=False)
class Rim:
    """A contour with what it is of the mesh.

    camera : number of the camera; point_mm (3,) centre of the hole, or first end of the edge; along (3,) unit vector of
    the edge, None of a hole; normal (3,) of the surface; radius_mm : of the hole, None where that is unknown
    """

    name: str
    camera: int
    contour: Contour
    point_mm: np.ndarray
    normal: np.ndarray
    along: np.ndarray | None = None
    radius_mm: float | None = None


@dataclass(frozen=True, eq=False)
class Marked:
    """Points of the mesh (n, 3) mm that were clicked at (n, 2) px in the image of a camera."""

    camera: int
    points_mm: np.ndarray
    points_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the images show; rims and points in them, the measured surface."""

    rims: Sequence[Rim]
    marked: Sequence[Marked]
    surface: SurfacePoints | None = None


class Observations:
    """What is seen, against a pose.

    Unknowns: six numbers in units of about a px, then the offsets d of all rims, two shifts of each (of an edge w, and
    0), the offset of the surface.
    """

    def __init__(self, cameras: Sequence[PlacedCamera], evidence: Evidence):
        self.cameras, self.evidence = cameras, evidence
        self.per_mm = np.array([1.0 / camera.pixel_size for camera in cameras])
        lenses = [camera.aimed for camera in cameras]
        self.centres = [lens.centre_mm for lens in lenses]
        self.rays = [lenses[rim.camera].rays(rim.contour.px)[1] for rim in evidence.rims]  # frame of the calibration
        points = np.concatenate([[rim.point_mm for rim in evidence.rims] or np.zeros((0, 3)),
                                 *(m.points_mm for m in evidence.marked),
                                 *([] if evidence.surface is None else [evidence.surface.mesh_mm])])
        size = max(float(np.linalg.norm(points - cameras[0].pivot_mm, axis=1).max(initial=0.0)), 1e-9)
        mm = 1.0 / self.per_mm.mean()
        self.unit = np.array([np.degrees(mm / size)] * 3 + [mm] * 3)
        n = len(evidence.rims)
        self.axes = [_axes(rim.normal, rim.along) for rim in evidence.rims]
        self.offset_std = np.array([np.inf if rim.along is None and rim.radius_mm is None else OFFSET_STD_PX
                                    for rim in evidence.rims] + [SHIFT_STD_PX] * (2 * n)
                                   + [MATCH_STD_PX] * (evidence.surface is not None))
        self.stations = [_station(rim.contour.px) for rim in evidence.rims]
        self.start = np.zeros(len(self.offset_std))
        self.start[:n] = [self._radius(rim) if rim.radius_mm is None and rim.along is None else 0.0
                          for rim in evidence.rims]
        self.std = {f"rim {k}": 0.3 for k in range(n)} | {"surface": 0.3 * mm}

    def _radius(self, rim: Rim) -> float:
        """px"""
        return float(np.linalg.norm(rim.contour.px - rim.contour.middle, axis=1).mean())

    def raw(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Residuals by group: rims in px, surface in mm, points in px."""
        groups, evidence, place = {}, self.evidence, self._place(z)
        for k, rim in enumerate(evidence.rims):
            groups[f"rim {k}"] = self._rim(k, rim, z, place)
        if evidence.surface is not None:
            surface = evidence.surface
            gap = ((self._back(surface.rig_mm, place) - surface.mesh_mm) * surface.normals).sum(axis=1)
            groups["surface"] = gap - z[-1] * surface.mm_per_px
        for k, marked in enumerate(evidence.marked):
            camera = replace(self.cameras[marked.camera], placement=z[:6] * self.unit)
            try:
                groups[f"points {k}"] = (camera.project(marked.points_mm) - marked.points_px).ravel()
            except InputError:  # behind the camera
                groups[f"points {k}"] = np.full(marked.points_px.size, FAR_PX)
        return groups

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Over standard deviations: `raw`, then the offsets."""
        return np.concatenate([*(group / self.std.get(name, CLICK_STD_PX) for name, group in self.raw(z).items()),
                               z[6:] / self.offset_std])

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """d residuals / d unknowns: of the pose by differences  # (n, n_unknowns)"""
        pose = scipy.optimize.approx_fprime(z[:6], lambda six: self.residuals(np.append(six, z[6:])), DIFFERENCE)
        columns = np.zeros((len(pose), len(z)))
        columns[:, :6] = pose
        n, row, place = len(self.evidence.rims), 0, self._place(z)
        for k, rim in enumerate(self.evidence.rims):
            rows = slice(row, row := row + len(rim.contour.px))
            columns[rows, 6 + k] = -1.0 / self.std[f"rim {k}"]
            i = 6 + n + 2 * k
            if rim.along is not None:
                columns[rows, i] = -self.stations[k] / self.std[f"rim {k}"]
            else:
                flat = self._away(k, rim, place)[0] @ self.axes[k] - z[i:i + 2] / self.per_mm[rim.camera]
                columns[rows, i:i + 2] = -flat / np.linalg.norm(flat, axis=1, keepdims=True) / self.std[f"rim {k}"]
        if self.evidence.surface is not None:
            mm_per_px = self.evidence.surface.mm_per_px
            columns[row:row + len(mm_per_px), -1] = -mm_per_px / self.std["surface"]
        offsets = np.arange(len(z) - 6)
        columns[len(pose) - len(offsets) + offsets, 6 + offsets] = 1.0 / self.offset_std
        return columns

    def _place(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From the frame of the calibration to that of the mesh: X = Y A + b  # (3, 3), (3,)"""
        camera, six = self.cameras[0], z[:6] * self.unit
        turn = rotation_of(six[:3])
        shift = camera.translation_mm @ camera.rotation + camera.pivot_mm + six[3:]
        return camera.rotation @ turn, camera.pivot_mm - shift @ turn

    def _back(self, points: np.ndarray, place: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return points @ place[0] + place[1]

    def _away(self, k: int, rim: Rim, place: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """From the centre of the hole, or the end of the edge, to where the rays meet the plane of the rim (n, 3) mm,
        and whether that is in front of the camera."""
        centre, ray = self._back(self.centres[rim.camera], place), self.rays[k] @ place[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            length = ((rim.point_mm - centre) @ rim.normal) / (ray @ rim.normal)
        return centre + length[:, None] * ray - rim.point_mm, length > 0.0

    def _rim(self, k: int, rim: Rim, z: np.ndarray, place: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        away, in_front = self._away(k, rim, place)
        i = 6 + len(self.evidence.rims) + 2 * k
        if rim.along is None:
            flat = away @ self.axes[k] - z[i:i + 2] / self.per_mm[rim.camera]
            distance = np.sqrt((flat**2).sum(axis=1)) - (rim.radius_mm or 0.0)
        else:
            distance = away @ self.axes[k][:, 1] - z[i] * self.stations[k] / self.per_mm[rim.camera]
        residual = distance * self.per_mm[rim.camera] - z[6 + k]
        return np.where(np.isfinite(residual) & in_front, residual, FAR_PX)

    def flat(self, k: int) -> np.ndarray:
        """Points of a contour in the plane of the rim, at the start  # (n, 2) mm"""
        return self._away(k, self.evidence.rims[k], self._place(np.zeros(6)))[0] @ self.axes[k]

    def without_shifts(self, z: np.ndarray) -> np.ndarray:
        """The unknowns with holes and edges where the mesh has them; holes keep their radius."""
        n, bare = len(self.evidence.rims), z.copy()
        bare[6 + n:6 + 3 * n] = 0.0
        bare[[6 + k for k, rim in enumerate(self.evidence.rims) if rim.along is not None]] = 0.0
        return bare

    def pieces(self, z: np.ndarray) -> np.ndarray:
        """Number of the piece of every residual; -1: known standard deviation  # (n,)"""
        numbers, evidence = [], self.evidence
        for k, rim in enumerate(evidence.rims):
            away, _ = self._away(k, rim, self._place(z))
            if rim.along is None:
                x, y = (away @ self.axes[k]).T
                length = np.arctan2(y, x) * np.hypot(x, y).mean()
            else:
                length = away @ rim.along
            first = next(j for j in range(k + 1) if _same(evidence.rims[j], rim))
            numbers.append(first + 1e-6 * np.round(length * self.per_mm[0] / PIECE_PX))
        if evidence.surface is not None:
            numbers.append(-1.0 - np.arange(len(evidence.surface.rig_mm)))
        n_fixed = sum(m.points_px.size for m in evidence.marked) + len(self.offset_std)
        pieces = np.unique(np.concatenate(numbers), return_inverse=True)[1] if numbers else np.zeros(0)
        return np.concatenate([pieces, np.full(n_fixed, -1)]).astype(int)


def _axes(normal: np.ndarray, along: np.ndarray | None) -> np.ndarray:
    """Two axes of a plane, the first one along an edge  # (3, 2), in columns"""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]) if along is None else along
    first = first / np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first)])


def _station(px: np.ndarray) -> np.ndarray:
    """Place along a contour, -1 … 1, of an edge  # (n, 2) px -> (n,)"""
    away = px - px.mean(axis=0)
    along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
    return along / max(float(np.abs(along).max()), 1e-9)


def _same(first: Rim, second: Rim) -> bool:
    """Whether two contours, of two cameras, are one of the mesh."""
    return (first.along is None) == (second.along is None) and bool(np.allclose(first.point_mm, second.point_mm))
