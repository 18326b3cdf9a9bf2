"""Holes: radius or place differ from the mesh."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.fe import find_holes

PROBE_RADIUS_SHARE = 0.02  # of the radius; places move as far
WHAT = {"hole_radius": "another radius", "hole_x": "another place along x", "hole_y": "another place along y"}
PLACE = ("hole_x", "hole_y")  # freed together: a misplaced hole is rarely misplaced along an axis


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    if experiment.model.n_dim != 2 or experiment.model.morphs or experiment.model.cracks:
        return ()
    holes = find_holes(experiment.model.mesh)
    proposals = []
    for number, hole in enumerate(holes, start=1):
        index = f"[{number}]" if len(holes) > 1 else ""
        step = PROBE_RADIUS_SHARE * float(hole.radius)
        at = {"hole_radius": float(hole.radius), "hole_x": float(hole.centre[0]), "hole_y": float(hole.centre[1])}
        place = further_dofs(situation, *(f"geometry.{key}{index}" for key in PLACE))
        for key, quantity in WHAT.items():
            name = f"geometry.{key}{index}"
            if (edits := further_dofs(situation, name)) is not None:
                proposals.append(Variant(f"{quantity} of hole {number}" if index else f"{quantity} of the hole", edits,
                                         (name,), {name: at[key]}, {name: at[key] + step},
                                         refit=(place or {}) if key in PLACE else {}))
    return tuple(proposals)


register(Candidate(
    "hole_geometry", "heterogeneity", "hole of another size or place", "the holes of the mesh",
    rivals={"heterogeneity": "more or less material next to the hole",
            "pixel_size": "a hole of another size in the image: with everything else, or alone",
            "origin": "a misplaced hole: with the whole mesh, or alone"},
    separating_tests=("measure the hole in the reference image", "measure the hole with a gauge"),
    variants=variants,
    paraphrase="radius or place of a hole differ from the mesh"))
