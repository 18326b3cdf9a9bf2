"""The fields of a RUN for its report, in the units that it shows, and the gauges that read them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from idic.experiment_file import gauges, locate, read_toml, validated, with_overrides
from idic.measure import FieldSeries
from idic.model import Gauge, Model
from idic.report import stress_unit
from idic.run.judgement.fields import read_fields, write_fields
from idic.run.judgement.floor import PointJob
from idic.run.prepared.context import RunContext
from idic.run.workers.runner import SerialRunner


def series_of(run: Path, context: RunContext, result: Mapping, model: Model) -> FieldSeries | None:
    """The fields over the frames, made now where the RUN was interrupted before; None where nothing was accepted.

    there : the experiment at the geometry that was identified
    """
    accepted = [entry for entry in result["history"] if entry["accepted"]]
    if not accepted:
        return None
    job = PointJob(str(run), accepted[-1]["evaluation"], accepted[-1]["values"])
    write_fields(job, SerialRunner())
    series, (unit, size) = read_fields(context, job.evaluation, model), stress_unit(result, "")
    if series is None or series.stress is None:
        return series
    return replace(series, stress=series.stress / size, stress_unit=unit)


def gauges_of(context: RunContext, model: Model) -> tuple[Gauge, ...]:
    """The gauges that the experiment file declares now; it may have got others since the identification."""
    file = locate(context.settings["experiment"])
    config = validated(with_overrides(read_toml(file), context.settings["overrides"]), file)
    return gauges(config, model.mesh, model.length_unit, model.camera, file)
