"""What the last model of a diagnosis leaves of the recording: in motions, in channels, on blocks."""

from __future__ import annotations

from dataclasses import dataclass, replace

from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import refit_of_one
from idic.diagnose.residual.channel_left import ChannelLeft, channels_left
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.residual.heldout import Misfit, misfit_of
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.screen.time_course import time_course_test
from idic.diagnose.selection.block_step import BlockJudgement, judged_by_step
from idic.diagnose.selection.state import Setting, State


@dataclass(frozen=True, eq=False)
class Remainder:
    """Tests of the last model against the recording.

    channels : residual of every channel
    of_recording : residual motion on the recording, None where no cause joined the identified model, or the enriched
        one finds no equilibrium from rest
    local : local residual tests at new inclusions, and the time-course test
    of_copy : residual motion on the copy that had no part in the fit
    blocks : both models on blocks of the recording, after one step from the finished fit to the others
    """

    channels: tuple[ChannelLeft, ...]
    of_recording: ExcessLeft | None
    local: tuple[ExcessLeft, ...]
    of_copy: ExcessLeft
    blocks: tuple[BlockJudgement, ...]

    @property
    def excesses(self) -> list[ExcessLeft]:
        """All of them, the most telling first."""
        return [*([] if self.of_recording is None else [self.of_recording]), *self.local, self.of_copy]


def remainder_of(state: State, misfit: Misfit) -> Remainder:
    """The tests of the last model.

    misfit : of the identified model on the recording
    """
    setting, base = state.setting, state.first.residual
    enriched = None if state.final is None else state.final.residual
    bounds = {"margin_px": setting.margin.px, "camera_px": setting.margin.camera_px}
    of_copy = ExcessLeft(state.first.fit.judgement, state.model.fit.judgement,
                         state.power_of_copy, **bounds)
    channels = channels_left(base, enriched)
    if enriched is None:
        return Remainder(channels, None, (), of_copy, ())
    local = (*local_residual_tests(base, enriched, setting.grid, state.final.fit.values, setting.margin),
             time_course_test(base, enriched, setting.grid, setting.margin))
    of_recording = ExcessLeft(misfit, misfit_of(enriched, setting.grid), state.power, **bounds)
    was_cut = not setting.quick and state.model.fit.status == "max_iterations"
    if of_copy.matters and was_cut and not any(excess.matters for excess in (of_recording, *local)):
        setting.stage("fit of the enriched model to one copy, without a limit of evaluations")
        with setting.clock.step("final_s"):
            of_copy = unlimited_excess(of_copy, replace(state.final, fit=state.model.fit), setting)
    blocks = judged_by_step(base, enriched, setting.grid)
    return Remainder(channels, of_recording, local, of_copy, blocks)


def unlimited_excess(copy: ExcessLeft, model: FittedModel, setting: Setting) -> ExcessLeft:
    """Excess on the copy for judging after the fit to the other copy has converged, without a limit of evaluations.

    model : with its last fit to that other copy
    """
    (fitted,) = setting.refits([refit_of_one(model.source, "ended", model.fit, setting.grid, setting.seed,
                                             unlimited=True)])
    return replace(copy, after=fitted.judgement) if fitted.usable else copy
