"""A course that the data give, where the course of a selected cause leaves something.

Candidates are screened with a few courses: in proportion to the motion or to time, ramps and jumps from some moments
on. The cause that is selected keeps its pattern. Where its refit leaves more than noise, its course becomes linear
between knots (`idic.model.free_course`) and the model is refitted; the copy without a part in the fit decides whether
that course stays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.courses import course_of
from idic.diagnose.refit import Refit
from idic.diagnose.refit_job import ExperimentSource, RefitJob, Refits
from idic.diagnose.residual.heldout import Fit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.candidate import Variant
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival
from idic.diagnose.selection.rivals import edits_of
from idic.model import without_knot

MIN_LEFT_Z = 3.0  # standard deviations of what a refit leaves in motions or channels


def with_own_course(source: ExperimentSource, null: Refit, winner: Rival, screening: Screening, refits: Refits,
                    grid: Grid, seed: int) -> Rival | None:
    """The winner of a round with a course that the data give; None where it has no course, or needs no other one."""
    if winner.copies > 1 or winner.refitted.choice is None or not leaves_something(winner.refitted.choice):
        return None
    free = screening.free_course_of(winner.ranked.variant)
    if free is None or winner.ranked.variant.free_course:
        return None
    before, after = source.load(edits_of(winner, screening)), source.load(free.edits)
    (old,) = winner.ranked.variant.new
    course, size, start = course_of(before, old), winner.refitted.values[old], {}
    for name in free.new:
        hat = course_of(after, name)
        top = int(np.argmax(np.abs(hat)))
        start[name] = size * float(course[top] / hat[top])
    variant = replace(free, label=f"{winner.ranked.variant.label}, with an identified time course", probe=start)
    freed = refitted_as(variant, source, null, winner, refits, grid, seed)
    if freed is None:
        return None
    return freed if freed.heldout - winner.heldout > MIN_HELDOUT_DROP + len(free.new) - 1 else None


def refitted_as(variant: Variant, source: ExperimentSource, null: Refit, winner: Rival, refits: Refits, grid: Grid,
                seed: int) -> Rival | None:
    """The winner of a round refitted as another variant of its cause, from its own values and the probe of that
    variant; None where the refit fails."""
    start = {**winner.refitted.values, **variant.probe}
    (answer,) = refits([RefitJob(winner.name, source, (variant.label,), (variant.edits,), (start,),
                                 winner.refitted.local, grid, np.inf, seed)])
    if not answer.usable:
        return None
    return replace(winner, ranked=replace(winner.ranked, variant=variant, label=variant.label), refitted=answer,
                   achieved=null.choice.chi2 - answer.choice.chi2,
                   heldout=null.judgement.chi2 - answer.judgement.chi2)


def has_own_course(rival: Rival) -> bool:
    """Whether its course is given by the data."""
    return any(without_knot(name) != name for name in rival.ranked.variant.new)


def leaves_something(one: Fit) -> bool:
    """Whether a fit leaves more than noise in motions or channels."""
    channels = float((one.channels**2).sum() - one.channels.size) / np.sqrt(2.0 * max(one.channels.size, 1))
    return max(one.excess_z, channels) > MIN_LEFT_Z
