"""The runs of a batch, and random starts of each: do they all end in the same place?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.experiment_file import load_experiment, read_toml, with_overrides
from idic.parameters import ParameterSet, drawn_start
from idic.run.batch.entries import BatchRun, read_batch


def batch_runs(paths: Sequence[str | Path], overrides: Mapping[str, Any] | None = None, starts: int | None = None,
               spread: float = 0.3, seed: int = 0) -> tuple[BatchRun, ...]:
    """The runs of experiments and lists (`idic.run.batch.entries.read_batch`), each from so many random starts."""
    runs = read_batch(paths, overrides)
    return runs if starts is None else _with_starts(runs, starts, spread, seed)


def _with_starts(runs: Sequence[BatchRun], starts: int, spread: float, seed: int) -> tuple[BatchRun, ...]:
    """Every run `starts` times, from random values around its own start.

    A positive parameter is multiplied by a factor that is log-uniform in [1/(1 + spread), 1 + spread]; another one
    moves by up to `spread` of its scale, uniformly; both within the bounds. Start number k depends on `seed` and k
    only. An experiment that cannot be read stays one run: its status will say why.

    Raises
    ------
    InputError
        An experiment in which nothing that `--set` reaches is free; a spread that is none.
    """
    if not 0.0 < spread < 10.0:
        raise InputError("not a usable spread", key="--spread", expected="a number above 0 and below 10: 0.3 is 30 %",
                         found=f"{spread:g}", remedy="give a number in this range")
    if starts < 1:
        raise InputError("not a number of starts", key="--starts", expected="1 or more", found=str(starts),
                         remedy="give a whole number of 1 or more")
    return tuple(start for run in runs for start in _starts_of(run, starts, spread, seed))


def _starts_of(run: BatchRun, starts: int, spread: float, seed: int) -> list[BatchRun]:
    try:
        parameters = load_experiment(run.experiment, run.overrides).model.parameters
    except InputError:
        return [run]
    width = max(2, len(str(starts - 1)))
    return [BatchRun(f"{run.name}-start{k:0{width}d}", run.experiment, {**run.overrides, **values})
            for k, values in enumerate(_values(run, parameters, starts, spread, seed))]


def _values(run: BatchRun, parameters: ParameterSet, starts: int, spread: float, seed: int) -> list[dict[str, float]]:
    reachable = _reachable(run)
    variables = [parameters[name] for name in parameters.free if name in reachable]
    if not variables:
        raise InputError("no start value to vary", file=run.experiment, key="--starts",
                         expected="free parameters of materials, or [[dof]] entries", found="none",
                         remedy="set identify = true for a parameter, or leave --starts out")
    drawn = []
    for k in range(starts):
        generator = np.random.default_rng([seed, k])
        drawn.append({p.name: drawn_start(p, spread, generator.uniform()) for p in variables})
    return drawn


def _reachable(run: BatchRun) -> set[str]:
    """Names of parameters whose start value ``--set`` can change."""
    raw = with_overrides(read_toml(Path(run.experiment)), run.overrides)
    names = {f"{name}.{key}" for name, table in raw.get("material", {}).items() for key in table}
    return names | {entry.get("name") for entry in raw.get("dof", []) if isinstance(entry, dict)}
