"""The last model fitted to the recording itself, with the known error of its values there.

The fit begins at the end of the fit to a copy, a few standard deviations away, with the estimator of that end. The
known error of its simulation is that of the values on the copy; where those of the recording change it, or ask for
bricks now that the cause is known, the fit is repeated with it. Bricks that are known already follow to the recording
in turns first, and the fit begins where these end: it is repeated only where it ends elsewhere. A quick diagnosis ends
with the fit to the copy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from idic.diagnose.discretisation.following import is_at
from idic.diagnose.discretisation.known_error import renewed_error
from idic.diagnose.discretisation.sheet import sheet_and_bricks_at
from idic.diagnose.discretisation.thickness_error import neglected_errors, with_bricks
from idic.diagnose.discretisation.thickness_std import std_factors
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import ExperimentSource, refit_of_one
from idic.diagnose.selection.move import Move, itself, moved
from idic.diagnose.selection.moves.other_axis import fit_from_other_axes, is_another_answer, is_better
from idic.diagnose.selection.stages import ENRICHED_RESIDUAL, WHOLE_FIT
from idic.diagnose.selection.state import Setting, State
from idic.identification import Identification

MINIMA = ("converged", "at_bound")  # ends of a search whose values are those of a minimum
MAX_RENEWALS = 3  # of the known error of the last model: it depends on the parameters, and they on it


def fitted_to_recording(state: State) -> State:
    """With the last model fitted to the recording, where a cause has joined the identified one."""
    return moved(state, TO_RECORDING)


def fitted(state: State) -> State:
    """The last model on the recording: from where turns with bricks end, or from its end on a copy."""
    setting, model = state.setting, state.model
    if setting.quick:
        return replace(state, final=_simulated(model.source, model.fit))
    turns = _turned(state)
    if turns is not None:
        return turns
    return replace(state, final=_simulated(model.source, whole_fit(setting, model)))


def _simulated(source: ExperimentSource, fit: Fit) -> FittedModel:
    """A fit to the recording with its residual, where it finds an equilibrium from rest."""
    model = FittedModel(source, fit)
    return (model.simulated() or model) if fit.usable else model


def _turned(state: State) -> State | None:
    """With the error of plane stress that follows from a copy to the recording, and the fit to the recording beside
    it; None where bricks are not known, or this fails. The fit to the copy has ended at a minimum: the turns take whole
    steps."""
    setting, model = state.setting, state.model
    if model.error is None or model.error.thickness is None or model.fit.status not in MINIMA:
        return None
    simulation = model if model.is_simulated_there else FittedModel(model.source, model.fit).simulated()
    if simulation is None:
        return None
    identified = model.identification()
    start = sheet_and_bricks_at(identified)
    renewed = None if start is None else renewed_error(
        identified, simulation.residual, setting.grid, start)
    if renewed is None:
        return None
    error, settled = renewed
    source = model.source.with_motion_error(error)
    fit = whole_fit(setting, FittedModel(source, model.fit), settled)
    return replace(state, final=_simulated(source, fit), settled=settled) if fit.usable else None


def whole_fit(setting: Setting, model: FittedModel, settled: Identification | None = None) -> Fit:
    """A model fitted to the recording itself, from the end of its last fit, or from where turns ended.

    settled : that end
    """
    values = model.fit.values
    steps = None if settled is None else {name: settled.parameters[name].value - value
                                          for name, value in values.items()}
    (fit,) = setting.refits([refit_of_one(model.source, "enriched", model.fit, setting.grid, setting.seed, steps,
                                          copies=False, estimator=model.fit.estimator, whole_std=True,
                                          begun=model.path)])
    return fit


@dataclass(frozen=True, eq=False)
class OnRecording:
    """A state with its last model on the recording itself, simulated there."""

    state: State
    final: FittedModel


def on_recording(state: State) -> OnRecording | None:
    """The last model on the recording; None where it finds no equilibrium, and in a quick diagnosis."""
    final = None if state.setting.quick else state.final
    return None if final is None or final.residual is None else OnRecording(state, final)


def with_renewed_errors(recorded: OnRecording) -> State:
    """The fit repeated while the known error follows it, and with bricks where the recording asks for them now."""
    state, final = recorded.state, recorded.final
    setting, settled = state.setting, state.settled
    for turn in range(MAX_RENEWALS):
        if settled is not None and is_at(final.fit.values, settled, final.fit.stds):
            break
        identified = final.identification()
        residual = final.residual
        bricks = None
        if turn == 0 and (final.error is None or final.error.thickness is None):
            final = replace(final, neglected=neglected_errors(identified))
            bricks = with_bricks(identified, residual, setting.grid, final.neglected)
        renewed = bricks or renewed_error(identified, residual, setting.grid)
        if renewed is None:
            break
        source = final.source.with_motion_error(renewed[0])
        settled = None if bricks else renewed[1]  # the error of the mesh is the old one
        fit = whole_fit(setting, FittedModel(source, final.fit), renewed[1])
        model = FittedModel(source, fit).simulated() if fit.usable else None
        if model is None:
            break
        final = model
    return replace(state, final=final, settled=settled)


def with_other_axis(recorded: OnRecording) -> State | None:
    """The better one of two axes, and the other one where the recording does not tell them apart."""
    final, other_fit = recorded.final, fit_from_other_axes(recorded.state, recorded.final)
    if other_fit is None:
        return None
    if is_better(other_fit, final.fit):
        turned = FittedModel(final.source, other_fit).simulated()
        final, other_fit = (final, None) if turned is None else (turned, final.fit)
    return replace(recorded.state, final=final, other_axis=other_fit)


def with_std_of_bricks(model: FittedModel) -> FittedModel:
    """A fit to the recording whose standard deviations know that the error of plane stress follows the law."""
    factors = std_factors(model.identification(), model.residual)
    stds = {name: None if std is None else std * factors.get(name, 1.0) for name, std in model.fit.stds.items()}
    return replace(model, fit=replace(model.fit, stds=stds))


def with_stds(recorded: OnRecording) -> State:
    """The last fit with its standard deviations, and another axis only where it is another answer."""
    final, other_fit = with_std_of_bricks(recorded.final), recorded.state.other_axis
    is_other = other_fit is not None and is_another_answer(other_fit, final.fit)
    return replace(recorded.state, final=final, other_axis=other_fit if is_other else None)


def _stage(state: State) -> str:
    if state.setting.quick:
        return ENRICHED_RESIDUAL
    return WHOLE_FIT


def _has_changed(state: State) -> bool:
    return state.model.fit is not state.first.fit


TO_RECORDING = (
    Move("fit to the recording", "final_s", itself, fitted, _has_changed, stage=_stage),
    Move("renewed error", "final_s", on_recording, with_renewed_errors),
    Move("other axis", "final_s", on_recording, with_other_axis),
    Move("standard deviations", "final_s", on_recording, with_stds),
)
