"""[[probe]], [[extensometer]], [[line]] and [[circle]] as places on the specimen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import Mesh, interpolation
from idic.images import Camera
from idic.model import Gauge, KINDS

_ENDS = {"probe": ("at",), "extensometer": ("from", "to"), "line": ("from", "to"), "circle": ("centre",)}


def gauges(config: ExperimentFile, mesh: Mesh, unit: str, camera: Camera, file) -> tuple[Gauge, ...]:
    """The gauges of an experiment, in mm of the mesh; unit : "px" where no scale is known.

    Raises
    ------
    InputError
        Two of one name, lengths in mm without a scale, or a place beside the specimen.
    """
    records, names = [], set()
    for key, name, table in _tables(config):
        if name in names:
            raise InputError("two gauges of one name", file=file, key=f"{key}.name", expected="a name of its own",
                             found=repr(name), remedy="choose another name")
        names.add(name)
        if mesh.n_dim == 2 and config.experiment.surface is not None:
            raise InputError("a gauge on a cross-section", file=file, key=key, expected="a plane model, or a solid",
                             found=f"images of the edge set {config.experiment.surface}", remedy="leave the gauge out")
        gauge = _gauge(key, name, table, unit, camera, file)
        _check_place(gauge, key, mesh, config.experiment.surface, unit, file)
        records.append(gauge)
    return tuple(records)


def _tables(config: ExperimentFile) -> Iterator[tuple[str, str, Any]]:
    for kind in KINDS:
        for number, table in enumerate(getattr(config, kind)):
            yield f"{kind}[{number}]", table.name or f"{kind} {number + 1}", table


def _gauge(key: str, name: str, table: Any, length_unit: str, camera: Camera, file) -> Gauge:
    kind = key.split("[", maxsplit=1)[0]
    unit = "px" if getattr(table, f"{_ENDS[kind][0]}_px") is not None else "mm"
    points = np.array([getattr(table, f"{stem}_{unit}") for stem in _ENDS[kind]], dtype=float)
    radius = getattr(table, f"radius_{unit}", None) or 0.0
    if unit == "mm" and length_unit == "px":
        raise InputError("a place in mm without a scale", file=file, key=f"{key}.{_ENDS[kind][0]}_mm",
                         expected="camera.pixel_size_mm, or _px", found="lengths in px",
                         remedy="give pixel_size_mm, or the column and row of the reference image")
    if unit == "px":
        points, radius = camera.inverse(points), radius * camera.pixel_size
    return Gauge(name, kind, tuple((float(x), float(y)) for x, y in points), float(radius), getattr(table, "points", 0))


def _check_place(gauge: Gauge, key: str, mesh: Mesh, surface: str | None, unit: str, file) -> None:
    """Points and ends lie on the specimen; of a line or circle a part does."""
    _, inside = interpolation(mesh.nodes[:, :2], mesh.surface_cells(surface), gauge.places)
    if inside.all() or (gauge.kind in ("line", "circle") and inside.any()):
        return
    x, y = gauge.places[int(np.argmin(inside))]
    low, high = mesh.nodes[:, :2].min(axis=0), mesh.nodes[:, :2].max(axis=0)
    raise InputError("a gauge beside the specimen", file=file, key=key,
                     expected=f"a place in the mesh: x from {low[0]:.4g} to {high[0]:.4g} {unit}, y from {low[1]:.4g} "
                              f"to {high[1]:.4g} {unit}, outside its holes",
                     found=f"{gauge.name} at ({x:.4g}, {y:.4g}) {unit}",
                     remedy="correct the place; idic check draws the mesh on the reference image")
