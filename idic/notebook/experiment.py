"""An experiment from Python objects: arrays, a mesh and a table in place of the files of an experiment folder."""

from __future__ import annotations

import csv
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.experiment_file import (
    EXPERIMENT_FILE, ORIGIN, Objects, from_objects, further_files, load_experiment, locate, read_toml, to_toml,
    with_law_files, with_overrides,
)
from idic.fe import inp_text
from idic.measure import Regularisation
from idic.model import Experiment as Record
from idic.notebook.free_motion import FreeMotion, measured_motion
from idic.notebook.saved_folder import saved_in_run
from idic.parameters import ParameterSet
from idic.readers import (
    ArrayFrames, FileStack, LOG_IN_MEMORY as LOG_OBJECT, Log, MESH_IN_MEMORY as MESH_OBJECT, RawMesh, frames_of,
    log_of, mesh_of, read_image,
)
from idic.virtual_tests import IMAGES, LOADS, empty_folder, write_images

MESH, MASK = "mesh.inp", "mask.tif"
_KEYS = {"images": f"{IMAGES}/*.tif", "loads": LOADS, "mesh": MESH, "mask": MASK}  # as `Experiment.save` writes them


class Experiment:
    """A test with its model, from Python objects; everything is read and checked at once, as experiment.toml is.

    docs/experiment-file.md has every key of the tables. A table of the file is a mapping here, ``[[boundary]]`` a list
    of mappings; a bare number is short for ``{"value": number}``.

    Parameters
    ----------
    images : array (n_frames, ny, nx) of uint8, uint16 or float32, list of arrays, or paths
        Grey values; rows count downwards. A path may be a folder, a pattern, a multi-page TIFF or a video.
    mesh : meshio.Mesh, path, or mapping
        In `mesh_unit` (default mm), or ``{"roi_px": [x0, y0, x1, y1], "element_px": 20}``: a mesh made on the image.
    kind : "plane_stress", "plane_strain" or "solid"; needed where anything is simulated
    materials : {element set: {"law": …, parameter: value}}; without, the experiment has a `free_motion` and no more
    camera : mapping, or a list of mappings
        ``pixel_size_mm``, ``origin_px``, ``axes``, ``noise_std_gv``, …; further cameras name their images as paths.
    loads : pandas.DataFrame, {column: (n_frames,) values}, or path of a CSV, optional
        One row per image, or with times; the unit is the end of the column's name (``force_N``).
    boundaries, channels : lists of tables ``[[boundary]]`` and ``[[channel]]``
    units : {column: unit} of a log whose names do not end in one, optional
    mask : array (ny, nx) or path, optional
        Above zero where a pixel may be correlated.
    sets, dofs, stages, heterogeneities, options, solver, setup : the further tables, optional
    probes, extensometers, lines, circles : lists of tables ``[[probe]]``, …: gauges on the specimen, optional
    folder : where paths inside the tables begin (further cameras, a law, a solver's template); default: the working
        folder
    **settings : the other keys of ``[experiment]``: ``thickness_mm``, ``title``, ``reference``, ``frame_interval_s``, …

    Raises
    ------
    InputError
        At the first error, with key, expected value, found value and remedy.

    Examples
    --------
    >>> import numpy as np, idic
    >>> rng = np.random.default_rng(0)
    >>> images = rng.integers(20, 230, (3, 60, 80)).astype(np.uint8)
    >>> strip = idic.Experiment(
    ...     images=images, mesh={"roi_px": [10, 10, 70, 50], "element_px": 20}, kind="plane_stress", thickness_mm=1.0,
    ...     camera={"pixel_size_mm": 0.1, "noise_std_gv": 2.0}, loads={"force_N": [0.0, 10.0, 20.0]},
    ...     materials={"sheet": {"law": "elastic", "E": {"value": 2e3, "unit": "MPa", "identify": True}, "nu": 0.3}},
    ...     boundaries=[{"nodes": "LEFT", "ux": 0.0, "uy": 0.0}, {"nodes": "RIGHT", "ux": "measured"}],
    ...     channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 0.1}])
    >>> strip
    Experiment('Experiment', 3 images of 80 x 60 px, 6 elements, identifies sheet.E)
    >>> strip.parameters["sheet.E"].shown
    2000.0
    """

    def __init__(self, *, images: Any, mesh: Any, kind: str | None = None,
                 materials: Mapping[str, Mapping] | None = None,
                 camera: Mapping | Sequence[Mapping] | None = None, loads: Any = None,
                 boundaries: Sequence[Mapping] = (), channels: Sequence[Mapping] = (),
                 units: Mapping[str, str] | None = None, mask: Any = None, sets: Mapping[str, Mapping] | None = None,
                 dofs: Sequence[Mapping] = (), stages: Sequence[Mapping] = (), heterogeneities: Sequence[Mapping] = (),
                 options: Mapping | None = None, solver: Mapping | None = None, setup: Mapping | None = None,
                 probes: Sequence[Mapping] = (), extensometers: Sequence[Mapping] = (),
                 lines: Sequence[Mapping] = (), circles: Sequence[Mapping] = (),
                 folder: str | os.PathLike = ".", **settings: Any):
        settings = {"title": "Experiment"} | settings
        objects_by_key = {"images": images, "mesh": mesh, "loads": loads, "mask": mask}
        named: dict[str, Any] = {key: name for key, name in _KEYS.items() if objects_by_key[key] is not None}
        if isinstance(mesh, Mapping):
            named["mesh"] = mesh
        elif isinstance(mesh, (str, os.PathLike)):
            named["mesh"] = Path(mesh).name
        shape = {"kind": kind or "plane_stress"} if kind or not materials else {}
        tables = {"experiment": shape | settings | named, "material": materials, "camera": camera,
                  "sets": sets, "boundary": boundaries, "channel": channels, "dof": dofs, "stage": stages,
                  "heterogeneity": heterogeneities, "options": options, "solver": solver, "setup": setup,
                  "probe": probes, "extensometer": extensometers, "line": lines, "circle": circles}
        tables = {name: _plain(table) for name, table in tables.items() if table}
        tables = with_law_files(tables, Path(folder), ORIGIN)
        objects = Objects(frames_of(images, settings.get("quantity") == "height"),
                          None if mesh is None or isinstance(mesh, Mapping) else mesh_of(mesh),
                          None if loads is None else log_of(loads, units, settings.get("decimal")),
                          None if mask is None else _mask(mask))
        self._source: _Objects | _File = _Objects(tables, objects, Path(folder))
        self.record = self._source.record()

    @classmethod
    def read(cls, path: str | os.PathLike) -> Experiment:
        """The experiment of a folder with an experiment.toml, or of such a file.

        Raises
        ------
        InputError
            At the first error in it.
        """
        return cls._from(_File(locate(os.fspath(path))))

    @classmethod
    def _from(cls, source: _Objects | _File) -> Experiment:
        experiment = cls.__new__(cls)
        experiment._source, experiment.record = source, source.record()
        return experiment

    def changed(self, values: Mapping[str, Any]) -> Experiment:
        """The experiment with other values, as ``--set key=value`` makes them.

        values : ``SPECIMEN.E`` for a start value, dotted keys of the tables for anything else (``options.substeps``)

        Raises
        ------
        InputError
            A key that does not exist, or a value that does not fit.
        """
        return self._from(self._source.changed(_plain(values)))

    @property
    def tables(self) -> dict:
        """The tables of experiment.toml that it stands for."""
        return self._source.tables

    @property
    def parameters(self) -> ParameterSet:
        """All parameters with their start values."""
        return self.record.model.parameters

    @property
    def title(self) -> str:
        return self.record.title

    def free_motion(self, regularisation: str = "mechanical", length_px: float | None = None) -> FreeMotion:
        """Measure the motion of all images on the mesh, from the images alone (docs/method.md, equation 13.1).

        Parameters
        ----------
        regularisation : "mechanical" | "gradient" | "none"
        length_px : waves of this length are damped by half; default: `idic.measure.Regularisation`

        Raises
        ------
        InputError
            No such regularisation, or images whose motion in space is no motion in one image.
        """
        return measured_motion(self.record, Regularisation(regularisation, length_px))

    def save(self, folder: str | os.PathLike) -> Path:
        """Write the experiment as a folder that `idic identify` reads: experiment.toml, images, mesh, log, mask.

        Returns
        -------
        Path
            The folder, new or empty before.

        Raises
        ------
        InputError
            The folder holds files already.
        """
        return self._source.save(Path(folder), self.record)

    def as_files(self, folder: Path) -> tuple[Path, dict]:
        """The experiment as a path and ``--set`` values; one of Python objects is saved in `folder` of a RUN.

        Image files are linked there, not copied: the RUN has its own copy of every image.

        Raises
        ------
        InputError
            The RUN began with another experiment, or the experiment has no material to identify.
        """
        if not self.record.model.materials:
            raise InputError("nothing to identify", file=ORIGIN, key="materials", found="no material",
                             expected="a law with a parameter that is free", remedy="add materials, or use free_motion")
        if isinstance(self._source, _File):
            return self._source.file, dict(self._source.overrides)
        return saved_in_run(lambda place: self._source.save(place, self.record, link=True), folder), {}

    def __repr__(self) -> str:
        record = self.record
        identified = ", ".join(record.model.parameters.free) or "nothing"
        return (f"Experiment({record.title!r}, {record.recording.in_words()}, {record.model.mesh.n_elements} elements, "
                f"identifies {identified})")

    def _repr_html_(self) -> str:
        from idic.notebook.html import experiment_html

        return experiment_html(self.record)


