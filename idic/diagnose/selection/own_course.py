"""A course that the data give, where the course of a selected cause leaves something.

Candidates are screened with a few courses: in proportion to the motion or to time, ramps and jumps from some moments
on. The cause that is selected keeps its pattern. Where its refit leaves more than noise, its course becomes linear
between knots (`idic.model.free_course`) and the model is refitted; the copy without a part in the fit decides whether
that course stays.

A cause with one amplitude per knot follows any function of time. Where the load only grows, that is any function of the
load: a free drift of the load cell and a stress that bends over the strain leave the same record. A rival that explains
nearly as much with a course of few unknowns is then not told from it, however large the drop of chi-square by the
further knots; unless the winner explained more than that rival when its own course had as few.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.physics.enrich import comes_back
from idic.diagnose.refits.refit import Refit
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob, Refits
from idic.diagnose.residual.heldout import Fit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.courses import course_of
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival, Round, within_noise
from idic.diagnose.selection.rivals import edits_of
from idic.model import without_knot

MIN_LEFT_Z = 3.0  # standard deviations of what a refit leaves in motions or channels
MIN_IMITATED_SHARE = 0.9  # of the held-out drop of the winner: what the rival leaves would be a flaw of its description


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


def with_imitated(one: Round, u: np.ndarray) -> Round:
    """The round with the rivals that the free course of its winner imitates among the indistinguishable ones.

    u : (n_frames, n_nodes, dim) simulated motion of the recording, whose way back tells a course from the load
    """
    winner = one.winner
    if winner is None or not has_own_course(winner) or comes_back(u):
        return one
    alike = [rival.name for rival in one.rivals
             if rival.name not in (winner.name, *one.equals) and rival.passes and rival.copies == winner.copies
             and len(rival.own_unknowns) < len(winner.own_unknowns) and not _is_behind(rival, one.plain)
             and rival.heldout > MIN_IMITATED_SHARE * winner.heldout]
    return replace(one, equals=(*one.equals, *dict.fromkeys(alike)))


def _is_behind(rival: Rival, plain: Rival | None) -> bool:
    """Whether the winner was better than this rival with as few unknowns, before its course was freed."""
    return (plain is not None and plain.copies == rival.copies and plain.evidence > rival.evidence
            and len(plain.own_unknowns) <= len(rival.own_unknowns) and not within_noise(rival, plain))
