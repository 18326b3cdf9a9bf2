"""The practical margin: motion that nothing is called a mismatch below, and that no law may be blamed for.

Two parts bound it. Interpolation and discretisation leave a motion in every sound recording; still frames do not show
them, as nothing moves there, and their size is an assumption. The camera's own floor is measured where the recording
has still frames (`idic.measure.dic.camera_floor`), by region. The larger of the two counts, with half as much again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.measure import CameraFloor

PRACTICAL_MARGIN_PX = 0.004  # rms: half as much again as interpolation and discretisation left in a sound recording
INCLUSION_MARGIN_PX = 0.003  # the same with an inclusion in the model: error of interpolation and discretisation alone
FLOOR_FACTOR = 1.5  # over the camera's floor: still frames are a sample of it


@dataclass(frozen=True)
class Margin:
    """The margin of one recording.

    floor : the camera's, None where no frame is at rest: the constants stand alone then
    """

    floor: CameraFloor | None = None

    @property
    def camera_px(self) -> float:
        """The camera's part, 0 where it is unknown or lost in noise."""
        return 0.0 if self.floor is None else FLOOR_FACTOR * self.floor.px

    @property
    def px(self) -> float:
        """Of the whole recording."""
        return max(PRACTICAL_MARGIN_PX, self.camera_px)

    @property
    def inclusion_px(self) -> float:
        """Of motions with the time course of an inclusion."""
        return max(INCLUSION_MARGIN_PX, self.camera_px)

    @property
    def words(self) -> str:
        """What the margin rests on, in one sentence."""
        if self.floor is None:
            return (f"The practical margin of {self.px:g} px is an assumption: no frame of this recording is at rest, "
                    f"and "
                    "the camera's own floor is not known.")
        n = len(self.floor.frames)
        observation = f"{n} image{'' if n == 1 else 's'} at rest show{'s' if n == 1 else ''}"
        if self.camera_px > PRACTICAL_MARGIN_PX:
            return (f"{observation} {self.floor.px:.2g} px of motion that no law explains. An effect below "
                    f"{self.px:.2g} px is not attributed to a law.")
        return (f"{observation} less than {self.floor.bound_px:.2g} px. The practical margin of {self.px:g} px is what "
                "interpolation and discretisation leave under motion, an assumption.")

    def content(self) -> dict:
        """The entry of diagnosis.json: the margin, and what it rests on."""
        floor = self.floor
        return {"px": self.px, "assumed_px": PRACTICAL_MARGIN_PX, "camera_px": self.camera_px,
                "camera_floor_px": None if floor is None else floor.px,
                "still_frames": [] if floor is None else list(floor.frames), "words": self.words}

    def local_px(self, weight: np.ndarray) -> float:
        """Of a region; weight : (n_nodes,) share of every node in it."""
        if self.floor is None or not weight.any():
            return self.px
        floor_px = float(np.sqrt(np.average(np.resize(self.floor.nodes_px, weight.shape)**2, weights=weight)))
        return max(PRACTICAL_MARGIN_PX, FLOOR_FACTOR * floor_px)

    def nodes_px(self, n_nodes: int) -> np.ndarray:
        """Of every node, camera by camera: further ones have the floor of the main one  # (n_nodes,)"""
        if self.floor is None:
            return np.full(n_nodes, PRACTICAL_MARGIN_PX)
        margins = np.maximum(PRACTICAL_MARGIN_PX, FLOOR_FACTOR * self.floor.nodes_px)
        return margins if n_nodes == len(margins) else np.tile(margins, n_nodes // len(margins))


ASSUMED = Margin()