@dataclass(frozen=True, eq=False)
class _Objects:
    """Tables and objects in place of files."""

    tables: dict
    objects: Objects
    folder: Path

    def record(self) -> Record:
        return from_objects(self.tables, self.objects, self.folder)

    def changed(self, values: Mapping[str, Any]) -> _Objects:
        return replace(self, tables=with_overrides(self.tables, values))

    def save(self, folder: Path, record: Record, link: bool = False) -> Path:
        objects = self.objects
        further_paths = [path.relative_to(self.folder.resolve())
                  for path in further_files(self.tables, objects, self.folder.resolve())]
        folder = empty_folder(folder)
        for path in dict.fromkeys(further_paths):
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.folder / path, folder / path)
        pattern, labels = _save_images(folder, objects.images, link)
        _save_mesh(folder, self.tables["experiment"].get("mesh"), objects.mesh, record)
        if objects.loads is not None:
            _save_log(folder / LOADS, objects.loads)
        if objects.mask is not None:
            write_images(folder, [(objects.mask > 0).astype(np.uint8)], ".")
            os.replace(folder / "frame_000.tif", folder / MASK)
        tables = self.tables | {"experiment": {**self.tables["experiment"], "images": pattern,
                                               **_named_frames(self.tables, record, labels)}}
        (folder / EXPERIMENT_FILE).write_text(to_toml(tables), encoding="utf-8")
        return folder


