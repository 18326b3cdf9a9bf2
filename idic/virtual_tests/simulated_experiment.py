"""`idic simulate`: an experiment as the model predicts it - images or scans, log, experiment file, truth - in a new
folder."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic.correlation import camera_at, channel_values, view_of
from idic.errors import InputError
from idic.experiment_file import DesignTable, locate, read_toml, recorded, to_toml, with_copied_images, with_overrides
from idic.images import AnyCamera, PlacedCamera, sensor_levels
from idic.model import Column, Controlled, Experiment, ForwardModel, Measured, Model, Parametrised, build_forward, solve
from idic.readers import parse_unit, unit_in_name
from idic.identification import DOT_SIGMA_PER_SPECKLE, chooses_increments, planned_speckle, recorded_or_planned
from idic.virtual_tests.experiment_files import (
    IMAGES, LOADS, SCANS, empty_folder, write_images, write_loads, write_scan, write_truth,
)
from idic.virtual_tests.rendering.render import Sensor, noisy_channel, record, render
from idic.virtual_tests.stereo_images import common_speckle, traced_images
from idic.virtual_tests.solid_speckle import PERIOD_CELLS, SolidSpeckle
from idic.virtual_tests.section_images import height_image, roughness, seen_section
from idic.virtual_tests.tomograms.simulated_scans import ScanGrey, scan_grey, simulated_scans
from idic.virtual_tests.virtual_test import medium_speckle, rough_surface, stated_speckle, with_contrast

INCREMENTS = 8  # per frame, extrapolated from these and half as many, where the experiment leaves the choice
DEFAULT_NOISE_GV = 2.0  # of 8 bit, where the experiment does not state its noise
SECTION_LENGTH_PX = 6.0  # correlation length of the roughness on a cross-section
HEIGHT_NOISE_SHARE = 0.01  # of the roughness
MIN_NOISE = 1e-4  # of the roughness: error of float32 and a spline on noise-free heights
SOLVER = "solver"  # folder of the template and files of an external solver
SCAN_SPECKLE_PX = 4.0  # of scans without a plan: as the default of [design]
MASK = "mask.npy"  # of scans
BACKGROUND_SHARE = 0.1  # of the grey levels
TIME_OFFSET = "time.offset"  # the new log is on time
RECORDING_KEYS = ("still_frames", "frame_interval_s", "first_frame_s", "image_times", "decimal")  # of the real files


def simulate(
    path: Path | str,
    out: Path | str,
    overrides: Mapping[str, Any] | None = None,
    bits: int = 8,
    noise_std_gv: float | None = None,
    seed: int = 0,
) -> Path:
    """Write the virtual experiment that the model of an experiment predicts with its own parameter values.

    Parameters
    ----------
    path : path
        The experiment (folder or TOML file) to imitate: its mesh, drives, camera, image size and times are used, and
        the speckle of [design] where there is no image.
    out : path
        New folder.
    overrides : mapping, optional
        ``--set key=value``: the truth, where it is not what the file says.
    bits : int
        8, 12 or 16; height images are always 32-bit float.
    noise_std_gv : float, optional
        Noise of a pixel or voxel; default: the experiment's, as the same share of the range of grey values, else 2
        grey values of 8 bit (1 % of the roughness for heights).

    Returns
    -------
    Path
        The new experiment.toml. Its starting values are the truth: move them before identifying.

    Raises
    ------
    InputError
        If the motion of an edge is "measured" or made of measured modes (there is nothing to measure it from), or the
        experiment has measured fields in place of images.
    NotConverged
        If the simulation does not reach the end.
    """
    experiment = recorded_or_planned(path, overrides)
    _check(experiment)
    forward = build_forward(experiment)
    solution = solve(forward, experiment.model.parameters,
                     increments=INCREMENTS if chooses_increments(experiment) else None)
    bits = 0 if experiment.recording.quantity == "height" else bits
    planned = planned_speckle(path, overrides)
    speckle_rng, camera_rng, channel_rng = np.random.default_rng(seed).spawn(3)
    motion = [*[np.zeros_like(solution.u[0])] * experiment.model.reference, *solution.u]
    sensors: list[Sensor] = []
    if experiment.recording.quantity == "volume":
        grey = scan_grey(experiment, bits, noise_std_gv, planned)
        folder = empty_folder(out, SCANS)
        _write_scans(folder, experiment, motion, grey, planned, speckle_rng, camera_rng)
        added_gv, total_gv = grey.noise_gv, grey.total_noise_gv
    else:
        sensors = [_sensor(view, bits, noise_std_gv, planned is not None) for view in experiment.views]
        folder = empty_folder(out)
        _write_views(folder, experiment, motion, sensors, bits, speckle_rng, camera_rng, planned)
        added_gv, total_gv = sensors[0].noise_std, sensors[0].total_noise_std
    columns = _columns(experiment, forward, solution.channels, channel_rng)
    in_log = {name: unit for name, unit in experiment.recording.column_units.items() if unit}
    column_units = in_log | _stated_units(with_overrides(read_toml(locate(path)), overrides))
    write_loads(folder, experiment.model.times,
                {name: values / _factor(name, column_units) for name, values in columns.items()},
                {name: column_units[name] for name in columns if name in in_log and unit_in_name(name) is None})
    _write_toml(locate(path), overrides, experiment, sensors, total_gv, folder)
    truth = {p.name: 0.0 if p.name == TIME_OFFSET else p.shown for p in experiment.model.parameters.values() if p.free}
    write_truth(folder, truth, total_gv, added_noise_std_gv=added_gv, seed=seed, bits=bits)
    return folder / "experiment.toml"


def _write_scans(folder: Path, experiment: Experiment, motion: Sequence[np.ndarray], grey: ScanGrey,
                 planned: DesignTable | None, texture_rng: np.random.Generator,
                 noise_rng: np.random.Generator) -> None:
    """Write a scan for each of the nodal displacements `motion` (n_nodes, 3) mm, and the mask where there is one."""
    size_px = SCAN_SPECKLE_PX if planned is None else planned.speckle_px
    speckle = SolidSpeckle.drawn(texture_rng, DOT_SIGMA_PER_SPECKLE * size_px)
    texture = with_contrast(speckle, grey.contrast_gv, 0.5 * 2.0**grey.bits, 1.0,
                            np.full(3, PERIOD_CELLS * speckle.cell_mm))
    for k, (tomograph, planes) in enumerate(simulated_scans(experiment, motion, grey, texture.value, noise_rng)):
        write_scan(folder / SCANS / f"scan_{k:03d}.tif", planes, tomograph.shape, tomograph.dtype, tomograph.voxel_mm)
    if experiment.voxel_mask is not None:
        everywhere = [slice(0, n) for n in experiment.recording.volumes.shape]
        np.save(folder / MASK, experiment.voxel_mask(*everywhere).astype(np.uint8))


def _write_views(folder: Path, experiment: Experiment, motion: Sequence[np.ndarray], sensors: Sequence[Sensor],
                 bits: int, speckle_rng: np.random.Generator, camera_rng: np.random.Generator,
                 planned: DesignTable | None) -> None:
    """Write the images of all cameras; motion : of the nodes (n_nodes, dim) mm, frame by frame"""
    camera = camera_at(experiment, experiment.model.parameters)
    speckle = common_speckle([view.model.camera for view in experiment.views], speckle_rng, 2.0**bits, planned)
    write_images(folder, _images(experiment, camera, motion, sensors[0], bits, speckle_rng, camera_rng, speckle,
                                 planned))
    for view, sensor in zip(experiment.views[1:], sensors[1:], strict=True):
        (folder / view.recording.camera_name).mkdir()
        write_images(folder, _images(view, camera_at(view, experiment.model.parameters),
                                     [view.model.turned(u) for u in motion], sensor, bits, speckle_rng, camera_rng,
                                     speckle, planned), view.recording.camera_name)


def _images(experiment: Experiment, camera: AnyCamera, motion: Sequence[np.ndarray], sensor: Sensor, bits: int,
            speckle_rng: np.random.Generator, camera_rng: np.random.Generator,
            speckle: SolidSpeckle | None = None, planned: DesignTable | None = None) -> Iterator[np.ndarray]:
    """The images of the nodal displacements `motion` (n_nodes, dim) mm, one at a time; the speckle as it is planned."""
    model = experiment.model
    rise, mesh = None, model.mesh
    if isinstance(camera, PlacedCamera):
        yield from traced_images(mesh, model.surface, camera, motion, sensor, camera_rng, speckle)
        return
    if experiment.recording.quantity == "height":
        rise = view_of(experiment, camera).rise
        if model.is_section:
            yield from _section_images(experiment, camera, motion, sensor, rise, speckle_rng, camera_rng)
            return
        texture = rough_surface(camera, sensor.shape, _roughness(experiment))(speckle_rng)
    elif planned is not None:
        texture = stated_speckle(camera, sensor.shape, planned.speckle_px, planned.contrast_gv)(speckle_rng, 2.0**bits)
    else:
        texture = medium_speckle(camera, sensor.shape)(speckle_rng, 2.0**bits)
    cells = mesh.surface_cells(model.surface)
    for frame, u in enumerate(motion):
        yield from render([u], mesh.nodes, cells, camera.at(frame), texture, sensor, camera_rng, rise)


def _section_images(experiment, camera, motion, sensor, rise, speckle_rng, camera_rng):
    """Height images of a cross-section: lengths in the unit of the heights."""
    model = experiment.model
    scale, (ny, nx) = 1.0 / experiment.recording.height_unit, sensor.shape
    pixel = scale * camera.pixel_size
    pattern = roughness(speckle_rng, _roughness(experiment), SECTION_LENGTH_PX * pixel)
    column = scale * camera.inverse(np.column_stack([np.arange(nx), np.zeros(nx)]))[:, 0]
    for u in motion:
        section = seen_section(model.mesh, model.surface, u, scale, rise, model.symmetry is not None)
        yield record(height_image(section, pattern, column, -pixel * np.arange(ny)), sensor, camera_rng)


def _check(experiment: Experiment) -> None:
    model, recording = experiment.model, experiment.recording
    if recording.points is not None:
        raise InputError(
            "the fields of another DIC system cannot be simulated",
            key="experiment.fields",
            expected="an experiment with images",
            found=recording.in_words(),
            remedy="describe camera and mesh of the test with images; idic design predicts the error bars of fields",
        )
    measured = [p for p in model.prescribed
                if isinstance(p.drive, Measured) or (isinstance(p.drive, Parametrised) and p.drive.kind == "dic")]
    if measured:
        raise InputError(
            f"the motion of {measured[0].nodes} is to be measured, so there is nothing to simulate it from",
            key=f"boundary {measured[0].nodes}.u{measured[0].component}",
            expected="a number, a column or a virtual boundary",
            found='"measured"' if isinstance(measured[0].drive, Measured) else '{ virtual = "dic" }',
            remedy='give the motion, for instance uy = { column = "grip_displacement_mm" }',
        )
    if model.is_section and recording.quantity != "height":
        raise InputError(
            "grey images of a cross-section seen from above cannot be simulated",
            key="experiment.surface",
            expected='a plane specimen, a solid with its face set, or quantity = "height"',
            found=f"kind = {model.kind!r} with the edge set {model.surface}",
            remedy="leave surface out, or simulate height images",
        )


def _sensor(experiment: Experiment, bits: int, noise_std_gv: float | None, planned: bool = False) -> Sensor:
    """planned : the noise is stated in grey values of the images that are written"""
    recording = experiment.recording
    levels = 2.0**bits
    if recording.quantity == "height":  # a height is taken at a point, not gathered over the area of a pixel
        std = noise_std_gv if noise_std_gv is not None else recording.noise.std_gv
        std = HEIGHT_NOISE_SHARE * _roughness(experiment) if std is None else std
        return Sensor(recording.stack.shape, bits=0, noise_std=std, supersampling=1)
    if noise_std_gv is None:
        noise_of_file = recording.noise.std_gv
        image = np.asarray(recorded(recording.stack).frame(experiment.model.reference))
        factor = 1.0 if planned else levels / sensor_levels(image)
        noise_std_gv = factor * noise_of_file if noise_of_file else DEFAULT_NOISE_GV * levels / 256.0
    return Sensor(recording.stack.shape, bits=bits, noise_std=noise_std_gv, background=BACKGROUND_SHARE * levels)


def _roughness(experiment: Experiment) -> float:
    """Standard deviation of the reference heights about their mean plane, in their unit; of flat ones: one pixel."""
    image = np.asarray(experiment.recording.stack.frame(experiment.model.reference), dtype=float)
    row, column = np.nonzero(np.isfinite(image))
    plane = np.column_stack([np.ones(len(row)), row, column])
    heights = image[row, column]
    rms = float(np.std(heights - plane @ np.linalg.lstsq(plane, heights, rcond=None)[0]))
    pixel = experiment.model.camera.pixel_size / experiment.recording.height_unit
    return rms if rms > 1e-6 * pixel else pixel


def _columns(
    experiment: Experiment, forward: ForwardModel, simulated: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Every column of the new log in internal units: channels and drives as simulated, with their noise."""
    model = experiment.model
    columns: dict[str, np.ndarray] = {}
    drives = (*model.drives, *(entry.drive for entry in model.temperatures))
    for number, drive in enumerate(drives):
        is_motion = number < len(model.prescribed)
        if isinstance(drive, Column):
            course = _on_time(model, drive.values, drive.rates, is_motion)
            columns[drive.column] = noisy_channel(course, drive.noise_std, rng)
        elif isinstance(drive, Controlled):
            columns[drive.column] = _on_time(model, drive.course, drive.rates, True)
    values = np.zeros((model.n_frames, len(model.channels)))
    for i, frame in enumerate(forward.frames):
        values[frame] = channel_values(experiment, model.parameters, simulated[i], frame)
    for i, channel in enumerate(model.channels):
        columns[channel.column] = noisy_channel(values[:, i], channel.noise_std or 0.0, rng)
    return columns


