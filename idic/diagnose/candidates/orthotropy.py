"""Orthotropic elasticity: a stiffness that depends on direction, about an unknown axis.

To first order the axial difference is two regular components, cos 2a and sin 2a of the axis a, and the shear modulus
two more, cos 4a and sin 4a. Axes every 22.5 (45) degrees with either sign come within 8 % of any of them; the refit is
the orthotropic law with its axis free from there.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import elastic_pair, enriched, materials_with, new

PROBE_ANISOTROPY = 0.05  # relative
AXIAL_ANGLES_DEG = (0.0, 22.5, 45.0, 67.5)  # degrees; 90 degrees further is the other sign
SHEAR_ANGLES_DEG = (0.0, 22.5)
MAX_PROBE_POISSON_RATIO = 0.49  # beyond a half the energy is not positive, and a body at its bound has one


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "elastic"):
        E, nu = elastic_pair(situation, name)
        G = 0.5 * E / (1.0 + nu)
        for angle in AXIAL_ANGLES_DEG:
            probe = {"E1": E * (1.0 + PROBE_ANISOTROPY), "E2": E * (1.0 - PROBE_ANISOTROPY),
                     "nu12": min(nu * (1.0 + PROBE_ANISOTROPY), MAX_PROBE_POISSON_RATIO), "G12": G}
            proposals.append(_variant(situation, name, f"{name} is stiffer along {angle:g} degrees, or across", angle,
                                      probe))
        for angle in SHEAR_ANGLES_DEG:
            probe = {"E1": E, "E2": E, "nu12": nu, "G12": G * (1.0 + PROBE_ANISOTROPY)}
            proposals.append(_variant(situation, name, f"{name} has another shear modulus on axes at {angle:g} degrees",
                                      angle, probe))
    return tuple(proposals)


def _variant(situation: Situation, name: str, label: str, angle: float, probe: dict[str, float]) -> Variant:
    E, nu = elastic_pair(situation, name)
    parameters = situation.experiment.model.parameters
    null = {"E1": E, "E2": E, "nu12": nu, "G12": 0.5 * E / (1.0 + nu)}
    edits = enriched(situation, name, "orthotropic", E1=new(probe["E1"], "MPa", parameters[f"{name}.E"].free),
                     E2=new(probe["E2"], "MPa"), nu12=new(probe["nu12"], "-", parameters[f"{name}.nu"].free),
                     G12=new(probe["G12"], "MPa"), angle=new(angle, "deg"))
    edits[f"material.{name}"]["kinematics"] = situation.experiment.model.material_of(name).kinematics

    def full(values: dict[str, float]) -> dict[str, float]:
        return {f"{name}.{key}": value for key, value in values.items()}

    return Variant(label, edits, tuple(f"{name}.{key}" for key in ("E1", "E2", "G12", "angle")),
                   full(null | {"angle": angle}), full(probe | {"angle": angle}), exact=True)


register(Candidate(
    "orthotropy", "elastic_form", "orthotropic elasticity", "equal stiffness in all directions",
    rivals={"grip_rotation": "grips that pull at an angle shear the specimen too",
            "poisson_ratio": "another contraction across the load",
            "heterogeneity": "more stiffness on one side"},
    separating_tests=("turn a second specimen by 45 degrees", "mount the specimen again"),
    variants=variants,
    paraphrase="orthotropy: a stiffness that depends on direction"))
