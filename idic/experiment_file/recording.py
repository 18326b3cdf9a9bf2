"""The recordings of an experiment: images, log and times; the fingerprint of all inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.measured_fields.noise import depth_of
from idic.experiment_file.measured_fields.placement import grid_of, rigid_is_free
from idic.experiment_file.measured_fields.stages import field_notes, kept_stages, open_series, stack_of
from idic.experiment_file.pinhole.lenses import calibrations
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.materials import MaterialTable
from idic.experiment_file.tables.further_cameras import CameraFrames, camera_files, camera_frames, camera_images
from idic.experiment_file.checks.height_maps import check_height_unit
from idic.experiment_file.checks.images_at_rest import check_depth
from idic.experiment_file.tables.solver import external_solver, solver_files
from idic.experiment_file.tables.temperatures import infrared_stacks, temperature_images
from idic.experiment_file.volumes.scans import ScanFiles, open_scans
from idic.experiment_file.volumes.voxel_mask import VoxelMask, mask_files, open_mask
from idic.fe import ExternalSetup
from idic.images import VolumeStack
from idic.laws import all_laws, code_of, outside_values, source_of
from idic.model import FieldPoints, KINDS
from idic.readers import (
    ArrayFrames, CameraRig, FieldStack, FileStack, FrameNames, Log, MatchedLog, RawMesh, existing_file, matching_files,
    open_stack, read_image, read_mesh_file,
)
from idic.path_names import path_inside
from idic.remote_files import image_facts

MAX_TIME_DIFFERENCE = 0.01  # of the duration, between log and image files: more is no rounding of a rate
_HASHED_AT_EACH_END = 1 << 16  # bytes of an image; whole ones are hashed at ingest (`idic.run.store.image_files`)


@dataclass(frozen=True)
class Recorded:
    """All stages of measured fields of which some are compared.

    counted : numbers of those that may be compared, from the reference on; compared : of those that are
    """

    stack: FieldStack
    counted: tuple[int, ...]
    compared: tuple[int, ...]


@dataclass(frozen=True)
class Frames:
    """The images of the main camera: stack, reference, excluded and still frames, mask."""

    stack: FileStack | ArrayFrames | FieldStack | ScanFiles | VolumeStack
    labels: tuple[str, ...]
    numbers: tuple[int, ...] | None
    reference: int
    excluded: tuple[int, ...]
    still: tuple[int, ...]
    still_stack: FileStack | None
    mask: np.ndarray | None
    notes: tuple[str, ...]
    averaged: tuple[int, ...] = ()  # several reference frames
    points: FieldPoints | None = None  # of measured fields
    stated_order: str = ""  # of the images, by the user; "": by their names, to be confirmed
    voxel_mask: VoxelMask | None = None  # of volumes
    recorded: Recorded | None = None  # where some stages of measured fields are chosen

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx) of the images, or of the grid of the points; (nz, ny, nx) of volumes."""
        return self.stack.shape if self.points is None else self.points.shape  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class RecordedFiles:
    """What the files of an experiment hold; no model changes it, and images are opened on demand.

    folder : of the files, `files` : all that are read whole; frames, cameras : images of the main camera (or stages of
    measured fields) and of the further ones; log : one row per frame; times : (n_frames,) s, None where neither log nor
    tables know them
    mesh : of the mesh file; calibrations : by file name; infrared : images by the number of their [[boundary]];
    solver : deck and command of an external program; identity : fingerprint of tables, files and images, "" of objects
    in memory
    """

    folder: Path
    frames: Frames
    cameras: tuple[CameraFrames, ...]
    log: MatchedLog | None
    times: np.ndarray | None
    mesh: RawMesh | None
    calibrations: Mapping[str, CameraRig]
    infrared: Mapping[int, FileStack]
    solver: ExternalSetup | None
    files: tuple[Path, ...]
    identity: str


