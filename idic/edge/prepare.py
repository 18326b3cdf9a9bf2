"""Before the first simulation: images into the RUN, noise of images and channels, a free FE-DIC where it is needed.

What is found is written to ``RUN/run.json`` and ``run.zarr/prepared`` once; workers and a resumed run read it there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.correlation.rows import build_reference, camera_at
from idic.drives import build_drives
from idic.edge.checkpoint import save_checkpoint
from idic.edge.config import load_experiment
from idic.edge.runner import TaskRunner
from idic.edge.tasks import DESCRIPTION, DESCRIPTION_SCHEMA
from idic.edge.zarr_arrays import read_array, write_array
from idic.edge.zarr_stack import ZarrStack
from idic.edge.zarr_store import RunStore
from idic.errors import InputError
from idic.experiment import Experiment, Measured
from idic.forward import build_forward
from idic.identify.channel_noise import channel_noise
from idic.identify.in_memory import gradient_noise_share
from idic.identify.stages import resolve_stages


def check_before_writing(experiment: Experiment) -> None:
    """Everything that can be found wrong without a simulation, before a RUN folder is made.

    Raises
    ------
    InputError
        No images, nothing to identify, sets or constraints that make no model, a mesh that is not in the image.
    """
    if experiment.stack is None:
        raise InputError("there are no images", file="experiment.toml", key="[experiment] images",
                         expected="a folder of TIFF or PNG images", found="nothing",
                         remedy='write for example  images = "images/*.tif"')
    resolve_stages(experiment)
    build_forward(experiment)
    build_reference(experiment, camera_at(experiment, experiment.parameters))


def ingest(store: RunStore, experiment: Experiment, progress: Callable[[int, int], None] | None = None) -> ZarrStack:
    """Copy the images into the RUN (nothing happens where they are there)."""
    return store.ingest(experiment.stack, progress, source=experiment.identity)


def needs_free_dic(experiment: Experiment) -> bool:
    """Whether motion or noise must first be measured from the images alone."""
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.prescribed)
    return measured or experiment.noise.std_gv is None


def prepare(run: str, path: str, overrides: dict, runner: TaskRunner) -> None:
    """Noise, weights and starting values of the frame-local unknowns, written to the RUN.

    Raises
    ------
    InputError
        If the model cannot be built from the experiment.
    """
    store = RunStore(run)
    experiment = replace(load_experiment(path, overrides), stack=ZarrStack(store.group("images")))
    std, source, excluded = experiment.noise.std_gv, experiment.noise.source, list(experiment.excluded)
    if needs_free_dic(experiment) and store.finished("dic") is None:
        runner.map(run_free_dic, [(run, path, overrides)], ["free-dic"], retries=1)
    with store.building("prepared") as folder:
        local = np.zeros((experiment.n_frames, build_drives(experiment).n_local))
        if needs_free_dic(experiment):
            found = read_free_dic(store)
            excluded += [int(k) for k in np.flatnonzero(found["unexplained"]) if int(k) not in excluded]
            local = measured_start(experiment, found["u_px"], excluded)
            if std is None:
                std, source = float(found["noise_gv"]), "residual_of_free_dic"
        write_array(folder, "local", local)
    seen = std * np.sqrt(gradient_noise_share(experiment))  # the blur lowers what a sum against the gradient sees
    noises = [channel.noise_std or channel_noise(channel.values) for channel in experiment.channels]
    write_description(run, {
        "experiment": str(Path(path).resolve()), "overrides": overrides, "identity": experiment.identity,
        "excluded": sorted(excluded), "excluded_by_user": list(experiment.excluded),
        "noise": {"std_gv": std, "source": source},
        "channel_noise_source": ["given" if channel.noise_std
                                 else "third differences" for channel in experiment.channels],
        "weights": {"kind": "noise" if experiment.options.weighting == "noise" else "paper (not yet scaled)",
                    "image": 1.0 / (2.0 * seen**2), "image_noise": seen,
                    "channels": [1.0 / noise**2 for noise in noises], "channel_noise": noises},
    })


def write_description(run: str | Path, description: dict) -> None:
    """Replace ``RUN/run.json`` whole."""
    save_checkpoint(Path(run) / DESCRIPTION, DESCRIPTION_SCHEMA, description)


def measured_start(experiment: Experiment, u_px: np.ndarray, excluded) -> np.ndarray:
    """Start of the frame-local unknowns from a free FE-DIC: nodal motion on the measured edges, zero elsewhere.

    u_px : (n_frames, n_nodes, 2) px, NaN where a node was not seen or a frame was lost. Returns (n_frames, m) mm.
    """
    drives = build_drives(experiment)
    local = np.zeros((experiment.n_frames, drives.n_local))
    if not drives.measured.any():
        return local
    back = np.linalg.inv(experiment.camera.jacobian(experiment.mesh.nodes))  # (n_nodes, 2, 2) mm/px
    u = np.einsum("nij,tnj->tni", back, u_px)
    rows = {drive: int(np.flatnonzero(drives.basis[:, drive])[0]) for drive, _ in
            zip(drives.local, drives.measured, strict=True) if drives.basis[:, drive].any()}
    good = [k for k in range(experiment.n_frames) if k not in excluded and np.isfinite(u[k]).any()]
    for column, (drive, is_measured) in enumerate(zip(drives.local, drives.measured, strict=True)):
        if is_measured:
            node, component = divmod(int(drives.dofs[rows[drive]]), experiment.n_dim)
            series = u[good, node, component]
            seen = np.isfinite(series)
            if seen.any():
                local[:, column] = np.interp(np.arange(experiment.n_frames), np.array(good)[seen], series[seen])
    return local


def run_free_dic(job: tuple[str, str, dict]) -> None:
    """Free FE-DIC over all frames on the experiment's mesh into ``run.zarr/dic`` (a task)."""
    from idic.dic import dic_stack

    run, path, overrides = job
    store = RunStore(run)
    experiment = replace(load_experiment(path, overrides), stack=ZarrStack(store.group("images")))
    found = dic_stack(experiment)
    with store.building("dic") as folder:
        write_array(folder, "u_px", found.u_px)
        write_array(folder, "rms_gv", found.rms_gv)
        write_array(folder, "chi2_dof", found.chi2_dof)
        write_array(folder, "unexplained", np.array([status == "unexplained" for status in found.status]))
        write_array(folder, "noise_gv", np.array([found.noise_gv]))


def read_free_dic(store: RunStore) -> dict[str, np.ndarray]:
    """What `run_free_dic` stored; noise_gv as a number."""
    folder = store.group("dic")
    found = {name: read_array(folder, name) for name in ("u_px", "rms_gv", "chi2_dof", "unexplained", "noise_gv")}
    return found | {"noise_gv": float(found["noise_gv"][0])}
