"""The noise of measured fields, and by it the weight of the displacement out of the plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.measured_fields.stages import side_seen
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.images import FieldNoise
from idic.model import CorrelatedNoise, Depth, FieldPoints, Noise
from idic.readers import FieldStack, MeasuredPoints, UM_PER_MM, largest_change


def depth_of(config: ExperimentFile, points: MeasuredPoints, free_rigid: bool) -> Depth | None:
    """How the displacement out of the plane is compared: on a solid, or on a sheet of known thickness, that was
    measured in three coordinates.

    Sides that move as the fields show do not hold the specimen out of its plane: then, and with ``motion = "free"``,
    every stage has an offset and two tilts of its own. A sheet bends in every stage as it likes.

    Raises
    ------
    InputError
        The change of thickness is asked for where nothing shows it.
    """
    table = config.experiment
    sheet = table.kind == "plane_stress" and table.thickness_mm is not None and config.solver is None
    if table.fields_thickness_change and (points.plane is None or not sheet):
        raise InputError("the change of thickness cannot be compared", key="experiment.fields_thickness_change",
                         expected="points of three coordinates, a sheet in plane stress, its thickness_mm, and the "
                         "built-in solver", found="points of two coordinates" if points.plane is None else
                         f"kind = {table.kind!r}" if table.kind != "plane_stress" else "no thickness_mm"
                         if table.thickness_mm is None else "[solver]", remedy="leave it out")
    if points.plane is None:
        return None
    if sheet and table.fields_thickness_change is not False:
        return Depth(side=side_seen(table))
    if table.kind != "solid":
        return None
    measured = any(drive is not None and drive.measured is not None for table in config.boundary
                   for drive in (table.u, table.ux, table.uy))
    return Depth(rigid_motion=free_rigid or measured)


def noise_of_fields(config: ExperimentFile, stack: FieldStack, points: FieldPoints, frames: Sequence[int],
                    reference: int, n_references: int, file: Path) -> Noise:
    """The noise of a point and its correlation: from the stages (`idic.images.quality.field_noise`), the size as given.

    Raises
    ------
    InputError
        The noise is neither given nor visible in the stages.
    """
    stated_std = config.experiment.fields_noise_um
    stage_noise = _noise_seen(stack, points, frames, reference, n_references, (0, 1))
    if stage_noise is None:
        if stated_std is None:
            raise InputError("the noise of the fields is not known", file=file, key="experiment.fields_noise_um",
                             expected="its standard deviation in µm, or three stages or more that show it",
                             found=f"{len(frames)} stages", remedy="give it: two stages at rest show it")
        return Noise(stated_std, "given")
    std = stage_noise.std if stated_std is None else stated_std
    rows = tuple(tuple(float(value) for value in row) for row in stage_noise.correlation)
    return Noise(std, "stage_differences" if stated_std is None else "given",
                 correlated=CorrelatedNoise(std, std * stage_noise.sum_std / stage_noise.std, rows, std))


def with_depth(points: FieldPoints, noise: Noise, stack: FieldStack, frames: Sequence[int], reference: int,
               n_references: int, unconditional: bool = True,
               thickness: float | None = None) -> tuple[FieldPoints, str]:
    """The points with the weight of the rows along the normal by their own noise, and a note.

    unconditional : False: of a sheet of this thickness (mm), only where its change can exceed that noise.

    The rows are weighed so that sums over many points scatter as those in the plane do; the correlation of neighbours
    is taken to be that in the plane. Where the stages do not show the noise, it is that in the plane.
    """
    assert points.depth is not None
    plane, normal_noise = noise.correlated, _noise_seen(stack, points, frames, reference, n_references, (2,))
    remark = "" if not points.depth.rigid_motion else "; an offset and two tilts of every stage are its own"
    if points.depth.side:
        most = _largest_change(stack, frames, thickness or 0.0)
        std = noise.std_gv if normal_noise is None else normal_noise.std
        remark = (f"; of a sheet it is the change of thickness, up to {most:.2g} µm rms here; every stage bends by a "
                  "polynomial of the third degree of its own")
        if not unconditional and most < (std or 0.0):
            return replace(points, depth=None), (
                f"the change of thickness moves the seen side by {most:.2g} µm rms at most, less than the noise along "
                f"the normal ({std:.2g} µm per point): it is not compared (fields_thickness_change = true compares it)")
    if normal_noise is None or plane is None:
        return replace(points, depth=replace(points.depth, std_um=noise.std_gv)), (
            "the displacement out of the plane is compared too, with the noise of the others" + remark)
    weight = plane.sum_std_gv / normal_noise.sum_std
    gain = (weight * normal_noise.std / plane.recorded_gv) ** 2
    return replace(points, depth=replace(points.depth, weight=weight, noise_gain=gain, std_um=normal_noise.std)), (
        f"the displacement out of the plane is compared too; its noise is {normal_noise.std:.3g} µm per point{remark}")


def _largest_change(stack: FieldStack, frames: Sequence[int], thickness: float) -> float:
    """What the last stage and the middle one can show of a change of thickness  # µm, rms over the points"""
    at = stack.points.positions
    looked = {frames[-1], frames[len(frames) // 2]}
    moved = (stack.frame(k)[:, :2].astype(float) * [1.0, -1.0] / UM_PER_MM for k in looked)
    return max(UM_PER_MM * largest_change(at, motion, 0.5 * thickness) for motion in moved)


def _noise_seen(stack: FieldStack, points: FieldPoints, frames: Sequence[int], reference: int, n_references: int,
                components: tuple[int, ...]) -> FieldNoise | None:
    files = tuple((entry.path, entry.number, entry.path.stat().st_mtime_ns) for entry in stack.entries)
    key = (files, stack.series.mm_per_unit, tuple(frames), reference, n_references, len(stack.points), components)
    return _seen_noise(_Recording(key, stack, points.positions_px))


@dataclass(frozen=True)
class _Components:
    """Some components of the displacement, as a stack of their own."""

    stack: FieldStack
    components: tuple[int, ...]

    def frame(self, k: int) -> np.ndarray:
        return self.stack.frame(k)[:, list(self.components)]


@dataclass(frozen=True)
class _Recording:
    """Stages, and all that tells them from others: files, their age, unit, frames, references, components."""

    key: tuple
    stack: FieldStack = field(compare=False)
    positions_px: np.ndarray = field(compare=False)


@lru_cache(maxsize=4)  # one command opens an experiment several times
def _seen_noise(recording: _Recording) -> FieldNoise | None:
    _, _, frames, reference, n_references, _, components = recording.key
    stack = _Components(recording.stack, components)
    return FieldNoise.of(stack, recording.positions_px, frames, reference, n_references)
