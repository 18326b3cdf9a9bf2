"""Selection goes both ways: every selected cause is tested again for removal and for exchange once others have joined
it.

The first cause is chosen while nothing else is in the model. What comes after may make it idle, or show that one of its
rivals fits the whole better. A revised set keeps the causes before the one in question, leaves that one out or puts a
rival in its place, and adds the later causes again; the whole is refitted and judged on the copy that had no part in
it.

    removal    accepted where the whole loses less than a further cause would have to bring
    exchange   accepted where the whole gains more than two models differ by noise; with the former course in place of
               one that the data give, where the whole loses less than that course had to bring
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.physics.candidate import Candidate
from idic.diagnose.refits.refit import Refit
from idic.diagnose.refits.refit_job import ExperimentSource, Refits
from idic.diagnose.residual.channel_left import explains_a_channel
from idic.diagnose.residual.heldout import Fit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.select import MIN_SEPARATION_CHI2, Ranked, Screening
from idic.diagnose.selection.few_jumps import with_few_jumps
from idic.diagnose.selection.own_course import has_own_course, with_own_course
from idic.diagnose.selection.own_scale import with_own_scale
from idic.diagnose.selection.rival import MIN_DROP_DIFFERENCE, MIN_FURTHER_SHARE, MIN_HELDOUT_DROP, Rival, Round
from idic.diagnose.selection.rivals import edits_of, refit_of_candidate
from idic.model import jump_frame

MAX_EXCHANGES = 2  # rivals that are tried in the place of one cause
MIN_EXCHANGE_SHARE = 0.3  # of the winner's drop of chi-square: a rival that may overtake it in the company of others
Screen = Callable[[ExperimentSource, Refit, Sequence[Candidate]], Screening]


@dataclass(frozen=True)
class Workplace:
    """What refits of revised sets need.

    screen : scores some candidates against a model on the recording; refits, grid, seed : as of all refits
    """

    screen: Screen
    refits: Refits
    grid: Grid
    seed: int


def min_further_drop(rival: Rival, whole_drop: float) -> float:
    """Held-out drop of chi-square that makes a cause one of several; whole_drop : of all causes together.

    A drop below a share of what all explain is a flaw of their description: a course or a mesh that differs a little.
    """
    return max(MIN_HELDOUT_DROP + len(rival.ranked.variant.new), MIN_FURTHER_SHARE * whole_drop)


def earns_its_place(rival: Rival, first: Fit, without: Fit, together: Fit) -> bool:
    """Whether a cause is one of several.

    first, without, together : models without any cause, and without and with this one, held out

    A channel has one reading per frame, where the images have thousands of motions: next to an inclusion friction of
    0.5 % of the largest force brings a hundredth of the whole, and is all that is wrong with the force. So a cause that
    acts on a channel, without a free course that would follow anything, needs no share of the whole where it explains
    what the verdict would call unexplained.
    """
    drop, variant = without.chi2 - together.chi2, rival.ranked.variant
    if drop >= min_further_drop(rival, first.chi2 - together.chi2):
        return True
    return (rival.ranked.candidate.side == "force" and not variant.free_course
            and drop >= MIN_HELDOUT_DROP + len(variant.new)
            and explains_a_channel(first.channels, without.channels, together.channels))


def revised(rounds: Sequence[Round], place: Workplace) -> list[Round]:
    """The rounds after removals and exchanges; as they are where every cause earns its place."""
    rounds = list(rounds)
    for _ in range(len(rounds)):
        better = _better(rounds, place)
        if better is None:
            break
        rounds = better
    return rounds


def _better(rounds: list[Round], place: Workplace) -> list[Round] | None:
    """The first removal or exchange that is accepted, of all causes but the last, which has just earned its place."""
    whole = rounds[-1].winner.refitted  # type: ignore[union-attr]
    first = rounds[0].null.judgement
    whole_drop = first.chi2 - whole.judgement.chi2
    for number in range(len(rounds) - 1):
        winner = rounds[number].winner
        allowed = min_further_drop(winner, whole_drop)
        if not is_needed(winner.ranked, whole, allowed):
            without = _rebuilt(rounds, number, None, place)
            if without is not None and not earns_its_place(winner, first, _judged(without), whole.judgement):
                return without
        gap = max(MIN_SEPARATION_CHI2, MIN_DROP_DIFFERENCE * whole_drop)
        for rival in exchangeable(rounds[number]):
            other = _rebuilt(rounds, number, rival, place)
            fewer = len(winner.ranked.variant.new) - len(rival.ranked.variant.new)
            least = -(MIN_HELDOUT_DROP + fewer) if rival is rounds[number].plain else gap
            if other is not None and whole.judgement.chi2 - _judged(other).chi2 > least:
                return other
    return None


def is_needed(ranked: Ranked, whole: Refit, allowed: float) -> bool:
    """Whether a parameter of a cause stands so far from its null in the whole that no refit without it need be made."""
    variant = ranked.variant
    for name in variant.new:
        std, null = whole.stds.get(name), variant.null.get(name, 0.0)
        if std and np.isfinite(null) and ((whole.values[name] - null) / std) ** 2 > 2.0 * allowed:
            return True
    return False


def exchangeable(one: Round) -> list[Rival]:
    """The winner of a round with the course it was screened with, then rivals that come near it, or cannot be told from
    it, the best first.
    """
    near = [r for r in one.rivals if r is not one.winner and r.refitted.usable and r.determined
            and (r.name in one.equals or r.achieved > MIN_EXCHANGE_SHARE * one.winner.achieved)]
    plain = [] if one.plain is None else [one.plain]
    return plain + sorted(near, key=lambda r: -r.achieved)[:MAX_EXCHANGES]


def _judged(rounds: Sequence[Round]) -> Fit:
    return rounds[-1].winner.refitted.judgement  # type: ignore[union-attr, return-value]


def _rebuilt(rounds: Sequence[Round], number: int, instead: Rival | None, place: Workplace) -> list[Round] | None:
    """The rounds with another cause, or none, in one place; None where a refit fails or a later cause does not
    apply."""
    kept, here = list(rounds[:number]), rounds[number]
    source, model = here.source, here.null
    whole, own = rounds[-1].winner.refitted.values, () if instead is None else instead.ranked.variant.new
    if instead is not None:
        kept.append(replace(here, winner=instead, equals=(), crossed_judgement=None, plain=None))
        source, model = source.with_edits(edits_of(instead, here.screening)), instead.refitted
    for later in rounds[number + 1:]:
        known = later.winner.ranked
        fresh = instead is None and model is here.null
        screening = here.screening if fresh else place.screen(source, model, [known.candidate])
        ranked = next((r for r in screening.ranked if r.key == known.key and np.isfinite(r.std)), None)
        if ranked is None:
            return None
        rival = refit_of_candidate(source, model, ranked, screening, place.refits, place.grid, place.seed,
                                   _starts({**later.winner.refitted.values, **whole}, own))
        if not rival.refitted.usable:
            return None
        rival = with_own_scale(source, model, rival, place.refits, place.grid, place.seed) or rival
        if has_own_course(later.winner):
            rival = with_own_course(source, model, rival, screening, place.refits, place.grid, place.seed) or rival
        if any(jump_frame(name) is not None for name in later.winner.ranked.variant.new):
            rival = with_few_jumps(source, model, rival, place.refits, place.grid, place.seed) or rival
        others = here.rivals if fresh else ()
        kept.append(Round(screening, model, (rival, *(r for r in others if r.ranked.key != rival.ranked.key)), rival,
                          source=source))
        source, model = source.with_edits(edits_of(rival, screening)), rival.refitted
    return kept


def _starts(values: Mapping[str, float], own: Sequence[str]) -> dict[str, float]:
    """Values of parameters as a start of a revised set, but those of the cause that joins it instead.

    own : its parameters. Two courses of one cause may share a name: an expansion per kelvin is found where the warmth
    goes with time, and stated where the temperature of every frame is found.
    """
    return {name: value for name, value in values.items() if name not in own}
