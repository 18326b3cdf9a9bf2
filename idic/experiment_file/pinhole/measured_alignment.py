"""The mesh placed before calibrated cameras by what their reference images show: holes, edges, the surface itself.

A start from the rough pixels of the file, contours in the images, then least squares; where two cameras see the
surface, it is measured from the speckle and the mesh laid onto it, anew from every better place.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import COARSE_PX, Seen, nodal_normals, speckle_agreement
from idic.experiment_file.placing.contours import Contour, edge_contour, hole_contour
from idic.experiment_file.placing.observations import Evidence, Marked, Rim
from idic.experiment_file.placing.pose import Pose, fitted_pose, reselected
from idic.experiment_file.placing.surface_points import SurfacePoints, surface_points
from idic.errors import InputError
from idic.experiment_file.pinhole.alignment import Clicks
from idic.experiment_file.pinhole.alignment_start import starts
from idic.experiment_file.schema.cameras import AlignmentTable
from idic.fe import Mesh
from idic.images import PLACEMENT_STEM, PlacedCamera, RIGID
from idic.parameters import JointPrior

SEARCHES_PX = (40.0, 8.0, 4.0)  # how far the place may be off in the second image, one after the other
MIN_SUBSETS, MIN_MATCHED = 12, 0.3
MAX_RIM_PX = 1.0                # rms of a contour, whose points are chosen within 0.75
MAX_SURFACE_PX = 2.0            # rms of the surface, in px across it
NOTED_EPIPOLAR_PX = 0.3
MAX_RADIUS_ERROR = 0.2
AMBIGUOUS_COST, MIN_AMBIGUITY_DEG = 20.0, 2.0  # chi² of dependent points; between two poses
FLAT_DEG = 8.0                  # normals of the surface around a hole
N_KEPT = 8


@dataclass(frozen=True, eq=False)
class Eye:
    """One pinhole camera of the file; image : of the reference; surface : face set it sees, None of a plane."""

    key: str
    camera: PlacedCamera
    image: np.ndarray
    table: AlignmentTable | None
    surface: str | None


@dataclass(frozen=True, eq=False)
class Placed:
    """Rotation (3, 3) and translation (3,) mm from the mesh frame to that of the calibration, the prior of
    ``placement.*`` about the pivot of the cameras, None of one camera, and notes."""

    rotation: np.ndarray
    translation_mm: np.ndarray
    prior: JointPrior | None
    notes: tuple[str, ...]


_kept: dict[bytes, Placed] = {}  # a diagnosis opens one experiment some hundred times


def placed_by_images(mesh: Mesh, eyes: Sequence[Eye], file) -> Placed:
    """The place of the mesh.

    Raises
    ------
    InputError
        A hole or an edge is not found, the speckle of two cameras does not match, or a motion of the mesh stays open.
    """
    digest = hashlib.blake2b(repr([(eye.key, eye.camera.key, eye.table, eye.surface) for eye in eyes]).encode())
    for array in (mesh.nodes, *(eye.image for eye in eyes)):
        digest.update(np.ascontiguousarray(array).tobytes())
    key = digest.digest()
    if key not in _kept:
        while len(_kept) >= N_KEPT:
            _kept.pop(next(iter(_kept)))
        _kept[key] = _Alignment(mesh, eyes, file).placed()
    return _kept[key]


def as_points(coordinates) -> np.ndarray:
    """Points of the mesh frame, z = 0 where it is not given  # (n, 2|3) -> (n, 3) mm"""
    return np.array([[*point, 0.0][:3] for point in coordinates], dtype=float)


def _cost(pose: Pose) -> float:
    return pose.cost


