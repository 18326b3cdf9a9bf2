"""The camera's floor of a RUN: measured once at the accepted motion, kept in ``run.zarr/floor``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from idic.correlation import FieldReference, ViewKind, view_of
from idic.measure import CameraFloor, find_still_frames
from idic.parameters import ParameterSet
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.store.arrays import FrameArrays, read_array, write_array
from idic.run.store.layout import BASE, FLOOR, group_name
from idic.run.store.run_store import RunStore
from idic.run.workers.runner import TaskRunner

MAX_FINDER_NODES = 400  # whose motion in all frames tells which frames are at rest


@dataclass(frozen=True)
class PointJob:
    """An evaluated point of a RUN; values : of its free parameters, internal units; lost : frames without the pattern
    of the specimen."""

    run: str
    evaluation: int
    values: Mapping[str, float]
    lost: tuple[int, ...] = ()


def measured_floor(job: PointJob, runner: TaskRunner) -> CameraFloor | None:
    """The floor at an accepted point, from the store or measured now; None where no frame is at rest."""
    store = RunStore(job.run)
    if store.finished(FLOOR, {"evaluation": job.evaluation}) is None:
        runner.map(measure_floor, [job], ["camera-floor"], retries=1)
    return read_floor(store)


def measure_floor(job: PointJob) -> None:
    """Measure the floor and store it (a task)."""
    context = open_run(job.run)
    floor = _floor(context, job.evaluation, context.experiment.model.parameters.with_values(job.values))
    with context.store.building(FLOOR, {"evaluation": job.evaluation}) as folder:
        if floor is None:
            write_array(folder, "numbers", np.zeros(0))
            return
        write_array(folder, "numbers", np.array([floor.px, floor.bound_px, floor.length_px, float(floor.separate)]))
        write_array(folder, "nodes_px", floor.nodes_px)
        write_array(folder, "frames", np.array(floor.frames, dtype=np.int64))
        write_array(folder, "drift_px", np.array(floor.drift_px))
        write_array(folder, "source", np.frombuffer(floor.source.encode(), dtype=np.uint8))


def read_floor(store: RunStore) -> CameraFloor | None:
    """What `measure_floor` stored; None where no frame is at rest or nothing was measured."""
    folder = store.finished(FLOOR)
    if folder is None:
        return None
    numbers = read_array(folder, "numbers")
    if not len(numbers):
        return None
    px, bound, length, separate = numbers.tolist()
    return CameraFloor(px, bound, read_array(folder, "nodes_px"), length,
                       tuple(read_array(folder, "frames").tolist()), read_array(folder, "source").tobytes().decode(),
                       tuple(read_array(folder, "drift_px").tolist()), bool(separate))


def floor_content(context: RunContext | None, floor: CameraFloor | None) -> dict:
    """The entry ``camera_floor`` of result.json."""
    if floor is None or context is None:
        return {"px": None, "bound_px": None, "length_px": None, "frames": [], "labels": [], "drift_px": [],
                "source": ""}
    labels = context.experiment.recording.labels
    return {"px": floor.px, "bound_px": floor.bound_px, "length_px": floor.length_px, "frames": list(floor.frames),
            "labels": [f"still image {k}" if floor.separate else labels[k] for k in floor.frames],
            "drift_px": list(floor.drift_px), "source": floor.source}


def _floor(context: RunContext, evaluation: int, parameters: ParameterSet) -> CameraFloor | None:
    shared = correlation_context(context, parameters)
    experiment = shared.experiment
    view = view_of(experiment, shared.camera)
    if view.kind not in (ViewKind.GREY, ViewKind.SPACE) or experiment.recording.noise.std_gv is None:
        return None
    motion = simulated_motion(context, evaluation, parameters)
    image = shared.reference.image
    image = image.in_plane if isinstance(image, FieldReference) else image
    nodes = image.pixel_map.visible_nodes
    nodes = nodes[np.unique(np.linspace(0, len(nodes) - 1, min(len(nodes), MAX_FINDER_NODES)).astype(int))]
    sampled = np.array([motion(frame)[nodes] for frame in range(experiment.model.n_frames)])
    still = find_still_frames(experiment, sampled, nodes)
    return CameraFloor.of(experiment, image, still, motion)


def simulated_motion(context: RunContext, evaluation: int, parameters: ParameterSet) -> Callable[[int], np.ndarray]:
    """Frame -> displacement of the nodes in the image of the main camera (n_nodes, 2) px; NaN before the reference."""
    shared = correlation_context(context, parameters)
    experiment, reference = shared.experiment, context.experiment.model.reference
    view, nodes = view_of(experiment, shared.camera), experiment.model.mesh.nodes
    stored = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "u")

    def motion(frame: int) -> np.ndarray:
        k = frame - reference
        if k < 0:
            return np.full((len(nodes), 2), np.nan)
        return view.at(frame).motion(nodes, stored.read(k, k + 1)[0])[:, :2]

    return motion
