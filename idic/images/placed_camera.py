"""A pinhole camera and the mesh that it sees: lens, place of the mesh in the frame of the calibration, rigid motion.

    X1 = W(X; placement)                 mesh axes, `idic.images.rigid_motion`; degrees of freedom ``placement.t_z`` ...
    X2 = W(X1; motion of the frame)      degrees of freedom ``placement.t_z_drift`` ...
    Z  = R0 X2 + d0                      where the mesh was put, by the user or by an alignment
    Y  = R Z + t                         pose of the calibration; degrees of freedom ``camera.rotation_x`` ... ``t_z``
    pixel = lens(R1 Y)                   R1: ``camera.turn_x`` ..., about the camera's own centre; ``camera.fx`` ...

The lens keeps the pose of the calibration file, so that its deviations are priors of its degrees of freedom. Rotation
with the translation held turns the camera about the origin of the rig, and moves it along; a camera that was disturbed
after the calibration turns about its own centre. Placement and motion are common to all cameras of a rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from idic.errors import InputError
from idic.images.lens_camera import LensCamera, POSE_PARAMETERS, left_jacobian, rotation_of
from idic.images.rigid_motion import RIGID, RigidMotion, displaced, rigid_slope

PLACEMENT_STEM = "placement"
PLACED_TURNS = ("turn_x", "turn_y", "turn_z")  # deg


@dataclass(frozen=True, eq=False)
class PlacedCamera:
    """Projection of mesh points (mm) through a lens.

    Attributes
    ----------
    lens : LensCamera
        In the frame of the calibration.
    rotation, translation_mm : arrays (3, 3), (3,)
        R0 and d0, from the mesh frame to that of the calibration.
    placement : array (6,)
        Rotation vector (deg) and translation (mm) of the degrees of freedom of the placement.
    pivot_mm : array (3,)
        Point of the mesh frame about which placement and motion turn.
    turn_deg : array (3,)
        Rotation vector, in the camera's frame, by which the camera was turned about its own centre.
    motion : RigidMotion, optional
        Of the specimen; `at` gives the camera of a frame.
    frame : int, optional
        That this is the camera of; None: the reference.
    """

    lens: LensCamera
    rotation: np.ndarray = field(default_factory=partial(np.eye, 3))
    translation_mm: np.ndarray = field(default_factory=partial(np.zeros, 3))
    placement: np.ndarray = field(default_factory=partial(np.zeros, 6))
    pivot_mm: np.ndarray = field(default_factory=partial(np.zeros, 3))
    motion: RigidMotion | None = None
    frame: int | None = None
    turn_deg: np.ndarray = field(default_factory=partial(np.zeros, 3))

    def __post_init__(self):
        for name in ("rotation", "translation_mm", "placement", "pivot_mm", "turn_deg"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def at(self, frame: int) -> PlacedCamera:
        """The camera of a frame; itself where nothing moves."""
        return self if self.motion is None else replace(self, frame=frame)

    @property
    def moved(self) -> np.ndarray:
        """Rotation vector (deg) and translation (mm) of the motion of this frame  # (6,)"""
        return np.zeros(6) if self.motion is None or self.frame is None else self.motion.at(self.frame)

    @property
    def aimed(self) -> LensCamera:
        """The lens in the frame of the calibration, turned about its own centre."""
        if not self.turn_deg.any():
            return self.lens
        turn = rotation_of(self.turn_deg)
        return self.lens.placed(turn @ self.lens.rotation, turn @ self.lens.translation_mm)

    @property
    def effective(self) -> LensCamera:
        """The equivalent camera in the mesh frame."""
        place, move = self.placement, self.moved
        turn = rotation_of(move[:3])
        rotation = turn @ rotation_of(place[:3])
        shift = self.pivot_mm - rotation @ self.pivot_mm + turn @ place[3:] + move[3:]
        rotation, shift = self.rotation @ rotation, self.rotation @ shift + self.translation_mm
        lens = self.aimed
        return lens.placed(lens.rotation @ rotation, lens.rotation @ shift + lens.translation_mm)

    # points ---------------------------------------------------------------------------------------
    def project(self, points: np.ndarray) -> np.ndarray:
        """(column, row) of mesh points  # (n, 2|3) mm -> (n, 2) px"""
        return self.effective.project(points)

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """d (column, row) / d (x, y, z)  # (n, 2|3) mm -> (n, 2, 3) px/mm"""
        return self.effective.jacobian(points)

    def inverse(self, pixels: np.ndarray) -> np.ndarray:
        """x, y where the rays of pixels meet the plane z = 0 of the mesh  # (n, 2) px -> (n, 2) mm"""
        return self.effective.inverse(pixels)

    @property
    def key(self) -> tuple:
        """What decides which points of the mesh the pixels of the reference frame show; hashable."""
        lens = self.aimed
        return (lens.intrinsic.tobytes(), lens.rotation.tobytes(), lens.translation_mm.tobytes(),
                self.rotation.tobytes(), self.translation_mm.tobytes(), self.placement.tobytes(),
                self.pivot_mm.tobytes())

    @property
    def pixel_size(self) -> float:
        """mm per px at the middle of the mesh, across the line of sight."""
        depth = float((self.effective.rotation @ self.pivot_mm + self.effective.translation_mm)[2])
        return abs(depth) / float(np.sqrt(self.lens.fx * self.lens.fy))

    @property
    def side(self) -> int:
        """+1 or -1: the side of the plane z = 0 of the mesh that it is on."""
        return 1 if self.effective.centre_mm[2] > 0.0 else -1

    # degrees of freedom ---------------------------------------------------------------------------
    def values(self) -> dict[str, float]:
        """The present values of lens and turn (by name) and placement (``placement.t_z``)."""
        placed = zip(RIGID, self.placement.tolist(), strict=True)
        turned = dict(zip(PLACED_TURNS, self.turn_deg.tolist(), strict=True))
        return self.lens.values() | turned | {f"{PLACEMENT_STEM}.{name}": value for name, value in placed}

    def with_parameters(self, values: Mapping[str, float]) -> PlacedCamera:
        """The camera with these of `values` set, and amplitudes of its motion (``placement.t_z_drift``)."""
        stem = f"{PLACEMENT_STEM}."
        placed = {name.removeprefix(stem): float(value) for name, value in values.items() if name.startswith(stem)}
        turn = np.array([values.get(name, angle) for name, angle in zip(PLACED_TURNS, self.turn_deg, strict=True)],
        dtype=float)
        lens = {name: value for name, value in values.items() if not name.startswith(stem) and name not in PLACED_TURNS}
        motion = self.motion
        if motion is not None:
            motion = motion.with_values(placed)
        unknown = set(placed) - set(RIGID) - set(() if motion is None else motion.names)
        if unknown:
            raise InputError("no such placement parameter", key=", ".join(sorted(unknown)), expected=", ".join(RIGID),
                             remedy="use one of these names")
        placement = np.array([placed.get(name, offset) for name, offset in zip(RIGID, self.placement, strict=True)])
        return replace(self, lens=self.lens.with_parameters(lens) if lens else self.lens, placement=placement,
                       motion=motion, turn_deg=turn)

    def parameter_jacobian(self, points: np.ndarray, name: str) -> np.ndarray:
        """d (column, row) of fixed mesh points by a degree of freedom  # (n, 2|3) mm -> (n, 2) px per unit"""
        points = _space(points)
        if name in (*self.lens.parameters, *PLACED_TURNS):
            return self._lens_slope(self._in_rig(points), name)
        motion_name = name.removeprefix(f"{PLACEMENT_STEM}.")
        placed = displaced(points, self.placement, self.pivot_mm)
        if motion_name in RIGID:
            slope = rigid_slope(points, self.placement, self.pivot_mm, RIGID.index(motion_name))
            slope = slope @ rotation_of(self.moved[:3]).T
        elif self.motion is not None and motion_name in self.motion.names:
            if self.frame is None:
                return np.zeros((len(points), 2))
            k, course = self.motion.course(motion_name, self.frame)
            slope = course * rigid_slope(placed, self.moved, self.pivot_mm, k)
        else:
            raise InputError("no such camera parameter", key=name,
                             expected=", ".join([*self.lens.parameters, *PLACED_TURNS, *RIGID]),
                             remedy="use one of these names")
        return np.einsum("nij,nj->ni", self.aimed.jacobian(self._in_rig(points)), slope @ self.rotation.T)

    def _lens_slope(self, points: np.ndarray, name: str) -> np.ndarray:
        """d (column, row) by a value of lens, pose or turn  # points (n, 3) mm of the rig -> (n, 2)"""
        lens = self.lens
        if name in lens.intrinsics or not (self.turn_deg.any() or name in PLACED_TURNS):
            return self.aimed.parameter_jacobian(points, name)
        turn, rotated = rotation_of(self.turn_deg), points @ lens.rotation.T
        if name in PLACED_TURNS:
            axis = np.radians(1.0) * left_jacobian(self.turn_deg)[:, PLACED_TURNS.index(name)]
            slope = np.cross(axis, (rotated + lens.translation_mm) @ turn.T)
        elif (k := POSE_PARAMETERS.index(name)) < 3:
            slope = np.cross(np.radians(1.0) * left_jacobian(lens.turned_deg)[:, k], rotated) @ turn.T
        else:
            slope = np.broadcast_to(turn[:, k - 3], rotated.shape)
        unplaced = lens.placed(np.eye(3), np.zeros(3))
        return np.einsum("nij,nj->ni", unplaced.jacobian((rotated + lens.translation_mm) @ turn.T), slope)

    def is_motion(self, name: str) -> bool:
        """Whether a degree of freedom is an amplitude of the motion: it leaves the reference frame as it is."""
        return self.motion is not None and name.removeprefix(f"{PLACEMENT_STEM}.") in self.motion.names

    def depths(self, points: np.ndarray) -> np.ndarray:
        """Distance along the optical axis  # (n, 2|3) mm -> (n,) mm"""
        camera = self.effective
        return _space(points) @ camera.rotation[2] + camera.translation_mm[2]

    def _in_rig(self, points):
        placed = displaced(points, self.placement, self.pivot_mm)
        return displaced(placed, self.moved, self.pivot_mm) @ self.rotation.T + self.translation_mm


def _space(points):
    points = np.asarray(points, dtype=float)
    return points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])
