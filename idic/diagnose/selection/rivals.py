"""Rivals of a round: which candidates are refitted, in which order and from where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Variant
from idic.diagnose.refits.refit import (MAX_BODY_EVALUATIONS, MAX_STARTS, MIN_BODY_EVALUATIONS, EarlyStop, Fit,
                                        warm_start)
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob, Refits
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import drop_on_copy
from idic.diagnose.screen.select import MAX_SHORTLIST, Ranked, Screening
from idic.diagnose.selection.rival import MIN_KEPT_SHARE, Rival, noise_of_evidence

MAX_PARALLEL_REFITS = 2  # refits side by side after the first: the fewer, the better the bar is known
MIN_GAIN_OVER_LIMIT = 1.1  # times the promise of its limit: a larger model is refitted as well
MIN_PROMISE_SHARE = 0.5  # of the best rival's drop: a candidate that promises less is not refitted
LUCK_STD = 2.0  # standard deviations of a drop on one copy that may be luck
MAX_ROOM_SHARE = 0.05  # of the drop of a refit: with less excess left it explains all
FIRST_ORDER_ERROR_SHARE = 0.2  # of a promise: error of first order
MAX_CLOSE_CHI2 = 25.0  # chi-square between two candidates that are hardly distinguishable, noise included


def refitted(source: ExperimentSource, null: Fit, screening: Screening, refits: Refits, grid: Grid, seed: int,
             bends: bool = False, is_alone: bool = False, is_far: bool = False) -> tuple[Rival, ...]:
    """Refit the shortlist, the most promising first; a candidate that cannot win any more is left out.

    A candidate that falls short of its promise and could still win starts again elsewhere. The reserve follows the
    shortlist, by the same rule; the rivals of the best candidate's family come last (`same_family_rivals`).

    Parameters
    ----------
    refits : runs jobs side by side; how many it can changes nothing in what they are asked (`next_wave`)
    bends : the null has a law that yields, and nothing is in the model yet (`same_family_rivals`)
    is_alone : only the most promising candidate is refitted, with the standard deviations of a last model
    is_far : the null is pixels off: what first order promises of a law says nothing (`other_laws`)
    """
    waiting, early_stop, best = alternatives(screening.shortlist), None, 0.0
    rivals: dict[tuple[str, str], Rival] = {}
    laws: set[tuple[str, str]] = set()
    reserve = [r for r in alternatives([*screening.shortlist, *screening.reserve]) if r in screening.reserve]
    starts = {r.key: starting_variants(screening, r.candidate, r.variant) for r in [*waiting, *reserve]}

    def run(chosen, first: int, end: int, min_drop: float | None = None) -> list[Rival]:
        jobs = [_job(source, null, r, starts[r.key][first:end], first == 0 and min_drop is None,
                     MIN_KEPT_SHARE * r.gain if min_drop is None else min_drop, grid, seed, early_stop) for r in chosen]
        answers = refits([replace(job, whole_std=is_alone) for job in jobs])
        return [_rival(ranked, answer, null, screening) for ranked, answer in zip(chosen, answers, strict=True)]

    if is_alone:
        return tuple(run(next_wave(waiting, True), 0, MAX_STARTS)) if waiting else ()
    while waiting:
        wave = next_wave(waiting, not rivals)
        waiting = waiting[len(wave):]
        rivals |= {rival.ranked.key: rival for rival in run(wave, 0, 1)}
        ahead = max((r for r in rivals.values() if r.refitted.usable), key=lambda r: r.achieved, default=None)
        best = 0.0 if ahead is None else ahead.achieved
        waiting = waiting if laws else contenders(waiting, ahead)
        if not waiting:
            waiting, reserve = contenders(reserve, ahead), []
            if is_far and not waiting:
                waiting, is_far = [r for r in other_laws(screening) if r.key not in rivals], False
                starts |= {r.key: starting_variants(screening, r.candidate, r.variant) for r in waiting}
                laws = {r.key for r in waiting}
        # an unknown more takes two of the functional on the mean, whatever it is (`Rival.evidence`)
        ends = [null.phi, *(r.refitted.phi + 2.0 * len(r.own_unknowns) for r in rivals.values())]
        lowest = min((phi for phi in ends if np.isfinite(phi)), default=np.nan)
        early_stop = None if laws else EarlyStop(null.phi, lowest)
    akin = same_family_rivals(screening, tuple(rivals.values()), bends)
    untried = [r for r in akin if r.key not in rivals]
    starts |= {r.key: starting_variants(screening, r.candidate, r.variant) for r in untried}
    short = [r.ranked for r in rivals.values() if len(starts[r.ranked.key]) > 1
             and (r.predicted > best or r.ranked in akin)
             and not (r.refitted.usable and r.achieved > MIN_KEPT_SHARE * r.predicted)]
    rivals |= {rival.ranked.key: rival for rival in run(untried, 0, MAX_STARTS, best)}
    for rival in run(short, 1, MAX_STARTS):
        former = rivals[rival.ranked.key]
        if rival.refitted.usable and not (former.refitted.usable and former.achieved >= rival.achieved):
            rivals[rival.ranked.key] = rival
    return tuple(rivals.values())


def same_family_rivals(screening: Screening, rivals: Sequence[Rival], bends: bool = False) -> list[Ranked]:
    """Rivals of the best candidate in its family: they are refitted whatever first order promises of them. Where the
    best is a law that leaves a good part, its rivals of other families are refitted as well: a solid that flows was
    told as nonlinear elasticity (92 % explained), and plasticity, 143 of its 166 standard deviations, was not tried.

    The best is the candidate with the largest drop where it was fitted, if no candidate passes on one copy.

    bends : the null has a law that yields: bends of its hardening curve are refitted as well if no candidate passes, or
    if the best one is another law that leaves something

    A straight line of hardening that was identified hides a bend to first order (drop of chi-square 28 promised, 128
    once it was refitted), and the back stress that imitates it was selected alone (93). Only where the way to the
    answer is not straight: laws, not channels and cameras. The same bend, clear, let warmth and a drift of the force
    stand out instead (z 7.6 and 6.1, itself 2.7), which did not survive on the other copy. Where another law passes and
    leaves a good part, it may stand for a bend, too: a curve that saturates, reloaded, was told as rate dependence.
    """
    passing = [r for r in rivals if r.passes]
    candidates = passing or [r for r in rivals if r.refitted.usable and r.achieved > r.min_heldout_drop]
    best = max(candidates, key=lambda r: r.achieved, default=None)
    laws = [r for r in screening.ranked if not r.variant.direct and r.variant.pixels is None]
    stands_in = best is not None and bool(passing) and best.ranked.candidate.changes_law and not explains_all(best)
    akin = [] if best is None else [r for r in laws if r.candidate.name in best.ranked.candidate.rivals
                                    and r.material == best.ranked.material
                                    and (r.candidate.family == best.ranked.candidate.family
                                         or (stands_in and r.candidate.changes_law))]
    hidden = [r for r in laws if r.candidate.hidden_by_yield_law and r not in akin]
    return akin + (hidden if bends and rivals and (not passing or stands_in) else [])


def other_laws(screening: Screening) -> list[Ranked]:
    """Significant candidates that change the law of a material, the most promising first.

    Where the null is pixels off they are refitted whatever they promise: the response to a law that flows is far from a
    straight line (an elastic bar that necks in the images: the place of the neck as a soft spot promises ten times what
    plasticity does, and explains less).
    """
    laws = [r for r in screening.significant if r.candidate.changes_law]
    return sorted(laws, key=lambda r: -r.gain)[:MAX_SHORTLIST]


def next_wave(waiting: Sequence[Ranked], first: bool) -> list[Ranked]:
    """Rivals refitted side by side next: the most promising one alone, then `MAX_PARALLEL_REFITS`; slow ones together.

    The result of a wave decides which others are still refitted, and is their bar. With waves as wide as there are
    workers, the answer would depend on the number of workers.
    """
    equally_slow = takewhile(lambda r: _is_slow(r) == _is_slow(waiting[0]), waiting)
    return list(equally_slow)[:1 if first else MAX_PARALLEL_REFITS]


def contenders(waiting: Sequence[Ranked], ahead: Rival | None) -> list[Ranked]:
    """Candidates that may still win against the best refit so far; all, where there is none.

    A promise bounds what a candidate explains only where its effect is a straight line in its amplitude. Beside
    parameters that are far off, one that yields, flows, slips or tears may explain any multiple of its promise: a solid
    that yields, identified as elastic, was told as creep (its promise 11 965), whose exponent imitates yielding, and
    plasticity (8811, and as much as creep once it was refitted) was left out. Such a candidate is refitted until it
    cannot win (`EarlyStop`).
    """
    if ahead is None:
        return list(waiting)
    return [r for r in waiting if r.candidate.is_nonlinear
            or (r.gain > MIN_PROMISE_SHARE * without_luck(ahead)
                and not (explains_all(ahead) and promises_too_little(r, ahead)))]


def without_luck(ahead: Rival) -> float:
    """The drop of a refit less what the noise of its copy may have brought, but not less than was promised.

    Promises are of the whole recording, a refit sees one copy, and a drop D has the standard deviation 2 sqrt(D) there:
    a force drift at 5 standard deviations (14 promised) brought 31 on its copy and -5 on the other, and an offset of
    the load cell, which was the truth, was not refitted.
    """
    if ahead.achieved <= ahead.predicted:
        return ahead.achieved
    return max(ahead.predicted, ahead.achieved - LUCK_STD * 2.0 * float(np.sqrt(ahead.achieved)))


def explains_all(ahead: Rival) -> bool:
    """Whether a refit explains all there is, as its score promised: no rival can do better, and first order is
    right."""
    return (ahead.refitted.choice.room < MAX_ROOM_SHARE * ahead.achieved
            and ahead.achieved > (1.0 - FIRST_ORDER_ERROR_SHARE) * ahead.predicted)


def promises_too_little(ranked: Ranked, ahead: Rival) -> bool:
    """Whether a candidate promises less than one that this record could not tell from the best would."""
    return ranked.gain < min((1.0 - FIRST_ORDER_ERROR_SHARE) * ahead.predicted, ahead.predicted - MAX_CLOSE_CHI2)


def alternatives(shortlist: Sequence[Ranked]) -> list[Ranked]:
    """The shortlist without those that promise no more than a limit of theirs: their turn is after it.

    Damage, whose simulations are slow where a body begins to tear, comes behind those that promise nearly as much:
    there is a bar for it then.
    """
    gains = {r.key: r.gain for r in shortlist}
    candidates = [r for r in shortlist
                  if not any(r.gain < max(MIN_GAIN_OVER_LIMIT, 1.0 + r.candidate.share_over_limit)
                             * gains.get((limit, r.material), 0.0)
                             for limit in r.candidate.limits)]
    close_gain = (1.0 - FIRST_ORDER_ERROR_SHARE) * max(gains.values(), default=0.0)
    slow = [r for r in candidates if _is_slow(r) and r.gain >= close_gain]
    quick = [r for r in candidates if r not in slow]
    end = max((k for k, r in enumerate(quick) if r.gain >= close_gain), default=-1) + 1
    return [*quick[:end], *slow, *quick[end:]]


def starting_variants(screening: Screening, candidate: Candidate, best: Variant) -> list[Variant]:
    """The best variant, then those of the same candidate with the same unknowns by score, at most `MAX_STARTS`."""
    scores = screening.scores
    scored = {trial.variant.label: (abs(scores.z[i]), trial.variant) for i, trial in enumerate(screening.trials)
              if trial.candidate.name == candidate.name and trial.variant.new == best.new}
    ordered = sorted((entry for label, entry in scored.items() if label != best.label), key=lambda e: -e[0])
    return [best, *(variant for _, variant in ordered)][:MAX_STARTS]


def opposite_place(screening: Screening, ranked: Ranked) -> Ranked | None:
    """The best place of a candidate with the opposite sign of its amplitude; None where no place asks for that.

    A stiff inclusion in the middle of a bar and a soft one at its end leave nearly the same motion: which of the two
    has the higher score, noise decides, and a search from the one does not come to the other.
    """
    scores = screening.scores
    opposite = [i for i, trial in enumerate(screening.trials)
                if trial.candidate.name == ranked.candidate.name and trial.variant.new == ranked.variant.new
                and trial.variant.place is not None and scores.U[i] * ranked.amplitude < 0.0]
    if not opposite:
        return None
    best = max(opposite, key=lambda i: abs(scores.z[i]))
    return replace(ranked, best=best, variant=screening.trials[best].variant, label=screening.trials[best].name,
                   amplitude=float(scores.expected_change[best]), std=float(scores.std[best]),
                   gain=drop_on_copy(scores.gain([best]), 1), bias=scores.bias_uncovered(best))


def refit_of_candidate(source: ExperimentSource, null: Fit, ranked: Ranked, screening: Screening, refits: Refits,
                       grid: Grid,
                       seed: int, values: Mapping[str, float]) -> Rival:
    """One candidate refitted on top of a model, from given values first, then from its probes.

    values : of parameters, where they are known; others as the candidate begins
    """
    variants = starting_variants(screening, ranked.candidate, ranked.variant)
    job = _job(source, null, ranked, variants[:1], True, MIN_KEPT_SHARE * ranked.gain, grid, seed, None)
    job = replace(job, labels=(job.labels[0], *job.labels), edits=(job.edits[0], *job.edits),
                  values=({**job.values[0], **values}, *job.values))
    (answer,) = refits([job])
    return _rival(ranked, answer, null, screening)


def refitted_from_other_starts(source: ExperimentSource, null: Fit, winner: Rival, screening: Screening,
                               refits: Refits, grid: Grid, seed: int) -> Rival | None:
    """What was selected, from its other starts: a law that leaves a good part from its other variants; a place that
    leaves one, or that the score does not tell apart, from the best one of the opposite sign. None where it has none,
    or none of them finds an answer."""
    answer, ranked = winner.refitted, winner.ranked
    if answer.choice is None:
        return None
    leaves_part = answer.choice.room >= MAX_ROOM_SHARE * winner.achieved
    if (place := opposite_place(screening, ranked)) is not None:
        if not leaves_part and ranked.gain - place.gain > noise_of_evidence(winner):
            return None
        job = _job(source, null, place, [place.variant], True, np.inf, grid, seed, None)
        ranked = place
    elif ranked.candidate.changes_law and leaves_part and winner.copies == 1:
        variants = [v for v in starting_variants(screening, ranked.candidate, ranked.variant)
                    if v.label != answer.label]
        if not variants:
            return None
        job = _job(source, null, ranked, variants, False, np.inf, grid, seed, None)
    else:
        return None
    (refit,) = refits([job])
    return _rival(ranked, refit, null, screening) if refit.usable else None


def edits_of(winner: Rival, screening: Screening) -> dict[str, Any]:
    """The edits of the variant that the winner's refit began at."""
    variant = variant_of(winner, screening)
    return {**variant.edits, **variant.refit}


