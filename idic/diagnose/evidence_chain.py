"""The chain of evidence of a verdict: what was found, its number, the threshold that it was held against.

One row per step, in the order of the decision; the verdict follows from the last column. The page shows it as a table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from idic.diagnose.locate.mismatch import MAX_MISMATCH_P, Mismatch
from idic.diagnose.remainder import Remainder
from idic.diagnose.residual.channel_left import MIN_READING_SHARE
from idic.diagnose.screen.practical import MAX_UNSEEN_SHIFT_STD
from idic.diagnose.screen.select import MAX_FAMILYWISE_P
from idic.diagnose.selection.rival import Rival, Round, noise_of_evidence, with_winners
from idic.diagnose.selection.verdict import MIN_RECOVERED_SHARE, MIN_SHARE_BEYOND, Verdict

ABOVE, BELOW = ">", "<"  # the side of the threshold on which a step holds


@dataclass(frozen=True)
class Link:
    """One step. claim : in words; sense : `ABOVE` or `BELOW`, where it holds; unit : of both numbers, "" of none"""

    claim: str
    number: float
    threshold: float
    unit: str = ""
    sense: str = ABOVE

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
        yield Link("mismatch: probability under noise and a motion at the practical margin", mismatch.p_value,
                   MAX_MISMATCH_P, sense=BELOW)
        yield Link("motion that the identified model leaves, rms", mismatch.effect_px_rms,
                   remainder.excesses[0].margin_px, "px")


def _without_winner(entry: Round) -> Iterator[Link]:
    """The nearest candidate where none was selected."""
    if entry.winner is None and entry.screening.ranked:
        ranked = entry.screening.ranked[0]
        rival = next((rival for rival in entry.rivals if rival.ranked.key == ranked.key), None)
        yield Link(f"{ranked.candidate.title}: family-wise p of its score", ranked.p_familywise, MAX_FAMILYWISE_P,
                   sense=BELOW)
        yield from _size(ranked.candidate.title, ranked.local_px, ranked.effect_channel, entry)
        if rival is not None and rival.refitted.usable:
            yield from _heldout(rival)
            yield from _shift(rival)


def _size(title: str, local_px: float, channel_std: float, entry: Round) -> Iterator[Link]:
    practical = entry.screening.practical
    yield Link(f"{title}: motion where it acts", local_px, practical.px, "px")
    yield Link(f"{title}: readings, in standard deviations of one", channel_std, practical.channel_std)


def _heldout(rival: Rival) -> Iterator[Link]:
    yield Link(f"{rival.ranked.candidate.title}: drop of chi-square on held-out data", rival.heldout,
               rival.min_heldout_drop)


def _shift(rival: Rival) -> Iterator[Link]:
    """By how much it moves a parameter, where nothing but its pattern shows a mismatch."""
    shifts = rival.shifts_std
    if not rival.practical.is_located and shifts:
        name = max(shifts, key=lambda entry: abs(shifts[entry]))
        yield Link(f"{rival.ranked.candidate.title}: shift of {name}, in its standard deviations, while nothing else "
                   "shows a mismatch", abs(shifts[name]), MAX_UNSEEN_SHIFT_STD, sense=BELOW)


def _candidate(winner: Rival, entry: Round) -> Iterator[Link]:
    title, size = winner.ranked.candidate.title, winner.effect
    yield Link(f"{title}: family-wise p of its score", winner.ranked.p_familywise, MAX_FAMILYWISE_P, sense=BELOW)
    if size is not None:
        yield from _size(title, size.local_px, size.channel_std, entry)
    yield from _heldout(winner)
    yield from _shift(winner)
    if winner.ranked.candidate.size is not None and winner.size is not None:
        yield Link(f"{title}: share of such causes that are as large ({winner.ranked.candidate.size.words} is usual)",
                   winner.share_beyond, MIN_SHARE_BEYOND)


def _against_rivals(winner: Rival, entry: Round) -> Iterator[Link]:
    """The best rival: behind by more than noise, or in the set."""
    rivals = [rival for rival in entry.rivals if rival is not winner and rival.improves]
    if rivals:
        rival = max(rivals, key=lambda member: member.evidence)
        yield Link(f"{winner.ranked.candidate.title}: evidence over {rival.ranked.candidate.title}, drop of chi-square",
                   winner.evidence - rival.evidence, noise_of_evidence(winner))


def _remainder(verdict: Verdict, remainder: Remainder) -> Iterator[Link]:
    excess = remainder.excesses[0]
    if verdict.selected:
        yield Link("explained share of the residual", verdict.share, MIN_RECOVERED_SHARE)
    yield Link("motion that the last model leaves, rms", excess.motion_px, excess.margin_px, "px", BELOW)
    for channel in remainder.channels:
        yield Link(f"part of {channel.column} that the last model leaves, of its largest value",
                   channel.reading_share, MIN_READING_SHARE, sense=BELOW)
