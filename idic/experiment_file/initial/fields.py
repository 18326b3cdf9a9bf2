"""`idic init` for a folder of measured fields: the stages of another DIC system, with their force where they hold
it."""

from __future__ import annotations

import glob
import json
import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.initial.loading import Loading, largest_load, loading
from idic.experiment_file.initial.open_edges import open_edges, open_rectangle
from idic.images import MIN_POINTS, MIN_STAGES
from idic.readers import (
    FORMATS, FieldSeries, Log, MeasuredPoints, PointOutline, StageRule, detected, notched_axis, parse_unit,
    patterns_of, strain_path,
)

_SUFFIXES = {suffix for entry in FORMATS if entry.kind == "fields" for suffix in entry.suffixes}
_LOG_SUFFIXES = {suffix for entry in FORMATS if entry.kind == "loads" for suffix in entry.suffixes}
_MESH_SUFFIXES = (".inp", ".msh", ".bdf", ".med")  # .vtu and .vtk may hold fields
_ELEMENTS_ACROSS = 6  # of the shorter side; three points or more each
_MIN_FILLED = 0.97  # of the rectangle around the points, by their outline: less is no rectangle
_LONG_FIELD_RATIO = 1.5  # of its sides: of a longer one the ends are loaded
_CLEAR_STRAIN_RATIO = 1.25  # of the mean strains along both axes
_MANY_STAGES = 200  # a longer series is thinned
_COMPARED_STAGES = 100  # of it, about
_SAMPLED_STAGES = 24  # of it, for the way of the mean strain
_MAX_BROKEN_SHARE = 0.1  # of the largest force; the stages from the first one below it on are after the break


def find_stages(files: Sequence[Path]) -> list[Path]:
    """The largest group of files in one folder, alike but for numbers, that hold measured fields; [] where there is
    none.

    Raises
    ------
    InputError
        There is none, and files that may be stages need a library that is not installed.
    """
    groups: dict[tuple[Path, str], list[Path]] = defaultdict(list)
    for path in files:
        if path.suffix.lower() in _SUFFIXES:
            groups[path.parent, re.sub(r"\d+", "#", path.name)].append(path)
    missing_libraries = []
    for _, paths in sorted(groups.items(), key=lambda item: -len(item[1])):
        try:
            detected(paths[0])
        except InputError as error:
            if isinstance(error.__context__, ImportError):
                missing_libraries.append(error)
            continue
        except OSError:
            continue
        return paths
    if missing_libraries:
        raise missing_libraries[0]
    return []


def fields_document(folder: Path, paths: Sequence[Path], files: Sequence[Path]) -> str:
    """The text of experiment.toml for the stages in `paths`; files : all of the folder, among them a log and a mesh.

    Raises
    ------
    InputError
        A stage cannot be read.
    """
    in_px = False
    try:
        series = FieldSeries.open(paths)
    except InputError as error:
        if error.key != "camera.pixel_size_mm":
            raise
        in_px, series = True, FieldSeries.open(paths, unit="mm")  # the size of a pixel is to be filled in
    points = series.measured_points([0])
    log, is_exported = series.log(), True
    other_files = [path for path in files if path not in set(paths)]
    meshes = (path.relative_to(folder).as_posix() for path in other_files if path.suffix.lower() in _MESH_SUFFIXES)
    mesh = next(meshes, None)
    separate_log = None if _force(log) is not None else _log_beside(other_files)
    if separate_log is not None:
        log, is_exported = separate_log[1], False
    column = _force(log)
    stage_log = log if log is not None and len(log.rows) == len(series.entries) else None
    strain, force, bent = largest_load(series, points, stage_log, column)
    upright, reason = _upright(points, strain)
    ends = ("TOP", "BOTTOM") if upright else ("RIGHT", "LEFT")
    loaded = loading(strain, force, bent, upright)
    parts = [_experiment(folder, _patterns(folder, paths), series, points, mesh, "px" if in_px else "mm"),
             *_log_lines(series, log, None if is_exported else separate_log[0].relative_to(folder).as_posix(), column),
             "",
             _camera(in_px, mesh is not None), _MATERIAL,
             _boundary(*ends, reason), _channel(column, ends[0], loaded),
             _open_edges(points, ends) if mesh is None else "", _TAIL]
    return "\n".join(parts)


def _upright(points: MeasuredPoints, strain: np.ndarray) -> tuple[bool, str]:
    """Whether the loaded ends are above and below, and why: notches and waists are in free edges; of a field about as
    wide as long the mean strain (2, 2) tells, unless it is shear or alike along both axes."""
    notched = notched_axis(points.positions, points.pitch)
    if notched is not None:
        return notched == 0, "the other two edges are notched"
    extent = np.ptp(points.positions, axis=0)
    small, large = np.sort(np.abs(np.diag(strain)))
    clear = large > _CLEAR_STRAIN_RATIO * small and large > 2.0 * abs(strain[0, 1])
    if clear and extent.max() < _LONG_FIELD_RATIO * extent.min():
        k = int(np.argmax(np.abs(np.diag(strain))))
        return k == 1, "the mean strain is larger along " + "xy"[k]
    return bool(extent[1] >= extent[0]), "the points span more along " + "xy"[int(extent[1] >= extent[0])]


