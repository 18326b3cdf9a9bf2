"""What a diagnosis cannot exclude: indistinguishable rivals, rivals that come near, and effects that this test cannot
see.

An effect that the identified parameters absorb leaves no residual, but biases them: its plausible size is named with
the shift that it would cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from idic.diagnose import (
    Diagnosis, HIDDEN_BY_MOTION, MESH_TOO_COARSE, MIN_EXCESS_Z, Ranked, Round, Variant, Verdict, holds,
)
from idic.report.result.words import short_names, size_text

FAR_FROM_LINEAR = "not refitted; its score says little of an effect that is far from linear, and a part remains"
MIN_HIDDEN_SHIFT_STD = 2.0  # standard deviations of a parameter that an invisible effect would move it by
MIN_NEAR_SHARE = 0.3  # of the winner's drop of chi-square: a rival that comes near
MIN_OTHER_SHARE = 0.5  # the same of one that is no known rival
MAX_HIDDEN = 5  # invisible effects that are named, the largest shift first


def not_excluded(diagnosis: Diagnosis, identified: Mapping[str, Mapping]) -> list[dict[str, str]]:
    """Entries ``name``, ``why``, the nearest first.

    identified : per free parameter of the identified model its last value and std in the unit of the file, as in
    result.json
    """
    won = [entry for entry in diagnosis.rounds if entry.winner is not None]
    entries = [*_untestable(won), *_near(won, diagnosis),
               *larger_models(won, diagnosis.verdict), *_passed_over(diagnosis), *_waiting(diagnosis.rounds[-1]),
               *({"name": name, "why": FAR_FROM_LINEAR} for name in diagnosis.verdict.unsettled)]
    members = {name for entry in won for name in entry.equals}  # of a set: nothing that is told beside says more
    entries = [*_indistinguishable(won), *(entry for entry in entries if entry["name"] not in members)]
    entries = list({(entry["name"], entry["why"]): entry for entry in entries}.values())
    names = {entry["name"] for entry in entries} | set(diagnosis.verdict.selected)
    return entries + [entry for entry in _hidden(diagnosis, identified) if entry["name"] not in names]


def _indistinguishable(won: Sequence[Round]) -> Iterator[dict[str, str]]:
    for entry in won:
        for name in dict.fromkeys(entry.equals):
            yield {"name": name, "why": "indistinguishable under this loading"}


def _untestable(won: Sequence[Round]) -> Iterator[dict[str, str]]:
    """Rivals that this record cannot separate from a selected candidate."""
    for entry in won:
        selected = entry.winner.ranked.candidate
        for rival, reason in entry.screening.untestable:
            if rival.name in selected.rivals or selected.name in rival.rivals:
                yield {"name": rival.name, "why": reason}


def _waiting(final_round: Round) -> Iterator[dict[str, str]]:
    """Candidates of grey values that are not tested because of unexplained motion, and what asks for a finer mesh."""
    for candidate, reason in final_round.screening.untestable:
        if reason == HIDDEN_BY_MOTION or reason.startswith(MESH_TOO_COARSE):
            yield {"name": candidate.name, "why": reason}


def _near(won: Sequence[Round], diagnosis: Diagnosis) -> Iterator[dict[str, str]]:
    """Rivals that explain a large part of what the selected candidate explains."""
    is_left = any(channel.is_significant for channel in diagnosis.remainder.channels)
    if not (is_left or diagnosis.verdict.after.excess_z > MIN_EXCESS_Z):
        return
    for entry in won:
        winner = entry.winner
        selected = winner.ranked.candidate
        for rival in entry.rivals:
            candidate = rival.ranked.candidate
            relation = selected.rivals.get(candidate.name) or candidate.rivals.get(selected.name)
            share = (rival.achieved if rival.refitted.usable
                     else rival.predicted) / winner.achieved
            if rival is winner or rival.name in entry.equals or not share > (MIN_NEAR_SHARE if relation
                                                                             else MIN_OTHER_SHARE):
                continue
            reach = "explains" if rival.refitted.usable else "was predicted to explain"
            given_up = "" if rival.refitted.usable else " (its refit was given up)"
            yield {"name": candidate.name,
                   "why": f"{reach} {100.0 * min(share, 1.0):.0f} % of what {selected.title} explains{given_up}; a "
                          f"part remains{f': {relation}' if relation else ''}"}


def larger_models(won: Sequence[Round], verdict: Verdict) -> Iterator[dict[str, str]]:
    """Models that have a selected candidate as a special case and were not refitted, as they promised hardly more,
    where a part remains and the last model's screening does not exclude them."""
    settled = {entry["name"] for entry in verdict.excluded}
    if not verdict.after.excess_z > MIN_EXCESS_Z:
        return
    for entry in won:
        winner = entry.winner.ranked
        refitted = {rival.ranked.key for rival in entry.rivals}
        for ranked in entry.screening.significant:
            is_larger = winner.candidate.name in ranked.candidate.limits and ranked.material == winner.material
            if is_larger and ranked.key not in refitted and ranked.candidate.name not in settled:
                yield {"name": ranked.candidate.name,
                       "why": f"has {winner.candidate.title} as a special case; its score promised "
                              f"{100.0 * (ranked.gain / winner.gain):.0f} % of what that one's did, too little for a "
                              "refit; a part remains"}


