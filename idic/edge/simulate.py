"""`idic simulate`: an experiment as the model predicts it - images, log, experiment file, truth - in a new folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from idic.correlation.rows import camera_at, channel_values
from idic.edge.config import load_experiment
from idic.edge.experiment_files import IMAGES, LOADS, empty_folder, write_images, write_loads, write_truth
from idic.edge.toml_file import locate, read_toml, with_overrides
from idic.edge.toml_writer import to_toml
from idic.edge.virtual_test import medium_speckle
from idic.errors import InputError
from idic.experiment import Column, Experiment, Measured, Parametrised
from idic.fe.mesh import surface_cells
from idic.forward import ForwardModel, build_forward, solve
from idic.virtual import Sensor, noisy_channel, render

DEFAULT_NOISE_GV = 2.0  # of 8 bit, where the experiment does not state its noise
BACKGROUND = 0.1  # of the grey levels
FRAME_KEYS = ("still_frames", "frame_interval_s", "first_frame_s", "image_times")  # they speak of the real images


def simulate(
    path: Path | str,
    out: Path | str,
    overrides: Mapping[str, object] | None = None,
    bits: int = 8,
    noise_std_gv: float | None = None,
    seed: int = 0,
) -> Path:
    """Write the virtual experiment that the model of an experiment predicts with its own parameter values.

    Parameters
    ----------
    path : path
        The experiment (folder or TOML file) to imitate: its mesh, drives, camera, image size and times are used.
    out : path
        New folder.
    overrides : mapping, optional
        ``--set key=value``: the truth, where it is not what the file says.
    bits : int
        8, 12 or 16.
    noise_std_gv : float, optional
        Camera noise; default: the experiment's, else 2 grey values of 8 bit.

    Returns
    -------
    Path
        The new experiment.toml. Its starting values are the truth: move them before identifying.

    Raises
    ------
    InputError
        If the motion of an edge is "measured" or made of measured modes (there is nothing to measure it from), or the images are height maps.
    NotConverged
        If the simulation does not reach the end.
    """
    experiment = load_experiment(path, overrides)
    _check(experiment)
    forward = build_forward(experiment)
    solution = solve(forward, experiment.parameters)
    sensor = _sensor(experiment, bits, noise_std_gv)
    folder = empty_folder(out)
    speckle_rng, camera_rng, channel_rng = np.random.default_rng(seed).spawn(3)
    camera = camera_at(experiment, experiment.parameters)
    texture = medium_speckle(camera, sensor.shape)(speckle_rng, 2.0**bits)
    cells = surface_cells(experiment.mesh, experiment.surface)
    still = [np.zeros_like(solution.u[0])] * experiment.reference
    write_images(
        folder, render([*still, *solution.u], experiment.mesh.nodes, cells, camera, texture, sensor, camera_rng)
    )
    write_loads(folder, experiment.times, _columns(experiment, forward, solution.channels, channel_rng))
    _write_toml(locate(path), overrides, experiment, sensor, folder)
    truth = {p.name: p.shown for p in experiment.parameters.values() if p.free}
    write_truth(folder, truth, sensor.total_noise_std, added_noise_std_gv=sensor.noise_std, seed=seed, bits=bits)
    return folder / "experiment.toml"


def _check(experiment: Experiment) -> None:
    measured = [p for p in experiment.prescribed
                if isinstance(p.drive, Measured) or (isinstance(p.drive, Parametrised) and p.drive.kind == "dic")]
    if measured:
        raise InputError(
            f"the motion of {measured[0].nodes} is to be measured, so there is nothing to simulate it from",
            key=f"boundary {measured[0].nodes}.u{measured[0].component}",
            expected="a number, a column or a virtual boundary",
            found='"measured"' if isinstance(measured[0].drive, Measured) else '{ virtual = "dic" }',
            remedy='give the motion, for instance uy = { column = "grip_displacement_mm" }',
        )
    if experiment.quantity != "grey":
        raise InputError(
            "virtual height maps are not available yet",
            key="experiment.quantity",
            expected='"grey"',
            found=experiment.quantity,
        )


def _sensor(experiment: Experiment, bits: int, noise_std_gv: float | None) -> Sensor:
    levels = 2.0**bits
    if noise_std_gv is None:
        noise_std_gv = experiment.noise.std_gv or DEFAULT_NOISE_GV * levels / 256.0
    return Sensor(experiment.stack.shape, bits=bits, noise_std=noise_std_gv, background=BACKGROUND * levels)


def _columns(
    experiment: Experiment, forward: ForwardModel, simulated: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Every column of the new log: the channels as simulated, the drives as they were, both with their noise."""
    columns: dict[str, np.ndarray] = {}
    drives = [*(p.drive for p in experiment.prescribed), *(load.drive for load in experiment.loads)]
    for drive in drives:
        if isinstance(drive, Column):
            columns[drive.column] = noisy_channel(drive.values, drive.noise_std, rng)
    values = np.zeros((experiment.n_frames, len(experiment.channels)))
    for i, frame in enumerate(forward.frames):
        values[frame] = channel_values(experiment, experiment.parameters, simulated[i], frame)
    for i, channel in enumerate(experiment.channels):
        columns[channel.column] = noisy_channel(values[:, i], channel.noise_std or 0.0, rng)
    return columns


def _write_toml(source: Path, overrides, experiment: Experiment, sensor: Sensor, folder: Path) -> None:
    """The experiment file of the new folder, and the files that it names."""
    raw = with_overrides(read_toml(source), overrides)
    table = {key: value for key, value in raw["experiment"].items() if key not in FRAME_KEYS}
    table |= {
        "images": f"{IMAGES}/*.tif",
        "loads": LOADS,
        "reference": experiment.reference,
        "exclude_frames": list(experiment.excluded),
    }
    for key in ("mesh", "mask"):
        name = table.get(key, {}).get("file") if isinstance(table.get(key), dict) else table.get(key)
        if name:
            target = folder / Path(name).name
            shutil.copy(source.parent / name, target)
            table[key] = (table[key] | {"file": target.name}) if isinstance(table[key], dict) else target.name
    raw["experiment"] = table
    raw["camera"] = dict(_camera_table(raw)) | {"noise_std_gv": round(sensor.total_noise_std, 4)}
    head = f"# Virtual experiment, simulated by idic from {experiment.title}. Its parameter values are the truth.\n\n"
    (folder / "experiment.toml").write_text(head + to_toml(raw), encoding="utf-8")


def _camera_table(raw: Mapping) -> Mapping:
    camera = raw.get("camera", {})
    return camera[0] if isinstance(camera, list) else camera
