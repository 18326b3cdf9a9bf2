"""A finished diagnosis: the models that were fitted, and the tests between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from idic.diagnose.discretisation.neglected import Neglected
from idic.diagnose.evidence_chain import chain_of
from idic.diagnose.free_form import FreeForm
from idic.diagnose.identified import Identified
from idic.diagnose.locate.active_elements import ACTIVE_STATES, Activity
from idic.diagnose.locate.mismatch import Mismatch, SelectedEffect
from idic.diagnose.odds import odds_of
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.remainder import Remainder
from idic.diagnose.residual.measured_motion import OutOfRegister
from idic.diagnose.residual.spots import LeftOut
from idic.diagnose.screen.courses import Course, courses_of
from idic.diagnose.selection.moves.shortlist import has_state
from idic.diagnose.selection.rival import Round, causes_of, with_winners
from idic.diagnose.selection.rivals import edits_of
from idic.diagnose.selection.state import State
from idic.diagnose.selection.verdict import Verdict
from idic.identification import Identification
from idic.parameters import ParameterSet


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All results, for files and figures.

    Attributes
    ----------
    identification : under diagnosis
    identified : it with its known error, its residual, and where its mismatch was located
    state : rounds, models and mismatch at the end of the selection
    remainder : what the last model leaves
    verdict : the outcome
    probability : that the selected set holds the truth (`idic.diagnose.probability`), None where the test says nothing
    active : elements in which the first selected candidate acts; None where it is no law of yielding, flow or damage
    corrected : the identified model with its known error, fitted to the recording, where no cause joined it: with
        bricks, or on a finer mesh that moves its parameters
    neglected : what bricks and finite strains would do to the parameters of the last model, where it has neither
    free_form : the free law, refitted where no named cause of the specimen fits
    notes : parts beside the verdict that failed
    register : where the images are out of register with the identified model and the measured motion took their place
    spots : what was left out of the images before
    """

    identification: Identification
    identified: Identified
    state: State
    remainder: Remainder
    verdict: Verdict
    probability: float | None = None
    active: Activity | None = None
    corrected: FittedModel | None = None
    neglected: Neglected | None = None
    free_form: FreeForm | None = None
    notes: tuple[str, ...] = ()
    register: OutOfRegister | None = None
    spots: LeftOut | None = None

    @property
    def chain(self) -> list[dict]:
        """The chain of evidence: what, number, threshold (`idic.diagnose.evidence_chain`)."""
        return chain_of(self.mismatch, self.rounds, self.verdict, self.remainder)

    @property
    def odds(self) -> list[list[dict]]:
        """Of the members of every indistinguishable set, with and without their plausible sizes."""
        return odds_of(self.rounds, self.probability)

    @property
    def mismatch(self) -> Mismatch | None:
        """Side, onset and place; None where a law finds no equilibrium along the path."""
        return self.state.mismatch

    @property
    def rounds(self) -> tuple[Round, ...]:
        """Additions to the model; the last one has no winner, unless the limit of rounds was reached."""
        return self.state.rounds

    @property
    def source(self) -> ExperimentSource:
        """The experiment with every selected candidate."""
        return (self.state.final or self.state.model).source

    @property
    def enriched(self) -> FittedModel | None:
        """The enriched model, where it was fitted to the recording and finds an equilibrium from rest; else None."""
        final = self.state.final
        return final if final is not None and final.fit.usable and final.residual is not None else None

    @property
    def last_parameters(self) -> ParameterSet:
        """Parameters of the enriched model as they start; of the identified one without it."""
        enriched = self.enriched
        experiment = self.identification.experiment if enriched is None else (
            enriched.residual.context.experiment)
        return experiment.model.parameters

    @property
    def first_cause(self) -> Round | None:
        """The round of the first selected candidate, None without one; finite strains belong to the description, and
        are no cause where there is another."""
        won = [entry for entry, _ in with_winners(self.rounds)]
        return next(iter(causes_of(won) or won), None)

    @property
    def refitted(self) -> list[FittedModel]:
        """The candidates that were refitted beside the first cause, it first, then by held-out drop."""
        entry = self.first_cause or self.rounds[-1]
        rivals = sorted((rival for rival in entry.rivals if rival.refitted.usable),
                        key=lambda rival: (rival is not entry.winner, rival.name not in entry.equals,
                                           -(rival.heldout or 0.0)))
        return [FittedModel(entry.source.with_edits(edits_of(rival, entry.screening)),
                            replace(rival.refitted, name=rival.name)) for rival in rivals]

    @property
    def selected_effect(self) -> SelectedEffect | None:
        """Side and onset of the first cause, None without one.

        It acts from the start unless it, or a candidate indistinguishable from it, has an onset.
        """
        first = self.first_cause
        winner = None if first is None else first.winner
        if first is None or winner is None:
            return None
        candidate, active = winner.ranked.candidate, self.active
        has_onset = any(rival.ranked.candidate.has_onset for rival in first.rivals
                        if rival is winner or rival.name in first.equals)
        is_monotone = active is not None and not candidate.shows_at_reversal
        modifies = is_monotone and has_state(self.identification, ACTIVE_STATES)
        began = [course.onset for course in self.courses(first) if course.onset and course.onset[0] > 0]
        return SelectedEffect(candidate.side, not has_onset, None if active is None else active.first_frame,
                              modifies, min(began, default=None) if has_onset else None)

    def courses(self, entry: Round) -> list[Course]:
        """Courses of the winner of a round, with their error bands; [] of a material."""
        enriched = self.enriched
        if enriched is None:
            return []
        return courses_of(entry.winner.name, enriched.residual.context.experiment,
                          self.identification.experiment, entry.winner.ranked.variant.new,
                          enriched.fit.values, enriched.fit.stds)
