"""How edges move in a planned test whose motion is an unknown: measured from the images, or a virtual boundary.

A course ``"TOP.uy" = [[0, 0], [60, 0.4]]`` under [design.program] (mm, or px where lengths are in px) moves the whole
edge; without it the motion of images that are there is measured by a free FE-DIC.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.drives import build_drives
from idic.edge.prepare import measured_start
from idic.edge.schema import ExperimentFile
from idic.errors import InputError
from idic.experiment import Experiment, Measured, Parametrised

Courses = Mapping[str, Sequence[Sequence[float]]]


def edge_keys(config: ExperimentFile) -> set[str]:
    """``SET.ux`` of every component of an edge whose motion is an unknown."""
    keys = set()
    for table in config.boundary:
        drives = {"x": table.ux, "y": table.uy, "z": table.uz}
        if table.u is not None:
            drives = dict.fromkeys("xyz", table.u)
        keys |= {f"{table.nodes}.u{c}" for c, drive in drives.items()
                 if drive is not None and (drive.measured or drive.virtual)}
    return keys


def edge_motion(experiment: Experiment, courses: Courses, recorded: bool,
                file) -> tuple[Experiment, np.ndarray, tuple[str, ...]]:
    """The experiment with its virtual boundaries moving, the motion of measured edges (n_frames, m) mm, and notes.

    Raises
    ------
    InputError
        If nothing says how a measured edge will move.
    """
    drives = build_drives(experiment)
    local = np.zeros((experiment.n_frames, drives.n_local))
    unknown = [p for p in experiment.prescribed if isinstance(p.drive, (Measured, Parametrised))]
    given = [p for p in unknown if _key(p) in courses]
    if not given:
        measured = [p for p in unknown if isinstance(p.drive, Measured)]
        if not measured:
            return experiment, local, ()
        if recorded:
            from idic.dic import dic_stack

            found = measured_start(experiment, dic_stack(experiment).u_px, experiment.excluded)
            return experiment, found, ("measured edges move as a free FE-DIC of the images says",)
        key = _key(measured[0])
        raise InputError("nothing says how a measured edge will move", file=file, key=f'design.program."{key}"',
                         expected="its course in time, in mm (px without a scale)", found="none",
                         remedy=f'add for instance  "{key}" = [[0, 0], [{experiment.times[-1]:g}, 0.4]]')
    values = {}
    for prescribed in given:
        times, course = np.array(courses[_key(prescribed)]).T
        history = np.interp(experiment.times, times, course)
        history = history - history[experiment.reference]
        stem = f"boundary.{prescribed.nodes}.{prescribed.component}"
        if isinstance(prescribed.drive, Measured):
            own = [i for i, drive in enumerate(drives.local) if drives.names[drive].startswith(f"{stem}.node")]
            local[:, own] = history[:, None]
        else:
            values |= _modes(experiment, prescribed.drive, stem, history)
    return _with_values(experiment, values), local, ()


def _key(prescribed) -> str:
    return f"{prescribed.nodes}.u{prescribed.component}"


def _modes(experiment: Experiment, drive: Parametrised, stem: str, history: np.ndarray) -> dict[str, float]:
    """Least-squares coefficients of a boundary that moves as one: all B-splines alike, or the constant polynomial."""
    start = experiment.times[experiment.reference]
    t = np.clip((experiment.times - start) / ((experiment.times[-1] - start) or 1.0), 0.0, None)
    powers = np.stack([t ** (j + 1) for j in range(drive.time_modes)], axis=1)
    found = np.linalg.lstsq(powers, history, rcond=None)[0]
    moved = range(drive.modes) if drive.kind == "bspline" else range(1)
    return {f"{stem}.s{i}t{j}": float(value) for i in moved for j, value in enumerate(found)}


def _with_values(experiment: Experiment, values: Mapping[str, float]) -> Experiment:
    return replace(experiment, parameters=experiment.parameters.with_values(values)) if values else experiment
