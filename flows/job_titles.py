"""The names of jobs in Prefect: ``simulate it003 SPECIMEN.E + 21 MPa``, ``correlate it003 frames 0-15, chunk 1 of 8``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from idic.run import BASE, CorrelationJob, SimulationJob, open_run


def titles_of(jobs: Sequence[Any], names: Sequence[str], name_run: bool = False) -> list[str]:
    """A name for each job of a call.

    names : in Dask; those of other jobs than simulations and correlations are kept
    name_run : with the folder of the RUN, as where several runs share a flow
    """
    runs = {job.run for job in jobs if isinstance(job, SimulationJob | CorrelationJob)}
    base = {(job.run, job.evaluation): job for job in jobs if isinstance(job, SimulationJob) and job.label == BASE}
    chunks: dict[tuple[str, int], int] = {}
    for job in jobs:
        if isinstance(job, CorrelationJob):
            chunks[job.run, job.evaluation] = chunks.get((job.run, job.evaluation), 0) + 1
    begun = dict.fromkeys(chunks, 0)
    titles = []
    for job, name in zip(jobs, names, strict=True):
        heading = f"{name.split('-it')[0].replace('-', ' ')} it{getattr(job, 'evaluation', 0):03d}"
        if name_run or len(runs) > 1:
            heading = f"{Path(getattr(job, 'run', '')).name}: {heading}"
        if isinstance(job, SimulationJob):
            titles.append(f"{heading} {_perturbed(job, base.get((job.run, job.evaluation)))}")
        elif isinstance(job, CorrelationJob):
            begun[job.run, job.evaluation] += 1
            number, of = begun[job.run, job.evaluation], chunks[job.run, job.evaluation]
            frames = f"frame {job.first}" if job.stop - job.first == 1 else f"frames {job.first}-{job.stop - 1}"
            titles.append(f"{heading} {frames}, chunk {number} of {of}")
        else:
            titles.append(name)
    return titles


def _perturbed(job: SimulationJob, base: SimulationJob | None) -> str:
    """The perturbed parameter and its change in the user's unit."""
    if base is None or job.label not in job.values:
        return job.label
    change, unit = job.values[job.label] - base.values[job.label], ""
    with suppress(Exception):  # a name only: the job itself says what is wrong with its RUN
        parameter = open_run(job.run).experiment.model.parameters[job.label]
        change, unit = change / parameter.factor, parameter.unit
    return f"{job.label} {'-' if change < 0 else '+'} {abs(change):.3g} {unit}".rstrip()