def _patterns(folder: Path, paths: Sequence[Path]) -> str | list[str]:
    """Of these files alone, as `fields` takes them."""
    patterns = patterns_of(folder, paths) if len(paths) > 1 else [glob.escape(paths[0].relative_to(folder).as_posix())]
    return patterns[0] if len(patterns) == 1 else patterns


def _log_beside(files: Sequence[Path]) -> tuple[Path, Log] | None:
    """The first table with a force among these files."""
    for path in files:
        if path.suffix.lower() in _LOG_SUFFIXES:
            try:
                log = Log.read(path)
            except InputError:
                continue
            if _force(log) is not None:
                return path, log
    return None


def _line(text: str, comment: str) -> str:
    return f"{text:<32} # {comment}"


def _experiment(folder: Path, patterns: str | list[str], series: FieldSeries, points: MeasuredPoints, mesh: str | None,
                unit: str) -> str:
    extent = np.ptp(points.positions, axis=0)
    margin = 0.5 * points.pitch
    widest = 0.97 * (min(extent) + 2.0 * margin)  # both numbers are written with few digits
    size = min(max(min(extent) / _ELEMENTS_ACROSS, 3.0 * points.pitch), widest)
    lines = [f"# An idic experiment, written by idic init for {len(series.entries)} stages of {len(points)} points "
             f"({series.format}).", "# Fill in the values marked FILL IN, then run  idic check .", "", "[experiment]",
             f"title = {json.dumps(folder.resolve().name)}",
             _line(f"fields = {json.dumps(patterns)}", "measured displacements instead of images; the first is the "
                                                      "reference"),
             _line(f"# fields_format = {json.dumps(series.format)}", "as found in the files"),
             *([_line('# fields_unit = "mm"', 'FILL IN: the files name no unit of length; "px" with pixel_size_mm in '
                                              "[camera]")] if series.unit_assumed else []),
             *(_mesh(points, margin, size, unit) if mesh is None
               else [_line(f"mesh = {json.dumps(mesh)}", "and mesh_unit, if not mm")]),
             _line('kind = "plane_stress"', "plane_stress | plane_strain | solid (with surface)"),
             _line("# thickness_mm = 1.0", "FILL IN if a force is compared")]
    if len(series.entries) < MIN_STAGES or len(points) < MIN_POINTS:
        few = f"{len(series.entries)} stages" if len(series.entries) < MIN_STAGES else f"{len(points)} points"
        lines.append(_line("fields_noise_um = 1.0", f"FILL IN: noise of a point, which {few} do not show"))
    return "\n".join([*lines, *_stages(series, points)])


def _log_lines(series: FieldSeries, log: Log | None, file: str | None, column: str | None) -> list[str]:
    """Where forces come from, and the stages after a break. file : of the log, None: the stages hold it"""
    n, lines = len(series.entries), []
    if log is None:
        lines.append(_line('# loads = "loads.csv"', "one row per stage, e.g. frame,time_s,force_N"))
    elif file is None:
        lines.append(f"# the stages hold {', '.join(log.names)}; a file would take their place: loads = \"loads.csv\"")
    else:
        lines.append(_line(f"loads = {json.dumps(file)}", f"columns: {', '.join(log.names)}"))
    timed = all(entry.time_s is not None for entry in series.entries)
    if file is not None and log is not None and len(log.rows) != n:
        lines += [f"# {len(log.rows)} rows for {n} stages: they are matched by the times of the stages"] if timed else [
            f"# FILL IN: {len(log.rows)} rows for {n} stages; give the times of the stages:",
            _line("# frame_interval_s = 1.0", 'with first_frame_s; or image_times = "times.csv" (column time_s)')]
    broken = _after_the_break(series, log if log is not None and len(log.rows) == n else None, column)
    return [*lines,
            f"exclude_frames = {json.dumps(broken, ensure_ascii=False)}   # the force has dropped: after the break"
            if broken else _line("# exclude_frames = [12]", "numbers in the file names, or indices from 0")]


def _mesh(points: MeasuredPoints, margin: float, size: float, unit: str) -> list[str]:
    """A rectangle around the points, or their outline where that is no rectangle."""
    extent = np.ptp(points.positions, axis=0)
    span = (f"# the points span {extent[0]:.4g} x {extent[1]:.4g} {unit} and end before the edges of the specimen: "
            f"FILL IN the")
    outline = PointOutline.around(points.positions, points.pitch, 0.0)
    if not outline.holes and outline.filled > _MIN_FILLED:
        return [f"mesh = {{ around_points_mm = [{margin:.2g}, {margin:.2g}], element_mm = {size:.3g} }}", span,
                "# margins along x and y, so that the mesh has the true width (a force is compared with its",
                "# cross-section), and leave geometry.outline (below) out"]
    holes = f" and {len(outline.holes)} hole{'s' * (len(outline.holes) > 1)}" if outline.holes else ""
    return [f"mesh = {{ outline_points_mm = {margin:.2g}, element_mm = {3.0 * points.pitch:.3g} }}",
            f"# an outline of {len(outline.outline)} corners{holes}, found from the points; the picture of idic check "
            f"shows it.", span,
            "# margin (half a facet); where the edges lie beyond it is identified (geometry.outline, below);",
            "# outline_mm draws it exactly: see docs/experiment-file.md, a mesh from a drawing"]


