"""Other defensible treatments of boundary and camera of the same test.

Each treatment is the experiment file with some of its tables replaced, as with ``--set``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from idic.images import PLACEMENT_STEM, PlacedCamera
from idic.model import Column, Experiment, Measured, Parametrised

AS_GIVEN = "as given"
COMPONENTS = {"ux": "x", "uy": "y", "uz": "z"}
MORE_SMOOTHING, MORE_MODES, MORE_TIMES = 10.0, 2, 1
# before a lens
SPECIMEN_MOTION = tuple(f"{PLACEMENT_STEM}.{name}_drift" for name in ("t_z", "rotation_x", "rotation_y"))
OF_FREE_DIC = {"virtual": "dic", "modes": 4, "time_modes": 3}  # courses of the measured motion, which may stop and turn


@dataclass(frozen=True)
class Treatment:
    """A treatment of boundary and camera in words, and the tables of the experiment file that state it."""

    boundary: str
    camera: str
    overrides: Mapping[str, Any]


def treatments(experiment: Experiment, raw: Mapping) -> list[Treatment]:
    """Every combination of boundary and camera treatments but the one of the run itself.

    raw : tables of the experiment file, ``--set`` applied
    """
    combinations = []
    for boundary, tables in _boundaries(experiment, raw):
        for camera, added in _cameras(experiment, raw):
            if (boundary, camera) == (AS_GIVEN, AS_GIVEN):
                continue
            overrides: dict[str, Any] = {}
            if tables is not None:
                overrides["boundary"] = tables
            if added:
                unknowns = [{"name": name, "value": 0.0} for name in added]
                overrides["dof"] = [*deepcopy(list(raw.get("dof", []))), *unknowns]
            combinations.append(Treatment(boundary, camera, overrides))
    return combinations


def _boundaries(experiment: Experiment, raw: Mapping) -> Iterator[tuple[str, list | None]]:
    """In words, and the [[boundary]] tables (None: those of the file)."""
    model = experiment.model
    yield AS_GIVEN, None
    drives = {type(entry.drive) for entry in model.prescribed}
    if Column in drives and model.solver is None:
        components = {(entry.get("nodes"), key) for entry in raw.get("boundary", []) for key in COMPONENTS
                      if key in entry or "u" in entry}
        yield "the grip may turn and run askew", _each(raw, lambda entry: _freed(entry, components))
    if Measured in drives:
        yield "measured edges, ten times as smooth", _each(raw, lambda entry: _changed(entry, "measured", {
            "measured": True, "smoothing": MORE_SMOOTHING}))
        yield "virtual boundaries", _each(raw, lambda entry: _changed(entry, "measured", dict(OF_FREE_DIC)))
    if Parametrised in drives:
        yield "virtual boundaries with more modes", _each(raw, _with_more_modes)
    stereo = model.n_dim == 3 and isinstance(model.camera, PlacedCamera)  # no edge of it is measured
    if experiment.recording.quantity == "grey" and model.solver is None and Measured not in drives and not stereo:
        yield "measured edges", _each(raw, _measured)


def _cameras(experiment: Experiment, raw: Mapping) -> Iterator[tuple[str, tuple[str, ...]]]:
    """In words, and the degrees of freedom that are added."""
    model = experiment.model
    yield AS_GIVEN, ()
    if experiment.recording.quantity != "grey" or model.solver is not None:
        return
    stem, names = experiment.recording.camera_name, set(model.parameters)
    if isinstance(model.camera, PlacedCamera):
        if model.has_times and not names & set(SPECIMEN_MOTION):
            yield "the specimen may approach and tilt", SPECIMEN_MOTION
        return
    drift, load, lens = ((f"{stem}.{name}",) for name in ("magnification_drift", "magnification_load", "k1"))
    followed = _magnification_column(raw, stem)
    if followed and not names & set(load):
        yield f"the magnification may follow {followed}", load
    if model.has_times and not names & set(drift):
        yield "the magnification may drift", drift
    if not model.has_times and not names & set(lens):
        yield "the lens may distort", lens
    tilts = tuple(f"{stem}.{name}" for name in ("tilt_x", "tilt_y"))
    if not names & set(tilts):
        yield "the camera may be tilted", tilts


def _magnification_column(raw: Mapping, stem: str) -> str | None:
    """The column of the log that the magnification of the main camera may follow, where one is given."""
    tables = raw.get("camera", {})
    main = tables if isinstance(tables, Mapping) else next((table for table in tables if table.get("name") == stem), {})
    return main.get("magnification_column")


def _each(raw: Mapping, change) -> list[dict]:
    return [change(deepcopy(dict(entry))) for entry in raw.get("boundary", [])]


def _as_table(drive: object) -> dict:
    if isinstance(drive, Mapping):
        return dict(drive)
    return {drive: True} if drive == "measured" else {"value": drive}


def _freed(entry: dict, components: set) -> dict:
    """Rotation added to every logged component, and misalignment towards one that is held, too: a free one follows.

    components : pairs of a node set and a component, "ux", that some table gives
    """
    keys = [key for key in COMPONENTS if key in entry]
    for key in keys:
        table = _as_table(entry[key])
        if "column" not in table:
            continue
        corrections = list(table.get("corrections", []))
        kinds = {correction["kind"] for correction in corrections}
        if "rotation" not in kinds:
            corrections.append({"kind": "rotation"})
        across = [COMPONENTS[component]
                  for component in ("ux", "uy") if component != key and (entry.get("nodes"), component) in components]
        if "misalignment" not in kinds and across:
            corrections.append({"kind": "misalignment", "towards": across[0]})
        entry[key] = table | {"corrections": corrections}
    return entry


def _changed(entry: dict, kind: str, table: dict) -> dict:
    for key in (*COMPONENTS, "u"):
        if key in entry and kind in _as_table(entry[key]):
            entry[key] = dict(table)
    return entry


def _with_more_modes(entry: dict) -> dict:
    for key in (*COMPONENTS, "u"):
        table = _as_table(entry[key]) if key in entry else {}
        if "virtual" in table and table["virtual"] != "dic":
            entry[key] = table | {"modes": table.get("modes", 6) + MORE_MODES,
                                  "time_modes": table.get("time_modes", 6) + MORE_TIMES}
    return entry


def _measured(entry: dict) -> dict:
    """Both components of a driven or held edge from the images."""
    if not any(key in entry for key in (*COMPONENTS, "u")):
        return entry
    other_keys = {key: value for key, value in entry.items() if key not in (*COMPONENTS, "u")}
    return other_keys | {key: "measured" for key in ("ux", "uy") if key in entry or "u" in entry}
