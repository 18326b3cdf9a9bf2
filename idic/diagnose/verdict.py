"""From numbers to a verdict: one word for a program, one sentence for a person.

    none              no candidate is significant and large enough; every family is bounded
    single            one candidate, and no rival that this record could not tell from it
    set               one of several candidates that this record cannot tell apart
    multiple          several effects, found one after the other
    outside_library   something is there, and no candidate explains most of it, or a good part is left that matters
    blind             nothing can be said: the identified parameters would hide every candidate, or the noise every
                      candidate of what the specimen does under load
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.diagnose.channel_left import ChannelLeft
from idic.diagnose.refit import Refit
from idic.diagnose.refit_job import ExperimentSource
from idic.diagnose.residual.margin import PRACTICAL_MARGIN_PX
from idic.diagnose.residual.heldout import Fit, pooled, share_recovered
from idic.diagnose.screen.candidate import Candidate
from idic.diagnose.screen.select import MAX_HIDDEN_VISIBILITY, MIN_PROBE_Z, MIN_SEPARATION_CHI2, Ranked, Screening

MIN_RECOVERED_SHARE = 0.7  # of the explainable share; below, the library does not hold the missing effect
MIN_EXCESS_Z = 5.0  # standard deviations of an excess that count as something
MAX_EXCESS_LEFT = 0.1  # of the motions' excess left, above the practical margin: a formal fit, not the cause
MAX_LOCAL_EXCESS_LEFT = 0.01  # the same at the place of a fitted inclusion: a tenth of the motion's amplitude
MAX_INCLUSION_EXCESS_LEFT = 0.02  # the same with an inclusion in the model, of motions with its time course: right ones left 0.006 at most
MIN_HELDOUT_DROP = 9.0  # chi-square per model and copy that judges
MIN_DROP_DIFFERENCE = 2e-3  # of a drop of chi-square: two simulations are not better than that
MIN_ACHIEVED_SHARE = 0.25  # of the promised drop of chi-square: a refit that ends with less has failed
COPIES = 2  # of the recording, whose drops of chi-square make the evidence for a rival
MIN_FURTHER_SHARE = 0.03  # of the drop of chi-square of all causes: less is a flaw of the description, not a further cause
MAX_AVERAGED_IMAGES = 400  # to be averaged: more is impractical


@dataclass(frozen=True, eq=False)
class Rival:
    """A shortlisted candidate after its refit.

    predicted, achieved : drop of chi-square on the copy for choosing; heldout : drop on the other one
    crossed : where both copies had to judge, its fit on the copy for choosing after a refit on the other one; heldout is
    the sum of both drops then, achieved_on_other what that refit achieved
    silent : both copies had to judge, and there is no answer on one: it decides nothing
    """

    ranked: Ranked
    refitted: Refit
    predicted: float
    achieved: float
    heldout: float
    crossed_judgement: Fit | None = None
    achieved_on_other: float = 0.0
    failed_on_one_copy: bool = False

    @property
    def name(self) -> str:
        return self.ranked.candidate.name

    @property
    def passes(self) -> bool:
        """Whether the improvement survives on data that had no part in the fit, and says something of its cause."""
        return self.refitted.usable and not self.failed_on_one_copy and self.determined and self.heldout > self.min_heldout_drop

    @property
    def min_heldout_drop(self) -> float:
        """Drop of chi-square on data without a part in the fit that is more than luck, for every copy that judges.

        The candidates were chosen on one of two: a sum that had to pass the bar of one alone would let a wrong one that
        was significant there (4 standard deviations) pass in 3 of 100 cases, and not in 3 of 1000.
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

        Each copy alone has half of the recording's power to tell two models apart. The drop where n unknowns were fitted is
        2 n larger, on the mean, than the drop elsewhere (Akaike 1974). Where both copies judge, the mean of the two fits.
        """
        return (self.heldout + self.achieved_everywhere) / self.copies - 2.0 * len(self.own_unknowns)

    @property
    def own_unknowns(self) -> tuple[str, ...]:
        """Free parameters that the model without it does not have."""
        return tuple(name for name in self.refitted.stds if name not in self.ranked.bias)

    @property
    def refit_failed(self) -> bool:
        """Whether the refit gives no information on this candidate."""
        return not self.refitted.usable or self.failed_on_one_copy or self.achieved < MIN_ACHIEVED_SHARE * self.predicted

    @property
    def determined(self) -> bool:
        """Whether the recording fixes any of its own unknowns: of a spot anywhere, of any size and stiffness, nothing
        is known but that something is there.

        Of a law that acts in the whole body the kind of effect is known also where its unknowns imitate each other: of
        yielding that has only just begun the yield stress and the hardening (correlation 0.993) are open, each alone.
        """
        if self.ranked.candidate.kind.active:
            return True
        own = [self.refitted.stds[name] for name in self.own_unknowns]
        return not own or any(std is not None for std in own)


@dataclass(frozen=True, eq=False)
class Round:
    """One addition to the model: screening of the null, refits of the shortlist, and the winner (None without one).

    crossed : the null's fit on the copy for choosing after a refit on the other one, where both had to judge
    source : the experiment of the null; passed_over : a rival that passes, and explains too little to be a further cause
    """

    screening: Screening
    null: Refit
    rivals: tuple[Rival, ...]
    winner: Rival | None
    equals: tuple[str, ...] = ()  # rivals that cannot be told from the winner
    crossed_judgement: Fit | None = None
    source: ExperimentSource | None = None
    passed_over: Rival | None = None

    def heldout_fits(self, rival: Rival) -> tuple[Fit, Fit]:
        """Of the null and a rival, where they had no part in the fit."""
        one, other = self.null.judgement, rival.refitted.judgement
        if rival.crossed_judgement is None:
            return one, other
        return pooled(one, self.crossed_judgement), pooled(other, rival.crossed_judgement)


@dataclass(frozen=True)
class Verdict:
    """The outcome.

    word : see the module; selected : candidates in the model, in the order of the rounds; indistinguishable : groups of
    candidates; excluded : candidates with a 95 % bound; cannot_tell : candidates that this test cannot see;
    next_experiment : the test that separates a group; share : explained share of the explainable residual
    """

    word: str
    selected: tuple[str, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    excluded: tuple[Mapping[str, str], ...]
    cannot_tell: tuple[str, ...]
    next_experiment: str | None
    share: float
    before: Fit
    after: Fit


def judge(rivals: Sequence[Rival], screening: Screening) -> tuple[Rival | None, tuple[str, ...]]:
    """Of the rivals that pass on held-out data the one with the most evidence, and the rivals that are indistinguishable.

    The difference in chi-square of two models on one recording has the standard deviation 2 sqrt(D), with D the
    chi-square that separates them: D < 9 per copy leaves both. A rival whose refit failed stays with the winner where
    their patterns are indistinguishable. A rival with the winner as its limit is no alternative to it; the next round
    tests whether it adds anything.
    """
    passing = sorted((r for r in rivals if r.passes), key=lambda r: -r.evidence)
    if not passing:
        return None, ()
    winner = passing[0]
    limits = [r for r in passing if r.name in winner.ranked.candidate.limits]
    if limits and winner.evidence - limits[0].evidence < COPIES * MIN_SEPARATION_CHI2:
        winner = limits[0]  # the same with fewer unknowns
    equals = []
    near = [r for r in rivals if r.refitted.usable and not r.failed_on_one_copy and r.determined and r.heldout > 0.0]
    lost = [r for r in rivals if r.refit_failed and r not in near]
    for rival in (*sorted(near, key=lambda r: -r.evidence), *lost):
        if rival is winner or winner.name in rival.ranked.candidate.limits:
            continue
        alike = rival.refit_failed and screening.separation_chi2(winner.ranked, rival.ranked) < MIN_SEPARATION_CHI2
        if alike or (rival in near and _within_noise(rival, winner)):
            equals.append(rival.name)
    return winner, tuple(equals)


def _within_noise(rival: Rival, winner: Rival) -> bool:
    """Whether the difference of two refits is within noise, or within the error of time integration and convergence
    for a large drop (creep and an equivalent Maxwell body: 15 108 and 15 120).
    """
    gap = abs(winner.evidence - rival.evidence)
    return gap < COPIES * max(MIN_SEPARATION_CHI2, MIN_DROP_DIFFERENCE * winner.achieved)


@dataclass(frozen=True, eq=False)
class ExcessLeft:
    """Excess of the residual before and after an addition to the model.

    power : chi-square of a motion of one px (rms) in all its frames; max_share, margin_px : share of the excess before,
    and motion, that only another cause leaves; camera_px : motion that the camera shows at rest, 0 where it is unknown
    """

    before: Fit
    after: Fit
    power: float
    max_share: float = MAX_EXCESS_LEFT
    margin_px: float = PRACTICAL_MARGIN_PX
    camera_px: float = 0.0

    @property
    def matters(self) -> bool:
        """Whether a part is left that is significant, large enough, and a good share of the excess before."""
        return (self.after.excess_z > MIN_EXCESS_Z and self.after.excess > self.max_share * self.before.excess
                and self.motion_px > self.margin_px)

    @property
    def motion_px(self) -> float:
        """Motion (px rms) that free motions still ask for beyond noise."""
        return effect(self.after, self.power)


def conclude(rounds: Sequence[Round], before: Fit, after: Fit, real: bool, excess: Sequence[ExcessLeft],
             unloads: bool | None = False, camera_chi2: float = 0.0, channels: Sequence[ChannelLeft] = ()) -> Verdict:
    """The verdict of a finished chain.

    Parameters
    ----------
    before, after : fits of the first and the last model, held out
    real : whether anything was located, whatever the candidates say
    excess : of the whole recording, with half the noise variance of a copy; of the copy that had no part in the fit, to
        which a model with many unknowns cannot have adapted; of motions with the time course of the selected candidate
        (`idic.diagnose.screen.time_course`) or at its place (`idic.diagnose.screen.local_residual`)
    unloads : whether the load of the recording came back to zero after its largest value; None where no log says so
    camera_chi2 : chi-square of the camera's own floor in `after`, which no model explains
    channels : what the last model leaves in them on the whole recording
    """
    won = [r for r in rounds if r.winner is not None]
    first, last = rounds[0].screening, rounds[-1].screening
    share = share_recovered(before, after, camera_chi2) if won else float("nan")
    in_channels = any(one.matters for one in channels)
    in_motions = (real and not won) or (bool(won) and any(_is_unexplained(one, share) for one in excess))
    word = _word(won, first, in_channels or in_motions)
    selected = tuple(r.winner.name for r in won)
    sets = tuple((r.winner.name, *r.equals) for r in won if r.equals)
    in_model = set(selected).union(*(r.equals for r in won)) if won else set()
    excluded = tuple({"name": r.candidate.name, "bound": bound_text(r)} for r in last.ranked
                     if r.standing in ("excluded", "small", "inadmissible") and r.candidate.name not in in_model)
    cannot = tuple(dict.fromkeys(r.candidate.name for r in last.ranked
                                 if r.standing == "cannot_tell" and r.candidate.name not in in_model))
    return Verdict(word, selected, sets, excluded, cannot, _next(word, won, first, unloads, in_motions), share, before,
                   after)


def _word(won: Sequence[Round], first: Screening, unexplained: bool) -> str:
    if not won:
        if unexplained:
            return "outside_library"
        hidden = bool(first.ranked) and all(r.visibility < MAX_HIDDEN_VISIBILITY for r in first.ranked)
        return "blind" if hidden or is_insensitive(first) else "none"
    if unexplained:
        return "outside_library"
    if len(won) > 1:
        return "multiple"
    return "set" if won[0].equals else "single"


def is_insensitive(screening: Screening) -> bool:
    """Whether no candidate of the specimen under load would have been significant at a plausible size.

    Camera, grips and warmth may still be bounded: without a load they are, and it says nothing of the material.
    """
    own = _under_load(screening)
    return bool(own) and all(r.standing == "cannot_tell" and r.largest_probe_z < MIN_PROBE_Z for r in own)


def _under_load(screening: Screening) -> list[Ranked]:
    """Candidates of the specimen whose effect grows with the load."""
    return [r for r in screening.ranked if r.candidate.side == "bulk" and r.candidate.kind.under_load]


def _is_unexplained(excess: ExcessLeft, share: float) -> bool:
    """Whether the selected candidate is a formal fit: a large share of the residual, or of the motions, is left.

    Motions count apart from the whole share, as a force that many candidates can fit would outweigh them.
    """
    if not excess.after.excess_z > MIN_EXCESS_Z or not np.isfinite(share) or excess.motion_px < excess.camera_px:
        return False
    return share < MIN_RECOVERED_SHARE or excess.matters


def _next(word: str, won: Sequence[Round], first: Screening, unloads: bool | None, in_motions: bool) -> str | None:
    """The next test: it separates the members of a set (cheapest first), makes a blind test sensitive, or locates the side
    of an unexplained mismatch.
    """
    for one in won:
        if one.equals:
            return _separating(one.winner.ranked.candidate)
    if word == "outside_library" and not in_motions:
        return ("hang a dead weight on the load cell and repeat the test at another speed: a reading that no motion goes with "
                "comes from the load train, its clock or the rate")
    if word == "outside_library":
        return ("repeat the test and unload to zero once: motion that stays is inelastic" if unloads is False else
                "repeat the test with the specimen, or a second one, mounted end for end: unexplained motion that turns "
                "with it comes from the specimen; motion that stays comes from the grips, the machine or the camera")
    if word == "blind":
        return _more_sensitive(first) if is_insensitive(first) else (
            "lock parameters that are known from another test, and diagnose again")
    return None


def _more_sensitive(screening: Screening) -> str | None:
    """By how much load or noise would have to change for the first of the specimen's candidates to show.

    To first order: a probe's effect grows as the load, the noise of a mean falls as the root of its number.
    """
    nearest = max(_under_load(screening), key=lambda r: r.largest_probe_z)
    if not nearest.largest_probe_z > 0.0:
        return None
    factor = MIN_PROBE_Z / nearest.largest_probe_z
    images = int(np.ceil(factor**2))
    average = f", or average {images} images of every frame" if images <= MAX_AVERAGED_IMAGES else ""
    return (f"load it {factor:.2g} times as far{average}: then the candidate nearest to visibility "
            f"({nearest.candidate.title}) would show at a plausible size")


def _separating(candidate: Candidate) -> str | None:
    return candidate.separating_tests[0] if candidate.separating_tests else None


def bound_text(ranked: Ranked) -> str:
    """What is excluded, in the candidate's own unit."""
    name = ranked.variant.new[0] if ranked.variant.direct else f"the effect of {ranked.label!r}"
    if ranked.variant.direct:
        return f"|{ranked.label}| < {ranked.bound:.2g} (95 %)"
    return f"less than {100.0 * ranked.bound:.2g} % of {name.removeprefix('the effect of ')} (95 %)"


def effect(before: Fit, unit_motion_chi2: float) -> float:
    """Motion (px rms) that free motions ask for beyond noise; unit_motion_chi2 : chi-square of one px, all frames."""
    return float(np.sqrt(max(before.gain.sum() - before.rank.sum(), 0.0) / max(unit_motion_chi2, 1e-300)))
