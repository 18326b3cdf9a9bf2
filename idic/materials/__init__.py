"""Constitutive laws: each is one function for one material point, in one file. Importing registers all of them."""

# the laws are registered in this order, which `idic laws` keeps
from idic.materials import elastic, orthotropic, neo_hookean, mooney_rivlin  # noqa: F401
from idic.materials.composed import elastoplastic  # noqa: F401
from idic.materials.plasticity import short_forms  # noqa: F401
from idic.materials.composed import free_rubber  # noqa: F401
from idic.materials.rate import maxwell, free_relaxation, creep  # noqa: F401
from idic.materials import elastic_damage, nonlinear_elastic  # noqa: F401
from idic.materials.rate import glassy_polymer  # noqa: F401
from idic.materials.core import point, points, symmetric, tensors
from idic.materials.core.compilation import MODES, CompiledLaw, compile
from idic.materials.core.law import DerivedQuantity, LawParameter, LawSpec, all_laws, get_law, law_for, register
from idic.materials.core.user_laws import load_user_laws

__all__ = ["MODES", "CompiledLaw", "DerivedQuantity", "LawParameter", "LawSpec", "all_laws", "compile", "get_law",
           "law_for", "point", "points", "register", "symmetric", "tensors"]

load_user_laws()