@dataclass(frozen=True)
class RecordedFolder:
    """One experiment file and its recordings."""

    file: Path
    folder: Path
    config: ExperimentFile
    raw: Mapping

    def recording(self) -> RecordedFiles:
        """Read the files; of images only the headers.

        Raises
        ------
        InputError
            The first file that is missing, damaged or contradicts the others.
        """
        frames, name = self.frames(), self.config.experiment.mesh.file
        rigs = calibrations(self.config, self.folder, self.file)
        mesh = None if name is None else self.meshed(name)
        solver = external_solver(self.config, self.folder, self.file)
        log = self.log(frames)
        files = [*self.small_files(), *(() if mesh is None else mesh.files[1:])]  # those that the mesh file includes
        return RecordedFiles(self.folder, frames, camera_frames(self.config, self.folder, self.file), log,
                         self.frame_times(frames) if log is None else log.times, mesh, rigs,
                         infrared_stacks(self.config, self.folder, self.file), solver, tuple(files),
                         self.identity(frames, files))

    def meshed(self, name: str) -> RawMesh:
        """The mesh with the cells, sets and lengths of the file."""
        return read_mesh_file(existing_file(self.folder, name, file=self.file, key="experiment.mesh"))

    def frames(self) -> Frames:
        """Open the images; InputError if there are none, too few, or if the keys for frames contradict each other."""
        table, file = self.config.experiment, self.file
        if table.fields:
            return self._field_frames()
        if table.volumes:
            return self._volume_frames()
        if not table.images:
            raise InputError("there are no images", file=file, key="experiment.images",
                             expected="the images of the test", found="no such key",
                             remedy='run the test, then write e.g. images = "images/*.tif"; before the test, '
                             "idic design predicts what it will determine")
        stack = self.opened_images()
        check_height_unit(stack, table.height_unit, file, "experiment.height_unit")
        self._check_complete(stack.labels)
        times = self.image_times_table()
        if times is not None:
            times.check_rows_of(stack.labels, "image_times")
        notes = stack.notes() + self._order_notes(stack) + self._image_times_notes()

        def indices(entries, key):
            numbers, note = FrameNames(stack.labels).indices(entries, file=file, key=f"experiment.{key}")
            notes.extend([note] if note else [])
            return numbers

        averaged = indices(table.reference, "reference") if table.reference is not None else (0,)
        reference = max(averaged)
        excluded = indices(table.exclude_frames, "exclude_frames")
        if len(averaged) > 1 and table.quantity == "height":
            raise InputError("several reference frames of height images", file=file, key="experiment.reference",
                             expected="one height image", found=str(len(averaged)),
                             remedy="name one of them, or store their average as one image")
        if set(averaged) & set(excluded):
            raise InputError("the reference frame is excluded", file=file, key="experiment.exclude_frames",
                             expected="frames other than the reference",
                             found=stack.labels[reference], remedy="choose another reference")
        if stack.n_frames - len(excluded) < 2:
            raise InputError("too few images to correlate", file=file, key="experiment.images",
                             expected="two images or more, one of them the reference",
                             found=f"{stack.n_frames - len(excluded)}", remedy="check the pattern and exclude_frames")
        if not set(range(reference + 1, stack.n_frames)) - set(excluded):
            raise InputError("no image follows the reference", file=file, key="experiment.reference",
                             expected="a reference that is taken before the images that are compared with it",
                             found=f"{stack.labels[reference]}, the last of {stack.n_frames}",
                             remedy="name the undeformed image, and check exclude_frames")
        still, still_stack = self._still_frames(stack, indices)
        return Frames(stack, stack.labels, FrameNames(stack.labels).numbers, reference, excluded, still, still_stack,
                       self.mask(stack), tuple(notes),
                       averaged if len(averaged) > 1 else (), stated_order=self.stated_order)

    @property
    def stated_order(self) -> str:
        """The order of the images, where the user states it, else ""."""
        return self.config.experiment.order or ""

    def opened_images(self) -> FileStack | ArrayFrames:
        """The images of the main camera; only their headers are read."""
        table, key = self.config.experiment, "experiment.images"
        return open_stack(matching_files(self.folder, table.images, file=self.file, key=key, order=table.order),
                          file=self.file, key=key, with_gaps=table.quantity == "height")

    def _field_frames(self) -> Frames:
        """Open the measured fields."""
        table, file = self.config.experiment, self.file
        series = open_series(self.config, self.folder, file)
        labels, notes = series.labels, self._image_times_notes()
        self._check_complete(labels)

        def indices(entries, key):
            numbers, note = FrameNames(labels).indices(entries, file=file, key=f"experiment.{key}")
            notes.extend([note] if note else [])
            return numbers

        averaged = indices(table.reference, "reference") if table.reference is not None else (0,)
        excluded = indices(table.exclude_frames, "exclude_frames")
        reference = max(averaged)
        if set(averaged) & set(excluded):
            raise InputError("the reference stage is excluded", file=file, key="experiment.exclude_frames",
                             expected="stages other than the reference", found=labels[reference],
                             remedy="choose another reference")
        later = sorted(set(range(reference + 1, len(labels))) - set(excluded))
        if not later:
            raise InputError("no stage follows the reference", file=file, key="experiment.fields",
                             expected="two stages or more, the reference before the others", found=f"{len(labels)}",
                             remedy="check the pattern, reference and exclude_frames")
        stack, recorded = stack_of(series, averaged, table), None
        if table.stages is not None:
            compared, note = kept_stages(table.stages, stack, averaged, excluded)
            recorded = Recorded(stack, (reference, *later), compared)
            stack = FieldStack(series.only(compared), stack.points, stack.n_components, stack.flattening)
            labels = tuple(labels[k] for k in compared)
            reference, averaged = compared.index(reference), tuple(compared.index(k) for k in averaged)
            later, excluded = list(range(reference + 1, len(compared))), ()
            notes.append(note)
        with_rigid_motion = rigid_is_free(self.config, file)
        grid = grid_of(stack.points, table.fields_subset_mm or 0.0, with_rigid_motion,
                       depth_of(self.config, stack.points, with_rigid_motion))
        notes += field_notes(stack, grid, later, table.thickness_mm, reference)
        return Frames(stack, labels, FrameNames(labels).numbers, reference, excluded, (), None, None, tuple(notes),
                      averaged if len(averaged) > 1 else (), grid, recorded=recorded)

    def opened_scans(self) -> ScanFiles:
        """The volumes; only their headers are read."""
        return open_scans(self.folder, self.config.experiment.volumes, file=self.file, key="experiment.volumes")

    @cached_property
    def existing_scans(self) -> ScanFiles | None:
        """The same; None where no pattern has a match: they are to come."""
        names = [pattern.partition("::")[0] for pattern in self.config.experiment.volumes]
        paths = [path_inside(self.folder, name, file=self.file, key="experiment.volumes") for name in names]
        has_match = any(path.exists() or any(self.folder.glob(name)) for path, name in zip(paths, names, strict=True))
        return self.opened_scans() if has_match else None

    def frames_to_come(self, stack: VolumeStack, labels: tuple[str, ...]) -> Frames:
        """Scans of a test that is still to be made; a grey value of air is known where there is a scan."""
        air_below_gv = None if self.config.scanner is None or self.existing_scans is None else (
            self.config.scanner.air_below_gv)
        mask = open_mask(self.folder, self.config.experiment.mask, air_below_gv, stack, self.file)
        return Frames(stack, labels, None, 0, (), (), None, None, (), voxel_mask=mask)

    def _volume_frames(self) -> Frames:
        """Open the scans."""
        table, file, key = self.config.experiment, self.file, "experiment.volumes"
        stack = self.opened_scans()
        labels, notes = stack.labels, self._image_times_notes()
        self._check_complete(labels)

        def indices(entries, key):
            numbers, note = FrameNames(labels).indices(entries, file=file, key=f"experiment.{key}")
            notes.extend([note] if note else [])
            return numbers

        averaged = indices(table.reference, "reference") if table.reference is not None else (0,)
        excluded = indices(table.exclude_frames, "exclude_frames")
        still = indices(table.still_frames, "still_frames") if table.still_frames else ()
        reference = max(averaged)
        if set(averaged) & set(excluded):
            raise InputError("the reference scan is excluded", file=file, key="experiment.exclude_frames",
                             expected="scans other than the reference", found=labels[reference],
                             remedy="choose another reference")
        if not set(range(reference + 1, stack.n_frames)) - set(excluded):
            raise InputError("no scan follows the reference", file=file, key=key,
                             expected="two scans or more, the reference before the others", found=f"{len(labels)}",
                             remedy="check the pattern, reference and exclude_frames")
        air_below_gv = None if self.config.scanner is None else self.config.scanner.air_below_gv
        return Frames(stack, labels, FrameNames(labels).numbers, reference, excluded, still, None, None, tuple(notes),
                      averaged if len(averaged) > 1 else (),
                      voxel_mask=open_mask(self.folder, table.mask, air_below_gv, stack, file))

    def _still_frames(self, stack: FileStack, indices) -> tuple[tuple[int, ...], FileStack | None]:
        """The frames taken at rest: frame numbers of the test, or a separate stack."""
        table, file = self.config.experiment, self.file
        still, still_stack = (), None
        if isinstance(table.still_frames, str):
            still_stack = open_stack(matching_files(self.folder, [table.still_frames], file=file,
                                                    key="experiment.still_frames"), file=file,
                                     key="experiment.still_frames", with_gaps=table.quantity == "height")
            self._same_size(still_stack.shape, stack, "experiment.still_frames",
                            "record them with the image window of the test, and crop them alike")
            check_depth(still_stack, stack, file, "experiment.still_frames")
            check_height_unit(still_stack, table.height_unit, file, "experiment.still_frames")
        elif table.still_frames:
            still = indices(table.still_frames, "still_frames")
        n_still = len(still) if still_stack is None else still_stack.n_frames
        if table.still_frames is not None and n_still < 2:
            raise InputError("too few still frames", file=file, key="experiment.still_frames",
                             expected="two or more, taken at rest", found=str(n_still),
                             remedy="name at least two, or leave the key out")
        return still, still_stack

    def mask(self, stack: FileStack) -> np.ndarray | None:
        """True where a pixel may be correlated  # (ny, nx) bool"""
        name, key = self.config.experiment.mask, "experiment.mask"
        if name is None:
            return None
        mask = self.painted(name) > 0
        self._same_size(mask.shape, stack, key, "make it from the reference image")
        if not mask.any():
            raise InputError("the mask is all black", file=self.file, key=key,
                             expected="white where the image is to be correlated", found="no pixel above zero",
                             remedy="paint the region of interest white")
        return mask

    def painted(self, name: str) -> np.ndarray:
        """The mask as it was painted, above zero where a pixel may be correlated  # (ny, nx)"""
        return read_image(existing_file(self.folder, name, file=self.file, key="experiment.mask"))

    def _same_size(self, shape, stack: FileStack, key: str, remedy: str) -> None:
        if tuple(shape) != tuple(stack.shape):
            raise InputError("the size differs from that of the images", file=self.file, key=key,
                             expected=f"{stack.shape[1]} x {stack.shape[0]} px",
                             found=f"{shape[1]} x {shape[0]} px", remedy=remedy)

    def log(self, frames: Frames) -> MatchedLog | None:
        """The log with one row per frame."""
        name = self.config.experiment.loads
        if name is None and isinstance(frames.stack, FieldStack):
            series_log = frames.stack.series.log()
            return None if series_log is None else series_log.match(frames.stack.n_frames, None, None)
        if name is None:
            return None
        if frames.recorded is not None:
            labels = frames.recorded.stack.labels
            log = self.recorded_log(name)
            times = self.image_times(len(labels))
            if times is None and len(log.rows) != len(labels):
                times = stage_times(frames.recorded.stack)
            stage_log = log.match(len(labels), FrameNames(labels).numbers, times)
            return stage_log.of_frames(frames.recorded.compared)
        log, times = self.recorded_log(name), self.image_times(frames.stack.n_frames)
        log.check_rows_of(frames.labels, "loads")
        if times is None and isinstance(frames.stack, FieldStack) and len(log.rows) != frames.stack.n_frames:
            times = stage_times(frames.stack)
        if times is None and (stated_times := self.stated_times(frames.stack)) is not None:
            if log.time_column is None or len(log.rows) != frames.stack.n_frames:
                times = stated_times
            else:
                log = with_time_note(log, stated_times)
        return log.match(frames.stack.n_frames, frames.numbers, times)

    def recorded_log(self, name: str) -> Log:
        """The log with the rows of the file."""
        log = Log.read(existing_file(self.folder, name, file=self.file, key="experiment.loads"),
                       self.config.experiment.decimal)
        image_times = self.image_times_table()
        return log if image_times is None else log.on_the_clock_of(image_times)

    def image_times_table(self) -> Log | None:
        """The file of `image_times`, as it stands there."""
        name = self.config.experiment.image_times
        if name is None:
            return None
        path = existing_file(self.folder, name, file=self.file, key="experiment.image_times")
        return Log.read(path, self.config.experiment.decimal)

    def frame_times(self, frames: Frames) -> np.ndarray | None:
        """Times of the frames that are compared in s, where [experiment] gives them  # (n_frames,)"""
        if frames.recorded is None:
            times = self.image_times(frames.stack.n_frames)
            return self.stated_times(frames.stack) if times is None else times
        times = self.image_times(frames.recorded.stack.n_frames)
        return None if times is None else times[list(frames.recorded.compared)]

    def stated_times(self, stack: FileStack | ArrayFrames | FieldStack | ScanFiles) -> np.ndarray | None:
        """Times of the frames that the files state, from `first_frame_s` on; None without  # (n_frames,) s"""
        times = stack.times_s if isinstance(stack, FileStack) else None
        if isinstance(stack, ScanFiles):
            return stack.times
        return None if times is None else self.config.experiment.first_frame_s + times

    def _check_complete(self, labels: tuple[str, ...]) -> None:
        """Refuse times by an interval where an image in between is missing."""
        if self.config.experiment.frame_interval_s is not None:
            FrameNames(labels).check_complete(file=self.file, key="experiment.frame_interval_s")

    def _order_notes(self, stack: FileStack | ArrayFrames) -> list[str]:
        """The reading of the file names, where it is not that of their digits from left to right."""
        if self.stated_order or not isinstance(stack, FileStack):
            return []
        reading = stack.reading_of_names(self.folder)
        return [] if not reading else [
            f"the images are in the order {stack.labels[0]}, {stack.labels[1]} … {stack.labels[-1]}: {reading}"]

    def _image_times_notes(self) -> list[str]:
        """How the file of the image times is read."""
        log = self.image_times_table()
        return [] if log is None else list(log.notes)

    def image_times(self, n_frames: int) -> np.ndarray | None:
        """Times of the images in s, where [experiment] gives them  # (n_frames,)"""
        table = self.config.experiment
        if table.frame_interval_s is not None:
            return table.first_frame_s + table.frame_interval_s * np.arange(n_frames)
        log = self.image_times_table()
        if log is None:
            return None
        path, times = log.file, log.times()
        if times is None:
            raise InputError("no times in the file", file=path, key="experiment.image_times",
                             expected="a column time_s, or one of times of day",
                             found="; ".join([", ".join(log.names), *log.unread]),
                             remedy="add the column")
        if len(times) != n_frames:
            raise InputError("the number of times differs from the number of images", file=path,
                             key="experiment.image_times", expected=f"{n_frames} rows, one per image",
                             found=f"{len(times)} rows", remedy="give one row per image in image order")
        return times

    def small_files(self) -> list[Path]:
        """All input files except the images."""
        table = self.config.experiment
        mask = None if table.volumes else table.mask
        files = [self.folder / name for name in (table.loads, table.mesh.file, mask, table.image_times)
                 if name is not None]
        if table.volumes and table.mask is not None:
            files += mask_files(self.folder, table.mask, self.file)
        return [*files, *camera_files(self.config, self.folder), *solver_files(self.config.solver, self.folder),
                *laws_of_user(self.config.material)]

    def still_files(self, frames: Frames) -> list[Path]:
        """Separate images of the specimen at rest, of all cameras."""
        entries = () if frames.still_stack is None else frames.still_stack.entries
        patterns = [table.still_frames for table in self.config.further_cameras if table.still_frames is not None]
        further_images = [path for pattern in patterns
                          for path in matching_files(self.folder, [pattern], file=self.file, key="camera")]
        return list(dict.fromkeys([*(entry.path for entry in entries), *further_images]))

    def identity(self, frames: Frames, files: Sequence[Path]) -> str:
        """The fingerprint of tables, files and images."""
        paths = dict.fromkeys(entry.path for entry in frames.stack.entries)
        infrared = temperature_images(self.config, self.folder, self.file)
        return fingerprint(self.raw, files, [*paths, *camera_images(self.config, self.folder), *infrared],
                           outside_law_files(self.config.material))


