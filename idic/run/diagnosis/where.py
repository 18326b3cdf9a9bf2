"""From a located mismatch to its figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.correlation.view import SECTION
from idic.diagnose.locate.active_elements import Activity
from idic.diagnose.locate.adjoint_sources import MAX_ELEMENT_P
from idic.diagnose.locate.mismatch import Mismatch
from idic.diagnose.locate.place import element_centres
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.fe.mesh.element import cell
from idic.model.experiment import Experiment
from idic.report.diagnosis.where import WhereRecord, pictures
from idic.report.figures.style import Picture
from idic.run.reporting.write import time_label

MIN_WINDOW_Z2 = 16.0  # z² of an element in one window: four standard deviations


def where_pictures(residual: ResidualEvidence, mismatch: Mismatch, always: bool | None = None,
                   side: str | None = None, active: Activity | None = None, bent: bool = False) -> tuple[Picture, ...]:
    """Figures of where, when and on which side; those without anything to show are left out.

    always, side : whether what was named is there from the start, and its side; None where nothing was
    active : where it acts in the enriched model; bent : as in `Mismatch.begins`
    """
    record = where_record(residual, mismatch, always, side, None if active is None else active.first_frame, bent)
    if active is not None:
        record = replace(record, since_active=active.since, words=record.words | {"active": active.verb})
    return pictures(record)


def where_record(residual: ResidualEvidence, mismatch: Mismatch, always: bool | None = None,
                 side: str | None = None, acts: int | None = None, bent: bool = False) -> WhereRecord:
    """Everything that the figures show, in the reader's units."""
    begin, interval = mismatch.begins(always, acts, bent)
    experiment, evidence = residual.context.experiment, residual.evidence
    source_map, onset, nested_tests = mismatch.source_map, mismatch.onset, mismatch.nested_tests
    channel = experiment.channels[0] if experiment.channels else None
    named = mismatch.place.elements if mismatch.has_place(side) else np.zeros(0, dtype=int)
    real = mismatch.is_significant or side is not None
    abscissa = experiment.times
    other = side is not None and side != mismatch.side and mismatch.is_significant
    words = {"ladder": f"Shares of the drop in chi-square that free motion inside the image brings: {nested_tests.reason}."
             + (" What was named acts elsewhere: motions alone do not tell so smooth a field, the refits do." if other
                else ""),
             "where": " ".join(w for w in mismatch.words if "push most" in w),
             "when": _when(begin, interval, mismatch.visible_frame), "course": mismatch.course.words}
    shares = {name: nested_tests.share(name) for name in nested_tests.levels if name != "force" and name != "light"}
    return WhereRecord(
        reference=experiment.stack.frame(experiment.reference) if evidence.n_components == 2 else None,
        outlines=_outlines(experiment, residual), statistic=source_map.statistic,
        p=np.where(source_map.same_sign, source_map.p, 1.0), named=named,
        since=_since(source_map, evidence.frames, begin), blind=_blind(experiment, residual),
        times=abscissa[evidence.frames], time_label=time_label(abscissa),
        amplitude=onset.amplitude if real else np.zeros_like(onset.amplitude), std=onset.std,
        load=None if channel is None else residual.channels[:, 0],
        load_label="" if channel is None else f"{channel.column} (simulated) [{channel.unit}]",
        onset=None if begin is None else float(abscissa[begin]),
        interval=None if interval is None else tuple(float(abscissa[k]) for k in interval),
        shares=shares if real else {}, excess={name: level.excess for name, level in nested_tests.levels.items()},
        side=side or mismatch.side, words=words, section=residual.view.kind == SECTION)


def _when(begin: int | None, interval: tuple[int, int] | None, visible: int | None) -> str:
    if begin is None:
        return ""
    if begin == 0:
        return f"It is there from the start, and visible from frame {visible} on."
    return f"It begins at frame {begin}" + (f" (95 %: {interval[0]} to {interval[1]})." if interval else ".")


def _outlines(experiment: Experiment, residual: ResidualEvidence) -> list[np.ndarray]:
    nodes = experiment.mesh.nodes
    at = nodes if residual.view.kind == SECTION else residual.context.camera.project(residual.view.points(nodes))
    return [at[nodes[:min(cell(block.cell).n_corners, 4)]]  # of a solid's cell one face
            for block in experiment.mesh.blocks for nodes in block.connectivity]


def _since(source_map, frames: np.ndarray, onset_frame: int | None) -> np.ndarray:
    """First frame of the first window, not before the onset, in which an element shows  # (n_elements,)"""
    onset = frames[0] if onset_frame is None else onset_frame
    late = np.array([frames[window[-1]] >= onset for window in source_map.windows])
    first = np.array([max(frames[window[0]], onset) for window in source_map.windows], dtype=float)
    shows = (source_map.z**2 > MIN_WINDOW_Z2) & late
    return np.where(shows.any(axis=1) & (source_map.p < MAX_ELEMENT_P), first[np.argmax(shows, axis=1)], np.nan)


def _blind(experiment: Experiment, residual: ResidualEvidence) -> np.ndarray:
    """Elements without pixels; of a cross-section those beside the columns that are seen, whatever lies above them."""
    if residual.view.kind == SECTION:
        x = experiment.mesh.nodes[:, 0]
        seen = x[residual.context.reference.pixel_map.visible_nodes]
        middle = element_centres(experiment.mesh)[:, 0]
        return (middle < seen.min()) | (middle > seen.max())
    blind = np.ones(experiment.mesh.n_elements, dtype=bool)
    owners = np.asarray(residual.context.reference.pixel_map.element)
    if experiment.n_dim == 3:  # faces, of one kind
        owners = np.asarray(experiment.mesh.edge_sets[experiment.surface])[owners, 0]
    blind[owners] = False
    return blind
