"""What the model of a RUN may leave unexplained at its accepted point: summed by a worker, kept in the store."""

from __future__ import annotations

from idic.correlation.shared_noise import generalised_weights
from idic.identify.discrepancy.normal_equations import DiscrepancySystem, reason_against
from idic.identify.sensitivity import perturbations
from idic.identify.step.stages import resolve_stages
from idic.identify.step.state import Evaluation, LoopState
from idic.run.session import Session
from idic.run.tasks import CorrelationJob, sum_discrepancy
from idic.store.discrepancy_store import LABEL, load_discrepancy
from idic.store.layout import group_name


def discrepancy_of(session: Session, state: LoopState, point: Evaluation | None) -> DiscrepancySystem | str:
    """The normal equations with the discrepancy of the model, or why there are none."""
    context = session.context
    stage = resolve_stages(session.experiment)[state.schedule.stage]
    reason = reason_against(context.at_stage(stage).experiment, point)
    if reason:
        return reason
    if context.store.finished(group_name(state.accepted.number, LABEL)) is not None:
        return load_discrepancy(context.store, state.accepted.number)
    changes = perturbations(session.experiment, session.sensitivity, state.accepted.values, context.moving)
    weights = generalised_weights(context.weights) if point.system.generalised else None
    job = CorrelationJob(session.run, state.accepted.number, 0, session.experiment.n_frames, state.accepted.values,
                         changes, weights, stage, state.increments.per_frame)
    list(session.stream("discrepancy", sum_discrepancy, [job]))
    return load_discrepancy(context.store, state.accepted.number)
