"""Mooney-Rivlin elasticity: a term in the second invariant on top of a neo-Hookean law."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import enriched, materials_with, new

PROBE_C01_SHARE = 0.1  # of C10


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "neo_hookean"):
        C01, size = f"{name}.C01", PROBE_C01_SHARE * situation.values[f"{name}.C10"]
        edits = enriched(situation, name, "mooney_rivlin", C01=new(size, "MPa"))
        proposals.append(Variant(f"{name} depends on the second invariant", edits, (C01,), {C01: 0.0}, {C01: size},
                                 sign=1, exact=True))
    return tuple(proposals)


register(Candidate(
    "second_invariant", "elastic_form", "Mooney-Rivlin elasticity", "C01 = 0",
    rivals={"viscoelasticity": "a stress that falls behind with time",
            "poisson_ratio": "a bulk modulus that is off"},
    separating_tests=("a biaxial test", "strain further"),
    variants=variants,
    paraphrase="a term in the second invariant of strain"))