def laws_of_user(materials: Mapping[str, MaterialTable]) -> list[Path]:
    """The Python files that the laws of the materials come from; none for laws of this package."""
    sources = [source_of(table.law) for table in materials.values()]
    return list(dict.fromkeys(path for path in sources if path is not None))


def outside_law_files(materials: Mapping[str, MaterialTable]) -> list[str]:
    """What laws of the user are made of beside their files: helpers and tables of theirs, or all of a typed law."""
    laws, texts = all_laws(), []
    for name in sorted({table.law for table in materials.values()} & set(laws)):
        for update in laws[name].updates.values():
            if not update.__module__.startswith("idic."):
                texts.append(code_of(update) if source_of(name) is None else outside_values(update))
    return [text for text in texts if text]


def with_time_note(log: Log, stated_times: np.ndarray) -> Log:
    """The log with a note where its times go on at another pace than those that the image files state.

    log : with a row and a time per image; stated_times : (n_frames,) s
    """
    spans = [float(np.ptp(times)) for times in (log.times(), stated_times)]
    if abs(spans[0] - spans[1]) <= MAX_TIME_DIFFERENCE * max(spans):
        return log
    return replace(log, notes=(*log.notes, (
        f"{log.file.name}: its times span {spans[0]:.4g} s, those of the image files {spans[1]:.4g} s: those of "
        f"{log.file.name} are used, row by row. Leave the column {log.time_column} out, or correct one of the two")))


