"""The evidence of a report beyond what an identification stores: free FE-DIC, noise floor, laws, frames to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import CorrelationContext, FieldReference, ViewKind, view_of
from idic.measure import FieldSeries, Seen
from idic.parameters import ParameterSet
from idic.report.evidence.free_dic import FreeMotions, noise_floor, with_residuals
from idic.report.evidence.hardening import hardening_curves
from idic.report.evidence.law import law_curves
from idic.report.evidence.points import point_maps_of
from idic.report.evidence.practice import frame_views, practice_of
from idic.report.evidence.relaxation import relaxation_curves
from idic.report.evidence.rubber import rubber_curves
from idic.report.evidence.section import section_fields, with_profiles, with_section_floor
from idic.report.evidence.temperature import temperature_factors
from idic.report.evidence.volumes.shown_mesh import ShownMesh
from idic.report.evidence.yield_surface import yield_surfaces
from idic.report.result.record import Sensitivities


@dataclass(frozen=True, eq=False)
class AcceptedFrames:
    """What a run keeps of its frames at the accepted point.

    Attributes
    ----------
    frames : frames of the maps
    motion : frame -> simulated motion of the nodes, (n_nodes, dim) mm
    residual : frame -> residual of the main camera, in the reference image
    series : fields of all frames
    measured_motions : the free FE-DIC of the shown frames, where the run has measured it
    """

    frames: Sequence[int]
    motion: Callable[[int], np.ndarray]
    residual: Callable[[int], np.ndarray]
    series: FieldSeries | None
    measured_motions: FreeMotions | None


def run_evidence(shared: CorrelationContext, result: Mapping, parameters: ParameterSet, accepted: AcceptedFrames,
                 sensitivities: Sensitivities | None, noise_sources: Sequence[str]) -> dict:
    """The laws of a `RunRecord`, and its fields `views`, `free`, `points` and `practice`, of the main camera.

    shared : of the accepted point; parameters : its values; noise_sources : of the channels, in words
    """
    experiment, reference = shared.experiment, shared.reference.image
    view, nodes = view_of(experiment, shared.camera), experiment.model.mesh.nodes
    laws = _laws(shared, result, parameters, accepted)
    if view.kind == ViewKind.VOLUME:
        return laws | {"views": _views_of_volume(shared, accepted)}
    at_rest = shared.camera.project(view.points(nodes))

    def motion(frame: int) -> np.ndarray:
        return view.at(frame).motion(nodes, accepted.motion(frame))  # (n_nodes, 2 or 3) px, and height

    def plane(frame: int) -> np.ndarray:
        return motion(frame)[:, :2]

    map_frames = accepted.frames
    frames = [k for k in experiment.correlated_frames(range(experiment.model.n_frames))
              if k != experiment.model.reference]
    dic_setup = Seen.by(experiment, reference) if experiment.recording.noise.std_gv else None
    floor = noise_floor(dic_setup, sensitivities, result, reference)
    views = frame_views(experiment.recording, frames, lambda frame: at_rest + plane(frame), accepted.residual)
    free_fields = None
    if dic_setup is not None:
        free_fields = accepted.measured_motions or FreeMotions.of(dic_setup, map_frames, plane)
    free_fields = None if free_fields is None else with_residuals(dic_setup, free_fields)
    if reference.is_section:
        views = with_profiles(views, reference, motion)
        if experiment.recording.noise.std_gv:
            free_fields = section_fields(experiment.recording, reference, at_rest[:, 0], map_frames, motion)
            floor = with_section_floor(floor, experiment, reference, at_rest[:, 0])
    points = None
    if isinstance(reference, FieldReference):
        points = point_maps_of(experiment, shared.camera, reference, map_frames, motion)
    practice = practice_of(experiment, reference, result, floor, noise_sources)
    return laws | dict(points=points, free_fields=free_fields, practice=practice, views=views)


def _laws(shared: CorrelationContext, result: Mapping, parameters: ParameterSet, accepted: AcceptedFrames) -> dict:
    """What the record shows of the identified laws."""
    experiment, model = shared.experiment, shared.experiment.model
    motions = np.array([accepted.motion(k) for k in accepted.frames])
    return dict(
        curves=law_curves(experiment, parameters, result, motions),
        rubber=rubber_curves(model, parameters, result, motions),
        relaxation=relaxation_curves(model, parameters, result),
        hardening=hardening_curves(model, parameters, result, accepted.series),
        surfaces=yield_surfaces(model, parameters, result, accepted.series),
        temperature_factors=temperature_factors(model, parameters, result),
    )


def _views_of_volume(shared: CorrelationContext, accepted: AcceptedFrames) -> tuple:
    """Sections of volumes to look at."""
    experiment, nodes = shared.experiment, shared.experiment.model.mesh.nodes
    view, shown_points = view_of(experiment, shared.camera), ShownMesh.seen_by(experiment, shared.camera)
    frames = [k for k in experiment.correlated_frames(range(experiment.model.n_frames))
              if k != experiment.model.reference]
    return frame_views(experiment.recording, frames,
                       lambda frame: shown_points.moved_px(view.at(frame).motion(nodes, accepted.motion(frame))),
                       accepted.residual)
