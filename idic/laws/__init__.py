"""Constitutive laws: each is one function for one material point, in one file. Importing registers all of them."""

import lazy_loader

# the laws are registered in this order, which `idic laws` keeps
from idic.laws import elastic, orthotropic, neo_hookean, mooney_rivlin  # noqa: F401
from idic.laws.composed import elastoplastic, short_forms, free_rubber  # noqa: F401
from idic.laws.rate import maxwell, free_relaxation, creep  # noqa: F401
from idic.laws import elastic_damage, nonlinear_elastic, laminate  # noqa: F401
from idic.laws.rate import glassy_polymer  # noqa: F401
from idic.laws.core.user_laws import load_user_laws

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

load_user_laws()
