"""A pair of virtual cameras at an angle, and the calibration file that says what the user believes of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from idic.images import PinholeCamera, rotation_of


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras in the mesh frame.

    cameras : (n,) PinholeCamera; shape : (ny, nx) px of the images
    """

    cameras: tuple[PinholeCamera, ...]
    shape: tuple[int, int]

    FROM_ABOVE: ClassVar[np.ndarray] = np.diag([1.0, -1.0, -1.0])  # a camera on +z: x to the right, y up

    @classmethod
    def around(cls, shape: tuple[int, int], pixel_mm: float, distance_mm: float, angles_deg: Sequence[float],
               k1: float = -0.15) -> Rig:
        """Cameras that look at the mesh origin from the side of +z, turned about the mesh's y axis."""
        ny, nx = shape
        focal = distance_mm / pixel_mm
        cameras = []
        for number, angle in enumerate(angles_deg):
            lens = {"fx": focal * (1.0 + 0.004 * number), "fy": focal * (1.001 + 0.004 * number),
                    "cx": 0.5 * (nx - 1) + 3.3, "cy": 0.5 * (ny - 1) - 2.1, "k1": k1, "p1": 3e-4}
            rotation = (rotation_of([0.4 * number - 0.2, 0.0, 0.3]) @ cls.FROM_ABOVE
                        @ rotation_of([0.0, -angle, 0.0]))
            cameras.append(PinholeCamera(**lens, rotation=rotation, translation_mm=[0.2, -0.1, distance_mm]))
        return cls(tuple(cameras), shape)

    def write_calibration(self, path: Path, deviations: Mapping[str, float] | None = None) -> None:
        """The rig as OpenCV's stereo calibration in JSON, relative to camera 0.

        deviations : standard deviations by name (``"0.fx"``, ``"1.rotation_y"``): the covariance of the file
        """
        entries: dict = {"image_size": [self.shape[1], self.shape[0]]}
        for number, camera in enumerate(self.cameras, 1):
            entries[f"K{number}"] = camera.matrix.tolist()
            entries[f"D{number}"] = [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3]
        if len(self.cameras) > 1:
            first, second = self.cameras[:2]
            turn = second.rotation @ first.rotation.T
            entries |= {"R": turn.tolist(), "T": (second.translation_mm - turn @ first.translation_mm).tolist()}
        if deviations:
            entries["covariance"] = {"names": list(deviations),
                                     "matrix": np.diag(np.square([*deviations.values()])).tolist()}
        path.write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")
