"""The verdict of a diagnosis: one word for programs, one sentence for people.

    none              no candidate is significant and large enough; every family is bounded
    single            one candidate; every rival is separated from it by this record
    set               one of several candidates that this record cannot separate
    multiple          several effects, found one after the other
    outside_library   a misfit that no candidate explains for the most part, or of which a significant part is left
    blind             nothing can be said: the identified parameters would hide every candidate, or the noise every
                      candidate of what the specimen does under load
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.diagnose.physics.candidate import Candidate
from idic.diagnose.residual.channel_left import ChannelLeft
from idic.diagnose.residual.excess_left import MIN_EXCESS_Z, ExcessLeft
from idic.diagnose.residual.heldout import Misfit, share_recovered
from idic.diagnose.screen.select import MAX_HIDDEN_VISIBILITY, MIN_PROBE_Z, Ranked, Screening
from idic.diagnose.selection.rival import MIN_SHARE_BEYOND, Rival, Round, with_winners
from idic.parameters import Parameter

MIN_RECOVERED_SHARE = 0.7  # of the explainable share; below, the library does not hold the missing effect
REFIT, BOUND = "refit", "bound"  # what excludes a candidate
MAX_AVERAGED_IMAGES = 400  # to be averaged: more is impractical
UNLOADING = "unload to zero"  # beginning of a test that a recording may hold already


@dataclass(frozen=True)
class Verdict:
    """The outcome.

    word : see the module; selected : candidates in the model, in the order of the rounds; indistinguishable : groups of
    candidates; excluded : insignificant candidates with a 95 % bound, and by what (`REFIT`, `BOUND`); cannot_tell :
    candidates that this test cannot see; next_experiment : the test that separates a group; share : explained share of
    the explainable residual; in_motions : whether motion is unexplained; in_channels : columns whose readings are;
    unsettled : candidates whose score would exclude them, which says too little of an effect that is far from linear;
    beyond_plausible : selected candidates of a size that no such cause has
    """

    word: str
    selected: tuple[str, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    excluded: tuple[Mapping[str, str], ...]
    cannot_tell: tuple[str, ...]
    next_experiment: str | None
    share: float
    before: Misfit
    after: Misfit
    in_motions: bool = False
    in_channels: tuple[str, ...] = ()
    unsettled: tuple[str, ...] = ()
    beyond_plausible: tuple[str, ...] = ()


def conclude(rounds: Sequence[Round], base: Misfit, enriched: Misfit, real: bool, excess: Sequence[ExcessLeft],
             unloads: bool | None = False, camera_chi2: float = 0.0, channels: Sequence[ChannelLeft] = (),
             freedom: Callable[[Ranked], Parameter | None] = lambda _: None) -> Verdict:
    """The verdict of a finished chain.

    Parameters
    ----------
    base, enriched : fits of the first and the last model, held out
    real : whether anything was located, whatever the candidates say
    excess : of the whole recording, with half the noise variance of a copy; of the copy that had no part in the fit, to
        which a model with many unknowns cannot have adapted; of motions with the time course of the selected candidate
        (`idic.diagnose.screen.time_course`) or at its place (`idic.diagnose.screen.local_residual`)
    unloads : whether the load of the recording came back to zero after its largest value; None where no log says so
    camera_chi2 : chi-square of the camera's own floor in `enriched`, or of the practical margin where only readings
        were off: what no model explains
    channels : what the last model leaves in them on the whole recording
    freedom : the degree of freedom of a direct candidate, whose unit its bound has
    """
    won = with_winners(rounds)
    first, final = rounds[0].screening, rounds[-1].screening
    readings = bool(excess) and is_of_readings(excess[0], channels)
    share = share_recovered(base, enriched, camera_chi2) if won else float("nan")
    in_channels = tuple(entry.column for entry in channels
                        if entry.matters or (share < MIN_RECOVERED_SHARE and entry.is_left))
    in_motions = (real and not won) or (bool(won) and any(
        _is_unexplained(entry, share, readings) for entry in excess))
    beyond = tuple(winner.name for _, winner in won if winner.share_beyond < MIN_SHARE_BEYOND)
    word = _word(won, first, bool(in_channels) or in_motions or bool(beyond))
    selected = tuple(winner.name for _, winner in won)
    sets = tuple((winner.name, *entry.equals) for entry, winner in won if entry.equals)
    in_model = set(selected).union(*(entry.equals for entry, _ in won))
    shown_names = in_model | {r.candidate.name for r in final.ranked
                              if r.standing in ("significant", "small", "inadmissible")}
    is_quiet = not _leaves(won, real, excess, channels)
    by = {r.candidate.name: excluded_by(r.candidate, rounds, is_quiet) for r in final.ranked
          if r.standing == "excluded" and r.candidate.name not in shown_names}
    excluded = tuple({"name": r.candidate.name, "bound": bound_text(r, freedom(r)), "by": by[r.candidate.name]}
                     for r in final.ranked if r.standing == "excluded" and by.get(r.candidate.name))
    cannot = tuple(dict.fromkeys(r.candidate.name for r in final.ranked
                                 if r.standing == "cannot_tell" and r.candidate.name not in in_model))
    advice = _next(word, won, first, unloads, in_motions, [entry for entry in channels if entry.is_left])
    return Verdict(word, selected, sets, excluded, cannot, advice, share, base, enriched, in_motions, in_channels,
                   tuple(name for name, reason in by.items() if not reason), beyond)


def _leaves(won: Sequence[tuple[Round, Rival]], real: bool, excess: Sequence[ExcessLeft],
            channels: Sequence[ChannelLeft]) -> bool:
    """Whether the last model leaves more than noise."""
    in_motions = any(entry.after.excess_z > MIN_EXCESS_Z for entry in excess[:1]) if won else real
    return in_motions or any(channel.is_significant for channel in channels)


def excluded_by(candidate: Candidate, rounds: Sequence[Round], is_quiet: bool) -> str:
    """What excludes a candidate whose score is insignificant: a refit that explains nothing, or the bound of the score;
    "" where neither does.

    A bound is one of first order. It holds for every effect where the model leaves noise alone: an amplitude within it
    is small. Where something is left, an effect that is far from linear may be large and have no score: a bar that
    necks has left the straight line of a small plastic strain.
    """
    refits = [rival for entry in rounds for rival in entry.rivals if rival.name == candidate.name]
    if any(rival.refitted.usable and rival.refitted.status == "converged" and not rival.improves for rival in refits):
        return REFIT
    return BOUND if is_quiet or not candidate.is_nonlinear else ""


def _word(won: Sequence[tuple[Round, Rival]], first: Screening, unexplained: bool) -> str:
    if not won:
        if unexplained:
            return "outside_library"
        hidden = bool(first.ranked) and all(r.visibility < MAX_HIDDEN_VISIBILITY for r in first.ranked)
        return "blind" if hidden or is_insensitive(first) else "none"
    if unexplained:
        return "outside_library"
    if len(won) > 1:
        return "multiple"
    return "set" if won[0][0].equals else "single"


def is_insensitive(screening: Screening) -> bool:
    """Whether no candidate of the specimen under load would have been significant at a plausible size.

    Camera, grips and warmth may still be bounded: without a load they are, and it says nothing of the material.
    """
    candidates = _under_load(screening)
    return bool(candidates) and all(r.standing == "cannot_tell" and r.largest_probe_z < MIN_PROBE_Z for r in candidates)


def _under_load(screening: Screening) -> list[Ranked]:
    """Candidates of the specimen whose effect grows with the load."""
    return [r for r in screening.ranked if r.candidate.side == "bulk" and r.candidate.kind.under_load]


def is_of_readings(excess: ExcessLeft, channels: Sequence[ChannelLeft]) -> bool:
    """Whether a finding is one of readings alone: before any cause a channel was off, and motions by less than the
    practical margin. What motions leave then is no finding, however many pixels make it significant: it is what
    interpolation and discretisation leave of a complete model, and no cause of readings explains it.

    excess : of the whole recording
    """
    return excess.before_px < excess.margin_px and any(channel.was_off for channel in channels)


def _is_unexplained(excess: ExcessLeft, share: float, readings: bool = False) -> bool:
    """Whether the selected candidate is a formal fit: a large share of the residual, or of the motions, is left.

    What noise leaves forbids nothing, however large its share of a faint effect; of a share below
    `MIN_RECOVERED_SHARE` anything significant does, here and in the channels.
    Motions count apart from the whole share, as a force that many candidates can fit would outweigh them.
    """
    floor = max(excess.camera_px, excess.margin_px) if readings else excess.camera_px
    if not excess.after.excess_z > MIN_EXCESS_Z or not np.isfinite(share) or excess.motion_px < floor:
        return False
    return share < MIN_RECOVERED_SHARE or excess.matters


def _next(word: str, won: Sequence[tuple[Round, Rival]], first: Screening, unloads: bool | None, in_motions: bool,
          channels: Sequence[ChannelLeft]) -> str | None:
    """The next test: it separates the members of a set (cheapest first), makes a blind test sensitive, locates the side
    of an unexplained mismatch, or confirms a cause.

    channels : channels in which a part remains
    """
    for entry, winner in won:
        if entry.equals:
            return _separating(winner.ranked.candidate)
    if word == "outside_library" and not in_motions and channels and not any(channel.is_load for channel in channels):
        return ("measure a known motion with the extensometer and repeat the test at another speed: a reading without "
                "a corresponding motion comes from the gauge, its mounting or its clock")
    if word == "outside_library" and not in_motions:
        return ("hang a dead weight on the load cell and repeat the test at another speed: a reading without a "
                "corresponding motion comes from the load train, its clock or the rate")
    if word == "outside_library":
        return ("repeat the test and unload to zero once: motion that stays is inelastic" if unloads is False else
                "repeat the test with the specimen, or a second one, mounted end for end: unexplained motion that "
                "turns "
                "with it comes from the specimen; motion that stays comes from the grips, the machine or the camera")
    if word == "blind":
        return _more_sensitive(first) if is_insensitive(first) else (
            "lock parameters that are known from another test, and diagnose again")
    if won:
        cause = won[0][1].ranked.candidate
        test = next((test for test in cause.separating_tests if not (unloads and test.startswith(UNLOADING))), None)
        return None if test is None else f"to confirm {cause.title}, {test}"
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


def bound_text(ranked: Ranked, freedom: Parameter | None = None) -> str:
    """What is excluded, in the user's unit of the candidate's own degree of freedom."""
    if ranked.variant.direct:
        size, unit = (ranked.bound, "") if freedom is None else (ranked.bound / abs(freedom.factor), freedom.unit)
        return f"|{ranked.label}| < {size:.2g}{f' {unit}' if unit not in ('', '-') else ''} (95 %)"
    return f"less than {100.0 * ranked.bound:.2g} % of its plausible size ({ranked.label}; 95 %)"
