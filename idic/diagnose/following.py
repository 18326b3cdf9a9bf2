"""What a model leaves that comes and goes with what was added to it.

A formal fit leaves motions that follow its effect in time: a cut that was fitted by a spot with next to no stiffness, a
grip that pulls unevenly by one that turns. Free motions of every frame (`idic.diagnose.heldout`) share their chi-square
with the noise of all frames; motions with one course in time, that of the effect, collect it: uneven grips show by 14 to 26
standard deviations where those had shown 4.7 to 6.4. What the enriched model's own parameters could still take over is
projected out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.evidence import Columns
from idic.diagnose.excess import power
from idic.diagnose.gather import Gathered
from idic.diagnose.heldout import Fit
from idic.diagnose.score import null_model, score
from idic.diagnose.subspace import RANK, Grid, hats, spectrum
from idic.diagnose.verdict import SPOT_MARGIN_PX, SPOT_TOO_MUCH, Remains

FINER = 2  # cells of the grid in one of the free motions': what is left of a cut is narrow


def left_following(before: Gathered, after: Gathered, grid: Grid) -> Remains:
    """What is left of the motions with the course of what was added.

    Parameters
    ----------
    before, after : the whole recording under the identified and the enriched model
    grid : of the free motions

    A spot describes most of whatever gives way in one place: with one in the model less may be left.
    """
    fine = replace(grid, cells=FINER * grid.cells)
    course = course_of(before, after)
    total = float(power(before.evidence) @ course**2)
    left = Remains(_fit(before, fine, course), _fit(after, fine, course), total)
    return replace(left, too_much=SPOT_TOO_MUCH, margin_px=SPOT_MARGIN_PX) if has_new_spot(before, after) else left


def course_of(before: Gathered, after: Gathered) -> np.ndarray:
    """How the simulated motion changed with what was added, over time; mean square 1  # (T,)"""
    changes = (after.u - before.u).reshape(len(after.u), -1)
    course = np.linalg.svd(changes @ changes.T)[0][:, 0]
    return course / np.sqrt(np.mean(course**2))


def has_new_spot(before: Gathered, after: Gathered) -> bool:
    """Whether a spot of another stiffness was added."""
    known = {(entry.element_set, entry.name) for entry in before.context.experiment.heterogeneities}
    return any(entry.form != "gradient" and (entry.element_set, entry.name) not in known
               for entry in after.context.experiment.heterogeneities)


def _fit(gathered: Gathered, grid: Grid, course: np.ndarray) -> Fit:
    """Drop of chi-square by motions with this course, as one frame; the model's own parameters may move along."""
    evidence = gathered.evidence
    fields = hats(evidence, grid).fields.toarray()
    columns = Columns(tuple(map(str, range(fields.shape[1]))), course[:, None, None] * fields,
                      np.zeros((len(course), len(evidence.channel_weight), fields.shape[1])))
    scores = score(evidence, null_model(evidence, gathered.null), columns)
    values, vectors, scale = spectrum(scores.information)
    good = values > RANK * values.max(initial=1e-300)
    gain = float(((vectors[:, good].T @ (scores.U * scale)) ** 2 / values[good]).sum())
    return Fit(evidence.frames[-1:], np.array([gain]), np.array([int(good.sum())]), np.zeros((1, 0)), float("nan"))
