"""Grip rotation: the set turns about its middle in proportion to the motion, with a column of the log, or from some
time on."""

from __future__ import annotations

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh
from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.parts import Column, Correction, Prescribed
from idic.model.terms.corrections.correction_term import (
    Cause, CorrectedMotion, CorrectionTerm, Probe, follows_motion, in_proportion, main_motion, probe_length,
    probe_starts,
)

COMPONENTS = "xyz"
LEVERS = {"x": ("y", -1.0), "y": ("x", 1.0), "z": ("x", 1.0)}  # small rotation: u_x = -w y, u_y = w x
GRIP_ROTATION = Cause(
    "grip_rotation", "grip rotation or misalignment", "a grip or pin that turns, or pulls at an angle",
    "no rotation, no motion across",
    rivals={"orthotropy": "a material with oblique axes shears under tension, too",
            "heterogeneity": "a specimen softer on one side bends",
            "camera_motion": "a camera that turns: then the whole image does"},
    separating_tests=("turn the specimen around and repeat",
                      "unload: a pin in a hole sticks by friction before it turns back; grease it and repeat",
                      "film the grips: pixels on both sides of the edge"))


def course(motion: CorrectedMotion) -> np.ndarray:
    return in_proportion(motion, "rotation")


def unit(motion: CorrectedMotion) -> str:
    """rad at the end of its course, or at the largest value of its column."""
    return f"rad/{motion.length_unit}" if follows_motion(motion) else "rad"


def pattern(correction: Correction, mesh: Mesh, nodes: np.ndarray, component: str) -> tuple[str, np.ndarray]:
    """The lever (mm): the distance from the middle between the outermost nodes of the set."""
    along, sign = LEVERS[component]
    place = mesh.nodes[nodes, COMPONENTS.index(along)]
    return component, sign * (place - 0.5 * (place.min() + place.max()))


def reach(mesh: Mesh, nodes: np.ndarray, component: str) -> float:
    """Half the length of the set.

    Raises
    ------
    InputError
        If the set is a point as far as a rotation goes.
    """
    along = LEVERS[component][0]
    half = 0.5 * float(np.ptp(mesh.nodes[nodes, COMPONENTS.index(along)]))
    if half <= 0.0:
        raise InputError("a node set that cannot rotate", key="corrections",
                         expected=f"a node set with an extent along {along}, for a rotation seen in u{component}",
                         found="all its nodes in one place",
                         remedy="leave the rotation out, or correct the other component")
    return half


def probes(experiment: Experiment, motion: Prescribed) -> list[Probe]:
    mesh = experiment.model.mesh
    column, nodes = main_motion(experiment.model), mesh.nodes[mesh.node_sets[motion.nodes]]
    if column is None or not float(np.ptp(nodes[:, 1 if motion.component == "x" else 0])) > 0.0:
        return []
    is_logged = isinstance(motion.drive, Column)
    size = float(np.abs(column.values).max()) if is_logged else 1.0
    half, length = 0.5 * float(np.ptp(nodes, axis=0).max()), probe_length(experiment.model)
    return [Probe(f"{motion.nodes} turns (u{motion.component})", {} if is_logged else {"column": column.column},
                  length / (half * size)),
            *timed_probes(experiment.model, motion, "turns", length / half)]


def timed_probes(model: Model, motion: Prescribed, verb: str, value: float) -> list[Probe]:
    """Probes that begin at some moment; [] where the test has no times."""
    if not model.has_times:
        return []
    return [Probe(f"{motion.nodes} {verb}{' at once' if keys['course'] == 'jump' else ''} from {keys['start_s']:.4g} s "
                  f"on (u{motion.component})", keys, value) for keys in probe_starts(model)]


ROTATION = CorrectionTerm("rotation", course, unit, GRIP_ROTATION, probes, pattern, reach, is_timed=True,
                          is_logged=True, free_unit=lambda length_unit: "rad")
