"""What a flow shows in Prefect: its stages as tasks, and the course of an identification as artifacts."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

from idic.identification import LoopState, resolve_stages
from idic.model import Experiment
from idic.run import RunPoints

SCHEDULE, EVALUATIONS, RESIDUAL = "idic-schedule", "idic-evaluations", "idic-residual"  # keys of the artifacts


def run_stage(name: str, function: Callable, *arguments) -> Any:
    """Run one stage as a Prefect task called `name`; its kind is the first word."""
    from prefect import task
    from prefect.cache_policies import NO_CACHE
    from prefect.context import TagsContext

    with TagsContext(current_tags=set()):  # those of the flow run say which process it is
        return task(name=name.split(" ", maxsplit=1)[0], task_run_name=name, cache_policy=NO_CACHE,
                    persist_result=False)(lambda: function(*arguments))()


class Publication:
    """What a flow shows of an identification while it runs; called with its points and every state (`Hooks.watch`)."""

    def __init__(self) -> None:
        self._points: list[int] = []
        self._scheduled = False

    def __call__(self, points: RunPoints, state: LoopState) -> None:
        if not self._scheduled:
            publish_schedule(points.experiment)
            self._scheduled = True
        publish_evaluations(points.experiment, state)
        if state.accepted is not None and state.accepted.number not in self._points:
            self._points.append(state.accepted.number)
            for folder in points.folders.parts.values():
                publish_residual(folder)


def publish_schedule(experiment: Experiment) -> None:
    """The stages of the schedule as a table artifact: free and locked degrees of freedom, images, frames."""
    from prefect.artifacts import create_table_artifact

    create_table_artifact(key=SCHEDULE, description=f"Schedule of {experiment.title}",
                          table=schedule_table(experiment))


def publish_evaluations(experiment: Experiment, state: LoopState) -> None:
    """All evaluated points as a table artifact, a version of it per iteration; the last version is the whole course."""
    from prefect.artifacts import create_table_artifact

    create_table_artifact(key=EVALUATIONS, description=f"Iteration {state.iteration}: {state.status}",
                          table=evaluations_table(experiment, state))


def publish_residual(run: Path) -> None:
    """The residual map of the last frame at the accepted point as an image artifact, a version of it per iteration.

    run : the folder of one experiment whose frames are images
    """
    from prefect.artifacts import create_image_artifact

    from idic.report import RANGE
    from idic.run import accepted_residual

    residual = accepted_residual(run)
    if residual is None:
        return
    chi2 = "" if residual.chi2 is None else f", chi2 per pixel {residual.chi2:.3g}"
    create_image_artifact(
        key=RESIDUAL, image_url=f"data:image/png;base64,{base64.b64encode(residual.picture).decode('ascii')}",
        description=f"{run.name}: residual of frame {residual.frame} after evaluation {residual.evaluation}{chi2}; "
                    f"full colour: {RANGE:g} standard deviations of the noise")


def schedule_table(experiment: Experiment) -> list[dict[str, str]]:
    """A row per stage of the schedule."""
    names = experiment.model.parameters.free
    return [{"stage": str(number),
             "free": ", ".join(stage.free),
             "locked": ", ".join(name for name in names if name not in stage.free) or "none",
             "low-pass [px]": "as the options" if stage.lowpass_px is None else f"{stage.lowpass_px:g}",
             "until [s]": "end" if stage.until_s is None else f"{stage.until_s:g}"}
            for number, stage in enumerate(resolve_stages(experiment), start=1)]


def evaluations_table(experiment: Experiment, state: LoopState) -> list[dict[str, str]]:
    """A row per evaluated point: stage, objective, residual, outcome, damping, and the free parameters in their
    units."""
    parameters = [experiment.model.parameters[name] for name in experiment.model.parameters.free]
    return [{"evaluation": str(entry["evaluation"]),
             "stage": str(entry["stage"] + 1),
             "objective": "no simulation" if entry["phi"] is None else f"{entry['phi']:.6g}",
             "residual rms": "" if entry["rms_gv"] is None else f"{entry['rms_gv']:.4g}",
             "step": "accepted" if entry["accepted"] else "passed over" if entry["passed_over"] else "rejected",
             "damping": f"{entry['damping']:.3g}",
             **{f"{p.name} [{p.unit or '-'}]": f"{entry['values'][p.name] / p.factor:.6g}" for p in parameters}}
            for entry in state.history]