def _open_edges(points: MeasuredPoints, ends: Sequence[str]) -> str:
    """The free edges, which points do not show: of an outline one by one, of a rectangle together."""
    margin = float(f"{0.5 * points.pitch:.2g}")  # as in `_mesh`
    point_outline = PointOutline.around(points.positions, points.pitch, margin)
    if point_outline.holes or point_outline.filled <= _MIN_FILLED:
        return open_edges(point_outline, points.pitch, ends)
    return open_rectangle(points.pitch)


def _stages(series: FieldSeries, points: MeasuredPoints) -> list[str]:
    """The rule by which stages of a long series are chosen, in its own words; a comment where all are compared."""
    n = len(series.entries)
    if n <= _MANY_STAGES:
        return [_line("# stages = { every_strain = 1e-4 }", "of a long series, some stages: also every_time_s, "
                                                             "every_change_um, max")]
    path = strain_path(series, points, np.unique(np.linspace(0, n - 1, _SAMPLED_STAGES).astype(int)).tolist())
    step = float(f"{path / _COMPARED_STAGES:.1g}")
    rule = StageRule(strain=step or None, most=_MANY_STAGES)
    text = f"{{ every_strain = {step:g}, max = {_MANY_STAGES} }}" if step else f"{{ max = {_MANY_STAGES} }}"
    return [f"# of the {n} stages those are compared that this rule keeps: {rule.words}",
            _line(f"stages = {text}", "leave it out to compare all")]


def _camera(in_px: bool, mesh_file: bool) -> str:
    if in_px or mesh_file:
        lines = ["[camera]",
                 *([_line("pixel_size_mm = 1.0", "FILL IN: the fields are in px; multiply the lengths of mesh and "
                                                 "geometry by it")]
                               if in_px else []),
                 *([_line('placement = "outline"', "the mesh is laid along the outline of the points")] if mesh_file
                   else [])]
        return "\n".join([*lines, ""])
    return "\n".join([_line("# [camera]", "only for a mesh file with axes of its own"),
                      _line('# placement = "outline"',
                            "idic lays it along the outline of the points; or say where it is:"),
                      _line("# origin_mm = [0.0, 0.0]", "where its origin lies in the axes of the points"),
                      _line('# axes = ["+x", "+y"]', "where its axes point"), ""])


_MATERIAL = "\n".join([_line("[material.ALL]", "one table per element set"),
                       _line('law = "elastic"', "idic laws lists them all"),
                       'E = { value = 70e3, unit = "MPa", identify = true }   # FILL IN a first guess',
                       "nu = { value = 0.3, identify = true }", ""])

_TAIL = """# [[dof]]                        # further degrees of freedom
# name = "camera.rotation_deg"   # the axes of the mesh against those of the points
# value = 0.0
"""


def _boundary(moving_end: str, fixed_end: str, reason: str) -> str:
    return "\n".join(["[[boundary]]", _line(f"nodes = {json.dumps(moving_end)}", f"loaded end: {reason}"),
                      _line('u = "measured"', "the motion of this end, from the fields"), "", "[[boundary]]",
                      f"nodes = {json.dumps(fixed_end)}", 'u = "measured"', ""])


def _channel(column: str | None, moving: str, loaded: Loading) -> str:
    factor = ", factor = -1.0" if loaded.opposite else ""
    lines = ["[[channel]]", f"column = {json.dumps(column or 'force_N')}",
             f"simulated = {{ reaction = {json.dumps(moving)}, component = {json.dumps(loaded.component)}{factor} }}"]
    lines[2] += "   # " + loaded.words if column is not None else ""
    if column is None:
        lines = [_line(f"# {line}", "measured against simulated; needs thickness_mm") if k == 0 else f"# {line}"
                 for k, line in enumerate(lines)]
    return "\n".join([*lines, _line("# noise_std = 5.0", "in the unit of the column; else from its course"), ""])


def _force(log: Log | None) -> str | None:
    if log is None:
        return None
    powers = parse_unit("N").powers
    return next((name for name in log.names if (unit := parse_unit(log.unit(name) or "")) is not None
                 and unit.powers == powers), None)


def _after_the_break(series: FieldSeries, log: Log | None, column: str | None) -> list[str]:
    """Labels of the last stages, whose force has dropped at once; [] where it has not."""
    if log is None or column is None:
        return []
    force = np.abs(log.column(column))
    top = int(np.argmax(force))
    low = np.flatnonzero(force < _MAX_BROKEN_SHARE * force[top])
    low = low[low > top]
    if not len(low) or low[0] + len(low) != len(force) or force[low[0] - 1] < 0.5 * force[top]:
        return []
    return [series.labels[int(k)] for k in low]