def _on_time(model: Model, values: np.ndarray, rates: np.ndarray | None, is_motion: bool) -> np.ndarray:
    """A logged course at `time.offset`; a motion counts from the reference frame  # (n_frames,)"""
    shift = model.log_shift(model.parameters)
    if rates is None or not shift:
        return values
    late = model.rates_since_reference(rates).copy() if is_motion else rates
    if is_motion:
        late[model.reference] = 0.0
    return values + shift * late


def _stated_units(tables: object) -> dict[str, str]:
    """Units that the experiment file gives to columns of the log, ``{ column = "grip", unit = "um" }``."""
    units: dict[str, str] = {}
    for below in tables.values() if isinstance(tables, dict) else tables if isinstance(tables, list) else ():
        units |= _stated_units(below)
    if isinstance(tables, dict) and isinstance(tables.get("column"), str) and isinstance(tables.get("unit"), str):
        units[tables["column"]] = tables["unit"]
    return units


def _factor(column: str, column_units: Mapping[str, str]) -> float:
    """Internal units per unit of a column of the log, as stated, or by the end of its name."""
    unit = parse_unit(column_units.get(column) or unit_in_name(column) or "")
    return 1.0 if unit is None else unit.factor


def _write_toml(source: Path, overrides, experiment: Experiment, sensors: Sequence[Sensor], noise_gv: float,
                folder: Path) -> None:
    """The experiment file of the new folder, and the files that it names; noise_gv : of the images, in all"""
    raw = with_overrides(read_toml(source), overrides)
    is_volume = experiment.recording.quantity == "volume"
    table = {key: value for key, value in raw["experiment"].items() if key not in RECORDING_KEYS}
    if is_volume:
        table.pop("mask", None)
        table |= {"mask": MASK} if experiment.voxel_mask is not None else {}
    table |= {
        **({"volumes": f"{SCANS}/*.tif"} if is_volume else {"images": f"{IMAGES}/*.tif"}),
        "loads": LOADS,
        "reference": experiment.model.reference,
        "exclude_frames": list(experiment.recording.excluded),
    }
    for key in ("mesh",) if is_volume else ("mesh", "mask"):
        name = table.get(key, {}).get("file") if isinstance(table.get(key), dict) else table.get(key)
        if name:
            target = folder / Path(name).name
            shutil.copy(source.parent / name, target)
            table[key] = (table[key] | {"file": target.name}) if isinstance(table[key], dict) else target.name
    raw["experiment"] = table
    raw["boundary"] = with_copied_images(raw.get("boundary", []), source.parent, folder, source)
    if is_volume:
        scanner = {key: value for key, value in raw.get("scanner", {}).items() if key != "air_below_gv"}
        raw["scanner"] = scanner | {"noise_std_gv": float(f"{noise_gv:.4g}")}
    else:
        raw["camera"] = _camera_tables(raw, experiment, sensors, source, folder)
    if "dof" in raw:
        raw["dof"] = [entry | {"value": 0.0} if entry["name"] == TIME_OFFSET else entry for entry in raw["dof"]]
    if "solver" in raw:
        raw["solver"] = _with_solver_files(raw["solver"], source.parent, folder)
    head = f"# Virtual experiment, simulated by idic from {experiment.title}. Its parameter values are the truth.\n\n"
    (folder / "experiment.toml").write_text(head + to_toml(raw), encoding="utf-8")