def variant_of(rival: Rival, screening: Screening) -> Variant:
    """The variant that a rival's refit began at."""
    if rival.refitted.label == rival.ranked.variant.label:
        return rival.ranked.variant
    variants = [trial.variant for trial in screening.trials if trial.candidate.name == rival.name]
    return next(v for v in variants if v.label == rival.refitted.label)


def finite(rival: Rival, screening: Screening) -> Rival:
    """A rival whose variant, where it brings a law of its own, brings the finite form."""
    variant = variant_of(rival, screening)
    edits, refit = ({key: _finite_table(value) for key, value in table.items()}
                    for table in (variant.edits, variant.refit))
    return replace(rival, ranked=replace(rival.ranked, variant=replace(variant, edits=edits, refit=refit)))


def _finite_table(value: Any) -> Any:
    """A table of a material with its kinematics, finite; every other value as it is."""
    return {**value, "kinematics": "finite"} if isinstance(value, Mapping) and "kinematics" in value else value


def _is_slow(ranked: Ranked) -> bool:
    """Whether its simulations take long: a body begins to tear."""
    return ranked.candidate.slow


def _job(source: ExperimentSource, null: Fit, ranked: Ranked, variants: Sequence[Variant], warm: bool, drop: float,
         grid: Grid, seed: int, early_stop: EarlyStop | None) -> RefitJob:
    """Variants start at their probes; warm : the best of them first at the amplitude of its score.

    drop : of chi-square, which ends the search for a better start
    """
    begins = [(v.label, {**v.edits, **v.refit}, {**null.values, **(v.null if v.direct else v.probe)})
              for v in variants]
    if warm:
        begins.insert(0, (begins[0][0], begins[0][1], warm_start(ranked, null.values)))
    labels, edits, values = zip(*begins, strict=True)
    return RefitJob(ranked.candidate.name, source, labels, edits, values, null.local, grid,
                    null.choice.chi2 - drop, seed, early_stop, most_evaluations=most_body_evaluations(null))


def most_body_evaluations(null: Fit) -> int:
    """Evaluations of the body per frame, beyond which a simulation of a rival has failed: more where the identified
    model takes several increments per frame itself, and where frames are few."""
    intervals = max(1, len(null.local) - 1)
    per_frame = 1.0 if null.steps is None else len(null.steps) / intervals
    return round(max(MAX_BODY_EVALUATIONS * per_frame, MIN_BODY_EVALUATIONS / intervals))


def _rival(ranked: Ranked, answer: Fit, null: Fit, screening: Screening) -> Rival:
    achieved, heldout = ((null.choice.chi2 - answer.choice.chi2, null.judgement.chi2 - answer.judgement.chi2)
                         if answer.usable else (float("nan"), float("nan")))
    return Rival(ranked, answer, ranked.gain, achieved, heldout, null=null, practical=screening.practical)
