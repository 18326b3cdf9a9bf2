"""A mesh cut where a crack is suspected, so that every model of a diagnosis has the same elements and pixels.

The identified model with a crack of no length is the null; the candidate frees its length. The path comes from the
residual (`idic.diagnose.locate.crack_path`), to first order and half an element. Refits with a crack of free length
then move its beginning and its direction to where free motions have least left to explain.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from idic.diagnose.candidates.crack import SUSPECT
from idic.diagnose.identified import Identified, as_identified
from idic.diagnose.locate.crack_path import Cells, CrackPath, Line, crack_path
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.heldout import misfit_of, positions
from idic.diagnose.residual.margin import Margin
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.diagnose.selection.stages import CRACK_PATH
from idic.diagnose.selection.state import Clock, Stage
from idic.errors import InputError, NotConverged
from idic.fe import Mesh, interpolation
from idic.identification import Identification, identify
from idic.model import Experiment, MotionError

MIN_Z = 8.0  # standard deviations of the score of a path
MIN_SHARE = 0.5  # of what free motions explain: a crack that explains less is not suspected
MIN_SHARE_OF_SOFT = 1.05  # of what the best disc of another stiffness explains (cracks: 1.11 and more)
MAX_KNOTS = 4
MIN_LOAD = 0.35  # of the largest motion: from this frame on the length is free
LONGER, FURTHER = 1.6, 3.0  # times the first length, and sizes of an element: how far the path goes on
ROOM = 1.2  # sizes of an element between the end of the path and the next edge
FIRST_STEP, LAST_STEP = 0.5, 0.1  # sizes of an element: of the beginning and the tip, across the path


def suspected(identified: Identified) -> CrackPath | None:
    """The path of a crack that would explain a good part of the residual, None where there is none, or where the model
    can have no crack."""
    model = identified.identification.experiment.model
    if (model.n_dim != 2 or model.cracks or model.morphs or model.solver is not None or not identified.is_mismatched
            or identified.residual.evidence.n_components != 2 or not identified.misfit.room):
        return None
    try:
        path = crack_path(identified.identification, identified.residual)
    except NotConverged:
        return None
    is_likely = path is not None and path.z > max(MIN_Z, np.sqrt(MIN_SHARE * identified.misfit.room),
                                                  np.sqrt(MIN_SHARE_OF_SOFT) * path.z_soft)
    return path if is_likely else None


def as_cut(identified: Identified, margin: Margin, quick: bool, stage: Stage, clock: Clock) -> Identified:
    """The identified model on a mesh that is cut where a crack is suspected; as it is where none is."""
    with clock.step("locate_s"):
        path = suspected(identified)
    if path is None:
        return identified
    stage(CRACK_PATH)
    with clock.step("refits_s"):
        cut = with_cut(identified, path)
    return identified if cut is None else as_identified(*cut, margin, quick, stage, clock)


def with_cut(identified: Identified, path: CrackPath) -> tuple[ExperimentSource, Identification] | None:
    """The source and the identification with the mesh cut along a path, a crack of no length; None where the mesh
    cannot be cut."""
    knots = _knots(identified)
    line = _moved(identified, path, knots)
    source = _uncorrected(identified).with_edits(_table(identified, line, knots, None))
    try:
        source = source.with_motion_error(_carried(identified, source.load().model.mesh))
    except InputError:
        return None
    identification = identify(_from(source.load(), identified.identification))
    return None if identification.point is None else (source, identification)


def _uncorrected(identified: Identified) -> ExperimentSource:
    """The source without the known error, which is of another mesh."""
    return identified.source.with_motion_error(None)


def _carried(identified: Identified, mesh: Mesh) -> MotionError | None:
    """The known error on the mesh that is cut: of a body without a crack, as none can be computed there."""
    error, plain = identified.source.motion_error, identified.identification.experiment.model.mesh
    if error is None:
        return None
    weights, inside = interpolation(plain.nodes, plain.blocks, mesh.nodes)
    u = np.stack([weights @ frame for frame in error.u])
    nearest = np.argmin(np.linalg.norm(plain.nodes - mesh.nodes[~inside, None], axis=2), axis=1)
    u[:, ~inside] = error.u[:, nearest]  # nodes on an arc, beyond the chord of their element
    return MotionError(u, error.channels)


def _knots(identified: Identified) -> list[int]:
    """Frames at which the length of the crack is free: those with a load, evenly spread."""
    residual = identified.residual
    size = np.sqrt((residual.solved_u.reshape(len(residual.u), -1) ** 2).mean(axis=1))
    loaded = residual.evidence.frames[size >= MIN_LOAD * size.max()]
    places = np.unique(np.rint(np.linspace(0, len(loaded) - 1, min(MAX_KNOTS, len(loaded)))).astype(int))
    return [int(frame) for frame in loaded[places]]


def _table(identified: Identified, line: Line, knots: list[int], length: float | None) -> dict[str, Any]:
    """Edits: the crack along a line, of a free length (mm, where it starts), or of none."""
    cells = Cells.of(identified.identification.experiment.model.mesh)
    room = cells.room_ahead(line) - ROOM * cells.size
    end = min(room, LONGER * line.length + FURTHER * cells.size)
    way = np.subtract(line.end, line.start) / line.length
    begin = np.array(line.start) if line.inner else np.array(line.start) - cells.size * way
    value = {"value": 0.0, "identify": False} if length is None else {"value": min(length, 0.9 * end), "identify": True}
    return {"crack": [{"name": SUSPECT, "path_mm": [[float(x) for x in point] for point in
                                                  (begin, line.start + end * way)],
                       "length_mm": value, "knots": knots}]}


def _moved(identified: Identified, path: CrackPath, knots: list[int]) -> Line:
    """The line that leaves free motions least to explain, of those with other beginnings and tips across it."""
    starts, size = (path.line, *path.alternatives), path.size
    line = min(starts, key=lambda start: _left(identified, start, knots)) if len(starts) > 1 else path.line
    costs: dict[tuple[float, float], float] = {}

    def cost(at: np.ndarray) -> float:
        key = (round(float(at[0]), 3), round(float(at[1]), 3))
        if key not in costs:
            costs[key] = _left(identified, _across(line, *(size * at)), knots)
        return costs[key]

    best, step = np.zeros(2), FIRST_STEP
    while step >= LAST_STEP:
        for axis in np.eye(2):
            values = [cost(best + way * step * axis) for way in (-1.0, 0.0, 1.0)]
            best = best + step * _lowest(values) * axis
        step *= 0.5
    lowest = min(costs, key=lambda key: costs[key])
    return _across(line, size * lowest[0], size * lowest[1])


def _lowest(values: list[float]) -> float:
    """Where a parabola through the values at -1, 0 and 1 is lowest, at most 1.5 away; at the lowest of them where it
    is none."""
    low, middle, high = values
    curvature = low + high - 2.0 * middle
    if np.isfinite(values).all() and curvature > 0.0:
        return float(np.clip(0.5 * (low - high) / curvature, -1.5, 1.5))
    return float(np.argmin(values) - 1)


def _across(line: Line, at_start: float, at_end: float) -> Line:
    """A line whose ends have moved across it (mm)."""
    way = np.subtract(line.end, line.start) / line.length
    across = np.array([-way[1], way[0]])
    start, end = line.start + at_start * across, line.end + at_end * across
    return Line((float(start[0]), float(start[1])), (float(end[0]), float(end[1])), line.inner)


def _left(identified: Identified, line: Line, knots: list[int]) -> float:
    """Chi-square that free motions and channels explain beside a crack of free length along a line."""
    try:
        source = _uncorrected(identified).with_edits(_table(identified, line, knots, line.length))
        refit = identify(_from(source.load(), identified.identification))
        if refit.point is None:
            return float("inf")
        residual = residual_evidence(refit, light=False, null=False)
    except (InputError, NotConverged, np.linalg.LinAlgError):
        return float("inf")
    return misfit_of(residual, replace(identified.grid, at=positions(residual))).chi2


def _from(experiment: Experiment, identification: Identification) -> Experiment:
    """An experiment that starts at the values of an identification."""
    parameters = experiment.model.parameters
    values = parameters.own_of(identification.parameters.as_values())
    return replace(experiment, model=replace(experiment.model, parameters=parameters.with_values(values)), stages=())
