"""The stages of a schedule: which degrees of freedom each frees, on which images."""

from __future__ import annotations

from dataclasses import replace

from idic.errors import InputError
from idic.identification.step.schedule import BLURRED_STAGE, begins_blurred, is_preliminary, seen_in
from idic.model import Experiment, Stage
from idic.parameters import ParameterSet


def resolve_stages(experiment: Experiment) -> tuple[Stage, ...]:
    """The schedule with "all" spelled out; by default one stage that frees everything, after a stage on blurred images
    where a start may have been searched. A schedule that ends on other images, or with locked parameters, goes on with
    it: values of locked ones are no answer, and error bars are of all.

    Raises
    ------
    InputError
        If a stage names something that is not a free parameter of the experiment, or ends before anything is compared.
    """
    everything = experiment.model.parameters.free
    if not everything:
        raise InputError("no parameter is to be identified", file="experiment.toml", key="[material]",
                         expected="at least one parameter with identify = true", found="none",
                         remedy='write for example  E = { value = 70e3, unit = "MPa", identify = true }')
    stages = experiment.stages or ((BLURRED_STAGE, Stage("all")) if begins_blurred(experiment) else (Stage("all"),))
    resolved = []
    for number, stage in enumerate(stages):
        names = everything if stage.free == "all" else tuple(stage.free)
        unknown = [name for name in names if name not in everything]
        if unknown:
            raise InputError(f"stage {number + 1} frees {', '.join(unknown)}", file="experiment.toml", key="[[stage]]",
                             expected=f"names among {', '.join(everything)}", found=", ".join(unknown),
                             remedy="mark the parameter with identify = true or take it out of the stage")
        check_images(experiment, stage, number)
        resolved.append(replace(stage, free=tuple(name for name in everything if name in names)))
    if is_preliminary(resolved[-1]) or resolved[-1].free != everything:
        resolved.append(Stage(everything))
    return tuple(resolved)


def check_images(experiment: Experiment, stage: Stage, number: int) -> None:
    """Refuse a stage without an image to correlate (`InputError`)."""
    model = experiment.model
    if stage.until_s is None or seen_in(experiment, stage).correlated_frames(range(model.n_frames)):
        return
    compared = experiment.correlated_frames(range(model.n_frames))
    begins = f"{model.times[compared[0]]:g} s or later" if compared else "images after the reference"
    raise InputError(f"stage {number + 1} ends before the first image that is compared", file="experiment.toml",
                     key="[[stage]] until_s", expected=begins, found=f"{stage.until_s:g} s",
                     remedy="let it end later, or leave until_s out")


def stage_parameters(parameters: ParameterSet, stage: Stage) -> ParameterSet:
    """The parameters with exactly the stage's names free."""
    return parameters.with_free(stage.free)
