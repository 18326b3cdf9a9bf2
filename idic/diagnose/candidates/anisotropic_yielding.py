"""Anisotropic yielding: Hill's r-values in a law of von Mises, in the axes of the mesh.

r is the width over the thickness strain of a strip cut along (r0), at 45 degrees to (r45) or across (r90) the rolling
direction, and 1 in an isotropic sheet. A composed law gets the term, others the law `j2_hill`.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import enriched, new
from idic.laws import ELASTOPLASTIC, composed_name, kinds_of

PROBE_R = 1.4
TERM = "hill48"
RATIOS = ("r0", "r45", "r90")
PROBES = {"along the mesh's x axis": ("r0",), "at 45 degrees to it": ("r45",), "across it": ("r90",),
          "in every direction alike": RATIOS}


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for material in situation.experiment.model.materials:
        name = material.element_set
        if (hill := _hill(material.law)) is None:
            continue
        law, stem = hill
        edits = enriched(situation, name, law, **{f"{stem}{r}": new(1.0) for r in RATIOS})
        names = tuple(f"{name}.{stem}{r}" for r in RATIOS)
        null = dict.fromkeys(names, 1.0)
        for direction, chosen in PROBES.items():
            probe = null | {f"{name}.{stem}{r}": PROBE_R for r in chosen}
            proposals.append(Variant(f"{name} thins less {direction}", edits, names, null, probe, exact=True))
    return tuple(proposals)


def _hill(law: str) -> tuple[str, str] | None:
    """The law with Hill's r-values and the beginning of their names; None where it has a yield surface of its own."""
    if law in ("j2_linear", "j2_voce"):
        return "j2_hill", ""
    if law != ELASTOPLASTIC and not law.startswith(f"{ELASTOPLASTIC}("):
        return None
    kinds = [kind for kind in law[len(ELASTOPLASTIC) + 1:-1].split("+") if kind]
    if set(kinds) & set(kinds_of("yield_surface")) - {"mises"} or any("*" in kind for kind in kinds):
        return None
    return composed_name((TERM, *(kind for kind in kinds if kind != "mises"))), "yield_surface_"


register(Candidate(
    "anisotropic_yielding", "plasticity", "anisotropic yielding", "von Mises' yield surface (all r-values 1)",
    rivals={"poisson_ratio": "both change the contraction across the load",
            "kinematic_hardening": "a back stress makes directions differ, too",
            "pressure_dependence": "a yield stress that depends on the state of stress",
            "hardening_curvature": "regions of another state of stress yield later or earlier"},
    separating_tests=("a second specimen, cut across the first", "a specimen with holes or notches",
                      "measure the thickness after the test"),
    variants=variants, has_onset=True,
    paraphrase="Hill 1948: yield stress and thinning of the sheet depend on direction", hidden_by_yield_law=True))
