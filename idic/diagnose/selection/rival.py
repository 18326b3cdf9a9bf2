"""A candidate after its refit, a round of the selection, and which candidate wins it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.heldout import Misfit, pooled
from idic.diagnose.screen.practical import EffectSize, PracticalSize
from idic.diagnose.screen.select import MIN_SEPARATION_CHI2, Ranked, Screening
from idic.diagnose.selection.block_step import BlockJudgement

MIN_HELDOUT_DROP = 9.0  # chi-square per model and copy that judges
MIN_DROP_DIFFERENCE = 2e-3  # of a drop of chi-square: two simulations are not better than that
MIN_ACHIEVED_SHARE = 0.25  # of the promised drop of chi-square: a refit that ends with less has failed
COPIES = 2  # of the recording, whose drops of chi-square make the evidence for a rival
MIN_KEPT_SHARE = 0.5  # of the promised drop: a refit that keeps less was far from linear
MIN_TOLD_Z = 2.326  # of a unit normal: a difference of two rivals has the same sign in 99 % of repeated noise
MIN_TOLD_CHI2 = (2.0 * MIN_TOLD_Z) ** 2  # `noise_of_evidence`
MIN_PRIOR_ODDS = 19.0  # of plausible sizes, 95:5: of two that the recording does not tell apart the likelier leads
# of the drop of chi-square of all causes: less is a flaw of the description, neither a further cause nor what tells two
# apart
MIN_FURTHER_SHARE = 0.03
# of causes of a kind that are as large (`PlausibleSize`): twenty times the size that half of them stay under
MIN_SHARE_BEYOND = 1.0 / 400.0
MIN_LEFT_Z = 3.0  # standard deviations of what a refit leaves in motions or channels
NO_CAUSE = "geometric_nonlinearity"  # candidate that belongs to the description of every body


@dataclass(frozen=True, eq=False)
class Rival:
    """A shortlisted candidate after its refit.

    predicted, achieved : drop of chi-square on the copy for choosing; heldout : drop on the other one
    crossed : where both copies had to judge, its fit on the copy for choosing after a refit on the other one; heldout
    is the sum of both drops then, achieved_on_other what that refit achieved
    failed_on_one_copy : both copies had to judge, and there is no answer on one: it decides nothing
    rival_place : of a place, the refit at another one that the recording does not tell from it
    null : the fit without it; practical : the size below which it is not named
    """

    ranked: Ranked
    refitted: Fit
    predicted: float
    achieved: float
    heldout: float
    crossed_judgement: Misfit | None = None
    achieved_on_other: float = 0.0
    failed_on_one_copy: bool = False
    rival_place: Rival | None = None
    null: Fit | None = None
    practical: PracticalSize = field(kw_only=True)

    @property
    def name(self) -> str:
        return self.ranked.candidate.name

    @property
    def passes(self) -> bool:
        """Whether the improvement survives on data that had no part in the fit, and says something of its cause."""
        return self.improves and self.is_practical

    @property
    def improves(self) -> bool:
        """The same, whatever its size."""
        return (self.refitted.usable and not self.failed_on_one_copy and self.determined
                and self.heldout > self.min_heldout_drop)

    @property
    def is_practical(self) -> bool:
        """Whether its effect has a practical size, and more than its pattern shows it. Of grey values the screening
        decides: no refit has their size."""
        return self.is_large and self.practical.is_shown(self.shifts_std)

    @property
    def is_large(self) -> bool:
        """Whether its motion or its readings are."""
        return (self.effect is None or self.ranked.variant.pixels is not None
                or self.practical.is_reached(self.effect))

    @property
    def effect(self) -> EffectSize | None:
        """Its size by what the refit explains, and by its score where the refit keeps the promise: the score also knows
        what unknowns of single frames take up. None without a refit."""
        if self.null is None or self.null.choice is None or self.refitted.choice is None:
            return None
        ranked = self.ranked
        locality = ranked.local_px / ranked.effect_px if ranked.effect_px > 0.0 else 1.0
        size = self.practical.of_refit(self.null.choice, self.refitted.choice, len(self.own_unknowns), locality)
        if self.achieved < MIN_KEPT_SHARE * self.predicted:
            return size
        return size.or_larger(EffectSize(ranked.effect_px, ranked.local_px, ranked.effect_channel))

    @property
    def size(self) -> float | None:
        """In the unit of its plausible size; None where it states none, or its parameters have no such size."""
        prior, variant, values = self.ranked.candidate.size, self.ranked.variant, self.refitted.values
        if prior is None:
            return None
        names = [name for name in variant.new if name in values and (not prior.in_probes or name in variant.probe)]
        changes = {name: abs(values[name] - variant.null.get(name, 0.0)) for name in names}
        probes = {name: abs(variant.probe[name] - variant.null.get(name, 0.0)) if prior.in_probes else 1.0
                  for name in names}
        return max((changes[name] / probes[name] for name in names if 0.0 < probes[name] < np.inf), default=None)

    @property
    def share_beyond(self) -> float:
        """Share of such causes that are as large and larger; 1 where no size is stated."""
        prior, size = self.ranked.candidate.size, self.size
        return 1.0 if prior is None or size is None else prior.share_beyond(size)

    @property
    def shifts_std(self) -> dict[str, float]:
        """By how much it moves the parameters of the model without it, in their standard deviations there."""
        null, values = self.null, self.refitted.values
        return {} if null is None else {name: (values[name] - null.values[name]) / std
                                        for name, std in null.stds.items() if std and name in values}

    @property
    def min_heldout_drop(self) -> float:
        """Drop of chi-square on data without a part in the fit that is more than luck, for every copy that judges.

        The candidates were chosen on the whole recording. One that noise brings to z standard deviations there drops
        chi-square by z^2 - 3 e^2 in the sum over both copies, e a unit normal: twice the bar asks for more than 4.5.
        One copy alone, which judges clear and further causes, lets a quarter of those with 4 pass.
        """
        return (MIN_HELDOUT_DROP + len(self.ranked.variant.new)) * self.copies

    @property
    def copies(self) -> int:
        """How many judge."""
        return 1 if self.crossed_judgement is None else 2

    @property
    def achieved_everywhere(self) -> float:
        """Drops of chi-square where it was fitted, one copy or both."""
        return self.achieved + self.achieved_on_other

    @property
    def evidence(self) -> float:
        """Drop of chi-square on both copies, less twice its own unknowns: what rivals that pass are compared by.

        Each copy alone has half of the recording's power to tell two models apart. The drop where n unknowns were
        fitted is 2 n larger, on the mean, than the drop elsewhere (Akaike 1974). Where both copies judge, the mean of
        the two fits.
        """
        return (self.heldout + self.achieved_everywhere) / self.copies - 2.0 * len(self.own_unknowns)

    @property
    def own_unknowns(self) -> tuple[str, ...]:
        """Free parameters that the model without it does not have."""
        return tuple(name for name in self.refitted.stds if name not in self.ranked.bias)

    @property
    def refit_failed(self) -> bool:
        """Whether the refit gives no information on this candidate."""
        return (not self.refitted.usable or self.failed_on_one_copy
                or self.achieved < MIN_ACHIEVED_SHARE * self.predicted)

    @property
    def determined(self) -> bool:
        """Whether the recording fixes any of its own unknowns: of a spot anywhere, of any size and stiffness, nothing
        is known but that something is there.

        Of a law that acts in the whole body the kind of effect is known also where its unknowns imitate each other: of
        yielding that has only just begun the yield stress and the hardening (correlation 0.993) are open, each alone;
        so are all stiffnesses of an orthotropic body whose load cell has an unknown offset. And of a cause with one
        unknown its drop of chi-square says that this is not zero, however little of its size is known.
        """
        if self.ranked.candidate.changes_law:
            return True
        stds = [self.refitted.stds[name] for name in self.own_unknowns]
        return len(stds) < 2 or any(std is not None for std in stds)


@dataclass(frozen=True, eq=False)
class Round:
    """One addition to the model: screening of the null, refits of the shortlist, and the winner (None without one).

    crossed : the null's fit on the copy for choosing after a refit on the other one, where both had to judge
    source : the experiment of the null; passed_over : a rival that passes, and explains too little to be a further
    cause, or that blocks of the recording do not confirm; blocks : null and winner on them;
    plain : the winner before its course was freed; awaits_others : blocks do not confirm the winner alone, and judge it
    with the causes of later rounds
    """

    screening: Screening
    null: Fit
    rivals: tuple[Rival, ...]
    winner: Rival | None
    source: ExperimentSource = field(kw_only=True)
    equals: tuple[str, ...] = ()  # rivals that cannot be told from the winner
    crossed_judgement: Misfit | None = None
    passed_over: Rival | None = None
    blocks: tuple[BlockJudgement, ...] = ()
    plain: Rival | None = None
    awaits_others: bool = False

    def heldout_fits(self, rival: Rival) -> tuple[Misfit, Misfit]:
        """Of the null and a rival, where they had no part in the fit; on one copy where only one of them judged both:
        a revised round has a null of its own, and the rivals of before."""
        null_misfit, rival_misfit = self.null.judgement, rival.refitted.judgement
        if self.crossed_judgement is None or rival.crossed_judgement is None:
            return null_misfit, rival_misfit
        return pooled(null_misfit, self.crossed_judgement), pooled(rival_misfit, rival.crossed_judgement)


def with_winners(rounds: Sequence[Round]) -> list[tuple[Round, Rival]]:
    """Rounds that have a winner, with it."""
    return [(entry, entry.winner) for entry in rounds if entry.winner is not None]


def winners(rounds: Sequence[Round]) -> list[Rival]:
    """Of all rounds that have one."""
    return [winner for _, winner in with_winners(rounds)]


def causes_of(rounds: Sequence[Round]) -> list[Round]:
    """Rounds that have added a cause: finite strains belong to the description of every body, and what joins them first
    is no further cause."""
    return [entry for entry, winner in with_winners(rounds) if winner.name != NO_CAUSE]


def judge(rivals: Sequence[Rival], screening: Screening) -> tuple[Rival | None, tuple[str, ...]]:
    """Of the rivals that pass on held-out data the one with the most evidence, and the rivals that are
    indistinguishable.

    Rivals whose difference is within `noise_of_evidence` are one set, whatever side each is on. Of a set the member
    with the most evidence leads, unless the size of another one is far more plausible (`share_beyond`): that is a
    stated prior, and no member leaves the set by it. A rival whose refit failed stays with the winner where their
    patterns are indistinguishable. A rival with the winner as its limit is no alternative to it; the next round tests
    whether it adds anything.
    """
    passing = sorted((r for r in rivals if r.passes), key=lambda r: -r.evidence)
    if not passing:
        return None, ()
    winner = passing[0]
    limits = [r for r in passing if r.name in winner.ranked.candidate.limits]
    least = max(COPIES * MIN_SEPARATION_CHI2, winner.ranked.candidate.share_over_limit * winner.evidence)
    if limits and winner.evidence - limits[0].evidence < least:
        winner = limits[0]  # the same with fewer unknowns
    equals = indistinguishable(rivals, winner, screening)
    likelier = [r for r in passing if r.name in equals
                and r.share_beyond > MIN_PRIOR_ODDS * winner.share_beyond]
    if likelier:
        members = [winner, *(r for r in rivals if r.name in equals)]
        winner = max(likelier, key=lambda r: r.share_beyond)
        former = [r.name for r in members if r.name != winner.name and winner.name not in r.ranked.candidate.limits]
        equals = list(dict.fromkeys([*former, *indistinguishable(rivals, winner, screening)]))
    return winner, tuple(equals)


def indistinguishable(rivals: Sequence[Rival], winner: Rival, screening: Screening) -> list[str]:
    """Names of the rivals that this recording cannot tell from the winner, the ones with the most evidence first."""
    equals = []
    candidates = [r for r in rivals if r.refitted.usable and not r.failed_on_one_copy and r.determined
                  and r.heldout > 0.0]
    lost = [r for r in rivals if r.refit_failed and r not in candidates]
    for rival in (*sorted(candidates, key=lambda r: -r.evidence), *lost):
        if rival is winner or winner.name in rival.ranked.candidate.limits:
            continue
        alike = rival.refit_failed and screening.separation_chi2(winner.ranked, rival.ranked) < MIN_SEPARATION_CHI2
        if alike or (rival in candidates and within_noise(rival, winner)):
            equals.append(rival.name)
    return equals


def leaves_something(misfit: Misfit) -> bool:
    """Whether a fit leaves more than noise in motions or channels."""
    channels = float((misfit.channels**2).sum() - misfit.channels.size) / np.sqrt(2.0 * max(misfit.channels.size, 1))
    return max(misfit.excess_z, channels) > MIN_LEFT_Z


def within_noise(rival: Rival, winner: Rival) -> bool:
    """Whether the difference of two refits is not told (`noise_of_evidence`)."""
    return abs(winner.evidence - rival.evidence) < noise_of_evidence(winner)


def lead_of(winner: Rival, rival: Rival) -> float:
    """Chi-square by which a winner is ahead of another refit of its candidate, on both copies."""
    if winner.copies == rival.copies:
        return winner.evidence - rival.evidence
    return COPIES * (winner.achieved - rival.achieved)


def noise_of_evidence(winner: Rival) -> float:
    """The difference to a winner's evidence that is not told.

    The difference D of the chi-square of two models on one recording has the standard deviation 2 sqrt(D) where the
    better one is right: it keeps its sign in 99 % of repeated noise from D = (2 * 2.326)^2 on. Two simulations differ
    by a share of a large drop: time integration, convergence (creep and an equivalent Maxwell body: 15 108 and 15 120).
    And where the winner itself leaves something, its form is not quite that of the cause: another form that is behind
    by less than that, or by less than a flaw of the description, is not refuted by it. A laminate whose fibres stiffen:
    a drift of the force from a chosen frame on was ahead of nonlinear elasticity by 237 of 13 508 and left 95.
    """
    evidence = max(MIN_TOLD_CHI2, COPIES * MIN_DROP_DIFFERENCE * winner.achieved, COPIES * remainder(winner.refitted))
    if winner.refitted.choice is None or not leaves_something(winner.refitted.choice):
        return evidence
    return max(evidence, MIN_FURTHER_SHARE * winner.evidence)


def remainder(fit: Fit) -> float:
    """Chi-square that a fit leaves in motions and channels beyond two standard deviations of noise."""
    if fit.choice is None:
        return 0.0
    size = fit.choice.channels.size
    channels = float((fit.choice.channels**2).sum()) - size - 2.0 * float(np.sqrt(2.0 * size))
    return fit.choice.room + max(channels, 0.0)
