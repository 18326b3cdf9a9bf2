"""What the model of a RUN may leave unexplained at its accepted point: summed by a worker, kept in the store."""

from __future__ import annotations

from idic.identification import DiscrepancySystem, Evaluation, LoopState, perturbations, reason_against
from idic.model import Stage
from idic.run.prepared.session import Session
from idic.run.prepared.tasks import CorrelationJob
from idic.run.store.discrepancy_store import LABEL, load_discrepancy
from idic.run.store.layout import group_name


def discrepancy_job(session: Session, state: LoopState, point: Evaluation | None,
                    stage: Stage) -> CorrelationJob | None:
    """The job of `sum_discrepancy` at the accepted point; None where it is done, or where there is a reason against it
    (`discrepancy_of`).

    stage : as which the images are seen
    """
    context = session.context
    if (reason_against(context.at_stage(stage).experiment, point)
            or context.store.finished(group_name(state.accepted.number, LABEL)) is not None):
        return None
    changes = perturbations(session.experiment, session.sensitivity, state.accepted.values, context.moving)
    weights = context.weights.as_generalised() if point.system.generalised else None
    return CorrelationJob(session.run, state.accepted.number, 0, session.experiment.model.n_frames,
                          state.accepted.values,
                          changes, weights, stage, state.increments.per_frame)


def discrepancy_of(session: Session, state: LoopState, point: Evaluation | None,
                   stage: Stage) -> DiscrepancySystem | str:
    """The normal equations with the discrepancy of the model, or why there are none."""
    reason = reason_against(session.context.at_stage(stage).experiment, point)
    return reason or load_discrepancy(session.context.store, state.accepted.number)
