"""Finite strains of a model that a cause has joined: counted where the recording asks for them.

Every body has them; a law of small strains is a choice of the file. While a cause is unknown it hides what they do: the
reading of a rubbing load train falls behind when the load turns round, ten times as far as finite strains lower it.
Then the cause explains a part of them (a friction that grows more slowly than the load), and the rest is left as motion
without a name. They bring no unknown, so that the drop of chi-square decides, as of bricks
(`idic.diagnose.discretisation.thickness_error`). A course that was freed for their sake goes back to the former one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from idic.diagnose.discretisation.combinations import FINITE_STRAINS, combinations, drop_by
from idic.diagnose.discretisation.thickness_error import MIN_DROP
from idic.diagnose.refits.refit import Refit, identification_at, residual_from_rest
from idic.diagnose.refits.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival, Round, judge
from idic.diagnose.selection.rivals import edits_of, variant_of
from idic.identification import Identification
from idic.simulation_error import strain_error


def with_finite_strains_counted(rounds: Sequence[Round], null: Refit, whole: ResidualEvidence, refits: Refits,
                                grid: Grid, seed: int,
                                ) -> tuple[list[Round], ExperimentSource, Refit, ResidualEvidence] | None:
    """The rounds, the last source, its fit and its residual, with the finite form of every law of small strains; None
    where the recording does not ask for it.

    rounds : the last one has a winner; null, whole : its fit, and its residual on the recording itself
    """
    last = rounds[-1]
    models = [rival for rival in (last.winner, last.plain) if rival is not None]
    found = _found(last, models[0])
    if not (is_asked_for(found, whole) or any(_asks(last, plain) for plain in models[1:])):
        return None
    edits = {f"material.{one.element_set}.kinematics": "finite" for one in found.experiment.materials}
    counted = [replace(one, source=one.source.with_edits(edits)) for one in rounds]  # type: ignore[union-attr]
    tried = [_again(counted[-1], finite(rival, last.screening), refits, grid, seed) for rival in models]
    if not tried[0].refitted.usable:
        return None
    best = plain_if_enough(tried)
    near = {rival: _again(counted[-1], finite(rival, last.screening), refits, grid, seed)
            for rival in last.rivals if rival.name in last.equals and rival.refitted.usable}
    chosen, equals = judge([best, *near.values()], last.screening)
    source = counted[-1].source.with_edits(edits_of(chosen or best, last.screening))  # type: ignore[union-attr]
    after = None if chosen is None else residual_from_rest(source.load(), chosen.refitted)
    if after is None or not chosen.refitted.judgement.chi2 < null.judgement.chi2:
        return None
    near |= {last.winner: best}
    one = replace(counted[-1], winner=chosen, equals=equals, rivals=tuple(near.get(one, one) for one in last.rivals),
                  plain=next((plain for plain in tried[1:] if chosen is tried[0] and plain.refitted.usable), None))
    return [*counted[:-1], one], source, chosen.refitted, after


def _found(one: Round, rival: Rival) -> Identification:
    """A rival of a round, after its refit, as an identification."""
    source, refitted = one.source.with_edits(edits_of(rival, one.screening)), rival.refitted  # type: ignore[union-attr]
    return identification_at(source.load(), refitted.values, refitted.local, refitted.steps)


def _asks(one: Round, rival: Rival) -> bool:
    """Whether the recording asks for finite strains beside a rival of a round: a free course may hide them."""
    found = _found(one, rival)
    residual = residual_from_rest(found.experiment, rival.refitted)
    return residual is not None and is_asked_for(found, residual)


def is_asked_for(found: Identification, residual: ResidualEvidence) -> bool:
    """Whether finite strains lower the chi-square of the recording by five standard deviations, to first order.

    found, residual : of the model; False where it has them already, or none can be simulated
    """
    error = strain_error(found.model_point)
    if error is None:
        return False
    tried = combinations(residual, null_model(residual.evidence, residual.null), {FINITE_STRAINS: error})
    return drop_by(tried, FINITE_STRAINS) >= MIN_DROP


def plain_if_enough(tried: Sequence[Rival]) -> Rival:
    """Of a winner and its former course, if any: the former one where the freed one does not bring what each of its
    knots must."""
    winner, former = tried[0], tried[1:]
    for plain in former:
        if not plain.refitted.usable:
            continue
        knots = len(winner.own_unknowns) - len(plain.own_unknowns)
        gain = plain.refitted.judgement.chi2 - winner.refitted.judgement.chi2
        if gain <= MIN_HELDOUT_DROP + knots:
            return plain
    return winner


def finite(rival: Rival, screening: Screening) -> Rival:
    """A rival whose variant, where it brings a law of its own, brings the finite form."""
    variant = variant_of(rival, screening)
    edits, refit = ({key: _finite_table(value) for key, value in some.items()}
                    for some in (variant.edits, variant.refit))
    return replace(rival, ranked=replace(rival.ranked, variant=replace(variant, edits=edits, refit=refit)))


def _finite_table(value: Any) -> Any:
    """A table of a material with its kinematics, finite; every other value as it is."""
    return {**value, "kinematics": "finite"} if isinstance(value, Mapping) and "kinematics" in value else value


def _again(one: Round, rival: Rival, refits: Refits, grid: Grid, seed: int) -> Rival:
    """A rival of a round fitted again with the present source of the round."""
    source = one.source.with_edits(edits_of(rival, one.screening))  # type: ignore[union-attr]
    (again,) = refits([refit_of_one(source, "finite", rival.refitted, grid, seed)])
    again = replace(again, name=rival.refitted.name, label=rival.refitted.label)
    if not again.usable:
        return replace(rival, refitted=again)
    return replace(rival, refitted=again, heldout=rival.heldout + rival.refitted.judgement.chi2 - again.judgement.chi2,
                   achieved=rival.achieved + rival.refitted.choice.chi2 - again.choice.chi2)
