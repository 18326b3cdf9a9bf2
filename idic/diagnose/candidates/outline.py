"""Outline: a mesh around measured points ends elsewhere than the specimen.

Points end half a facet before an edge, and a grid of them shows an edge within a distance only. Each free edge is a
variant; the refit of any frees them all, and together they promise what they explain together.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import open_share
from idic.fe import EDGE_STD_SHARE, OUTLINE, edges_by_name, free_edges

PROBE_SHARE = 0.1  # of the distance of the points


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    if experiment.recording.points is None or experiment.model.cracks or open_share(experiment.model) is None:
        return ()
    pitch = experiment.recording.points.pitch_mm
    supports = {entry.nodes: experiment.model.mesh.node_sets[entry.nodes] for entry in experiment.model.prescribed}
    edges = edges_by_name(experiment.model.mesh, free_edges(experiment.model.mesh, supports))
    prior = {"prior": {"mean": 0.0, "std": EDGE_STD_SHARE * pitch}}
    dofs = list(situation.document.get("dof", ()))
    every = {"dof": [*dofs, *({"name": f"{OUTLINE}.{edge}"} | prior for edge in edges)]}
    return tuple(Variant(f"{edge} lies further out or in", {"dof": [*dofs, {"name": name}]}, (name,), {name: 0.0},
                         {name: PROBE_SHARE * pitch}, exact=True, refit=every)
                 for edge in edges for name in [f"{OUTLINE}.{edge}"])


register(Candidate(
    "outline", "boundary", "another outline of the specimen", "the outline of the points",
    rivals={"thickness": "a section that is too small: thinner, or narrower",
            "thermal_expansion": "a free edge that lies elsewhere bulges as if it were warm",
            "heterogeneity": "missing material at a notch is as softness there"},
    separating_tests=("draw the outline of the specimen (outline_mm in mesh)",),
    variants=variants,
    paraphrase="free edges that lie further out than the outline of the points"))
