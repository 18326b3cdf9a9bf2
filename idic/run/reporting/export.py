"""The fields of a RUN as files for other programs: CSV, VTU with PVD, XDMF, Zarr."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np

from idic.errors import InputError
from idic.inside import folder_inside, free_inside, write_inside
from idic.measure import FieldSeries, MEASURES, field_columns
from idic.run.prepared.context import open_run
from idic.run.reporting.paraview import VTK_NAMES, three_columns, write_collection
from idic.run.reporting.series import series_of
from idic.run.reporting.write import accepted_parameters
from idic.run.store.arrays import create_array
from idic.run.store.result_file import read_result


@dataclass(frozen=True, eq=False)
class Exported:
    """What the writers get: fields, times (one per frame of the series, s or numbers), and the columns of a frame."""

    series: FieldSeries
    times: np.ndarray
    columns: Callable[[int], Mapping[str, np.ndarray]]

    @property
    def frames(self) -> Iterator[tuple[int, float, Mapping[str, np.ndarray]]]:
        """Number, time and columns of every frame."""
        for k, frame in enumerate(self.series.frames):
            yield frame, float(self.times[k]), self.columns(k)


def export_fields(run: Path | str, folder: Path | str, file_format: str = "csv", measure: str = "green_lagrange",
                  angle_deg: float = 0.0) -> Path:
    """Write displacement, strain, stress and state of all shown frames, simulated and measured.

    Parameters
    ----------
    folder : path
        Made where it is missing.
    file_format : "csv" | "vtu" | "xdmf" | "zarr"
    measure, angle_deg : see `idic.measure.fields.columns.field_columns`

    Returns
    -------
    Path
        What to open: a folder of CSV files, ``fields.pvd``, ``fields.xdmf`` or ``fields.zarr``.

    Raises
    ------
    InputError
        No finished run, a format or measure that does not exist, or a test without fields.
    """
    if file_format not in WRITERS:
        raise InputError("no such format", key="--format", expected=", ".join(WRITERS), found=file_format,
                         remedy="write one of these names")
    if measure not in MEASURES:
        raise InputError("no such strain", key="--strain", expected=", ".join(MEASURES), found=measure,
                         remedy="write one of these names")
    run, folder = Path(run), Path(folder)
    result, context = read_result(run), open_run(str(run))
    experiment = context.experiment.at_geometry(accepted_parameters(result, context.experiment.model.parameters))
    series = series_of(run, context, result, experiment.model)
    if series is None:
        raise InputError("the run has no fields", file=run,
                         expected="an accepted simulation of a plane model or a solid",
                         found="a cross-section, or no accepted simulation", remedy="see result.json for its status")
    folder_inside(folder)
    content = Exported(series, experiment.model.times[list(series.frames)],
                       lambda k: field_columns(series, k, measure, angle_deg))
    return WRITERS[file_format](content, folder)


def _csv(content: Exported, folder: Path) -> Path:
    """One file per frame, one row per node."""
    plane = content.series.surface.plane
    for frame, _, columns in content.frames:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["node", f"x_{content.series.unit}", f"y_{content.series.unit}", *columns])
        for i, (label, point) in enumerate(zip(plane.node_labels, plane.nodes, strict=True)):
            writer.writerow([label, *(_number(v) for v in (*point, *(values[i] for values in columns.values())))])
        write_inside(folder, f"frame_{frame:04d}.csv", text.getvalue())
    return folder


def _number(value: float) -> str:
    return f"{value:.9g}" if np.isfinite(value) else ""


def _vtu(content: Exported, folder: Path) -> Path:
    """PVD and VTU, on the surface that the camera sees."""
    frames = ((time, {name: values.astype(np.float32) for name, values in columns.items()} | _vectors(content, columns))
              for _, time, columns in content.frames)
    return write_collection(folder, content.series.surface.plane, frames)


def _xdmf(content: Exported, folder: Path) -> Path:
    """One XDMF file with all frames, numbers as text: every reader takes it."""
    plane, path = content.series.surface.plane, free_inside(folder, "fields.xdmf")
    cells = [(VTK_NAMES[block.cell], np.asarray(block.connectivity)) for block in plane.blocks]
    with meshio.xdmf.TimeSeriesWriter(path, data_format="XML") as writer:
        writer.write_points_cells(three_columns(plane.nodes), cells)
        for _, time, columns in content.frames:
            writer.write_data(time, point_data=dict(columns) | _vectors(content, columns))
    return path


def _zarr(content: Exported, folder: Path) -> Path:
    """A Zarr group: ``frame``, ``time``, ``node``, ``x``, ``y``, and (frames, nodes) for every field."""
    path, plane = folder / "fields.zarr", content.series.surface.plane
    if os.path.lexists(path):
        raise InputError("there is such a file", file=path, expected="a new name", found="an earlier export",
                         remedy="remove it, or choose another --out")
    frames = list(content.frames)
    arrays = {"frame": np.array([frame for frame, _, _ in frames]), "time": np.array([time for _, time, _ in frames]),
              "node": np.asarray(plane.node_labels), "x": plane.nodes[:, 0], "y": plane.nodes[:, 1]}
    arrays |= {name: np.array([columns[name] for _, _, columns in frames]) for name in frames[0][2]}
    folder_inside(folder, path.name)
    write_inside(path, "zarr.json", '{"zarr_format": 3, "node_type": "group", "attributes": {}}\n')
    for name, values in arrays.items():
        create_array(path, name, values.shape, values.shape, values.dtype)[...] = values
    return path


def _vectors(content: Exported, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Displacements as vectors too, by which ParaView warps."""
    unit = content.series.unit
    vectors = {f"displacement{tail}_{unit}": [f"u_{axis}_{unit}{tail}" for axis in "xyz"] for tail in ("", "_measured")}
    return {name: three_columns(np.column_stack([columns[axis] for axis in axes if axis in columns]))
            for name, axes in vectors.items() if axes[0] in columns}


WRITERS: Mapping[str, Callable[[Exported, Path], Path]] = {"csv": _csv, "vtu": _vtu, "xdmf": _xdmf, "zarr": _zarr}