class _Alignment:
    """Contours, start and fit of one rig."""

    def __init__(self, mesh: Mesh, eyes: Sequence[Eye], file):
        self.mesh, self.eyes, self.file = mesh, eyes, file
        self.key = f"{next(eye.key for eye in eyes if eye.table is not None)}.alignment"
        self.measured = len(eyes) > 1 and all(eye.table is None or eye.table.measured_surface is not False
                                              for eye in eyes)
        if not self.measured and any(eye.table is not None and eye.table.measured_surface for eye in eyes):
            raise InputError("a measured surface of one camera", file=file, key=f"{self.key}.measured_surface",
                             expected="two cameras with a lens", found="1", remedy="leave measured_surface out")
        self.rims: Sequence[Rim] = [rim for number, eye in enumerate(eyes) for rim in self._rims(number, eye)]
        self.marked = [Marked(number, as_points(eye.table.points_mm), np.array(eye.table.points_px))
                       for number, eye in enumerate(eyes) if eye.table is not None and eye.table.points_mm]

    def placed(self) -> Placed:
        cameras, surface, ambiguous = self._started(), None, 0.0
        try:
            if not self.measured:
                best = min((fitted_pose(start, Evidence(self.rims, self.marked)) for start in cameras), key=_cost)
                evidence = reselected(self._at(best), Evidence(self.rims, self.marked))
                self.rims = evidence.rims
                pose, ambiguous = self._best([fitted_pose(start, evidence) for start in [*cameras, self._at(best)]])
            else:
                estimate = max(cameras, key=self._agreement)
                for search in SEARCHES_PX:
                    surface = self._surface(estimate, search)
                    pose = fitted_pose(estimate, Evidence(self.rims, self.marked, surface))
                    estimate = self._at(pose)
                evidence = reselected(estimate, Evidence(self.rims, self.marked, surface))
                self.rims, pose = evidence.rims, fitted_pose(estimate, evidence)
        except InputError as error:
            raise self._with_place(error) from None
        self._check(pose)
        names = tuple(f"{PLACEMENT_STEM}.{name}" for name in RIGID)
        prior = JointPrior(names, np.zeros(6), pose.covariance) if self.measured else None
        return Placed(pose.rotation, pose.translation_mm, prior, tuple(self._notes(pose, surface, ambiguous)))

    # what the images show -------------------------------------------------------------------------
    def _rims(self, number: int, eye: Eye):
        if eye.table is None:
            return
        for k, hole in enumerate(eye.table.holes):
            key, centre = f"{eye.key}.alignment.holes[{k}]", as_points([hole.centre_mm])[0]
            normal = self._normal(centre[None], eye.surface, key, hole.radius_mm)
            yield Rim(key, number, self._contour(hole_contour, eye, hole.px, key), centre, normal, None, hole.radius_mm)
        for k, edge in enumerate(eye.table.edges):
            key, ends = f"{eye.key}.alignment.edges[{k}]", as_points(edge.points_mm)
            normal = self._normal(ends, eye.surface, key)
            along = ends[1] - ends[0]
            yield Rim(key, number, self._contour(edge_contour, eye, edge.points_px, key), ends[0], normal,
                      along / np.linalg.norm(along))

    def _contour(self, seek, eye: Eye, px, key: str) -> Contour:
        try:
            return seek(np.asarray(eye.image, dtype=float), np.array(px))
        except InputError as error:
            raise self._with_place(error, key) from None

    def _normal(self, points: np.ndarray, surface: str | None, key: str, radius: float | None = None) -> np.ndarray:
        """Unit normal of the surface of the mesh around points, which lie on it  # (n, 3) mm -> (3,)"""
        if self.mesh.n_dim == 2:
            return np.array([0.0, 0.0, 1.0])
        nodes = np.unique(np.concatenate([b.connectivity.ravel() for b in self.mesh.surface_cells(surface)]))
        at, normals = self.mesh.nodes[nodes], nodal_normals(self.mesh, surface)[nodes]
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        neighbours = np.zeros(len(nodes), dtype=bool)
        for point in points:
            distance = np.linalg.norm(at - point, axis=1)
            neighbours |= distance <= 1.3 * max(distance.min(), radius or 0.0) + 1e-9
        normal = normals[neighbours].mean(axis=0)
        normal /= max(float(np.linalg.norm(normal)), 1e-300)
        if (normals[neighbours] @ normal).min() < np.cos(np.radians(FLAT_DEG)):
            raise InputError("a hole or an edge on a curved surface", file=self.file, key=key,
                             expected="a flat surface around it", found="normals that differ by more than "
                             f"{FLAT_DEG:g}°", remedy="click points there (points_mm, points_px); the surface around "
                             "them may be measured (measured_surface = true)")
        off = float(np.abs((at[neighbours].mean(axis=0) - points) @ normal).max())
        if off > 1e-3 * float(np.ptp(at, axis=0).max()):
            raise InputError("a hole or an edge off the surface of the mesh", file=self.file, key=key,
                             expected=f"points on {surface}", found=f"{off:.3g} mm off it",
                             remedy="give the points of the mesh on the side that the camera sees")
        return normal

    # start ----------------------------------------------------------------------------------------
    def _started(self) -> list[list[PlacedCamera]]:
        """Places to start from, each of all cameras."""
        clicks = self._clicks()
        centre = np.mean([eye.camera.aimed.centre_mm for eye in self.eyes], axis=0)
        outward = np.array([0.0, 0.0, 1.0])
        if self.mesh.n_dim == 3:
            outward = nodal_normals(self.mesh, self.eyes[0].surface).sum(axis=0)
        return [[replace(eye.camera, rotation=turn, translation_mm=shift) for eye in self.eyes]
                for turn, shift in starts(clicks, centre, outward, self.measured, self.file, self.key)]

    def _clicks(self) -> list[Clicks]:
        """Middles of holes, ends of edges, clicked points, by camera."""
        clicks = []
        for number, eye in enumerate(self.eyes):
            rims = [rim for rim in self.rims if rim.camera == number and rim.along is None]
            edges = [] if eye.table is None else eye.table.edges
            marked = [m for m in self.marked if m.camera == number]
            points = [*(rim.point_mm[None] for rim in rims), *(as_points(e.points_mm) for e in edges),
                      *(m.points_mm for m in marked)]
            pixels = [*(rim.contour.middle[None] for rim in rims), *(np.array(e.points_px) for e in edges),
                      *(m.points_px for m in marked)]
            if points:
                clicks.append(Clicks(f"{eye.key}.alignment", eye.camera.aimed, np.concatenate(points),
                                     np.concatenate(pixels)))
        return clicks

    # surface --------------------------------------------------------------------------------------
    def _view(self, cameras: Sequence[PlacedCamera], number: int) -> Seen:
        return Seen(cameras[number], self.eyes[number].image, self.eyes[number].surface)

    def _agreement(self, cameras: Sequence[PlacedCamera]) -> float:
        correlation = speckle_agreement(self.mesh, self._view(cameras, 0), self._view(cameras, 1),
                                        COARSE_PX).correlation
        return -1.0 if np.isnan(correlation) else correlation

    def _surface(self, cameras: Sequence[PlacedCamera], search: float) -> SurfacePoints:
        """Measured points of the first camera with every other one."""
        pairs = [surface_points(self.mesh, self._view(cameras, 0), self._view(cameras, number), search)
                 for number in range(1, len(cameras))]
        rig, on_mesh, normals, mm_per_px, epipolar = (
            np.concatenate([getattr(pair, name) for pair in pairs])
            for name in ("rig_mm", "mesh_mm", "normals", "mm_per_px", "epipolar_px"))
        every = SurfacePoints(rig, on_mesh, normals, mm_per_px, epipolar, sum(pair.n_tried for pair in pairs))
        n = len(every.rig_mm)
        if n < MIN_SUBSETS or n < MIN_MATCHED * every.n_tried:
            raise InputError("the surface cannot be measured", expected="speckle that two cameras see alike, at the "
                             "place of the mesh", found=f"{n} of {every.n_tried} subsets match",
                             remedy="check that left and right belong to their calibration, centre_mm, points_mm and "
                                    "their pixels, and the light; or measured_surface = false with more points")
        return every

    def _at(self, pose: Pose) -> list[PlacedCamera]:
        """The cameras at a place of the mesh."""
        return [replace(eye.camera, rotation=pose.rotation, translation_mm=pose.translation_mm) for eye in self.eyes]

    def _best(self, poses: Sequence[Pose]) -> tuple[Pose, float]:
        """The pose that fits best, its covariance widened to one that fits nearly as well; the angle between, deg."""
        best = min(poses, key=_cost)
        pivot = self.eyes[0].camera.pivot_mm
        steps = [best.step_to(pose, pivot) for pose in poses if pose.cost < best.cost + AMBIGUOUS_COST]
        farthest = max(steps, key=lambda step: float(np.linalg.norm(step[:3])))
        angle = float(np.linalg.norm(farthest[:3]))
        if angle < MIN_AMBIGUITY_DEG:
            return best, 0.0
        return replace(best, covariance=best.covariance + np.outer(farthest, farthest)), angle

    # result ---------------------------------------------------------------------------------------
    def _check(self, pose: Pose) -> None:
        for rim, (rms, _, radius) in zip(self.rims, pose.rims, strict=True):
            if rms > MAX_RIM_PX:
                raise InputError("a contour does not fit the others", file=self.file, key=rim.name,
                                 expected=f"less than {MAX_RIM_PX:g} px (rms)", found=f"{rms:.1f} px",
                                 remedy="check centre_mm, points_mm, radius_mm, that the pixels are those of this "
                                        "hole or edge, and the calibration")
            if rim.radius_mm is not None and abs(radius - rim.radius_mm) > MAX_RADIUS_ERROR * rim.radius_mm:
                raise InputError("a hole of another radius", file=self.file, key=rim.name,
                                 expected=f"{rim.radius_mm:g} mm", found=f"{radius:.3g} mm",
                                 remedy="correct radius_mm, or the pixel in the hole")
        if pose.rms_surface_mm > MAX_SURFACE_PX * self._mm_per_px(pose):
            raise InputError("the measured surface is not that of the mesh", file=self.file, key=self.key,
                             expected=f"less than {MAX_SURFACE_PX * self._mm_per_px(pose):.2g} mm (rms)",
                             found=f"{pose.rms_surface_mm:.2g} mm",
                             remedy="check the mesh, its unit and its face set; or set measured_surface = false")

    def _mm_per_px(self, pose: Pose) -> float:
        return self._at(pose)[0].pixel_size

    def _notes(self, pose: Pose, surface: SurfacePoints | None, ambiguous: float):
        parts = []
        for rim, (rms, offset, radius) in zip(self.rims, pose.rims, strict=True):
            kind = f"hole of radius {radius:.4g} mm" if rim.along is None else f"edge, offset {offset:+.2f} px"
            parts.append(f"{rim.name.replace('.alignment', '')} {kind}, {len(rim.contour.px)} points, {rms:.2f} px")
        if self.marked:
            parts.append(f"{sum(len(m.points_mm) for m in self.marked)} clicked points, {pose.rms_click_px:.2f} px")
        yield f"alignment (rms): {'; '.join(parts)}"
        if surface is not None:
            epipolar = float(np.sqrt(np.mean(surface.epipolar_px**2)))
            yield (f"measured surface: {len(surface.rig_mm)} of {surface.n_tried} subsets, {pose.rms_surface_mm:.2g} "
                   f"mm (rms) from the mesh, {epipolar:.2f} px off the epipolar lines"
                   + (": the calibration or the pairing is off" if epipolar > NOTED_EPIPOLAR_PX else ""))
        if ambiguous:
            yield (f"a tilt that differs by {ambiguous:.0f}° fits as well, of one camera: identify placement.*, "
                   "or use a second camera")
        six = ", ".join(f"{name} {std:.2g} {'deg' if k < 3 else 'mm'}"
                        for k, (name, std) in enumerate(zip(RIGID, pose.std, strict=True)))
        yield f"standard deviations of the placement{'' if self.measured else ' (roughly)'}, about the middle: {six}"

    def _with_place(self, error: InputError, key: str | None = None) -> InputError:
        return InputError(error.what, file=self.file, key=key or error.key or self.key, expected=error.expected,
                          found=error.found, remedy=error.remedy)
