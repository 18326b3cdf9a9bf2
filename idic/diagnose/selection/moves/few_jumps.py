"""A slip that happens in a few jumps: their frames and sizes.

A ramp or a course that is linear between knots describes several jumps badly, and says neither when they happened nor
how far. The columns of jumps in all frames are one pattern times courses, so that they cost one response; of them the
fewest are taken whose every one lowers chi-square by `MIN_JUMP_CHI2` and by `MIN_FURTHER_SHARE` of what they explain
together, the best one after the other, each moved afterwards to where it explains most beside the others. A smaller
share is a flaw of their description, or another cause that many jumps would follow. The copy without a part in that
choice decides.

A jump that bricks, finite strains or an error of the mesh make idle is taken out again: beside plasticity a plate of
bricks under a grip that slips once had another jump in its first frame, of 1.5 standard deviations in the end.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import identification_at
from idic.diagnose.refits.refit_job import refit_of_one
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.diagnose.residual.score import Scores, null_model, score
from idic.diagnose.residual.thinning import CHOICE, thinned
from idic.diagnose.screen.free_courses import free_edits
from idic.diagnose.screen.score_columns import score_columns
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.moves.own_course import refitted_as
from idic.diagnose.selection.moves.rivals_again import refitted_again
from idic.diagnose.selection.rival import MIN_FURTHER_SHARE, Rival, leaves_something
from idic.diagnose.selection.rivals import edits_of
from idic.diagnose.selection.state import Selected, State, changed_cause, improvable
from idic.model import jump_frame, jump_name, term_of_motion, without_knot

MIN_JUMP_CHI2 = 18.0  # that a jump must bring; the best of 100 frames reaches it under noise in 2 of 1000 recordings
MAX_JUMPS = 5  # more are a course


def may_jump(selected: Selected) -> bool:
    """Whether the winner may jump, and leaves something, as it was screened, or follows a course between knots."""
    winner = selected.winner
    if not _verb(winner.ranked.variant.new) or winner.copies > 1 or winner.refitted.choice is None:
        return False
    return winner.ranked.variant.free_course or leaves_something(winner.refitted.choice)


def with_few_jumps(selected: Selected) -> State | None:
    """The winner in a few jumps, whose frames the copy for choosing tells; None where it tells none."""
    state, winner, variant = selected.state, selected.winner, selected.winner.ranked.variant
    source = state.model.source
    name, choice = without_knot(variant.new[0]), partial(thinned, sign=CHOICE, seed=state.setting.seed)
    model = state.model.fit
    null = identification_at(choice(source.load()), model.values, model.local, model.steps)
    residual = residual_evidence(null, light=False)
    frames = [int(frame) for frame in residual.evidence.frames]
    bare = {**variant.edits}
    if "dof" in bare:  # knots that are locked at zero
        bare["dof"] = [entry for entry in bare["dof"] if without_knot(entry["name"]) != name]
    edits = free_edits(source.document(), bare, variant, {"course": "jumps", "jump_frames": frames})
    if edits is None:
        return None
    every = _jumping(winner, edits, [jump_name(name, frame) for frame in frames])
    _, columns = score_columns(null, residual, [(winner.ranked.candidate, every)],
                               lambda changes: choice(source.load(changes)))
    scores = score(residual.evidence, null_model(residual.evidence, residual.null), columns)
    chosen = few_jumps(scores)
    if not chosen:
        return None
    sizes = dict(zip([every.new[k] for k in chosen], scores.together(chosen).tolist(), strict=True))
    edits = free_edits(source.document(), bare, variant, {"course": "jumps",
                                                          "jump_frames": [frames[k] for k in chosen]})
    return None if edits is None else refitted_as(selected, replace(_jumping(winner, edits, list(sizes)), probe=sizes))


def explains_more(selected: Selected, tried: State) -> bool:
    """Whether the jumps have more evidence than the former course."""
    return tried.winner is not None and tried.winner.evidence > selected.winner.evidence


def few_jumps(scores: Scores) -> list[int]:
    """The fewest columns of which each lowers chi-square by `MIN_JUMP_CHI2`, and by a share of what they explain
    together, beside the others, in their order; at most `MAX_JUMPS`, none where more would be needed."""
    everyone = range(len(scores.U))
    chosen: list[int] = []

    def gain(members: list[int]) -> float:
        return scores.gain(sorted(members)) if members else 0.0

    while True:
        candidates = [k for k in everyone if k not in chosen and scores.own[k] > 0]
        best = max(candidates, key=lambda k: gain([*chosen, k]), default=None)
        together = 0.0 if best is None else gain([*chosen, best])
        if best is None or together - gain(chosen) < max(MIN_JUMP_CHI2, MIN_FURTHER_SHARE * together):
            return sorted(chosen)
        if len(chosen) == MAX_JUMPS:
            return []
        chosen.append(best)
        for place in range(len(chosen)):
            companions = chosen[:place] + chosen[place + 1:]
            chosen[place] = max((k for k in everyone if k not in companions and scores.own[k] > 0),
                                key=lambda k: gain([*companions, k]))


def idle_jumps(cause: Selected) -> list[str]:
    """Jumps of the last cause that stand below the root of `MIN_JUMP_CHI2` standard deviations from zero in the last
    fit; none where all do."""
    fit, variant = cause.state.model.fit, cause.winner.ranked.variant
    jumps = [name for name in variant.new if jump_frame(name) is not None]
    idle = [name for name in jumps if (std := fit.stds.get(name)) and (fit.values[name] / std) ** 2 < MIN_JUMP_CHI2]
    return idle if len(idle) < len(jumps) else []


def without_idle_jumps(cause: Selected) -> State | None:
    """The last cause without its idle jumps; None where the fit fails."""
    state, entry, winner = cause.state, cause.round, cause.winner
    fit, idle, variant = state.model.fit, idle_jumps(cause), winner.ranked.variant
    jumps = tuple(name for name in variant.new if name not in idle)
    label = _label(jumps)
    null, probe = ({name: value for name, value in values.items() if name in jumps}
                   for values in (variant.null, variant.probe))
    fewer = replace(variant, label=label, edits=_without_frames(variant.edits, {jump_frame(name) for name in idle}),
                    new=jumps, null=null, probe=probe)
    former = replace(winner, ranked=replace(winner.ranked, variant=fewer, label=label),
                     refitted=replace(winner.refitted, label=label))
    source = entry.source.with_edits(edits_of(former, entry.screening))
    start = replace(fit, values={name: value for name, value in fit.values.items() if name not in idle})
    (refit,) = state.setting.refits([refit_of_one(source, winner.name, start, state.setting.grid,
                                                  state.setting.seed)])
    rival = refitted_again(former, replace(refit, label=label)) if refit.usable else None
    if rival is None:
        return None
    rivals = tuple(rival if member is winner else member for member in entry.rivals)
    return state.with_last(replace(entry, winner=rival, rivals=rivals), FittedModel(source, rival.refitted))


def loses_nothing(cause: Selected, tried: State) -> bool:
    """Whether the whole loses no more than what a jump must bring, for each that is gone."""
    jumps = len(idle_jumps(cause))
    loss = tried.model.fit.judgement.chi2 - cause.state.model.fit.judgement.chi2
    return not loss > MIN_JUMP_CHI2 * jumps


def _without_frames(edits: Mapping[str, Any], frames: set[int | None]) -> dict[str, Any]:
    """Edits whose jumps happen in all of their frames but these."""
    tables = copy.deepcopy(list(edits["boundary"]))
    for drive in (drive for table in tables for drive in table.values() if isinstance(drive, dict)):
        for entry in drive.get("corrections", ()):
            if "jump_frames" in entry:
                entry["jump_frames"] = [frame for frame in entry["jump_frames"] if frame not in frames]
    return {**edits, "boundary": tables}


def _jumping(winner: Rival, edits: Mapping[str, Any], names: list[str]) -> Variant:
    """The variant of a winner with jumps."""
    return replace(winner.ranked.variant, label=_label(names), edits=edits, new=tuple(names),
                   null=dict.fromkeys(names, 0.0), probe=dict.fromkeys(names, 1.0), sign=0, refit={}, exact=True,
                   direct=False, free_course=True)


def _label(names: Sequence[str]) -> str:
    edge = names[0].rpartition(".")[0].removeprefix("boundary.")
    return f"{edge} {_verb(names)} in {len(names)} jump{'s' if len(names) > 1 else ''}"


def _verb(names: Sequence[str]) -> str:
    """What a cause does at jumps; "" where it has none."""
    term = term_of_motion(names[0]) if names else None
    return "" if term is None else term.jumps


FEW_JUMPS = Move("few jumps", "refits_s", improvable, with_few_jumps, may_jump, explains_more)
IDLE_JUMPS = Move("idle jumps", "revision_s", changed_cause, without_idle_jumps, lambda cause: bool(idle_jumps(cause)),
                  loses_nothing)
