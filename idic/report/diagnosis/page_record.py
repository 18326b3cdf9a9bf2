"""From a finished diagnosis to its page and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.correlation import channel_values
from idic.diagnose import (
    Diagnosis, JUDGEMENT, Notes, ResidualEvidence, SEED, WindowCurve, identification_at, law_pairs, map_of_noise,
    maps_of_evidence, maps_of_identification, thinned, window_curves,
)
from idic.report.diagnosis.content import titles_of
from idic.report.diagnosis.page import draw_diagnosis_sections, render_diagnosis_page
from idic.report.diagnosis.record import Curve, DiagnosisRecord, KNOWN_ERROR_COUNTED
from idic.report.diagnosis.where_record import where_pictures
from idic.report.figures.picture import Picture
from idic.report.result.words import short_names, time_label


def diagnosis_page(diagnosis: Diagnosis, content: Mapping, notes: Notes) -> tuple[str, tuple[Picture, ...]] | None:
    """The HTML text of the page, and its figures; figures that fail are left out and noted, and so is the page.

    content : of diagnosis.json
    """
    pictures = notes.attempt("the figures of the place", where_pictures, diagnosis, otherwise=())
    return notes.attempt("the page", _page, diagnosis, content, notes, pictures, otherwise=None)


def _page(diagnosis: Diagnosis, content: Mapping, notes: Notes,
          pictures: tuple[Picture, ...]) -> tuple[str, tuple[Picture, ...]]:
    record = record_of(diagnosis, content, titles_of(diagnosis), notes, pictures)
    sections = draw_diagnosis_sections(record, notes)
    figure_notes = [note for note in notes.texts if note not in content["cautions"]]
    record = replace(record, content={**content, "cautions": [*content["cautions"], *figure_notes]})
    return (render_diagnosis_page(record, sections),
            tuple(picture for section in sections for picture in section.pictures))


def record_of(diagnosis: Diagnosis, content: Mapping, titles: Mapping[str, str], notes: Notes,
              pictures: tuple[Picture, ...] = ()) -> DiagnosisRecord:
    """Everything the page shows, in the reader's units."""
    experiment, verdict = diagnosis.identification.experiment, diagnosis.verdict
    frame = notes.attempt("the frame of the maps", _shown_frame, diagnosis, otherwise=verdict.before.worst_frame)
    return DiagnosisRecord(
        title=experiment.title, content=content, titles=titles, frame=frame,
        residuals=notes.attempt("the maps of the residual", _residuals, diagnosis, frame, otherwise=()),
        excess_frames=verdict.before.frames, excess_before=verdict.before.frame_excess,
        excess_after=verdict.after.frame_excess if diagnosis.state.final is not None else None,
        excess_std=verdict.before.frame_excess_std,
        abscissa=experiment.model.times, time_label=time_label(experiment.model.times), curves=_curves(diagnosis),
        further=pictures,
        windows=notes.attempt("the parameters over the frames", _windows, diagnosis, otherwise=()),
        laws=notes.attempt("the curves of the laws", law_pairs, diagnosis, otherwise=()))


def _shown_frame(diagnosis: Diagnosis) -> int:
    """Of the frames with the largest excess and the largest motion the one whose residual is larger.

    The excess counts motion beside the mean of all frames, which the noise of the reference image may share: where a
    seating bends every later frame, that of the first one at rest is the largest, and its residual is noise.
    """
    residual, worst = diagnosis.identified.residual, diagnosis.verdict.before.worst_frame
    moved = int(residual.evidence.frames[np.argmax(np.abs(residual.u).reshape(len(residual.u), -1).max(axis=1))])
    return max((worst, moved), key=lambda frame: float(np.nanmean(maps_of_evidence(residual, frame)[0] ** 2)))


def _windows(diagnosis: Diagnosis) -> tuple[WindowCurve, ...]:
    curves = window_curves(diagnosis)
    labels = short_names([curve.name for curve in curves])
    return tuple(replace(curve, name=labels[curve.name]) for curve in curves)


def _residuals(diagnosis: Diagnosis, frame: int) -> tuple[tuple[str, tuple[tuple[str, np.ndarray], ...]], ...]:
    """Name of every camera, "" of a single one, and its maps with their titles."""
    maps_before = maps_of_evidence(diagnosis.identified.residual, frame)
    titled_maps = [("before", maps_before)]
    if diagnosis.enriched is not None:
        titled_maps.append(("after", maps_of_evidence(diagnosis.enriched.residual, frame)))
        last_round = diagnosis.rounds[-1]
        model = last_round.winner.refitted if last_round.winner is not None else last_round.null
        copy = thinned(diagnosis.source.load(), JUDGEMENT, SEED)
        heldout = identification_at(copy, model.values, model.local, model.steps)
        titled_maps.append(("after, held-out copy", maps_of_identification(heldout, frame)))
    elif diagnosis.corrected is not None:
        titled_maps.append((KNOWN_ERROR_COUNTED, maps_of_identification(diagnosis.corrected.identification(), frame)))
    titled_maps.append(("noise, drawn", tuple(map_of_noise(residual_map, SEED) for residual_map in maps_before)))
    cameras = diagnosis.identified.residual.cameras
    names = [camera.context.experiment.recording.camera_name for camera in cameras] if len(cameras) > 1 else [""]
    return tuple((name, tuple((title, maps[k]) for title, maps in titled_maps)) for k, name in enumerate(names))


def _curves(diagnosis: Diagnosis) -> tuple[Curve, ...]:
    experiment = diagnosis.identification.experiment
    channels_before = _shown_channels(diagnosis.identified.residual)
    channels_after = None if diagnosis.enriched is None else _shown_channels(diagnosis.enriched.residual)
    noise = diagnosis.identified.residual.context.weights.channel_noise
    size = [channel.shown_factor for channel in experiment.model.channels]
    return tuple(Curve(channel.column, channel.shown_unit, np.asarray(channel.values, float) / size[i],
                       channels_before[:, i] / size[i],
                       None if channels_after is None else channels_after[:, i] / size[i], float(noise[i]) / size[i])
                 for i, channel in enumerate(experiment.model.channels))


def _shown_channels(residual: ResidualEvidence) -> np.ndarray:
    """Simulated channels with scale, offset and drift, NaN in frames without correlation  # (n_frames, n_channels)"""
    context = residual.context
    values = np.full((context.experiment.model.n_frames, residual.channels.shape[1]), np.nan)
    for frame, simulated in zip(residual.evidence.frames, residual.channels, strict=True):
        values[frame] = channel_values(context.experiment, context.parameters, simulated, int(frame))
    return values
