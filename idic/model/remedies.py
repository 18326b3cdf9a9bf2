"""Which keys of experiment.toml an experiment can have: the one place that fits a remedy to data, camera, log and mesh.

A remedy names its keys in words: ``a mask leaves the place out``. `Remedies.possible` keeps those whose keys the
experiment can have.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from idic.images import Camera, PlacedCamera
from idic.model.records.experiment import Experiment
from idic.model.records.parts import Column

Condition = Callable[[Experiment], bool]


@dataclass(frozen=True)
class Remedies:
    """What the user of an experiment can write; experiment : the view of a camera, whose keys those of [camera] are."""

    experiment: Experiment

    @staticmethod
    def written(raw: Mapping[str, Any]) -> frozenset[str]:
        """The keys of a file, dotted: ``experiment.frame_interval_s``, ``experiment.mesh.file``; of a camera by its
        name: ``camera.pixel_size_mm``."""
        cameras = raw.get("camera", ())
        tables = {"experiment": raw.get("experiment", {}), "options": raw.get("options", {})}
        for table in [cameras] if isinstance(cameras, Mapping) else cameras:
            tables[str(table.get("name", "camera"))] = table
        return frozenset(f"{name}.{key}" for name, table in tables.items() for key in _keys(table))

    @staticmethod
    def keys_in(remedy: str) -> list[str]:
        """The keys that not every experiment can have, of those that a remedy names."""
        return [word for word in re.findall(r"\w+", remedy) if word in CONDITIONS]

    def can_have(self, key: str) -> bool:
        """Whether the experiment can have a key of `CONDITIONS`."""
        return CONDITIONS[key](self.experiment)

    def possible(self, *remedies: str, otherwise: str = "") -> str:
        """The remedies that this experiment can follow, as alternatives in a sentence; `otherwise` where there is
        none."""
        alternatives = [remedy for remedy in remedies if all(self.can_have(key) for key in self.keys_in(remedy))]
        return ", or ".join(alternatives) or otherwise

    @property
    def scale(self) -> str:
        """The keys that say how large the mesh is in the image, in words."""
        return self._drawn or self.possible("pixel_size_mm", "matrix_px_per_unit", "voxel_mm", "the calibration",
                                            "translation_mm", "the alignment", otherwise="the positions of the cameras")

    @property
    def _drawn(self) -> str:
        """The keys of a mesh that is drawn on the image, which is as large as it is drawn, where it is drawn."""
        return self.possible("roi_px", "outline_px")

    @property
    def place(self) -> str:
        """The keys that say where the mesh is in the image, in words."""
        return self._drawn or self.possible("origin_px", "axes", "matrix_px_per_unit", "rotation and translation_mm",
                                            "the alignment", "origin_mm", otherwise="the positions of the cameras")

    @property
    def times_of_images(self) -> str:
        """The keys that give the images times to match those of a log, after ``a column time_s``; "" where they have
        some."""
        keys = self.possible("image_times", "frame_interval_s")
        has_some = _has(self.experiment, "experiment.frame_interval_s", "experiment.image_times")
        return "" if has_some or not keys else f", and {keys} under [experiment]"

    def exclusion(self, frames: Sequence[int]) -> str:
        """``exclude_frames`` with these frames and those that are left out already, as TOML; "" where no two would
        remain."""
        model, recording = self.experiment.model, self.experiment.recording
        left_out = sorted({*recording.excluded, *frames})
        if len(left_out) > model.n_frames - 2 or model.reference in left_out:
            return ""
        return json.dumps([recording.frame_names[k] for k in left_out], ensure_ascii=False)


def _keys(table: Mapping[str, Any]) -> list[str]:
    keys = []
    for key, value in table.items():
        inner = value if isinstance(value, Mapping) else {"file": value} if key == "mesh" else {}
        keys += [key, *(f"{key}.{name}" for name in inner)]
    return keys


def _has(experiment: Experiment, *keys: str) -> bool:
    """Whether the file has one of these keys."""
    return not experiment.written.isdisjoint(keys)


def _of_camera(experiment: Experiment, key: str) -> bool:
    return _has(experiment, f"{experiment.recording.camera_name}.{key}")


def _is_of(*quantities: str) -> Condition:
    return lambda experiment: experiment.recording.quantity in quantities


def _has_lens(experiment: Experiment) -> bool:
    return isinstance(experiment.model.camera, PlacedCamera)


def _has_telecentric_images(experiment: Experiment) -> bool:
    return isinstance(experiment.model.camera, Camera) and experiment.recording.quantity in ("grey", "height")


def _has_calibration(experiment: Experiment) -> bool:
    return _has_lens(experiment) and _of_camera(experiment, "calibration")


def _has_axes(experiment: Experiment) -> bool:
    if _has_telecentric_images(experiment):
        return not _of_camera(experiment, "matrix_px_per_unit")
    return experiment.recording.quantity in ("displacement", "volume")


def _is_in_px(experiment: Experiment) -> bool:
    """Whether the mesh is made on the image, in px: such a mesh has no unit of length."""
    return _has(experiment, "experiment.mesh.roi_px", "experiment.mesh.outline_px")


def _has_pixel_size(experiment: Experiment) -> bool:
    return _has_telecentric_images(experiment) and not _of_camera(experiment, "matrix_px_per_unit")


def _has_log(experiment: Experiment) -> bool:
    return _has(experiment, "experiment.loads")


def _has_two_more_frames(experiment: Experiment) -> bool:
    """Whether a frame can be left out: two remain."""
    return experiment.model.n_frames - len(experiment.recording.excluded) > 2


CONDITIONS: dict[str, Condition] = {
    # [experiment]
    "mask": _is_of("grey", "height"),
    "still_frames": _is_of("grey", "height", "volume"),
    "exclude_frames": _has_two_more_frames,
    "image_times": lambda e: _has_log(e) and not _has(e, "experiment.frame_interval_s"),
    "frame_interval_s": lambda e: _has_log(e) and not _has(e, "experiment.image_times"),
    "fields_noise_um": _is_of("displacement"),
    "mesh_unit": lambda e: _has(e, "experiment.mesh.file") and e.model.length_unit != "px",
    "roi_px": lambda e: _has(e, "experiment.mesh.roi_px"),
    "outline_px": lambda e: _has(e, "experiment.mesh.outline_px"),
    "holes_px": _is_in_px,
    "holes_mm": lambda e: _has(e, "experiment.mesh.roi_mm", "experiment.mesh.outline_mm",
                               "experiment.mesh.around_points_mm"),
    # [camera] and [scanner]
    "pixel_size_mm": _has_pixel_size,
    "matrix_px_per_unit": lambda e: _of_camera(e, "matrix_px_per_unit"),
    "origin_px": lambda e: _has_telecentric_images(e) or e.recording.quantity == "volume",
    "origin_mm": _is_of("displacement"),
    "axes": _has_axes,
    "voxel_mm": _is_of("volume"),
    "noise_std_gv": lambda e: e.recording.quantity in ("grey", "height", "volume"),
    "calibration": _has_calibration,
    "identify_calibration": _has_calibration,
    "translation_mm": lambda e: _has_lens(e) and not _of_camera(e, "alignment"),
    "alignment": lambda e: _has_lens(e) and not _of_camera(e, "translation_mm"),
    # [[channel]]
    "noise_std": lambda e: bool(e.model.channels),
    # [options]
    "lowpass_px": _is_of("grey", "height"),
    "element_order": lambda e: e.model.solver is None and not _has(e, "options.element_order"),
    # [[boundary]]
    "time_modes": lambda e: any(isinstance(entry.drive, Column) for entry in e.model.prescribed),
}
