"""A held end that moves in another shape than any candidate describes: the last rival of what was selected.

A free motion of one end, the law kept, imitates an inclusion or a stiffness of another direction near it, and two
rotations imitate a bent end. So before a cause of the material, or several causes, are told, every end in turn moves
by Legendre polynomials along itself (`EDGE_MODE_DEGREE`), in every component that the model prescribes: in proportion
to the logged motion, or with a course that the data give. Such a model is refitted and judged as every candidate is;
where it explains more than the selected causes, less what its unknowns could by chance, none of them is told. Where one
cause of the boundary was selected, it must explain as much more as a further cause: less is a flaw of its course.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from idic.diagnose.locate.freedoms import EDGE_MODE_DEGREE
from idic.diagnose.locate.mismatch import Mismatch
from idic.diagnose.physics.candidate import Candidate, Situation
from idic.diagnose.physics.edits import driven, with_correction
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.screen.free_courses import KNOTTED
from idic.diagnose.selection.free_model import EndMotion, FreeEnd
from idic.diagnose.selection.move import Move, itself
from idic.diagnose.selection.rival import (
    COPIES, MIN_DROP_DIFFERENCE, MIN_FURTHER_SHARE, MIN_SEPARATION_CHI2, Round, leaves_something, winners,
)
from idic.diagnose.selection.state import State
from idic.diagnose.selection.verdict import MIN_RECOVERED_SHARE
from idic.model import Column

def may_be_an_end(mismatch: Mismatch | None, rounds: Sequence[Round], remainder: ExcessLeft) -> bool:
    """Whether a free end may explain more than the selected causes.

    The free motion of all ends, in every frame, recovers as much of the motions as a cause must; and what was selected
    is no single cause of the camera or the force that leaves nothing.

    remainder : of the last model, on the copy without a part in its fit
    """
    if mismatch is None or not mismatch.is_significant:
        return False
    if not mismatch.nested_tests.share("boundary") >= MIN_RECOVERED_SHARE:
        return False
    won = [winner.ranked.candidate.side for winner in winners(rounds)]
    return len(won) != 1 or won[0] in ("bulk", "boundary") or remainder.matters


def may_have_free_end(state: State) -> bool:
    """Whether a free end may explain more than what was selected; not in a quick diagnosis."""
    if state.setting.quick:
        return False
    remainder = ExcessLeft(state.first.fit.judgement, state.model.fit.judgement,
                           state.power_of_copy, margin_px=state.setting.margin.px)
    return may_be_an_end(state.mismatch, state.rounds, remainder)


def with_free_end(state: State) -> State | None:
    """The state whose last word is the end that explains most; None where none has an answer."""
    first, model = state.first, state.model
    motions = list(end_motions(first.source, first.situation()))
    ends = refitted_ends(state, [motion for motion in motions if not motion.free_course])
    best = max(ends, key=lambda end: end.evidence, default=None)
    is_unsettled = model.fit is first.fit or leaves_something(model.fit.choice)
    if best is None or (is_unsettled and leaves_something(best.refitted.choice)):
        ends += refitted_ends(state, [motion for motion in motions if motion.free_course
                                      and (best is None or motion.nodes == best.motion.nodes)])
        best = max(ends, key=lambda end: end.evidence, default=None)
    return None if best is None else told(state, best)


def refitted_ends(state: State, motions: Sequence[EndMotion]) -> list[FreeEnd]:
    """Freed ends after their refits, without those that have no answer."""
    setting, null = state.setting, state.first.fit
    jobs = [RefitJob(f"free_end_{number}{'_course' * motion.free_course}", state.first.source, (motion.nodes,),
                     (motion.edits,), (null.values,), null.local, setting.grid, np.inf, setting.seed)
            for number, motion in enumerate(motions)]
    names = tuple(cause.name for cause in selected_causes(state))
    return [FreeEnd(fit, ExcessLeft(null.judgement, fit.judgement, state.power_of_copy,
                                    margin_px=setting.margin.px, camera_px=setting.margin.camera_px), motion,
                    null.choice.chi2 - fit.choice.chi2, names)
            for motion, fit in zip(motions, setting.refits(jobs) if jobs else [], strict=True)
            if fit.judgement is not None]


def selected_causes(state: State) -> list[Candidate]:
    """Of all rounds."""
    return [winner.ranked.candidate for winner in winners(state.rounds)]


def is_the_last_word(state: State, tried: State) -> bool:
    """Whether the freed end describes the recording, and explains more than the selected causes."""
    moves_an_end = [cause.side for cause in selected_causes(state)] == ["boundary"]
    end = tried.end
    return end.describes and explains_more(end, state.first.fit, state.model.fit, moves_an_end)


def explains_more(end: FreeEnd, null: Fit, final: Fit, moves_an_end: bool = False) -> bool:
    """Whether a freed end explains more than the selected causes on both copies, less twice its further unknowns, by
    more than noise and the error of two simulations; moves_an_end : where one cause of the boundary was selected, by as
    much as a further cause must."""
    if final is null:
        return True
    achieved = null.choice.chi2 - final.choice.chi2
    heldout = null.judgement.chi2 - final.judgement.chi2
    evidence = achieved + heldout - 2.0 * (len(final.stds) - len(null.stds))
    share = MIN_FURTHER_SHARE if moves_an_end else MIN_DROP_DIFFERENCE
    return end.evidence - evidence > COPIES * max(MIN_SEPARATION_CHI2, share * achieved)


def end_motions(source: ExperimentSource, situation: Situation) -> Iterator[EndMotion]:
    """Of every prescribed set of a plane model its freed motion: in proportion to the log, and with a free course."""
    experiment = situation.experiment
    if experiment.model.n_dim != 2:
        return
    column = max((entry.drive for entry in experiment.model.prescribed if isinstance(entry.drive, Column)),
                 key=lambda drive: float(np.abs(drive.values).max()), default=None)
    held_sets: dict[str, list[tuple[int, str, bool]]] = {}
    for number, nodes, component, drive in driven(situation):
        held_sets.setdefault(nodes, []).append((number, component, "column" in drive))
    for nodes, entries in held_sets.items():
        if len(experiment.model.mesh.node_sets[nodes]) <= EDGE_MODE_DEGREE:
            continue
        for free_course in (False, True):
            if column is None and not free_course:
                continue
            document = dict(situation.document)
            for number, component, logged in entries:
                form = dict(KNOTTED) if free_course else {} if logged else {"column": column.column}
                for degree in range(EDGE_MODE_DEGREE + 1):
                    document |= with_correction(replace(situation, document=document), number, component,
                                                {"kind": "shape", "degree": degree} | form)
            edits = {"boundary": document["boundary"]}
            free_names = source.load(edits).model.parameters.free
            names = tuple(name for name in free_names if name not in experiment.model.parameters.free)
            yield EndMotion(nodes, edits, names, free_course, experiment.model.length_unit)


def told(state: State, end: FreeEnd) -> State:
    """Side and rounds of a diagnosis whose last word is a free end: no cause is selected."""
    reason = (f"the free motion of {end.motion.nodes} describes {100.0 * end.share:.0f} % of the residual on held-out "
              "data, more than any cause of the library")
    tests = replace(state.mismatch.nested_tests, side="boundary", reason=reason)
    return replace(state, end=end, model=state.first,
                   mismatch=replace(state.mismatch, side="boundary", nested_tests=tests),
                   rounds=(replace(state.rounds[0], winner=None, equals=(), passed_over=None),))


FREE_END = Move("free end", "free_end_s", itself, with_free_end, may_have_free_end, is_the_last_word,
                part="the free motion of an end",
                stage=lambda state: "free motion of every end, as a rival of what was selected")
