"""The evidence of a report beyond what an identification stores: free FE-DIC, noise floor, laws, frames to look at."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.correlation import CorrelationContext, FieldReference, VOLUME, correlated_frames, view_of
from idic.measure import seen_by
from idic.parameters import ParameterSet
from idic.report import (
    Sensitivities, frame_views, free_motions, law_curves, noise_floor, point_maps_of, practice_of, relaxation_curves,
    rubber_curves, section_fields, shown_mesh, with_profiles, with_residuals, with_section_floor,
)
from idic.run.judgement.free import read_free
from idic.run.judgement.residual_maps import residuals_of
from idic.run.judgement.shown_frames import shown_frames
from idic.run.prepared.context import RunContext, correlation_context
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name


def evidence(context: RunContext, result: Mapping, point: int, parameters: ParameterSet,
             sensitivities: Sensitivities | None) -> dict:
    """The fields `views`, `free`, `curves` and `practice` of a `RunRecord`, of the main camera.

    point : number of the accepted evaluation; parameters : its values
    """
    shared = correlation_context(context, parameters)
    experiment, reference = shared.experiment, shared.reference.image
    view, nodes = view_of(experiment, shared.camera), experiment.model.mesh.nodes
    stored = FrameArrays.open(context.store.group(group_name(point, BASE)), "u")
    if view.kind == VOLUME:
        return _of_volume(context, result, shared, parameters, stored)
    at_rest = shared.camera.project(view.points(nodes))

    def simulated(frame: int) -> np.ndarray:
        k = frame - experiment.model.reference
        return stored.read(k, k + 1)[0]  # (n_nodes, dim) mm

    def motion(frame: int) -> np.ndarray:
        return view.at(frame).motion(nodes, simulated(frame))  # (n_nodes, 2 or 3) px, and height

    def plane(frame: int) -> np.ndarray:
        return motion(frame)[:, :2]

    map_frames = shown_frames(experiment)
    frames = [k for k in correlated_frames(experiment, range(experiment.model.n_frames))
              if k != experiment.model.reference]
    dic_setup = seen_by(experiment, reference) if experiment.recording.noise.std_gv else None
    floor = noise_floor(dic_setup, sensitivities, result, reference)
    views = frame_views(experiment.recording, frames, lambda frame: at_rest + plane(frame),
                        residuals_of(context, last_accepted(result)))
    free_fields = None
    if dic_setup is not None:
        free_fields = read_free(context.store, point) or free_motions(dic_setup, map_frames, plane)
    free_fields = None if free_fields is None else with_residuals(dic_setup, free_fields)
    if reference.is_section:
        views = with_profiles(views, reference, motion)
        if experiment.recording.noise.std_gv:
            free_fields = section_fields(experiment.recording, reference, at_rest[:, 0], map_frames, motion)
            floor = with_section_floor(floor, experiment, reference, at_rest[:, 0])
    sources = ["given" if source == "given" else f"{source} of the log"
               for source in context.settings["channel_noise_source"]]
    points, motions = None, np.array([simulated(k) for k in map_frames])
    if isinstance(reference, FieldReference):
        points = point_maps_of(experiment, shared.camera, reference, map_frames, motion)
    return dict(
        points=points,
        free_fields=free_fields,
        curves=law_curves(experiment, parameters, result, motions),
        rubber=rubber_curves(experiment.model, parameters, result, motions),
        relaxation=relaxation_curves(experiment.model, parameters, result),
        practice=practice_of(experiment, reference, result, floor, sources),
        views=views,
    )


def _of_volume(context: RunContext, result: Mapping, shared: CorrelationContext, parameters: ParameterSet,
               stored: FrameArrays) -> dict:
    """The same of volumes: sections to look at, and the curves of the laws."""
    experiment, nodes = shared.experiment, shared.experiment.model.mesh.nodes
    view, shown_points = view_of(experiment, shared.camera), shown_mesh(experiment, shared.camera)

    def simulated(frame: int) -> np.ndarray:
        k = frame - experiment.model.reference
        return stored.read(k, k + 1)[0]  # (n_nodes, 3) mm

    frames = [k for k in correlated_frames(experiment, range(experiment.model.n_frames))
              if k != experiment.model.reference]
    motions = np.array([simulated(k) for k in shown_frames(experiment)])
    views = frame_views(experiment.recording, frames,
                        lambda frame: shown_points.moved_px(view.at(frame).motion(nodes, simulated(frame))),
                        residuals_of(context, last_accepted(result)))
    return dict(curves=law_curves(experiment, parameters, result, motions),
                rubber=rubber_curves(experiment.model, parameters, result, motions),
                relaxation=relaxation_curves(experiment.model, parameters, result), views=views)


def last_accepted(result: Mapping) -> Mapping:
    """The entry of the history that describes the identified point."""
    return [entry for entry in result["history"] if entry["accepted"]][-1]
