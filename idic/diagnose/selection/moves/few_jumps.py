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
from idic.diagnose.selection.moves.shortlist import has_winner
from idic.diagnose.selection.rival import MIN_FURTHER_SHARE, Rival, leaves_something
from idic.diagnose.selection.rivals import edits_of
from idic.diagnose.selection.state import State
from idic.model import jump_frame, jump_name, term_of_motion, without_knot

MIN_JUMP_CHI2 = 18.0  # that a jump must bring; the best of 100 frames reaches it under noise in 2 of 1000 recordings
MAX_JUMPS = 5  # more are a course


def may_jump(state: State) -> bool:
    """Whether the winner may jump, and leaves something, as it was screened, or follows a course between knots."""
    winner = state.winner
    if winner is None or not _verb(winner.ranked.variant.new) or winner.copies > 1 or winner.refitted.choice is None:
        return False
    return winner.ranked.variant.free_course or leaves_something(winner.refitted.choice)


def with_few_jumps(state: State) -> State | None:
    """The winner in a few jumps, whose frames the copy for choosing tells; None where it tells none."""
    source, winner, variant = state.model.source, state.winner, state.winner.ranked.variant  # type: ignore[union-attr]
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
    every = _jumping(winner, edits, [jump_name(name, frame) for frame in frames])  # type: ignore[arg-type]
    _, columns = score_columns(null, residual, [(winner.ranked.candidate, every)],  # type: ignore[union-attr]
                               lambda changes: choice(source.load(changes)))
    scores = score(residual.evidence, null_model(residual.evidence, residual.null), columns)
    chosen = few_jumps(scores)
    if not chosen:
        return None
    sizes = dict(zip([every.new[k] for k in chosen], scores.together(chosen).tolist(), strict=True))
    edits = free_edits(source.document(), bare, variant, {"course": "jumps",
                                                          "jump_frames": [frames[k] for k in chosen]})
    return refitted_as(state, replace(_jumping(winner, edits, list(sizes)), probe=sizes))  # type: ignore[arg-type]


def explains_more(state: State, tried: State) -> bool:
    """Whether the jumps have more evidence than the former course."""
    return tried.winner.evidence > state.winner.evidence  # type: ignore[union-attr]


def few_jumps(scores: Scores) -> list[int]:
    """The fewest columns of which each lowers chi-square by `MIN_JUMP_CHI2`, and by a share of what they explain
    together, beside the others, in their order; at most `MAX_JUMPS`, none where more would be needed."""
    everyone, chosen = range(len(scores.U)), []

    def gain(members: list[int]) -> float:
        return scores.gain(sorted(members)) if members else 0.0

    while True:
        others = [k for k in everyone if k not in chosen and scores.own[k] > 0]
        best = max(others, key=lambda k: gain([*chosen, k]), default=None)
        together = 0.0 if best is None else gain([*chosen, best])
        if together - gain(chosen) < max(MIN_JUMP_CHI2, MIN_FURTHER_SHARE * together):
            return sorted(chosen)
        if len(chosen) == MAX_JUMPS:
            return []
        chosen.append(best)
        for place in range(len(chosen)):
            rest = chosen[:place] + chosen[place + 1:]
            chosen[place] = max((k for k in everyone if k not in rest and scores.own[k] > 0),
                                key=lambda k: gain([*rest, k]))


def idle_jumps(state: State) -> list[str]:
    """Jumps of the last cause that stand below the root of `MIN_JUMP_CHI2` standard deviations from zero in the last
    fit; none where all do."""
    fit, variant = state.model.fit, state.rounds[-1].winner.ranked.variant  # type: ignore[union-attr]
    jumps = [name for name in variant.new if jump_frame(name) is not None]
    idle = [name for name in jumps if fit.stds.get(name)
            and (fit.values[name] / fit.stds[name]) ** 2 < MIN_JUMP_CHI2]  # type: ignore[operator]
    return idle if len(idle) < len(jumps) else []


def without_idle_jumps(state: State) -> State | None:
    """The last cause without its idle jumps; None where the fit fails."""
    entry, fit, idle = state.rounds[-1], state.model.fit, idle_jumps(state)
    winner = entry.winner
    variant = winner.ranked.variant  # type: ignore[union-attr]
    jumps = tuple(name for name in variant.new if name not in idle)
    label = _label(jumps)
    fewer = replace(variant, label=label, edits=_without_frames(variant.edits, {jump_frame(name) for name in idle}),
                    new=jumps, **{part: {name: value for name, value in getattr(variant, part).items() if name in jumps}
                                  for part in ("null", "probe")})
    rival = replace(winner, ranked=replace(winner.ranked, variant=fewer, label=label),  # type: ignore
                    refitted=replace(winner.refitted, label=label))  # type: ignore[union-attr]
    source = entry.source.with_edits(edits_of(rival, entry.screening))  # type: ignore[union-attr]
    start = replace(fit, values={name: value for name, value in fit.values.items() if name not in idle})
    (again,) = state.setting.refits([refit_of_one(source, winner.name, start, state.setting.grid,  # type: ignore
                                                  state.setting.seed)])
    rival = refitted_again(rival, replace(again, label=label)) if again.usable else None
    if rival is None:
        return None
    rivals = tuple(rival if former is winner else former for former in entry.rivals)
    return state.with_last(replace(entry, winner=rival, rivals=rivals), FittedModel(source, rival.refitted))


def loses_nothing(state: State, tried: State) -> bool:
    """Whether the whole loses no more than what a jump must bring, for each that is gone."""
    jumps = len(idle_jumps(state))
    loss = tried.model.fit.judgement.chi2 - state.model.fit.judgement.chi2  # type: ignore[union-attr]
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
    last = names[0].rpartition(".")[0].removeprefix("boundary.")
    return f"{last} {_verb(names)} in {len(names)} jump{'s' if len(names) > 1 else ''}"


def _verb(names: Sequence[str]) -> str:
    """What a cause does at jumps; "" where it has none."""
    term = term_of_motion(names[0]) if names else None
    return "" if term is None else term.jumps


FEW_JUMPS = Move("few jumps", "refits_s", edit=with_few_jumps, accept=explains_more,
                 applies=lambda state: has_winner(state) and may_jump(state))
IDLE_JUMPS = Move("idle jumps", "revision_s", edit=without_idle_jumps, accept=loses_nothing,
                  applies=lambda state: state.has_changed and bool(idle_jumps(state)))