def _passed_over(diagnosis: Diagnosis) -> Iterator[dict[str, str]]:
    """A candidate that would explain too little more to be a further cause."""
    final_round = diagnosis.rounds[-1]
    if final_round.passed_over is not None and not holds(final_round.blocks):
        yield {"name": final_round.passed_over.name,
               "why": "explains more of the blocks of the recording that it was fitted to, but not of the others"}
    elif final_round.passed_over is not None:
        drop = diagnosis.rounds[0].null.judgement.chi2 - final_round.passed_over.refitted.judgement.chi2
        yield {"name": final_round.passed_over.name, "why":
               f"as a further cause it would explain {100.0 * final_round.passed_over.heldout / drop:.2g} % of the "
               f"whole; so little may be an error of the selected model"}


def _hidden(diagnosis: Diagnosis, identified: Mapping[str, Mapping]) -> list[dict[str, str]]:
    """Candidates that this test cannot detect, whose plausible size would change an identified parameter."""
    stds = {name: entry["std"] * abs(diagnosis.identification.parameters[name].factor)
            for name, entry in identified.items() if entry["std"]}
    labels = short_names(list(stds))
    entries = []
    for ranked in diagnosis.rounds[-1].screening.ranked:
        shift = hidden_shift(ranked, stds) if ranked.standing == "cannot_tell" else None
        if shift is not None:
            name, size, in_std = shift
            share = size / (identified[name]["value"] * diagnosis.identification.parameters[name].factor or np.inf)
            entries.append((abs(in_std), {"name": ranked.candidate.name, "why":
                            f"{probe_words(ranked.variant)} would not show and would move {labels[name]} by "
                            f"{'+' if share > 0 else '−'}{size_text(100.0 * abs(share))} % ({size_text(abs(in_std))} "
                            f"standard deviations)"}))
    return [entry for _, entry in sorted(entries, key=lambda pair: -pair[0])][:MAX_HIDDEN]


def hidden_shift(ranked: Ranked, stds: Mapping[str, float]) -> tuple[str, float, float] | None:
    """Parameter that a plausible effect moves most: its name, the shift (internal unit), in standard deviations.

    None where no shift matters, or the effect is of no size.
    """
    size = ranked.probe_size
    if not np.isfinite(size):
        return None
    shifts = {name: -ranked.moves[name] * size for name in stds if name in ranked.moves}
    name = max(shifts, key=lambda n: abs(shifts[n]) / stds[n], default=None)
    if name is None or not abs(shifts[name]) > MIN_HIDDEN_SHIFT_STD * stds[name]:
        return None
    return name, shifts[name], shifts[name] / stds[name]


def probe_words(variant: Variant) -> str:
    """The plausible size of an effect, by its own degree of freedom where it has one finite null."""
    name = variant.new[0] if variant.new else ""
    null, probe = variant.null.get(name, np.nan), variant.probe.get(name, np.nan)
    if not (np.isfinite(null) and np.isfinite(probe)) or null == probe:
        return variant.label
    key = name.rpartition(".")[2].replace("_", " ")
    change = f"{100.0 * (probe / null - 1.0):+.2g} %" if null else f"{probe:.2g}"
    return f"{variant.label} ({key} {change})"