def stage_times(stack: FieldStack) -> np.ndarray | None:
    """Times of the stages as their system has recorded them; None where one has none  # (n_stages,) s"""
    times = [entry.time_s for entry in stack.entries]
    return None if any(time is None for time in times) else np.array(times, float)


def fingerprint(raw: Mapping, files: Iterable[Path], images: Iterable[Path], laws: Iterable[str] = ()) -> str:
    """sha256 of the tables (without title, [setup] and gauges), the small files, the name, size and ends of every
    image, and what laws are made of.

    Comments and spaces in an .inp file do not count.
    """
    tables = {name: value for name, value in raw.items() if name not in ("setup", *KINDS)}
    tables["experiment"] = {key: value for key, value in dict(raw.get("experiment", {})).items() if key != "title"}
    digest = hashlib.sha256(b"idic.experiment/1\n" + json.dumps(tables, sort_keys=True, default=str).encode())
    for path in files:
        digest.update(f"\nfile {path.name} ".encode() + _small_file(path))
    for path in images:
        facts = image_facts(path)
        size, ends = ends_of(path) if facts is None else (facts.size, facts.ends_sha256)
        digest.update(f"\nimage {path.name} {size} ".encode() + bytes.fromhex(ends))
    for text in laws:
        digest.update(f"\nlaw {text}".encode())
    return digest.hexdigest()


def ends_of(path: Path) -> tuple[int, str]:
    """Size of a file, and the sha256 of its ends; of a folder, over all of its files."""
    if path.is_dir():
        parts = [(file.relative_to(path), *ends_of(file)) for file in sorted(path.rglob("*")) if file.is_file()]
        names = repr([(str(name), size, ends) for name, size, ends in parts])
        return sum(size for _, size, _ in parts), hashlib.sha256(names.encode()).hexdigest()
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(_HASHED_AT_EACH_END)
        stream.seek(max(size - _HASHED_AT_EACH_END, 0))
        tail = stream.read(_HASHED_AT_EACH_END)
    return size, hashlib.sha256(head + tail).hexdigest()


def _small_file(path: Path) -> bytes:
    """sha256 of what of a file decides the result."""
    return hashlib.sha256(_without_comments(path, path.read_bytes())).digest()


def _without_comments(path: Path, content: bytes) -> bytes:
    """What of a file decides the result, as far as that is known without reading it as what it is."""
    if path.suffix.lower() != ".inp":
        return content
    lines = (b",".join(part.strip() for part in line.split(b",")) for line in content.splitlines())
    return b"\n".join(line for line in lines if line and not line.startswith(b"**"))
