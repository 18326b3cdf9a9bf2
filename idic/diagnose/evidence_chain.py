"""The chain of evidence of a verdict: what was found, its number, the threshold that it was held against.

One row per step, in the order of the decision; the verdict follows from the last column. The page shows it as a table,
and says none of it again in other words: every step has its message here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from idic.diagnose.locate.mismatch import MAX_MISMATCH_P, Mismatch
from idic.diagnose.remainder import Remainder
from idic.diagnose.residual.channel_left import MIN_READING_SHARE
from idic.diagnose.screen.practical import MAX_UNSEEN_SHIFT_STD
from idic.diagnose.screen.select import MAX_FAMILYWISE_P
from idic.diagnose.selection.rival import MIN_SHARE_BEYOND, Rival, Round, noise_of_evidence, with_winners
from idic.diagnose.selection.verdict import MIN_RECOVERED_SHARE, Verdict

ABOVE, BELOW = ">", "<"  # the side of the threshold on which a step holds


@dataclass(frozen=True)
class Message:
    """What a step says. claim : in words, with what it is about in braces; sense : `ABOVE` or `BELOW`, where it holds;
    unit : of both numbers, "" of none"""

    claim: str
    sense: str = ABOVE
    unit: str = ""

    def link(self, number: float, threshold: float, **words: str) -> Link:
        """The step with its numbers."""
        return Link(self.claim.format(**words), number, threshold, self.unit, self.sense)


MISMATCH_P = Message("mismatch: probability under noise and a motion at the practical margin", BELOW)
MISMATCH_SIZE = Message("motion that the identified model leaves, rms", unit="px")
SCORE_P = Message("{title}: family-wise p of its score", BELOW)
MOTION_SIZE = Message("{title}: motion where it acts", unit="px")
READING_SIZE = Message("{title}: readings, in standard deviations of one")
HELDOUT_DROP = Message("{title}: drop of chi-square on held-out data")
SHIFT = Message("{title}: shift of {parameter}, in its standard deviations, while nothing else shows a mismatch", BELOW)
SHARE_BEYOND = Message("{title}: share of such causes that are as large ({usual} is usual)")
DIFFERENCE = Message("{title}: evidence over {rival}, drop of chi-square")
EXPLAINED = Message("explained share of the residual")
MOTION_LEFT = Message("motion that the last model leaves, rms", BELOW, "px")
READING_LEFT = Message("part of {column} that the last model leaves, of its largest value", BELOW)


@dataclass(frozen=True)
class Link:
    """One step: a message with its numbers."""

    claim: str
    number: float
    threshold: float
    unit: str
    sense: str

    @property
    def holds(self) -> bool:
        """Whether the number is on the side of the threshold that the step asks for."""
        return self.number > self.threshold if self.sense == ABOVE else self.number < self.threshold

    @property
    def content(self) -> dict:
        """The entry of diagnosis.json."""
        return {"what": self.claim, "number": self.number, "threshold": self.threshold, "unit": self.unit,
                "sense": self.sense, "holds": self.holds}


def chain_of(mismatch: Mismatch | None, rounds: Sequence[Round], verdict: Verdict, remainder: Remainder) -> list[dict]:
    """Every step with its number, its threshold, and whether it holds."""
    links = [*_mismatch(mismatch, remainder), *_without_winner(rounds[0])]
    for entry, winner in with_winners(rounds):
        links += [*_candidate(winner, entry), *_against_rivals(winner, entry)]
    links += _remainder(verdict, remainder)
    return [link.content for link in links]


def _mismatch(mismatch: Mismatch | None, remainder: Remainder) -> Iterator[Link]:
    if mismatch is not None:
        yield MISMATCH_P.link(mismatch.p_value, MAX_MISMATCH_P)
        yield MISMATCH_SIZE.link(mismatch.effect_px_rms, remainder.excesses[0].margin_px)


def _without_winner(entry: Round) -> Iterator[Link]:
    """The nearest candidate where none was selected."""
    if entry.winner is None and entry.screening.ranked:
        ranked = entry.screening.ranked[0]
        rival = next((rival for rival in entry.rivals if rival.ranked.key == ranked.key), None)
        yield SCORE_P.link(ranked.p_familywise, MAX_FAMILYWISE_P, title=ranked.candidate.title)
        yield from _size(ranked.candidate.title, ranked.local_px, ranked.effect_channel, entry)
        if rival is not None and rival.refitted.usable:
            yield from _heldout(rival)
            yield from _shift(rival)


def _size(title: str, local_px: float, channel_std: float, entry: Round) -> Iterator[Link]:
    practical = entry.screening.practical
    yield MOTION_SIZE.link(local_px, practical.px, title=title)
    yield READING_SIZE.link(channel_std, practical.channel_std, title=title)


def _heldout(rival: Rival) -> Iterator[Link]:
    yield HELDOUT_DROP.link(rival.heldout, rival.min_heldout_drop, title=rival.ranked.candidate.title)


def _shift(rival: Rival) -> Iterator[Link]:
    """By how much it moves a parameter, where nothing but its pattern shows a mismatch."""
    shifts = rival.shifts_std
    if not rival.practical.is_located and shifts:
        name = max(shifts, key=lambda entry: abs(shifts[entry]))
        yield SHIFT.link(abs(shifts[name]), MAX_UNSEEN_SHIFT_STD, title=rival.ranked.candidate.title, parameter=name)


def _candidate(winner: Rival, entry: Round) -> Iterator[Link]:
    candidate, effect = winner.ranked.candidate, winner.effect
    yield SCORE_P.link(winner.ranked.p_familywise, MAX_FAMILYWISE_P, title=candidate.title)
    if effect is not None:
        yield from _size(candidate.title, effect.local_px, effect.channel_std, entry)
    yield from _heldout(winner)
    yield from _shift(winner)
    if candidate.size is not None and winner.size is not None:
        yield SHARE_BEYOND.link(winner.share_beyond, MIN_SHARE_BEYOND, title=candidate.title,
                                usual=candidate.size.words)


def _against_rivals(winner: Rival, entry: Round) -> Iterator[Link]:
    """The best rival: behind by more than noise, or in the set."""
    rivals = [rival for rival in entry.rivals if rival is not winner and rival.improves]
    if rivals:
        rival = max(rivals, key=lambda member: member.evidence)
        yield DIFFERENCE.link(winner.evidence - rival.evidence, noise_of_evidence(winner),
                              title=winner.ranked.candidate.title, rival=rival.ranked.candidate.title)


def _remainder(verdict: Verdict, remainder: Remainder) -> Iterator[Link]:
    excess = remainder.excesses[0]
    if verdict.selected:
        yield EXPLAINED.link(verdict.share, MIN_RECOVERED_SHARE)
    yield MOTION_LEFT.link(excess.motion_px, excess.margin_px)
    for channel in remainder.channels:
        yield READING_LEFT.link(channel.reading_share, MIN_READING_SHARE, column=channel.column)
