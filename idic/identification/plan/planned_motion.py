"""How edges move in a planned test whose motion is an unknown: measured from the images, or a virtual boundary.

A course ``"TOP.uy" = [[0, 0], [60, 0.4]]`` under [design.program] (mm, or px where lengths are in px) moves the whole
edge; without it the motion of images that are there is measured by a free FE-DIC.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.errors import InputError
from idic.experiment_file import ExperimentFile
from idic.identification.free_motion.free_motion_start import measured_start, motion_in_space
from idic.measure import BoundaryStart, Regularisation, dic_stack, with_boundary_start
from idic.model import COMPONENTS, DriveTable, Experiment, Measured, Model, Parametrised, Prescribed

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
        If the motion of a measured edge is not known before the test, or the modes of a boundary are to be those of
        images to come.
    """
    is_volume = experiment.recording.quantity == "volume"
    unknown = [p for p in experiment.model.prescribed if isinstance(p.drive, (Measured, Parametrised))]
    driven_edges = [p for p in unknown if _key(p) in courses]
    if driven_edges:
        motion, notes = _prescribed_motion(experiment.model, driven_edges, courses), ()
        motion = motion if is_volume else _in_images(experiment.model, motion)
    elif unknown and recorded:
        motion = motion_in_space(experiment) if is_volume else dic_stack(experiment, Regularisation.smooth()).u_px
        notes = ("ends of unknown motion move as a free FE-DVC of the scans measures" if is_volume else
                 "edges of unknown motion move as a free FE-DIC of the images measures",)
    else:
        motion, notes = None, ()
    _check_known(experiment.model, unknown, driven_edges, motion is not None, recorded, file)
    if motion is None:
        return experiment, np.zeros((experiment.model.n_frames, DriveTable.of(experiment).n_local)), ()
    excluded = experiment.recording.excluded
    in_space = motion if is_volume else None
    experiment = with_boundary_start(experiment, BoundaryStart.of(experiment, motion, excluded, in_space))
    return experiment, measured_start(experiment, motion, excluded, in_space), notes


def _prescribed_motion(model: Model, driven_edges: Sequence[Prescribed], courses: Courses) -> np.ndarray:
    """Motion of the edges that move along their courses  # (n_frames, n_nodes, dim) mm"""
    u = np.zeros((model.n_frames, *model.mesh.nodes.shape))
    for entry in driven_edges:
        times, course = np.array(courses[_key(entry)]).T
        history = np.interp(model.times, times, course)
        history = history - history[model.reference]
        u[:, model.node_set(entry.nodes), COMPONENTS.index(entry.component)] = history[:, None]
    return u


def _in_images(model: Model, u: np.ndarray) -> np.ndarray:
    """What a camera would measure of a motion (n_frames, n_nodes, dim) mm  # (n_frames, n_nodes, 2) px"""
    reference_px = model.camera.project(model.mesh.nodes)
    return np.array([model.camera.project(model.mesh.nodes + frame) - reference_px for frame in u])


def _check_known(model: Model, unknown, driven_edges, moves: bool, recorded: bool, file) -> None:
    for entry in unknown:
        key, drive = _key(entry), entry.drive
        of_images = isinstance(drive, Parametrised) and drive.kind == "dic"
        if of_images and not recorded:
            raise InputError("a virtual boundary with measured shapes, but there are no images yet", file=file,
                             key=f"boundary {key}", expected='virtual = "bspline" or "polynomial"', found='"dic"',
                             remedy="plan with B-splines of as many modes")
        if isinstance(drive, Measured) and entry not in driven_edges and (driven_edges or not moves):
            raise InputError("the motion of a measured edge is not known before the test", file=file,
                             key=f'design.program."{key}"',
                             expected="its course in time, in mm (px without a scale)", found="none",
                             remedy=f'add for instance  "{key}" = [[0, 0], [{model.times[-1]:g}, 0.4]]')


def _key(prescribed: Prescribed) -> str:
    return f"{prescribed.nodes}.u{prescribed.component}"
