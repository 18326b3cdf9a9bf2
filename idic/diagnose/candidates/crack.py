"""Crack: a cut that opens under load, found from the stiffness that the residual asks for.

A cut asks for less stiffness along a line. Every line from the edge of a sheet into it is looked at: the sum of the
scores of the elements on it, over the root of their number. The best one, and the same turned a little to either side,
become variants; every line that was looked at counts as a test. The refit has the length free.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from idic.diagnose.locate.place import element_centres, in_words
from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.fe import boundary_faces

NAME = "found"
DIRECTIONS = 12  # of the lines from each place on the edge
LENGTHS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5)  # of the size of the body
TURN_DEG = 10.0  # to either side of the best line
ON_LINE_SHARE = 0.75  # of the size of an element: how far from a line the centres of its elements are
MIN_ELEMENTS = 3  # on a line
PATH_SHARE = 1.8  # of the length that the scores show: where the path ends


def variants(situation: Situation) -> tuple[Variant, ...]:
    model = situation.experiment.model
    geometry = any(entry["name"].startswith("geometry.") for entry in situation.document.get("dof", ()))
    if (model.n_dim != 2 or model.surface or model.symmetry or model.solver or geometry or model.length_unit != "mm"
            or situation.document.get("crack")):
        return ()
    score = situation.stiffness_score()
    line = None if score is None else best_line(situation, score)
    if line is None:
        return ()
    start, angle, length, searched = line
    return tuple(_variant(situation, start, angle + np.radians(turn), length, searched)
                 for turn in (0.0, -TURN_DEG, TURN_DEG))


def best_line(situation: Situation, score: np.ndarray) -> tuple[np.ndarray, float, float, int] | None:
    """Start on the edge (2,) mm, angle (rad), length (mm) of the line that asks most for less stiffness, and how many
    lines were looked at; None where none asks for less."""
    mesh = situation.experiment.model.mesh
    centres = element_centres(mesh)
    size = float(np.sqrt(np.prod(np.ptp(mesh.nodes, axis=0)) / mesh.n_elements))
    best, searched = (0.0, None), 0
    for face in boundary_faces(mesh):
        a, b = mesh.nodes[mesh.face_nodes(face)[:2]]
        start, inwards = 0.5 * (a + b), np.arctan2(b[0] - a[0], a[1] - b[1])
        for angle in inwards + np.pi * ((np.arange(DIRECTIONS) + 0.5) / DIRECTIONS - 0.5):
            along = np.array([np.cos(angle), np.sin(angle)])
            part, aside = (centres - start) @ along, np.abs((centres - start) @ [-along[1], along[0]])
            in_strip = (aside < ON_LINE_SHARE * size) & (part > 0.0)
            for length in np.multiply(LENGTHS, mesh.size):
                on_line = in_strip & (part < length)
                searched += 1
                if on_line.sum() >= MIN_ELEMENTS:
                    weight = -float(score[on_line].sum()) / np.sqrt(on_line.sum())
                    best = max(best, (weight, (start, float(angle), float(length))), key=lambda entry: entry[0])
    return None if best[1] is None else (*best[1], searched)


def _variant(situation: Situation, start: np.ndarray, angle: float, length: float, searched: int) -> Variant:
    along, model = np.array([np.cos(angle), np.sin(angle)]), situation.experiment.model
    path = np.array([start, start + PATH_SHARE * length * along])
    dof = f"crack.{NAME}.length"
    table: dict[str, Any] = {"name": NAME, "path_mm": np.round(path, 6).tolist(),
                             "length_mm": {"value": float(length), "identify": True}}
    return Variant(f"a crack from {in_words(start, size=model.mesh.size)} at {np.degrees(angle) % 360.0:.0f} degrees",
                   {"crack": [table]}, (dof,), {dof: 0.0}, {dof: float(length)}, sign=1, form="crack",
                   place=tuple((start + 0.5 * length * along).tolist()), exact=True, searched=searched)


register(Candidate(
    "crack", "heterogeneity", "crack", "a body that hangs together",
    rivals={"heterogeneity": "a void or a soft place gives way like an opening cut; its faces do not part along a line",
            "damage": "both give way where stress is high; damage has no faces",
            "paint_loss": "the pattern along an opening cut is lost"},
    separating_tests=("look at the place with a magnifying glass, or with dye", "unload: a crack closes"),
    variants=variants, paraphrase="a cut that starts at an edge and opens under load",
    refitted_form=lambda variant, values: variant.form))
