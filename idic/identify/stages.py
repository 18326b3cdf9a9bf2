"""Staged schedules: which degrees of freedom are free when."""

from __future__ import annotations

from idic.errors import InputError
from idic.experiment import Experiment, Stage
from idic.parameters import ParameterSet


def resolve_stages(experiment: Experiment) -> tuple[Stage, ...]:
    """The schedule with "all" spelled out; without one, a single stage that frees everything.

    Raises
    ------
    InputError
        If a stage names something that is not a free parameter of the experiment.
    """
    everything = experiment.parameters.free
    if not everything:
        raise InputError("no parameter is to be identified", file="experiment.toml", key="[material]",
                         expected="at least one parameter with identify = true", found="none",
                         remedy='write for example  E = { value = 70e3, unit = "MPa", identify = true }')
    stages = experiment.stages or (Stage("all"),)
    resolved = []
    for number, stage in enumerate(stages):
        names = everything if stage.free == "all" else tuple(stage.free)
        unknown = [name for name in names if name not in everything]
        if unknown:
            raise InputError(f"stage {number + 1} frees {', '.join(unknown)}", file="experiment.toml", key="[[stage]]",
                             expected=f"names among {', '.join(everything)}", found=", ".join(unknown),
                             remedy="mark the parameter with identify = true or take it out of the stage")
        resolved.append(Stage(tuple(name for name in everything if name in names), stage.max_iterations))
    return tuple(resolved)


def stage_parameters(parameters: ParameterSet, stage: Stage) -> ParameterSet:
    """The parameters with exactly the stage's names free."""
    return parameters.with_free(stage.free)