@dataclass(frozen=True)
class _File:
    """An experiment.toml."""

    file: Path
    overrides: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tables(self) -> dict:
        return with_overrides(read_toml(self.file), self.overrides)

    def record(self) -> Record:
        return load_experiment(self.file, self.overrides)

    def changed(self, values: Mapping[str, Any]) -> _File:
        return replace(self, overrides={**self.overrides, **values})

    def save(self, folder: Path, record: Record, link: bool = False) -> Path:
        raise InputError("the experiment is a folder already", file=self.file,
                         expected="an experiment of Python objects",
                         found="one that was read from a file", remedy="copy its folder")


def _save_images(folder: Path, images: ArrayFrames | FileStack, link: bool) -> tuple[str, list[str]]:
    """Write the images, or copy (link) their files; returns the pattern that finds them in their order, and their
    labels."""
    entries = images.entries if isinstance(images, FileStack) else ()
    if len({(entry.path, entry.page) for entry in entries}) != images.n_frames:  # arrays, or a file that is named twice
        return _KEYS["images"], write_images(folder, (images.frame(k) for k in range(images.n_frames)))
    names = {}
    for k, path in enumerate(dict.fromkeys(entry.path for entry in entries)):
        names[path] = f"frame_{k:03d}{path.suffix.lower()}"
        target = folder / IMAGES / names[path]
        if not link or not _linked(path, target):
            shutil.copyfile(path, target)
    return f"{IMAGES}/*", [names[entry.path] + entry.label[len(entry.path.name):] for entry in entries]


def _linked(path: Path, target: Path) -> bool:
    """Make `target` a link to a file; False where the system has no links for this user."""
    try:
        target.symlink_to(path.resolve())
    except (OSError, NotImplementedError):
        return False
    return True


def _save_mesh(folder: Path, name: Any, mesh: RawMesh | None, record: Record) -> None:
    if mesh is None:
        return
    if mesh.file != MESH_OBJECT:
        shutil.copyfile(mesh.file, folder / name)
        for path in mesh.files[1:]:  # those that it includes
            target = folder / path.relative_to(mesh.file.parent)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
        return
    internal_mesh, _ = mesh.to_mesh(record.model.n_dim, 1.0)
    (folder / name).write_text(inp_text(internal_mesh, record.title), encoding="utf-8")


def _save_log(file: Path, log: Log) -> None:
    if log.file != LOG_OBJECT:
        shutil.copyfile(log.file, file)
        return
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(log.names)
        if any(log.table.units):
            writer.writerow(log.table.units)
        writer.writerows(log.rows)


def _named_frames(tables: Mapping, record: Record, labels: Sequence[str]) -> dict:
    """The keys that name frames, by the labels of the images as they are written."""
    frames_by_key = {"reference": list(record.recording.averaged) or [record.model.reference],
                     "exclude_frames": list(record.recording.excluded),
             "still_frames": list(record.recording.still_frames)}
    named = tables["experiment"]
    return {key: [labels[k] for k in numbers] for key, numbers in frames_by_key.items() if key in named
            and not (key == "still_frames" and isinstance(named[key], str))}


def _mask(mask: Any) -> np.ndarray:
    """Above zero where a pixel may be correlated  # (ny, nx)"""
    if isinstance(mask, (str, os.PathLike)):
        return read_image(Path(mask))
    painted = np.asarray(mask)
    if painted.ndim != 2:
        raise InputError("not a mask", file=ORIGIN, key="mask", expected="an array (ny, nx), above zero inside",
                         found=f"shape {painted.shape}", remedy="make it from the reference image")
    return painted


def _plain(value: Any) -> Any:
    """Mappings, sequences and numbers of NumPy as those that a TOML file gives."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value
