"""Misalignment: the grip pulls at an angle, so that the set moves across in proportion to the motion."""

from __future__ import annotations

import numpy as np

from idic.fe import Mesh
from idic.model.records.experiment import Experiment
from idic.model.records.parts import Column, Constant, Correction, Prescribed
from idic.model.terms.corrections.correction_term import (
    CorrectedMotion, CorrectionTerm, Key, Probe, follows_motion, in_proportion, main_motion, probe_length,
)
from idic.model.terms.corrections.rotation import GRIP_ROTATION, timed_probes


def course(motion: CorrectedMotion) -> np.ndarray:
    return in_proportion(motion, "misalignment")


def unit(motion: CorrectedMotion) -> str:
    """None in proportion to the motion, else a displacement."""
    return "" if follows_motion(motion) else motion.length_unit


def pattern(correction: Correction, mesh: Mesh, nodes: np.ndarray, component: str) -> tuple[str, np.ndarray]:
    """All nodes alike, across the motion."""
    return correction.keys.get("towards") or ("y" if component == "x" else "x"), np.ones(len(nodes))


def probes(experiment: Experiment, motion: Prescribed) -> list[Probe]:
    column = main_motion(experiment.model)
    is_held_across = any(entry.nodes == motion.nodes and entry.component != motion.component
                         and isinstance(entry.drive, (Column, Constant)) for entry in experiment.model.prescribed)
    if column is None or not isinstance(motion.drive, Column) or experiment.model.n_dim != 2 or not is_held_across:
        return []
    length = probe_length(experiment.model)
    return [Probe(f"{motion.nodes} moves askew (u{motion.component})", {},
                  length / float(np.abs(column.values).max())),
            *timed_probes(experiment.model, motion, "moves askew", length)]


MISALIGNMENT = CorrectionTerm("misalignment", course, unit, GRIP_ROTATION, probes, pattern, is_timed=True,
                              is_logged=True, keys=(Key("towards", words=("x", "y", "z")),))
