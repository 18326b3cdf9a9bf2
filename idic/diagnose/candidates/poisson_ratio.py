"""Another Poisson's ratio: a contraction across the load, or a bulk modulus, that the file locks at a wrong value."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import freed

PROBE_POISSON_STEPS = {"nu": 0.02, "nu12": 0.02}  # added
PROBE_BULK_MODULUS_FACTOR = 1.1  # of a bulk modulus


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for material in situation.experiment.model.materials:
        for parameter in ("nu", "nu12", "kappa"):
            full = f"{material.element_set}.{parameter}"
            edits = freed(situation, material.element_set, parameter)
            if edits is None:
                continue
            value = situation.values[full]
            step = PROBE_POISSON_STEPS.get(parameter)
            if step is None:
                probe = PROBE_BULK_MODULUS_FACTOR * value
            else:
                probe = value + (step if value + step < 0.49 else -step)
            proposals.append(Variant(f"another {parameter} of {material.element_set}", edits, (full,), {full: value},
                                     {full: probe}, exact=True))
    return tuple(proposals)


register(Candidate(
    "poisson_ratio", "elastic_form", "another Poisson's ratio", "the value in the file",
    rivals={"magnification": "motion out of plane stretches the image in both directions",
            "thermal_expansion": "the same strain in both directions",
            "orthotropy": "another contraction across the load"},
    separating_tests=("a second camera from the side", "measure the thickness under load"),
    variants=variants,
    paraphrase="the contraction across the load, or the bulk modulus, differs from the file"))
