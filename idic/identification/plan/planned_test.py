"""A test that is still to be made, as an `Experiment`: missing data are made up as [design] says, and reported.

Images and logs that are there are used. One image is the photograph of the pattern: it is the reference, the frames to
come need no images. Without any, a virtual speckle stands for the pattern. A log that is missing is replaced by the
courses of ``[design.program]``; channels to be measured need no values.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.experiment_file import (
    DesignTable, ExperimentFile, ExperimentFolder, Frames, load_experiment, locate, read_toml, validated,
    with_overrides,
)
from idic.images import dense_speckle
from idic.model import Experiment, Noise
from idic.path_names import path_inside
from idic.readers import MatchedLog, check_increasing, matching_files, open_stack, unit_in_name
from idic.identification.plan.planned_motion import edge_keys, edge_motion
from idic.identification.plan.planned_scans import PlannedScans, texture_tile

DOT_SIGMA_PER_SPECKLE = 0.4  # sigma of the dots per px of speckle size
MEAN_GREY_VALUE = 128.0  # middle of 8 bit
SUPERSAMPLING = 3
NOISE_SHARE = 0.04  # of the pattern's standard deviation, where nothing is said of the noise: 2 of 50 grey values
SEED = 0
VIRTUAL_SPECKLE = "virtual speckle"
TEMPLATE = "[design] with image_px = [1200, 800], n_frames = 50, duration_s = 100, and [design.program]"
TEMPLATE_OF_SCANS = "[design] with image_px = [600, 600, 900], n_frames = 8, duration_s = 8000, and [design.program]"


@dataclass(frozen=True)
class Plan:
    """A planned test: the experiment, the motion of its measured edges (n_frames, m) mm, and the list of data made
    up."""

    experiment: Experiment
    local: np.ndarray
    pattern: str  # "photograph" | "images" | VIRTUAL_SPECKLE
    assumptions: tuple[str, ...]

    @classmethod
    def of(cls, path: str | Path, overrides: Mapping[str, Any] | None = None,
           noise_std_gv: float | None = None) -> Plan:
        """Read an experiment that need not have been made yet.

        Parameters
        ----------
        noise_std_gv : standard deviation of the image noise, over what the folder says.

        Raises
        ------
        InputError
            As `load_experiment`; or neither images nor a plan, a course for nothing, a course that ends too early, a
            channel to come without its noise.
        """
        folder = _folder(path, overrides, noise_std_gv)
        file, experiment = folder.file, folder.experiment()
        folder.check_program()
        folder.check_channel_noise()
        experiment, noise = _with_noise(experiment, noise_std_gv, folder.plan.noise_std_gv)
        experiment, local, motion = edge_motion(experiment, folder.plan.program, folder.recorded, file)
        return cls(experiment, local, folder.pattern, (*folder.assumptions(), noise, *motion))


class PlannedStack:
    """The reference image, shown again for every frame to come."""

    def __init__(self, image: np.ndarray, n_frames: int):
        self._image, self._n_frames = image, n_frames

    @property
    def n_frames(self) -> int:
        return self._n_frames

    @property
    def shape(self) -> tuple[int, int]:
        return self._image.shape

    def frame(self, k: int) -> np.ndarray:
        return self._image


def recorded_or_planned(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Experiment:
    """An experiment as it was recorded, else as it is planned: the model of a simulation.

    Raises
    ------
    InputError
        As `load_experiment` and `Plan.of`.
    """
    folder = _folder(path, overrides)
    if folder.config.design is None or (folder.recorded and folder.has_log):
        return load_experiment(path, overrides)
    return Plan.of(path, overrides).experiment


def planned_speckle(path: str | Path, overrides: Mapping[str, Any] | None = None) -> DesignTable | None:
    """The plan of `recorded_or_planned` whose speckle is made up; None where there is an image of the real one."""
    folder = _folder(path, overrides)
    return folder.config.design if folder.pattern == VIRTUAL_SPECKLE else None


def _folder(path: str | Path, overrides: Mapping[str, Any] | None, noise_std_gv: float | None = None) -> PlannedFolder:
    """noise_std_gv : of scans, over what the folder says: nothing is assumed of theirs"""
    file = locate(path)
    raw = with_overrides(read_toml(file), overrides)
    config = validated(raw, file)
    noise_gv = noise_std_gv or (config.design.noise_std_gv if config.design is not None else None)
    if config.experiment.volumes and noise_gv is not None:
        raw = with_overrides(raw, {"scanner.noise_std_gv": noise_gv})
        config = validated(raw, file)
    return PlannedFolder(file, file.parent.resolve(), config, raw)


def virtual_speckle(shape: tuple[int, int], speckle_px: float, contrast_gv: float) -> np.ndarray:
    """A dense random speckle of this size and standard deviation about mid-grey, as 8 bit see it  # (ny, nx) uint8"""
    rng, n = np.random.default_rng(SEED), SUPERSAMPLING
    pattern = dense_speckle(rng, DOT_SIGMA_PER_SPECKLE * speckle_px, -0.5, 0.5, extent_px=1.2 * max(shape))
    offset = (np.arange(n) + 0.5) / n - 0.5
    columns = (np.arange(shape[1])[:, None] + offset).ravel()
    image = np.empty(shape)
    for row in range(shape[0]):
        points = np.stack(np.broadcast_arrays(columns, (row + offset)[:, None]), axis=-1).reshape(-1, 2)
        image[row] = pattern.value(points).reshape(n, shape[1], n).mean(axis=(0, 2))
    return np.clip(np.rint(MEAN_GREY_VALUE + contrast_gv / image.std() * (image - image.mean())), 0,
                   255).astype(np.uint8)


