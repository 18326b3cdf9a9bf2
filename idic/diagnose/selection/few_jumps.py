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
from typing import Any

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.refits.refit import Refit, identification_at
from idic.diagnose.refits.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.diagnose.residual.score import Scores, null_model, score
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import CHOICE, thinned
from idic.diagnose.screen.free_courses import free_edits
from idic.diagnose.screen.score_columns import score_columns
from idic.diagnose.selection.own_course import leaves_something, refitted_as
from idic.diagnose.selection.rival import MIN_FURTHER_SHARE, Rival, Round
from idic.diagnose.selection.rivals import edits_of
from idic.diagnose.selection.rivals_again import refitted_again
from idic.model import jump_frame, jump_name, without_knot

MIN_JUMP_CHI2 = 18.0  # that a jump must bring; the best of 100 frames reaches it under noise in 2 of 1000 recordings
MAX_JUMPS = 5  # more are a course


def with_few_jumps(source: ExperimentSource, null: Refit, winner: Rival, refits: Refits, grid: Grid,
                   seed: int) -> Rival | None:
    """The winner of a round as a slip in a few jumps; None where it is none, or where jumps explain it no better.

    winner : as it was screened, or with a course between knots
    """
    variant = winner.ranked.variant
    if winner.name != "grip_slip" or winner.copies > 1 or winner.refitted.choice is None:
        return None
    if not (variant.free_course or leaves_something(winner.refitted.choice)):
        return None
    name = without_knot(variant.new[0])
    found = identification_at(thinned(source.load(), CHOICE, seed), null.values, null.local, null.steps)
    residual = residual_evidence(found, light=False)
    frames = [int(frame) for frame in residual.evidence.frames]
    own = {**variant.edits}
    if "dof" in own:  # knots that are locked at zero
        own["dof"] = [entry for entry in own["dof"] if without_knot(entry["name"]) != name]
    edits = free_edits(source.document(), own, variant, {"course": "jumps", "jump_frames": frames})
    if edits is None:
        return None
    every = _jumping(winner, edits, [jump_name(name, frame) for frame in frames])
    _, columns = score_columns(found, residual, [(winner.ranked.candidate, every)],
                               lambda made: thinned(source.load(made), CHOICE, seed))
    scores = score(residual.evidence, null_model(residual.evidence, residual.null), columns)
    chosen = few_jumps(scores)
    if not chosen:
        return None
    sizes = dict(zip([every.new[k] for k in chosen], scores.together(chosen).tolist(), strict=True))
    edits = free_edits(source.document(), own, variant,
                       {"course": "jumps", "jump_frames": [frames[k] for k in chosen]})
    made = replace(_jumping(winner, edits, list(sizes)), probe=sizes)  # type: ignore[arg-type]
    jumping = refitted_as(made, source, null, winner, refits, grid, seed)
    return jumping if jumping is not None and jumping.evidence > winner.evidence else None


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


def without_idle_jumps(one: Round, source: ExperimentSource, null: Refit, refits: Refits, grid: Grid,
                       seed: int) -> tuple[Round, ExperimentSource, Refit] | None:
    """A round whose winner slips in fewer jumps, its source and its fit; None where every jump is needed.

    source, null : of the model with that winner, and its last fit; a jump is idle where it stands below the root of
    `MIN_JUMP_CHI2` standard deviations from zero, and the whole loses no more than that without it
    """
    winner = one.winner
    jumps = [name for name in winner.ranked.variant.new if jump_frame(name) is not None]  # type: ignore[union-attr]
    idle = [name for name in jumps if null.stds.get(name)
            and (null.values[name] / null.stds[name]) ** 2 < MIN_JUMP_CHI2]  # type: ignore[operator]
    if not idle or len(idle) == len(jumps):
        return None
    variant = winner.ranked.variant  # type: ignore[union-attr]
    kept = tuple(name for name in variant.new if name not in idle)
    label = _label(kept)
    fewer = replace(variant, label=label, edits=_without_frames(variant.edits, {jump_frame(name) for name in idle}),
                    new=kept, **{part: {name: value for name, value in getattr(variant, part).items() if name in kept}
                                 for part in ("null", "probe")})
    rival = replace(winner, ranked=replace(winner.ranked, variant=fewer, label=label),  # type: ignore[union-attr]
                    refitted=replace(winner.refitted, label=label))  # type: ignore[union-attr]
    there = one.source.with_edits(edits_of(rival, one.screening))  # type: ignore[union-attr]
    near = replace(null, values={name: value for name, value in null.values.items() if name not in idle})
    (fitted,) = refits([refit_of_one(there, winner.name, near, grid, seed)])  # type: ignore[union-attr]
    made = refitted_again(rival, replace(fitted, label=label)) if fitted.usable else None
    if made is None or fitted.judgement.chi2 - null.judgement.chi2 > MIN_JUMP_CHI2 * len(idle):
        return None
    rivals = tuple(made if r is winner else r for r in one.rivals)
    return replace(one, winner=made, rivals=rivals), there, made.refitted


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
    return f"{last} slips in {len(names)} jump{'s' if len(names) > 1 else ''}"
