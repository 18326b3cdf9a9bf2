"""The accepted point of a result: its channels, and whether the RUN still has it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.correlation import channel_values
from idic.errors import InputError
from idic.run.prepared.context import RunContext
from idic.run.recovery.recover import START
from idic.run.store.arrays import FrameArrays, read_array
from idic.run.store.layout import BASE, group_name

MAX_MOTION_ERROR = 0.01  # of the largest prescribed motion: output files hold five to seven digits


def refuse_passed_point(context: RunContext, result: Mapping) -> None:
    """InputError where a run was resumed after an interruption and killed: its result is of a point before that."""
    number = last_accepted(result)["evaluation"]
    if result.get("status") != "interrupted" or context.store.finished(group_name(number, BASE)) is not None:
        return
    raise InputError("the run was interrupted, and its result is older than its last step", file=context.store.run,
                     expected=f"the simulation of evaluation {number}", found="those of later ones",
                     remedy="finish the run first:  idic identify EXPERIMENT --out RUN --resume")


def channels_of(context: RunContext, result: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """Simulated and measured channels of the accepted point of a result  # 2 x (n_frames, n_channels)

    The stored ones where they are of that point; those of an earlier one, before a pause, are not.
    """
    entry, folder = last_accepted(result), context.store.finished("channels")
    if folder is None or context.store.ident(folder).get("evaluation") != entry["evaluation"]:
        return channel_table(context, entry["values"], entry["evaluation"])
    return read_array(folder, "simulated"), read_array(folder, "measured")


def channel_table(context: RunContext, values: Mapping[str, float],
                  evaluation: int) -> tuple[np.ndarray, np.ndarray]:
    """Simulated and measured channels of all frames, scale and offset included  # 2 x (n_frames, n_channels)"""
    experiment = context.experiment
    parameters = experiment.model.parameters.with_values(values)
    stored = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "channels").read()
    simulated = np.full((experiment.model.n_frames, len(experiment.model.channels)), np.nan)
    for i, frame in enumerate(range(experiment.model.reference, experiment.model.n_frames)):
        simulated[frame] = channel_values(experiment, parameters, stored[i], frame)
    return simulated, experiment.model.measured_channels(parameters)


def solver_notes(context: RunContext, values: Mapping[str, float], evaluation: int) -> list[str]:
    """Where an external solver moves a set otherwise than the experiment file prescribes."""
    if not context.external:
        return []
    stored = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "u")
    local = read_array(context.store.group(group_name(evaluation, START)), "local")
    motions = context.forward.motions(context.experiment.model.parameters.with_values(values), local)  # type: ignore[attr-defined]
    means = {name: np.zeros(len(prescribed)) for name, (_, prescribed) in motions.items()}
    for frame in range(len(context.forward.frames) if motions else 0):
        u = stored.read(frame, frame + 1).ravel()
        for name, (dofs, _) in motions.items():
            means[name][frame] = u[dofs].mean()
    notes = []
    for name, (_, prescribed) in motions.items():
        off = np.abs(means[name] - prescribed)
        at, largest = int(off.argmax()), float(np.abs(prescribed).max())
        if off[at] > MAX_MOTION_ERROR * largest:
            notes.append(f"the external solver moves {name} by {means[name][at]:.4g} mm in frame {at} after the "
                         f"reference, where the experiment file prescribes {prescribed[at]:.4g} mm: unless the deck is "
                         "meant to (a machine that yields), its times, units or signs are wrong")
    return notes


def last_accepted(result: Mapping) -> Mapping:
    return [entry for entry in result["history"] if entry["accepted"]][-1]
