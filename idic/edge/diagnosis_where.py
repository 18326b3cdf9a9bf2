"""From a located mismatch to its figures."""

from __future__ import annotations

import numpy as np

from idic.diagnose.gather import Gathered
from idic.diagnose.mismatch import Mismatch
from idic.diagnose.sources import SIGNIFICANT
from idic.edge.report import time_label
from idic.experiment import Experiment
from idic.fe.element import cell
from idic.report.diagnosis_where import WhereRecord, pictures
from idic.report.style import Picture

SHOWS = 16.0  # z² of an element in one window: four standard deviations


def where_pictures(gathered: Gathered, mismatch: Mismatch) -> tuple[Picture, ...]:
    """Figures of where, when and on which side; those without anything to show are left out."""
    return pictures(where_record(gathered, mismatch))


def where_record(gathered: Gathered, mismatch: Mismatch) -> WhereRecord:
    """Everything that the figures show, in the reader's units."""
    experiment, evidence = gathered.context.experiment, gathered.evidence
    sources, onset, ladder = mismatch.sources, mismatch.onset, mismatch.ladder
    channel = experiment.channels[0] if experiment.channels else None
    named = mismatch.place.elements if mismatch.place is not None else np.zeros(0, dtype=int)
    real = mismatch.is_real
    abscissa = experiment.times
    words = {"ladder": f"Shares of the drop in chi-square that free motion inside the image brings: {ladder.reason}.",
             "where": " ".join(w for w in mismatch.words if "elements around" in w),
             "when": " ".join(w for w in mismatch.words if "begins" in w), "course": mismatch.course.words}
    shares = {name: ladder.share(name) for name in ladder.rungs if name != "force" and name != "light"}
    return WhereRecord(
        reference=experiment.stack.frame(experiment.reference) if evidence.n_components == 2 else None,
        outlines=_outlines(experiment, gathered), statistic=sources.statistic,
        p=np.where(sources.alike, sources.p, 1.0), named=named,
        since=_since(sources, evidence.frames, mismatch.onset_frame), blind=_blind(experiment, gathered),
        times=abscissa[evidence.frames], time_label=time_label(abscissa),
        amplitude=onset.amplitude if real else np.zeros_like(onset.amplitude), std=onset.std,
        load=None if channel is None else gathered.channels[:, 0],
        load_label="" if channel is None else f"{channel.column} (simulated) [{channel.unit}]",
        onset=None if mismatch.onset_frame is None else float(abscissa[mismatch.onset_frame]),
        interval=None if mismatch.onset_ci is None else tuple(float(abscissa[k]) for k in mismatch.onset_ci),
        shares=shares if real else {}, excess={name: rung.excess for name, rung in ladder.rungs.items()},
        side=mismatch.side, words=words)


def _outlines(experiment: Experiment, gathered: Gathered) -> list[np.ndarray]:
    at = gathered.context.camera.project(gathered.view.points(experiment.mesh.nodes))
    return [at[nodes[:cell(block.cell).n_corners]] for block in experiment.mesh.blocks for nodes in block.connectivity]


def _since(sources, frames: np.ndarray, onset_frame: int | None) -> np.ndarray:
    """First frame of the first window, not before the onset, in which an element shows  # (n_elements,)"""
    onset = frames[0] if onset_frame is None else onset_frame
    late = np.array([frames[window[-1]] >= onset for window in sources.windows])
    first = np.array([max(frames[window[0]], onset) for window in sources.windows], dtype=float)
    shows = (sources.z**2 > SHOWS) & late
    return np.where(shows.any(axis=1) & (sources.p < SIGNIFICANT), first[np.argmax(shows, axis=1)], np.nan)


def _blind(experiment: Experiment, gathered: Gathered) -> np.ndarray:
    blind = np.ones(experiment.mesh.n_elements, dtype=bool)
    blind[np.asarray(gathered.context.reference.pixel_map.element)] = False
    return blind
