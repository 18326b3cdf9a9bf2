"""From a diagnosis to its figures of place, onset and side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.correlation import ViewKind
from idic.diagnose import (
    Diagnosis, Mismatch, ResidualEvidence, SelectedEffect, element_centres, holds_motion, place_words,
)
from idic.images import picture
from idic.model import Experiment, Model
from idic.report.diagnosis.spot_figure import spot_picture
from idic.report.diagnosis.where import WhereRecord, pictures
from idic.report.figures.picture import Picture
from idic.report.result.words import time_label


def where_pictures(diagnosis: Diagnosis) -> tuple[Picture, ...]:
    """Figures of spots, and of place, onset and side of a diagnosis; () where nothing was located."""
    spots = diagnosis.spots
    of_spots = () if spots is None else (spot_picture(diagnosis.identification.experiment, spots.spots),)
    if diagnosis.mismatch is None:
        return of_spots
    record = where_record(diagnosis.identified.residual, diagnosis.mismatch, diagnosis.selected_effect)
    active = diagnosis.active
    if active is not None:
        record = replace(record, since_active=active.since, words=record.words | {"active": active.verb})
    return (*of_spots, *pictures(replace(record, cracks=_cracks(diagnosis))))


def _cracks(diagnosis: Diagnosis) -> tuple[np.ndarray, ...]:
    """The cracks of the enriched model in the last frame, from their beginning to the tip  # (m, 2) px each"""
    fitted = diagnosis.enriched
    if fitted is None or fitted.residual is None:
        return ()
    context = fitted.residual.context
    model = context.experiment.model
    if not model.cracks:
        return ()
    lines = []
    for crack, length in zip(model.cracks, model.tips_at(model.parameters.with_values(fitted.fit.values))[-1],
                             strict=True):
        nodes, place = model.mesh.nodes[crack.cut.left_nodes], crack.cut.place
        along = np.append(place[place < length], length)
        points = np.column_stack([np.interp(along, place, component) for component in nodes.T])
        lines.append(context.camera.project(fitted.residual.view.points(points)))
    return tuple(line for line in lines if len(line) > 1)


def where_record(residual: ResidualEvidence, mismatch: Mismatch, selected: SelectedEffect | None = None) -> WhereRecord:
    """Everything that the figures show, in the reader's units; selected : the selected candidate, None without one."""
    begin, interval = mismatch.reported_onset(selected)
    experiment, evidence = residual.context.experiment, residual.evidence
    source_map, onset, nested_tests = mismatch.source_map, mismatch.onset, mismatch.nested_tests
    channel = experiment.model.channels[0] if experiment.model.channels else None
    source_elements = mismatch.place.elements if mismatch.has_place(selected) else np.zeros(0, dtype=int)
    real = mismatch.is_significant or selected is not None
    abscissa = experiment.model.times
    elsewhere = selected is not None and selected.side != mismatch.side and mismatch.is_significant
    words = {"side": f"How much of the residual each freedom explains, of what any smooth motion does. By it "
                     f"{nested_tests.reason}."
                     + (" The selected candidate acts on another side: motion alone cannot attribute such a smooth "
                        "field, the refits can." if elsewhere else ""),
             "where": place_words(mismatch, experiment.model.length_unit) or "",
             "when": _when(begin, interval, mismatch.visible_frame), "course": mismatch.course.words}
    shares = {name: nested_tests.share(name) for name in nested_tests.levels if name not in ("force", "brightness")}
    reference, outlines = _picture_and_outlines(residual, mismatch)
    return WhereRecord(
        reference=reference, outlines=outlines, statistic=source_map.statistic,
        p=np.where(source_map.same_sign, source_map.p, 1.0), source_elements=source_elements,
        since=source_map.first_frames(evidence.frames, begin), blind=_blind(experiment, residual),
        times=abscissa[evidence.frames], time_label=time_label(abscissa),
        amplitude=onset.amplitude if real else np.zeros_like(onset.amplitude), std=onset.std,
        load=None if channel is None else residual.channels[:, 0] / channel.shown_factor,
        load_label="" if channel is None else f"{channel.column} (simulated) [{channel.shown_unit}]",
        onset=None if begin is None else float(abscissa[begin]),
        interval=None if interval is None else tuple(float(abscissa[k]) for k in interval),
        shares=shares if real else {}, excess={name: level.excess for name, level in nested_tests.levels.items()},
        side=selected.side if selected else mismatch.side, words=words, section=residual.view.kind == ViewKind.SECTION)


def _when(begin: int | None, interval: tuple[int, int] | None, visible: int | None) -> str:
    if begin is None:
        return ""
    if begin == 0:
        return "The mismatch is present from the start" + ("." if visible is None else
                                                           f" and more than noise from frame {visible} on.")
    return f"The mismatch begins at frame {begin}" + (f" (95 %: {interval[0]} to {interval[1]})." if interval else ".")


def _picture_and_outlines(residual: ResidualEvidence,
                          mismatch: Mismatch) -> tuple[np.ndarray | None, list[list[np.ndarray]]]:
    """The reference image, and the elements on it; of a volume in three sections through the place."""
    experiment, evidence = residual.context.experiment, residual.evidence
    model, recording = experiment.model, experiment.recording
    if recording.quantity == "volume":
        nodes_px, scans = residual.context.camera.project(model.mesh.nodes), recording.volumes
        middle = nodes_px.mean(axis=0) if mismatch.place is None else residual.context.camera.project(
            mismatch.place.centroid[None])[0]
        column, row, plane = np.clip(np.rint(middle), 0, np.array(scans.shape)[::-1] - 1).astype(int).tolist()
        at = column, row, plane
        return (picture(lambda *block: scans.block(model.reference, *block), scans.shape, at),
                WhereRecord.sections(model.mesh, nodes_px, scans.shape, at))
    is_shown = evidence.n_components == 2 or recording.points
    return (recording.picture(model.reference) if is_shown else None,
            [[outline] for outline in _outlines(model, residual)])


def _outlines(model: Model, residual: ResidualEvidence) -> list[np.ndarray]:
    nodes = model.mesh.nodes
    view = residual.view
    at = nodes if view.kind == ViewKind.SECTION else residual.context.camera.project(view.points(nodes))
    return [at[nodes[:min(block.kind.n_corners, 4)]]  # of a solid's cell one face
            for block in model.mesh.blocks for nodes in block.connectivity]


def _blind(experiment: Experiment, residual: ResidualEvidence) -> np.ndarray:
    """Elements without pixels, or without a node whose motion was measured  # (n_elements,) bool; of a cross-section
    those outside the visible columns"""
    model = experiment.model
    if holds_motion(experiment.recording):
        measured_nodes = np.unique(residual.evidence.seen // residual.evidence.n_components)
        return np.concatenate([~np.isin(block.connectivity, measured_nodes).any(axis=1) for block in model.mesh.blocks])
    if residual.view.kind == ViewKind.SECTION:
        x = model.mesh.nodes[:, 0]
        visible_x = x[residual.context.reference.pixel_map.visible_nodes]
        middle = element_centres(model.mesh)[:, 0]
        return (middle < visible_x.min()) | (middle > visible_x.max())
    blind = np.ones(model.mesh.n_elements, dtype=bool)
    for camera in residual.cameras:
        owners = np.asarray(camera.context.reference.pixel_map.element)
        if model.n_dim == 3 and residual.evidence.n_axes == 2:  # faces, of one kind
            owners = np.asarray(model.mesh.edge_sets[camera.context.experiment.model.surface])[owners, 0]
        blind[owners] = False
    return blind
