"""Figures of the blind trial: confusion matrix, onset and place, scores of decoys."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from idic.report import Colour, Picture, look, new_figure, to_picture
from idic_studies.trial.evaluation import TrialRecord
from idic_studies.trial.scores import confusion

_SQUARE = 0.5 * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])


def confusion_picture(records: Sequence[TrialRecord]) -> Picture | None:
    """Rows: the true effect; columns: the first name, or the verdict."""
    rows, columns, counts = confusion(records)
    if not rows:
        return None
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    with look():
        figure = new_figure(0.36 * len(columns) + 2.6, 0.27 * len(rows) + 2.0)
        axes = figure.subplots()
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.2, aspect="auto")
        for i, j in np.argwhere(counts):
            axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=7.5,
                      color="white" if share[i, j] > 0.6 else "#222222")
        for i, row in enumerate(rows):
            right = "none" if row == "clean" else "outside_library" if row.startswith("outside:") else row
            if right in columns:
                x, y = columns.index(right) + _SQUARE[0], i + _SQUARE[1]
                axes.plot(x, y, color=Colour.ORANGE, lw=1.3)
        axes.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=60, ha="right",
                        rotation_mode="anchor")
        axes.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
        axes.set_xlabel("first name")
        axes.set_ylabel("true effect")
        axes.grid(False)
        return to_picture(figure, "confusion", "Confusion matrix",
                      "Number of trials; colour: share of the row. Framed: right. Single effects of all strengths, "
                      "then clean recordings and effects that the library does not hold.")


def place_and_onset(records: Sequence[TrialRecord]) -> Picture | None:
    """Histograms of onset errors and overlaps of place."""
    onset = [r.onset_error for r in records if r.onset_error is not None]
    overlap = [r.overlap for r in records if r.overlap is not None]
    if not onset and not overlap:
        return None
    with look():
        figure = new_figure(7.5, 2.6)
        onset_axis, overlap_axis = figure.subplots(1, 2)
        onset_axis.hist(onset, bins=np.arange(-16.5, 17.5), color=Colour.BLUE)
        onset_axis.axvspan(-2.5, 2.5, color=Colour.GREY, alpha=0.15, lw=0)
        onset_axis.set(xlabel="found − true onset [frames]", ylabel="trials")
        overlap_axis.hist(overlap, bins=np.linspace(0.0, 1.0, 11), color=Colour.BLUE)
        overlap_axis.axvline(0.5, color=Colour.RED, lw=1.0)
        overlap_axis.set(xlabel="overlap of place (intersection / union)", ylabel="trials")
        return to_picture(figure, "onset-place", "Onset and place",
                          "Shaded: within two frames. Line: the target's median.")


def decoy_picture(records: Sequence[TrialRecord]) -> Picture | None:
    """Scores of decoys on clean recordings, compared with the unit normal."""
    clean = [r.ablations["decoys"] for r in records if r.group == "clean" and r.ablations]
    if not clean:
        return None
    with look():
        figure = new_figure(4.2, 2.7)
        axes = figure.subplots()
        largest = np.sort([entry["largest"] for entry in clean])
        n = int(clean[0]["n"])
        axes.step(largest, np.arange(1, len(largest) + 1) / len(largest), where="post", color=Colour.BLUE,
                  label="measured")
        z = np.linspace(1.0, 6.0, 200)
        axes.plot(z, (1.0 - 2.0 * stats.norm.sf(z)) ** n, color=Colour.GREY, ls="--",
                  label=f"{n} independent unit normals")
        axes.set(xlabel="largest score of the decoys [std]", ylabel="share of clean recordings", ylim=(0.0, 1.02))
        axes.legend(loc="lower right")
        return to_picture(figure, "decoys", "Decoys on clean recordings",
                      "Random patterns as smooth as the candidates. Left of the dashed line: the patterns are "
                      "correlated.")
