"""From the paths of a command to the run that it asks for: one experiment, or several together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from idic.errors import InputError
from idic.run.joint_run import JointRun
from idic.run.runs import Run, SingleRun
from idic.store.run_store import RunStore


def plan_run(paths: Sequence[str | Path], out: str | Path, overrides: Mapping[str, object]) -> Run:
    """The run of one experiment, or of several with shared materials; everything is read, nothing written.

    Raises
    ------
    InputError
        If anything in the input is not what was expected.
    """
    if not paths:
        raise InputError("no experiment", expected="an experiment folder, or several", found="none",
                         remedy="name the folder that holds experiment.toml")
    if len(paths) == 1:
        return SingleRun(RunStore(out), str(paths[0]), dict(overrides))
    return JointRun.planned(paths, out, dict(overrides))