def _with_solver_files(table: Mapping, source: Path, folder: Path) -> dict:
    """[solver] with its template and files in a folder of their own; their names differ, as they meet in a run."""
    (folder / SOLVER).mkdir()
    for name in (table["template"], *table.get("files", ())):
        shutil.copy(source / name, folder / SOLVER)
    files = {"files": [f"{SOLVER}/{Path(name).name}" for name in table["files"]]} if "files" in table else {}
    return dict(table) | files | {"template": f"{SOLVER}/{Path(table['template']).name}"}


def _camera_tables(raw: Mapping, experiment: Experiment, sensors: Sequence[Sensor], source: Path,
                   folder: Path) -> dict | list[dict]:
    """[camera], or all of [[camera]], with the noise that was added and the new places of images and masks."""
    raw_cameras = raw.get("camera", {})
    tables = [dict(table) for table in (raw_cameras if isinstance(raw_cameras, list) else [raw_cameras])]
    copied: dict[Path, str] = {}  # calibration files by their old places
    for number, (table, view, sensor) in enumerate(zip(tables, experiment.views, sensors, strict=True)):
        if "calibration" in table:
            calibration = source.parent / table["calibration"]
            if calibration not in copied:
                is_used = calibration.name in copied.values()
                camera_name = view.recording.camera_name
                copied[calibration] = f"{camera_name}_{calibration.name}" if is_used else calibration.name
                shutil.copy(calibration, folder / copied[calibration])
            table["calibration"] = copied[calibration]
        std = sensor.total_noise_std or MIN_NOISE * _roughness(view)
        table["noise_std_gv"] = float(f"{std:.4g}")
        table.pop("noise_model", None)  # the noise that was added is even
        if number:
            table["images"] = f"{view.recording.camera_name}/*.tif"
            table.pop("still_frames", None)
            if "mask" in table:
                mask = Path(table["mask"])
                table["mask"] = f"{view.recording.camera_name}_{mask.name}"
                shutil.copy(source.parent / mask, folder / table["mask"])
    return tables if isinstance(raw_cameras, list) else tables[0]
