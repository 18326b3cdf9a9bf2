"""Grip rotation or misalignment: a motion linear along the set, or a motion across the load."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import driven, with_correction
from idic.model import Column, Experiment

PROBE_PX = 0.2
ONSETS = (0.0, 0.2, 0.4, 0.6, 0.8)  # of the test, of a rotation with a course of its own


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    column = _main_column(experiment)
    if column is None:
        return ()
    found = []
    for number, nodes, component, drive in driven(situation):
        present = [entry["kind"] for entry in drive.get("corrections", ())]
        own = {} if "column" in drive else {"column": column.column}
        size = float(np.abs(column.values).max()) if "column" in drive else 1.0
        half = 0.5 * float(np.ptp(experiment.mesh.nodes[experiment.mesh.node_sets[nodes]], axis=0).max())
        length = PROBE_PX * experiment.camera.pixel_size
        if "rotation" not in present and _extended(experiment, nodes, component):
            found.append(_variant(situation, number, nodes, component, {"kind": "rotation"} | own,
                                  length / (half * size)))
            found += [_variant(situation, number, nodes, component, {"kind": "rotation"} | course, length / half)
                      for course in _courses(situation)]
        if "misalignment" not in present and "column" in drive and experiment.n_dim == 2 \
                and _held_across(situation, nodes, component):
            found.append(_variant(situation, number, nodes, component, {"kind": "misalignment"}, length / size))
            found += [_variant(situation, number, nodes, component, {"kind": "misalignment"} | course, length)
                      for course in _courses(situation)]
    return tuple(found)


def _variant(situation: Situation, number: int, nodes: str, component: str, correction: dict,
             probe: float) -> Variant:
    name = f"boundary.{nodes}.{component}.{correction['kind']}"
    what = "turns" if correction["kind"] == "rotation" else "moves askew"
    if "start_s" in correction:
        what += f"{' at once' if correction['course'] == 'jump' else ''} from {correction['start_s']:.4g} s on"
    return Variant(f"{nodes} {what} (u{component})", with_correction(situation, number, component, correction), (name,),
                   {name: 0.0}, {name: probe}, exact=True)


def _courses(situation: Situation) -> list[dict]:
    """Courses that begin at some moment: evenly in time from then on, or at once."""
    if not situation.experiment.extras.get("has_times", True):
        return []
    first = float(situation.experiment.times[situation.experiment.reference])
    return [{"start_s": float(np.round(first + onset * situation.duration, 9)), "course": course}
            for onset in ONSETS for course in (("ramp", "jump") if onset else ("ramp",))]


def _main_column(experiment: Experiment) -> Column | None:
    """The logged motion that moves most."""
    drives = [entry.drive for entry in experiment.prescribed if isinstance(entry.drive, Column)]
    return max(drives, key=lambda drive: np.abs(drive.values).max(), default=None)


def _extended(experiment: Experiment, nodes: str, component: str) -> bool:
    along = 1 if component == "x" else 0
    places = experiment.mesh.nodes[experiment.mesh.node_sets[nodes]][:, along]
    return float(np.ptp(places)) > 0.0


def _held_across(situation: Situation, nodes: str, component: str) -> bool:
    return any(other == nodes and across != component for _, other, across, _ in driven(situation))


register(Candidate(
    "grip_rotation", "boundary", "grip rotation or misalignment", "no rotation, no motion across",
    rivals={"orthotropy": "a material with oblique axes shears under tension, too",
            "heterogeneity": "a specimen softer on one side bends",
            "camera_motion": "a camera that turns: then the whole image does"},
    separating_tests=("turn the specimen around and repeat", "film the grips: pixels on both sides of the edge"),
    variants=variants,
    paraphrase="a grip that rotates, or pulls at an angle"))
