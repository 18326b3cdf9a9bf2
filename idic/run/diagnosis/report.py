"""From a finished diagnosis to what a person looks at: ``RUN/diagnosis.html`` and ``RUN/figures/diagnosis_*.png``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from idic.correlation.frame_equations import CorrelationContext, channel_values
from idic.correlation.view import view_of
from idic.diagnose.refit import identification_at
from idic.diagnose.residual.heldout import Fit
from idic.diagnose.residual.residual_evidence import ResidualEvidence, context_of
from idic.diagnose.residual.thinning import JUDGEMENT, thinned
from idic.identify.in_memory import Identification
from idic.report.diagnosis.page import draw_sections, render_page
from idic.report.diagnosis.record import Curve, DiagnosisRecord
from idic.report.figures.style import Picture
from idic.run.diagnosis.chain import SEED, Diagnosis
from idic.run.diagnosis.law import law_pairs, window_curves
from idic.run.reporting.write import time_label

PAGE_FILE = "diagnosis.html"


def write_page(run: Path | str, diagnosis: Diagnosis, content: Mapping, titles: Mapping[str, str],
               further: tuple[Picture, ...] = ()) -> Path:
    """Write the page and its figures; returns the page's path."""
    run = Path(run)
    record = record_of(diagnosis, content, titles, further)
    sections = draw_sections(record)
    (run / "figures").mkdir(exist_ok=True)
    for section in sections:
        for picture in section.pictures:
            (run / "figures" / f"{picture.name}.png").write_bytes(picture.png)
    path = run / PAGE_FILE
    path.write_text(render_page(record, sections), encoding="utf-8")
    return path


def record_of(diagnosis: Diagnosis, content: Mapping, titles: Mapping[str, str],
              further: tuple[Picture, ...] = ()) -> DiagnosisRecord:
    """Everything the page shows, in the reader's units."""
    experiment, verdict = diagnosis.found.experiment, diagnosis.verdict
    frame = _worst_frame(verdict.before)
    return DiagnosisRecord(
        title=experiment.title, content=content, titles=titles, residuals=_residuals(diagnosis, frame), frame=frame,
        excess_frames=verdict.before.frames, excess_before=_excess(verdict.before),
        excess_after=_excess(verdict.after) if diagnosis.final is not None else None,
        excess_std=np.sqrt(2.0 / np.maximum(verdict.before.rank, 1)),
        abscissa=experiment.times, time_label=time_label(experiment.times), curves=_curves(diagnosis), further=further,
        windows=window_curves(diagnosis), laws=law_pairs(diagnosis))


def _worst_frame(fit: Fit) -> int:
    return int(fit.frames[np.argmax(fit.gain - fit.rank)])


def _excess(fit: Fit) -> np.ndarray:
    return (fit.gain - fit.rank) / np.maximum(fit.rank, 1)


def _residuals(diagnosis: Diagnosis, frame: int) -> tuple[tuple[str, np.ndarray], ...]:
    shown = [("before", _of_residual(diagnosis.residual, frame))]
    if diagnosis.residual_after is not None:
        shown.append(("after", _of_residual(diagnosis.residual_after, frame)))
        last = diagnosis.rounds[-1]
        model = last.winner.refitted if last.winner is not None else last.null
        copy = thinned(diagnosis.source.load(), JUDGEMENT, SEED)
        found = identification_at(copy, model.values, model.local, model.steps)
        shown.append(("after, held-out copy", residual_in_sigma(context_of(found), frame, _motion(found, frame))))
    before = shown[0][1]
    drawn = np.random.default_rng(SEED).standard_normal(before.shape)
    return (*shown, ("mere noise, drawn", np.where(np.isfinite(before), drawn, np.nan)))


def _of_residual(residual: ResidualEvidence, frame: int) -> np.ndarray:
    at = int(np.flatnonzero(residual.evidence.frames == frame)[0])
    return residual_in_sigma(residual.context, frame, residual.u[at])


def _motion(found: Identification, frame: int) -> np.ndarray:
    """Simulated motion of one frame  # (n_nodes, dim) mm; no frame beyond it is simulated, nothing differentiated"""
    return next(state.u for state in found.march() if state.frame + found.experiment.reference == frame)


def residual_in_sigma(context: CorrelationContext, frame: int, u: np.ndarray) -> np.ndarray:
    """Residual of a frame over the standard deviation that mere noise would leave there  # (ny, nx), NaN outside

    Gain and offset of the frame (levels of height images) are removed by least squares. u : (n_nodes, dim) mm
    """
    experiment = context.experiment
    motion = view_of(experiment, context.camera).at(frame).motion(experiment.mesh.nodes, u)
    nodal = context.reference.compare(experiment, frame, motion)
    light = np.linalg.pinv(nodal.bb, hermitian=True) @ nodal.rb if nodal.n_brightness else np.zeros(0)
    found = context.reference.compare_pixels(experiment, frame, motion, light)
    noise = experiment.noise.std_gv * np.sqrt(found.still_gain / found.n_images + found.noise_gain)
    r = found.r.astype(float) / noise
    return context.reference.pixel_map.to_image(np.where(found.valid, r, np.nan))


def _curves(diagnosis: Diagnosis) -> tuple[Curve, ...]:
    found = diagnosis.found.experiment
    before = _shown_channels(diagnosis.residual)
    after = None if diagnosis.residual_after is None else _shown_channels(diagnosis.residual_after)
    noise = diagnosis.residual.context.weights.channel_noise
    return tuple(Curve(channel.column, channel.unit, np.asarray(channel.values, float), before[:, i],
                       None if after is None else after[:, i], float(noise[i]))
                 for i, channel in enumerate(found.channels))


def _shown_channels(residual: ResidualEvidence) -> np.ndarray:
    """Simulated channels with scale, offset and drift, NaN in frames without correlation  # (n_frames, n_channels)"""
    context = residual.context
    values = np.full((context.experiment.n_frames, residual.channels.shape[1]), np.nan)
    for frame, simulated in zip(residual.evidence.frames, residual.channels, strict=True):
        values[frame] = channel_values(context.experiment, context.parameters, simulated, int(frame))
    return values
