"""Staged schedules: which degrees of freedom are free when."""

from __future__ import annotations

from dataclasses import replace

from idic.errors import InputError
from idic.experiment import Experiment, Stage
from idic.identify.schedule import leads
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
        resolved.append(replace(stage, free=tuple(name for name in everything if name in names)))
    last = resolved[-1]
    if leads(last):  # blurred or fewer images lead to the answer, they do not give it
        resolved.append(replace(last, max_iterations=None, lowpass_px=None, until_s=None))
    return tuple(resolved)


def stage_parameters(parameters: ParameterSet, stage: Stage) -> ParameterSet:
    """The parameters with exactly the stage's names free."""
    return parameters.with_free(stage.free)
