"""Constitutive laws: one point, one function, one file. Importing this package registers all laws and compiles none."""

from idic.materials import (  # noqa: F401 (registers, in the order of `idic laws`)
    elastic,
    orthotropic,
    neo_hookean,
    mooney_rivlin,
    j2_linear,
    j2_voce,
    j2_power,
    j2_power_reference,
    j2_swift,
    j2_kinematic,
    j2_hill,
    j2_pressure,
    viscoplastic,
    maxwell,
    creep,
    elastic_damage,
    glassy_polymer,
)
from idic.materials.compilation import MODES, CompiledLaw, compile
from idic.materials.law import DerivedQuantity, LawParameter, LawSpec, all_laws, get_law, law_for, register
from idic.materials.user_laws import load_user_laws

__all__ = ["MODES", "CompiledLaw", "DerivedQuantity", "LawParameter", "LawSpec", "all_laws", "compile", "get_law",
           "law_for", "register"]

load_user_laws()