@dataclass(frozen=True)
class _Course:
    """The log of a planned test: courses of the programme, else columns of a log, zero for channels to come.

    late, is_interpolated : as those of `MatchedLog`; a plan is on time, and has values at its frames
    """

    folder: PlannedFolder
    times: np.ndarray
    log: MatchedLog | None
    late: float = 0.0
    is_interpolated: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Courses of the programme and columns of the log."""
        return (*self.folder.plan.program, *(() if self.log is None else self.log.names))

    @property
    def notes(self) -> tuple[str, ...]:
        """How the log was read, where there is one."""
        return () if self.log is None else self.log.notes

    def unit(self, name: str) -> str | None:
        """The unit of a column of the log; that of a course is in its name."""
        return self.log.unit(name) if self.log is not None and name in self.log.names else unit_in_name(name)

    def column(self, name: str, *, file=None, key=None) -> np.ndarray:
        courses = self.folder.plan.program
        if name in courses:
            return np.interp(self.times, *np.array(courses[name]).T)
        if self.log is not None and name in self.log.names:
            return self.log.column(name, file=file, key=key)
        if name in self.folder.channels:
            return np.zeros(len(self.times))
        raise InputError("a column without a course", file=file, key=key,
                         expected=f"{name} in the log, or its course under [design.program]",
                         found=f"courses of {', '.join(courses) or 'nothing'}",
                         remedy=f"add for instance  {name} = [[0, 0], [{self.times[-1]:g}, 1.0]]  ([time in s, value])")


@dataclass(frozen=True)
class PlannedFolder(ExperimentFolder):
    """An experiment folder of which parts may be missing."""

    @property
    def plan(self) -> DesignTable:
        return self.config.design or DesignTable()

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(channel.column for channel in self.config.channel)

    @cached_property
    def images(self) -> list[Path]:
        """The images that are there; a pattern without a match stands for images to come."""
        files = []
        for pattern in self.config.experiment.images:
            path_inside(self.folder, pattern, file=self.file, key="experiment.images")
            with suppress(InputError):
                files += matching_files(self.folder, [pattern], file=self.file, key="experiment.images")
        return files

    @cached_property
    def recorded(self) -> bool:
        """Whether the test was made: two images or scans or more, or measured fields."""
        key = "experiment.images"
        if self.config.experiment.fields:
            return True
        if self.config.experiment.volumes:
            return self.existing_scans is not None and self.existing_scans.n_frames > 1
        return bool(self.images) and open_stack(self.images, file=self.file, key=key).n_frames > 1

    @property
    def has_log(self) -> bool:
        name = self.config.experiment.loads
        if name is None and self.config.experiment.fields:  # the stages may hold it
            return True
        return name is not None and path_inside(self.folder, name, file=self.file, key="experiment.loads").is_file()

    @property
    def pattern(self) -> str:
        if self.config.experiment.fields:
            return "measured fields"
        if self.config.experiment.volumes:
            return "scans" if self.recorded else VIRTUAL_SPECKLE if self.existing_scans is None else "scan"
        return "images" if self.recorded else "photograph" if self.images else VIRTUAL_SPECKLE

    # replacements of missing data ---------------------------------------------------------
    def frames(self) -> Frames:
        if self.recorded:
            return super().frames()
        if self.config.experiment.volumes:
            return self._scans_to_come()
        plan = self.plan
        self._need("n_frames", plan.n_frames)
        if self.images:
            photographs = open_stack(self.images, file=self.file, key="experiment.images")
            image, first = photographs.frame(0), photographs.labels[0]
            if plan.image_px is not None and tuple(plan.image_px) != image.shape[::-1]:
                raise InputError("not the size of the photograph", file=self.file, key="design.image_px",
                                 expected=f"{image.shape[1]} x {image.shape[0]} px",
                                 found=f"{plan.image_px[0]} x {plan.image_px[1]} px", remedy="leave image_px out")
        else:
            self._need("image_px", plan.image_px)
            self._check_axes(2, "images: columns and rows")
            if self.config.experiment.quantity != "grey":
                raise InputError("a virtual surface for height images", file=self.file, key="experiment.images",
                                 expected="one measured height map of the specimen", found="none",
                                 remedy="record one before the test and name it under images")
            image, first = virtual_speckle(tuple(plan.image_px[::-1]), plan.speckle_px, plan.contrast_gv), "speckle"
        stack = PlannedStack(image, plan.n_frames)
        labels = (first, *(f"planned {k}" for k in range(1, plan.n_frames)))
        return Frames(stack, labels, None, 0, (), (), None, self.mask(stack), ())

    def _scans_to_come(self) -> Frames:
        """The one scan that is there, or a virtual texture, for every scan."""
        plan, scans = self.plan, self.existing_scans
        self._need("n_frames", plan.n_frames)
        later_labels = tuple(f"planned {k}" for k in range(1, plan.n_frames))
        if scans is not None:
            size = list(scans.shape[::-1])
            if plan.image_px is not None and list(plan.image_px) != size:
                raise InputError("not the size of the scan", file=self.file, key="design.image_px",
                                 expected=str(size), found=str(plan.image_px), remedy="leave image_px out")
            return self.frames_to_come(scans.repeated(plan.n_frames), (scans.labels[0], *later_labels))
        self._need("image_px", plan.image_px)
        self._check_axes(3, "scans: columns, rows and slices")
        tile = texture_tile(DOT_SIGMA_PER_SPECKLE * plan.speckle_px, plan.contrast_gv, MEAN_GREY_VALUE, SEED)
        columns, rows, slices = plan.image_px
        stack = PlannedScans((slices, rows, columns), tile, plan.n_frames)
        return self.frames_to_come(stack, ("texture", *later_labels))

    def _check_axes(self, n_axes: int, words: str) -> None:
        sides = self.plan.image_px
        if len(sides) != n_axes:
            raise InputError("the size of the images to come", file=self.file, key="design.image_px",
                             expected=f"{n_axes} numbers for {words}", found=str(sides), remedy="correct it")

    def log(self, frames: Frames) -> MatchedLog | _Course | None:  # type: ignore[override]
        log = super().log(frames) if self.has_log else None
        if (log is not None and self.recorded) or not (log or self.plan.program or self.channels):
            return log
        return _Course(self, self._times(frames.stack.n_frames), log)

    def image_times(self, n_frames: int) -> np.ndarray | None:
        times = super().image_times(n_frames)
        if times is not None or (self.recorded and (self.has_log or self.config.design is None)):
            return times
        return self._times(n_frames)

    def small_files(self) -> list[Path]:
        return [path for path in super().small_files() if path.is_file()]

    def identity(self, frames: Frames, files: Sequence[Path]) -> str:
        return super().identity(frames, files) if self.recorded else ""

    def _times(self, n_frames: int) -> np.ndarray:
        times = super().image_times(n_frames)
        return np.linspace(0.0, self._duration(n_frames), n_frames) if times is None else times

    def _duration(self, n_frames: int) -> float:
        program_end = max((course[-1][0] for course in self.plan.program.values()), default=float(n_frames - 1))
        return self.plan.duration_s or program_end

    def _need(self, key: str, value: object) -> None:
        if value is None:
            raise InputError("there are no images yet" if key == "image_px" else "there are no images of a test yet",
                             file=self.file, key=f"design.{key}",
                             expected=f"scans, or a plan: {TEMPLATE_OF_SCANS}" if self.config.experiment.volumes
                             else f"images, or a plan: {TEMPLATE}",
                             found="neither" if self.config.design is None else f"[design] without {key}",
                             remedy=f"add {key} under [design]")

    # checks and assumptions ---------------------------------------------------------------------
    def check_program(self) -> None:
        """Every course drives something, and lasts as long as the test."""
        columns = {*columns_of(self.config), *edge_keys(self.config)} - set(self.channels)
        for name, course in self.plan.program.items():
            key, times = f"design.program.{name}", np.array(course)[:, 0]
            if name not in columns:
                suggestions = difflib.get_close_matches(name, columns, n=1, cutoff=0.6)
                measured = name in self.channels
                raise InputError("a course for a channel, which the simulation gives" if measured
                                 else "a course that drives nothing", file=self.file, key=key,
                                 expected=f"one of {', '.join(sorted(columns)) or '(no boundary names a column)'}",
                                 found=name, remedy=f"did you mean {suggestions[0]}?" if suggestions else "remove it")
            check_increasing(times, self.file, key)
            end = self._times(self.plan.n_frames or 2)[-1] if not self.recorded else times[-1]
            if times[0] > 0.0 or times[-1] < end:
                raise InputError("a course that does not cover the test", file=self.file, key=key,
                                 expected=f"times from 0 to {end:g} s", found=f"{times[0]:g} to {times[-1]:g} s",
                                 remedy="complete the course, or change duration_s")

    def check_channel_noise(self) -> None:
        """A channel that is not measured yet has no scatter to take its noise from."""
        for number, channel in enumerate(self.config.channel):
            if channel.noise_std is None and not (self.has_log and self.recorded):
                raise InputError("the noise of a channel that is not measured yet", file=self.file,
                                 key=f"channel[{number}].noise_std", expected="its standard deviation",
                                 found="no such key", remedy=f"add what the instrument of {channel.column} has, "
                                 "for instance noise_std = 5.0")

    def assumptions(self) -> list[str]:
        """What was made up, in sentences."""
        plan, lines = self.plan, []
        if self.pattern == VIRTUAL_SPECKLE:
            thing = "scan" if self.config.experiment.volumes else "photograph"
            lines.append(f"no {thing}: a virtual speckle of {plan.speckle_px:g} px and {plan.contrast_gv:g} grey "
                         "values of contrast (standard deviation) stands for the pattern")
        if self.pattern == "scan":
            lines.append(f"the texture is that of {self.existing_scans.labels[0]}; its own noise counts as texture")
        if self.pattern == "photograph":
            lines.append(f"the pattern is that of {self.images[0].name}; its own noise counts as pattern")
        if not self.recorded:
            end = self._duration(plan.n_frames)
            lines.append(f"{plan.n_frames} frames in {end:g} s" + ("" if plan.duration_s or plan.program
                                                                 else " (no duration_s: one per second)"))
        elif plan.program and self.has_log:
            lines.append("images and log are there: [design.program] is not used")
        table = self.config.experiment
        ignored = [key for key in ("reference", "exclude_frames", "still_frames") if getattr(table, key)]
        if ignored and not self.recorded:
            lines.append(f"{', '.join(ignored)}: left for the images to come")
        return lines


def columns_of(config: ExperimentFile) -> set[str]:
    """Columns of the log that boundaries name."""
    entries = [getattr(table, name) for table in config.boundary for name in type(table).model_fields]
    return {entry.column for entry in entries if getattr(entry, "column", None) is not None}


def _with_noise(experiment: Experiment, *stds_gv: float | None) -> tuple[Experiment, str]:
    """The experiment with its image noise: the first that is given, else its own, else an assumption; and a note."""
    recording = experiment.recording
    chosen = next((std for std in stds_gv if std is not None), None)
    if chosen is not None:
        source = Noise(chosen, "given")
    elif recording.noise.std_gv is not None:
        source = recording.noise
    else:
        contrast = float(np.std(recording.stack.frame(experiment.model.reference)))
        source = Noise(NOISE_SHARE * contrast, "assumed")
    words = {"given": "as given", "still_frames": "from still frames",
             "stage_differences": "from the differences of stages",
             "assumed": f"assumed: {100 * NOISE_SHARE:g} % of the contrast; give noise_std_gv or --noise-gv"}
    quantity = "image noise" if recording.points is None else "noise of a component"
    return (replace(experiment, recording=replace(recording, noise=source)),
            f"{quantity}: {source.std_gv:.3g} {recording.value_unit} ({words.get(source.source, source.source)})")
