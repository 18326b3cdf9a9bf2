"""Before the first simulation: images into the RUN, noise of images and channels, a free FE-DIC where it is needed.

``RUN/run.json`` and ``run.zarr/prepared`` hold the outcome; workers and a resumed run read it there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from idic.correlation import build_experiment_reference, camera_at
from idic.errors import InputError
from idic.experiment_file import corners_px, load_experiment, recorded, seen_nodes, seen_region, visible_cells
from idic.identification import (
    check_method, check_volume_axes, measured_nodes, motion_in_space, needs_free_dic, needs_motion_in_space,
    noise_weights, regularisation_of, resolve_stages,
)
from idic.images import Stack
from idic.measure import FrameSequence, virtual_boundaries
from idic.model import Experiment, Measured, Parametrised, build_forward
from idic.path_names import path_name
from idic.readers import FieldStack, FileStack, check_stages
from idic.run.prepared.measured_beginning import (
    FreeMotion, beginning_of, camera_noises, cameras_to_measure, motion_of_volumes,
)
from idic.run.store.arrays import FrameArrays, read_array, write_array
from idic.run.store.camera_groups import group_of, ingest_all, noise_entry, with_stored_images
from idic.run.store.checkpoint import save_checkpoint, to_hex
from idic.run.store.layout import DESCRIPTION, DESCRIPTION_SCHEMA, stored_frames
from idic.run.store.run_store import RunStore
from idic.run.store.stack import Ingested, IngestJob
from idic.run.workers.runner import TaskRunner

BYTES_FOR_WORKERS = 200_000_000  # half a second of one process; less is not worth the wait for the workers


def check_before_writing(experiment: Experiment) -> None:
    """Check the experiment as far as that is possible without a simulation, before a RUN folder is made.

    Raises
    ------
    InputError
        No images, images in another order than that of time, nothing to identify,
        sets or constraints that make no model, a mesh that is not in the image, modes
        to be measured on an edge that is not in the image.
    """
    model, recording = experiment.model, experiment.recording
    if recording.stack is None:
        raise InputError("there are no images", file="experiment.toml", key="[experiment] images",
                         expected="a folder of TIFF or PNG images", found="nothing",
                         remedy='write for example  images = "images/*.tif"')
    _check_heights(experiment)
    if isinstance(recording.stack, FieldStack):
        check_stages(recording.stack, [k for k in range(model.n_frames) if k not in recording.excluded])
    check_method(experiment)
    resolve_stages(experiment)
    build_forward(experiment)
    if model.solver is not None:
        model.solver.require_ready()
    reference, *_ = [build_experiment_reference(view, camera_at(view,
    model.parameters)) for view in experiment.views]
    if recording.quantity != "volume":  # they show every node in space
        _check_measurable(experiment, reference.pixel_map.visible_nodes)
    check_volume_axes(experiment)
    _check_sequences(experiment)


def _check_sequences(experiment: Experiment) -> None:
    """Refuse images whose motion contradicts the order of their names, and cameras whose images of one number show
    different moments; a single camera without an order to confirm is not read."""
    sequences = [_sequence(view) if len(experiment.cameras) or FrameSequence.has_order_to_confirm(view) else None
                 for view in experiment.views if view.recording.quantity != "volume"]
    main, *further_cameras = sequences or [None]
    for sequence in sequences:
        if sequence is not None:
            sequence.check_order()
    for sequence in further_cameras:
        if main is not None and sequence is not None:
            sequence.late_against(main)


def _sequence(view: Experiment) -> FrameSequence:
    """The images of one camera, on the specimen."""
    model, recording = view.model, view.recording
    points, cells = seen_nodes(model.mesh, model.kind, model.surface)
    visible = visible_cells(model.mesh, model.kind, model.surface, model.camera, recording.image_shape)
    corners = corners_px(points, cells, model.kind, model.surface, model.camera)
    return FrameSequence.of(view, seen_region(corners, visible, recording.image_shape, recording.mask))


def _check_heights(experiment: Experiment) -> None:
    """Refuse height images where a free FE-DIC would be needed, which reads grey images only."""
    if experiment.recording.quantity != "height":
        return
    if experiment.recording.noise.std_gv is None:
        raise InputError("the noise of the height images is not known", file="experiment.toml",
                         key="camera.noise_std_gv", expected="the standard deviation of one image, in height_unit",
                         found="neither noise_std_gv nor still_frames",
                         remedy="give one of them: two images of the specimen at rest are enough")
    for entry in experiment.model.prescribed:
        if isinstance(entry.drive, Measured) or (isinstance(entry.drive, Parametrised) and entry.drive.kind == "dic"):
            raise InputError("an edge motion that is to be measured, but height images", file="experiment.toml",
                             key=f"[[boundary]] nodes = {entry.nodes}, u{entry.component}",
                             expected="a number, a column, or a virtual boundary",
                             found="a motion measured from the images",
                             remedy='give it, or identify it by { virtual = "bspline" }')


def _check_measurable(experiment: Experiment, visible: np.ndarray) -> None:
    """Refuse measured modes of an edge outside the image; visible : indices of the nodes in the image."""
    visible_boundaries = virtual_boundaries(experiment)
    for entry in experiment.model.prescribed:
        if not isinstance(entry.drive, Parametrised) or entry.drive.kind != "dic":
            continue
        if entry not in visible_boundaries or not np.isin(experiment.model.node_set(entry.nodes), visible).any():
            raise InputError("a motion that the images do not show", file="experiment.toml",
                             key=f"[[boundary]] nodes = {entry.nodes}, u{entry.component}",
                             expected="an edge in the image, moving in its plane",
                             found='{ virtual = "dic" } on another',
                             remedy='use virtual = "bspline", whose modes need no measurement')


def ingest(store: RunStore, experiment: Experiment, runner: TaskRunner,
           progress: Callable[[int, int], None] | None = None) -> None:
    """Copy the images of all cameras into the RUN, where they are not there yet.

    progress : called as progress(count, total) over the images of all cameras
    """
    stacks = [recorded(view.recording.stack) for view in experiment.views]
    large = sum(map(_bytes, stacks)) > BYTES_FOR_WORKERS
    by_workers = runner.sees_files and runner.workers > 1 and large and all(map(_has_a_file_each, stacks))

    def on_workers(function: Callable[[IngestJob], Ingested], jobs: Sequence[IngestJob]) -> Iterable[Ingested]:
        return runner.stream(function, [_with_its_own_frames(job) for job in jobs], [job.name for job in jobs],
                             retries=1)

    ingest_all(store, experiment, progress, on_workers if by_workers else map)


def _bytes(stack: Stack) -> float:
    return float(stack.n_frames * np.prod(stack.shape))  # one byte per pixel at least


def _has_a_file_each(stack: Stack) -> bool:
    """Whether every frame is a file of its own; the pages of one file are best read in turn."""
    return isinstance(stack, FileStack) and len({entry.path for entry in stack.entries}) == stack.n_frames


def _with_its_own_frames(job: IngestJob) -> IngestJob:
    """The job without the other frames of its stack: thousands of jobs would each carry thousands of names."""
    stack = cast(FileStack, job.stack)
    return replace(job, stack=FileStack(list(stack.entries[job.first : job.stop]), stack.with_gaps), begins=job.first)


def prepare(run: str, path: str, overrides: dict, runner: TaskRunner) -> None:
    """Noise, weights and starting values of the frame-local unknowns, written to the RUN.

    Raises
    ------
    InputError
        If the model cannot be built from the experiment.
    """
    store = RunStore(run)
    experiment = with_stored_images(store, load_experiment(path, overrides))
    if needs_free_dic(experiment) and store.finished("dic") is None:
        runner.map(run_free_dic, [(run, path, overrides, 0)], ["free-dic"], retries=1)
    if needs_motion_in_space(experiment) and store.finished("motion") is None:
        runner.map(run_stereo_dic, [(run, path, overrides)], ["free-stereo-dic"], retries=1)
    with store.building("prepared") as folder:
        beginning = beginning_of(experiment, _free_motion(store, experiment))
        write_array(folder, "local", beginning.local)
        for name, (shapes, courses) in beginning.boundary.modes.items():
            write_array(folder, path_name(f"{name}.shapes"), shapes)
            write_array(folder, path_name(f"{name}.courses"), courses)
    missing = [number for number in cameras_to_measure(experiment)
               if store.finished(group_of(experiment, number, "dic")) is None]
    runner.map(run_free_dic, [(run, path, overrides, number) for number in missing],
               [f"free-dic-{experiment.cameras[number - 1].name}" for number in missing], retries=1)
    noises = camera_noises(experiment, {
        number: read_free_dic(store, group_of(experiment, number, "dic"))["noise_gv"]
        for number, view in enumerate(experiment.views) if view.recording.noise.std_gv is None}, beginning.excluded)
    views = [replace(view, recording=replace(view.recording, noise=noise)) for noise,
             view in zip(noises, experiment.views, strict=True)]
    weights = noise_weights(experiment, views)
    write_description(run, {
        "experiment": str(Path(path).resolve()), "overrides": overrides, "identity": experiment.recording.identity,
        "excluded": sorted(beginning.excluded), "excluded_by_user": list(experiment.recording.excluded),
        "noise": noise_entry(noises[0]), "camera_noises": [noise_entry(noise) for noise in noises[1:]],
        "channel_noise_source": ["given" if channel.noise_std
                                 else "differences" for channel in experiment.model.channels],
        "weights": {"kind": "noise" if experiment.options.weighting == "noise" else "paper (not yet scaled)",
                    "image": weights.image, "image_noise": weights.image_noise,
                    "channels": [1.0 / noise**2 for noise in weights.channel_noise.tolist()],
                    "channel_noise": weights.channel_noise.tolist(),
                    "cameras": list(weights.cameras), "camera_noise": list(weights.camera_noise)},
        "boundary": {"values": {name: to_hex(value) for name, value in beginning.boundary.values.items()},
                     "modes": list(beginning.boundary.modes), "notes": list(beginning.boundary.notes)},
    })


def write_description(run: str | Path, description: dict) -> None:
    """Replace ``RUN/run.json`` whole."""
    save_checkpoint(Path(run) / DESCRIPTION, DESCRIPTION_SCHEMA, description)


def _free_motion(store: RunStore, experiment: Experiment) -> FreeMotion | None:
    """What the stored free FE-DIC of the main camera, or FE-DVC, says of the frames; None where none is needed."""
    if experiment.recording.quantity == "volume" and needs_motion_in_space(experiment):
        return motion_of_volumes(read_array(store.group("motion"), "u_mm"))
    if not needs_free_dic(experiment):
        return None
    frames = read_free_dic(store)
    nodes = None if virtual_boundaries(experiment) else measured_nodes(experiment)
    in_space = read_array(store.group("motion"), "u_mm") if needs_motion_in_space(experiment) else None
    return FreeMotion(read_free_motion(store, nodes=nodes), frames["unexplained"], frames["lost"], nodes, in_space)


def run_free_dic(job: tuple[str, str, dict, int]) -> None:
    """Free FE-DIC over all frames of a camera on the experiment's mesh into ``run.zarr/dic`` (a task).

    job : the RUN, the experiment, ``--set key=value``, the number of the camera (0: the main one)
    """
    from idic.measure import dic_stack

    run, path, overrides, number = job
    store = RunStore(run)
    experiment = with_stored_images(store, load_experiment(path, overrides))
    view, shape = experiment.views[number], (experiment.model.mesh.n_nodes, 2)
    with store.building(group_of(experiment, number, "dic")) as folder:
        array = FrameArrays.create(folder, "u_px", experiment.model.n_frames, shape,
                                   stored_frames(experiment.model.n_frames, 16 * shape[0]), compressed=True)
        with array.writer() as writer:
            stack = dic_stack(view, regularisation_of(experiment.options), keep=writer.append)
        write_array(folder, "rms_gv", stack.rms_gv)
        write_array(folder, "chi2_dof", stack.chi2_dof)
        for name in ("unexplained", "lost"):
            write_array(folder, name, np.array([status == name for status in stack.status]))
        write_array(folder, "noise_gv", np.array([stack.noise_gv]))


def run_stereo_dic(job: tuple[str, str, dict]) -> None:
    """Free stereo FE-DIC of all cameras with a lens into ``run.zarr/motion`` (a task).

    job : the RUN, the experiment, ``--set key=value``
    """
    run, path, overrides = job
    store = RunStore(run)
    experiment = with_stored_images(store, load_experiment(path, overrides))
    with store.building("motion") as folder:
        write_array(folder, "u_mm", motion_in_space(experiment))


def read_free_dic(store: RunStore, name: str = "dic") -> dict[str, Any]:
    """What `run_free_dic` stored of the frames but their motion; noise_gv as a number."""
    folder = store.group(name)
    arrays = {name: read_array(folder, name) for name in ("rms_gv", "chi2_dof", "unexplained", "noise_gv")}
    lost = read_array(folder, "lost") if (folder / "lost").exists() else np.zeros_like(arrays["unexplained"])
    return arrays | {"noise_gv": float(arrays["noise_gv"][0]), "lost": lost}


def read_free_motion(store: RunStore, name: str = "dic", nodes: np.ndarray | None = None) -> np.ndarray:
    """The motion that `run_free_dic` stored; nodes : of these alone, None: of all  # (n_frames, n, 2) px"""
    array = FrameArrays.open(store.group(name), "u_px")
    if nodes is None:
        return array.read()
    return np.concatenate([array.read(*span)[:, nodes] for span in array.chunks()])
