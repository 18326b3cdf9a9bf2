"""The stages of measured fields: which are read and compared, how a sheet is laid flat, what a user should know."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.experiment import ExperimentTable, StagesTable
from idic.model import FieldPoints
from idic.readers import (
    ALLOWED_SHARE, FieldSeries, FieldStack, Flattening, NamedColumns, StageRule, chosen_stages, largest_bending,
    matching_files, mean_strain, out_of_plane,
)

MIN_TOLD_BENDING = 0.005  # of the mean strain
MAX_SHARE_OF_TENSION = 0.5  # beyond, it is no fault of a tension test
MIN_TOLD_REFERENCE_STRAIN = 0.02  # of the largest mean strain: the reference stage of the other system is missing
MIN_TOLD_CURVATURE_STRAIN = 2e-5  # of a surface by bending, half a thickness away from the middle


def open_series(config: ExperimentFile, folder: Path, file: Path) -> FieldSeries:
    """All stages of the experiment."""
    table = config.experiment
    paths = matching_files(folder, table.fields, file=file, key="experiment.fields", order=table.order)
    pixel_size = config.camera.pixel_size_mm if config.camera else None
    columns = None if config.fields is None else NamedColumns(**config.fields.columns.model_dump())
    unit = table.fields_unit or (columns.unit if columns is not None else None)
    return FieldSeries.open(paths, table.fields_format, unit, pixel_size, columns)


def stack_of(series: FieldSeries, references: Sequence[int], table: ExperimentTable) -> FieldStack:
    """The displacements since the mean of the reference stages; of a sheet those of its middle, laid flat. Of a solid
    and of a sheet of known thickness also that along the normal of the points."""
    points = series.measured_points(references)
    if points.heights is None:
        return FieldStack(series, points)
    if table.kind == "solid":
        return FieldStack(series, points, 3)
    half = table.thickness_mm if table.kind == "plane_stress" else None  # a cut in plane strain does not bend
    toward = side_seen(table) * (half or 0.0)
    return FieldStack(series, points, 3 if half else 2, Flattening.of(points.positions, points.heights, toward))


def side_seen(table: ExperimentTable) -> int:
    """1 where z points towards the cameras, else -1."""
    return 1 if table.fields_seen_from == "+z" else -1


def kept_stages(table: StagesTable, stack: FieldStack, references: Sequence[int],
                excluded: Sequence[int]) -> tuple[tuple[int, ...], str]:
    """The stages that the rule of `experiment.stages` keeps, and the rule in words."""
    rule = StageRule(table.every_strain, table.every_change_um, table.every_time_s, table.max)
    numbers = chosen_stages(stack.series, stack.points, rule, references, excluded)
    return numbers, (f"{len(numbers)} of {len(stack.series.entries)} stages are compared, {rule.words}; the reference "
                     "and the last stage are among them (stages in [experiment])")


def field_notes(stack: FieldStack, grid: FieldPoints, stages: Sequence[int], thickness: float | None,
                reference: int = 0) -> list[str]:
    """What a user should know of the fields: format, points, a reference that is strained already, and motion out of
    the plane at the last of the stages."""
    series, points, last_stage = stack.series, stack.points, stages[-1]
    extent = np.ptp(points.positions, axis=0)
    notes = [f"fields: {len(series.entries)} stages in the format {series.format}; {len(points)} points over "
             f"{extent[0]:.3g} x {extent[1]:.3g} mm, {grid.pitch_mm:.3g} mm apart; positions are those of the plane of "
             "the points" + (f", from which they lie {points.plane.flatness_mm:.2g} mm (rms)" if points.plane else "")]
    if series.unit_assumed:
        notes.append(f"fields: the header names no unit of length; they are read as {series.unit}, with y upwards "
                     "(fields_unit in [experiment] states another unit)")
    notes += _strained_reference(stack, reference, last_stage)
    if points.plane is None:
        return notes
    moved = points.moved(series.stage(last_stage))
    deflection = out_of_plane(points.positions, moved[:, 2])
    if deflection is None:
        return notes
    text = (f"out of the plane, at {series.labels[last_stage]}: {deflection.rms_mm:.2g} mm rms, tilt "
            f"{np.degrees(np.hypot(*deflection.tilt)):.2g}°, curvature {1e3 * deflection.curvature:.2g} 1/m")
    if grid.depth is not None and not grid.depth.side:
        return [*notes, text]
    bending = 0.5 * deflection.curvature * (thickness or 0.0)
    text += ("; the plane model is compared with the mid-plane of the sheet, flattened: tilt, arcs"
             + (f" and the strain of bending at the surface ({bending:.1e})" if bending > MIN_TOLD_CURVATURE_STRAIN
                else " and bending" if thickness else "") + " are removed from the in-plane motion")
    if not thickness and 0.5 * deflection.curvature > MIN_TOLD_CURVATURE_STRAIN:
        text += "; with thickness_mm the strain of bending at the surface would be, too"
    most = largest_bending(stack, stages, thickness) if thickness else None
    if most is None or most.share < MIN_TOLD_BENDING:
        return [*notes, text]
    if most.share <= ALLOWED_SHARE:
        return [*notes, f"{text}. Bending is at most {100 * most.share:.2g} % of the mean strain"]
    if most.share > MAX_SHARE_OF_TENSION:
        return [*notes, f"{text}. At {series.labels[most.stage]} the sheet bends out of its plane more than it is "
                        f"strained in it: {most.strain:.1e} at its surface by bending. A plane model has no bending; "
                        'kind = "solid" with its surface has']
    return [*notes, f"{text}. At {series.labels[most.stage]} bending is {100 * most.share:.2g} % of the mean strain "
                    f"({most.strain:.1e}; a tension test allows 10 %): the grips may not be in line, or the sheet was "
                    "not flat"]


def _strained_reference(stack: FieldStack, reference: int, last_stage: int) -> list[str]:
    """A note where the reference stage has a strain against that of the other system, which is missing."""
    series, points = stack.series, stack.points
    first = series.stage(reference)
    if first.displacement is None:
        return []
    is_measured = np.isfinite(first.displacement).all(axis=1)
    places, displacement = first.points[is_measured, :2], first.displacement[is_measured, :2]
    strain = float(np.linalg.norm(mean_strain(places, displacement)))
    largest_strain = float(np.linalg.norm(mean_strain(points.positions, points.moved(series.stage(last_stage))[:, :2])))
    if strain <= MIN_TOLD_REFERENCE_STRAIN * largest_strain:
        return []
    return [f"fields: {series.labels[reference]}, the reference, is strained by {strain:.2g} already, against the "
            f"reference of the other system, which is not among the stages ({largest_strain:.2g} at "
            f"{series.labels[last_stage]}): idic counts motion from {series.labels[reference]} on, and a force before "
            "it is compared with none. Export the reference stage as well, the one without displacement"]
