"""The ends of the specimen as the log moves or holds them, beside their motion in the images: evidence without a
simulation."""

from __future__ import annotations

import numpy as np

from idic.experiment_file import seen_nodes
from idic.measure import AffineMotions
from idic.model import Column, Constant, Experiment
from idic.report.evidence.causes.evidence import Evidence
from idic.report.evidence.causes.lines import moves_freely

NODES_PER_SET = 5  # each end counts alike
MIN_IN_IMAGE = 0.3  # motion in the image of a component, over the largest of all: the rest points into the image


def counted_frames(experiment: Experiment) -> list[int]:
    """Frames after the reference that are compared."""
    model = experiment.model
    return [k for k in range(model.reference + 1, model.n_frames) if k not in experiment.recording.excluded]


def component_px(experiment: Experiment, nodes: str, component: str) -> tuple[np.ndarray, np.ndarray]:
    """Places of some nodes of a set in the reference image, and their motion per mm of a component  # (p, 2) twice"""
    model = experiment.model
    points, _ = seen_nodes(model.mesh, model.kind, model.surface)
    chosen = np.asarray(model.mesh.node_sets[nodes])
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), NODES_PER_SET)).astype(int))]
    axis = "xyz".index(component)
    if not len(chosen) or axis >= points.shape[1]:
        return np.zeros((0, 2)), np.zeros((0, 2))
    at, pitch = points[chosen], 1e-3 * float(np.ptp(points, axis=0).max())
    places = model.camera.project(at)
    return places, (model.camera.project(at + pitch * np.eye(points.shape[1])[axis]) - places) / pitch


def logged_ends(experiment: Experiment, motions: AffineMotions) -> Evidence | None:
    """The evidence of driven and held ends; None where none is known in the image, or the camera moves freely."""
    model = experiment.model
    if model.is_section or moves_freely(experiment) or (
            experiment.recording.points is not None and experiment.recording.points.free_rigid):
        return None
    stated_entries = [entry for entry in model.prescribed
             if isinstance(entry.drive, Column) or (isinstance(entry.drive, Constant) and entry.drive.value == 0.0)]
    parts = [(entry, *component_px(experiment, entry.nodes, entry.component)) for entry in stated_entries]
    largest = max((float(np.linalg.norm(steps, axis=1).mean()) for _, places, steps in parts if len(places)),
                  default=0.0)
    places_px, directions, expected, sets = [], [], [], []
    for entry, places, steps in parts:
        sizes = np.linalg.norm(steps, axis=1)
        if not len(places) or sizes.mean() < MIN_IN_IMAGE * largest:
            continue
        repeat = int(round(NODES_PER_SET / len(places)))
        values = np.zeros(model.n_frames)
        if isinstance(entry.drive, Column):
            values = np.asarray(entry.drive.values, float) - float(entry.drive.values[model.reference])
        for _ in range(max(repeat, 1)):
            places_px.append(places)
            directions.append(steps / sizes[:, None])
            expected.append(np.outer(values, sizes))
            sets += [entry.nodes] * len(places)
    if len(set(sets)) < 2:
        return None
    return Evidence(experiment, motions, np.concatenate(places_px), np.concatenate(directions),
                    np.nan_to_num(np.concatenate(expected, axis=1)), "log", tuple(sets), loads_of(experiment))


def loads_of(experiment: Experiment) -> dict[str, np.ndarray]:
    """Forces and pressures of the log by column  # (n_frames,)"""
    loads = {channel.column: np.asarray(channel.values, float) for channel in experiment.model.channels
             if channel.is_load and np.ptp(channel.values) > 0.0}
    loads |= {load.drive.column: np.asarray(load.drive.values, float) for load in experiment.model.loads
              if isinstance(load.drive, Column)}
    return {name: values for name, values in loads.items() if np.isfinite(values).all()}
