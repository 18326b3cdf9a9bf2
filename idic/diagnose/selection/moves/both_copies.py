"""Rivals that both copies of the recording judge: where one copy alone shows none of them clearly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob, Refits, refit_of_one
from idic.diagnose.residual.excess_left import MIN_EXCESS_Z
from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection import stages
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.moves.shortlist import judged
from idic.diagnose.selection.rival import Rival, causes_of
from idic.diagnose.selection.rivals import variant_of
from idic.diagnose.selection.state import OpenRound, State, open_round


def undecided(rivals: Sequence[Rival]) -> list[Rival]:
    """Rivals that both copies judge: all, if none is significant on one copy and one is where it was fitted.

    One copy shows a faint effect by seven tenths of the standard deviations that the recording does.
    """
    candidates = [r for r in rivals if r.refitted.usable and r.achieved > 0.0]
    clear = any(r.passes and r.heldout > MIN_EXCESS_Z**2 for r in candidates)
    return candidates if not clear and any(r.achieved > r.min_heldout_drop for r in candidates) else []


def judged_on_both(model: FittedModel, rivals: Sequence[Rival], screening: Screening, refits: Refits,
                   grid: Grid, seed: int) -> tuple[tuple[Rival, ...], Misfit | None]:
    """Rivals refitted to the copy for judging and judged on the other one too: no copy judges a fit to itself.

    The candidates were chosen on one of the two, so the bar is twice as high (`Rival.min_heldout_drop`).

    model : without a candidate

    Returns
    -------
    The rivals with their drops on both copies, and the null's fit on the second copy. Without an answer of the null
    there, the rivals are unchanged and the fit is None.
    """
    source = model.source
    (null_of_copy,) = refits([refit_of_one(source, "null", model.fit, grid, seed, swapped=True, begun=model.path)])
    if not null_of_copy.usable:
        return tuple(rivals), None
    candidates = undecided(rivals)
    answers = refits([_swapped(source, null_of_copy, r, variant_of(r, screening), grid, seed) for r in candidates])
    judged_rivals = {id(r): _judged_twice(r, null_of_copy, answer)
                     for r, answer in zip(candidates, answers, strict=True)}
    return tuple(judged_rivals.get(id(r), r) for r in rivals), null_of_copy.judgement


def _swapped(source: ExperimentSource, null: Fit, rival: Rival, variant: Variant, grid: Grid, seed: int) -> RefitJob:
    """A rival on the copy for judging: from its probe, and from where it ended on the other one; the better of both.

    The other copy judges it: what started there counts only where the search has left its start (`Start.borrowed`).
    """
    labels, edits = (f"{variant.label}, from the other copy", variant.label), {**variant.edits, **variant.refit}
    probe = {**null.values, **(variant.null if variant.direct else variant.probe)}
    return RefitJob(rival.name, source, labels, (edits, edits), (rival.refitted.values, probe), null.local, grid,
                    -np.inf, seed, swapped=True, borrowed=labels[0])


def _judged_twice(rival: Rival, null: Fit, answer: Fit) -> Rival:
    if not answer.usable:
        return replace(rival, failed_on_one_copy=True)
    return replace(rival, heldout=rival.heldout + null.judgement.chi2 - answer.judgement.chi2,
                   crossed_judgement=answer.judgement,
                   achieved_on_other=null.choice.chi2 - answer.choice.chi2)


def needs_both(under_way: OpenRound) -> bool:
    """Whether both copies judge the first cause."""
    state = under_way.state
    return not state.setting.quick and not causes_of(state.rounds) and bool(undecided(under_way.round.rivals))


def on_both_copies(under_way: OpenRound) -> State:
    """The round with its rivals judged on both copies."""
    state, entry = under_way.state, under_way.round
    setting, model = state.setting, state.model
    rivals, crossed = judged_on_both(model, entry.rivals, entry.screening,
                                     setting.refits, setting.grid, setting.seed)
    return judged(state, replace(entry, rivals=rivals, crossed_judgement=crossed))


def _stage(under_way: OpenRound) -> str:
    return f"{stages.BOTH_COPIES}: {', '.join(r.ranked.called for r in undecided(under_way.round.rivals))}"


BOTH_COPIES = Move("both copies", "refits_s", open_round, on_both_copies, needs_both, stage=_stage)
