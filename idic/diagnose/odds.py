"""The members of the indistinguishable sets: the plausibility of their sizes, and their odds with and without it."""

from __future__ import annotations

from collections.abc import Sequence

from idic.diagnose.selection.rival import Rival, Round


def members_of(entry: Round) -> list[Rival]:
    """The winner of a round, then the rivals that are indistinguishable from it."""
    equals = [next(rival for rival in entry.rivals if rival.name == name) for name in dict.fromkeys(entry.equals)
              if any(rival.name == name for rival in entry.rivals)]
    return [] if entry.winner is None else [entry.winner, *equals]


def odds_of(rounds: Sequence[Round], probability: float | None) -> list[list[dict]]:
    """Every set of several members: ``name``, ``share_without`` (of the recording alone, which does not tell them
    apart: even), ``share_with`` (by the stated sizes, too), ``probability`` (its part of that of the set, null where
    the test says nothing), ``times_plausible`` in the unit of ``plausible`` (null where any size is), ``source``.

    probability : that the sets hold the truth
    """
    sets = []
    for entry in rounds:
        members = members_of(entry)
        if len(members) < 2:
            continue
        total = sum(member.share_beyond for member in members)
        sets.append([_member(member, len(members), total, probability) for member in members])
    return sets


def _member(member: Rival, number: int, total: float, probability: float | None) -> dict:
    prior, size = member.ranked.candidate.size, member.size
    times = None if prior is None or size is None else size / prior.size
    share = member.share_beyond / total
    return {"name": member.name, "share_without": 1.0 / number, "share_with": share,
            "probability": None if probability is None else share * probability,
            "times_plausible": times, "plausible": None if prior is None else prior.words,
            "source": None if prior is None else prior.source}
