"""Cases over all registered laws: a law is covered by the contract from the moment it is registered."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.laws import all_laws, compile, composed_name, kinds_of


def needs_axes(kind):
    """Whether a term of elasticity is refused without material axes."""
    try:
        composed_name(["mises", kind])
    except InputError:
        return True
    return False


def drawn_terms(rng):
    """A random composed law: any elasticity and surface, up to two hardening terms and two back stresses, rate,
    damage."""
    surface = str(rng.choice(kinds_of("yield_surface")))
    elastic = [str(rng.choice(kinds_of("elasticity")))]
    nonlinear = [str(k) for k in rng.permutation(kinds_of("nonlinear_elasticity"))[:rng.integers(0, 3)]]
    nonlinear = [k for k in nonlinear if "orthotropic" in elastic or not needs_axes(k)]
    hardening = [str(k) for k in rng.permutation(kinds_of("hardening"))[:rng.integers(0, 3)]]
    hardening = ["free3"] if "free" in hardening else hardening  # the whole hardening
    back = [str(k) for k in rng.permutation(kinds_of("backstress"))[:rng.integers(0, 3)]]
    rate = [str(k) for k in rng.permutation(kinds_of("rate"))[:rng.integers(0, 2)]]
    damage = ["lemaitre"][:rng.integers(0, 2)]
    if surface == "free_surface":
        elastic, nonlinear = [], []
    return composed_name([surface, *hardening,
                          *([] if surface == "drucker_prager" else elastic + nonlinear + back + damage),
                          *rate])


ALL_TERMS = composed_name(["hill48", "voce", "linear", "armstrong_frederick", "armstrong_frederick", "norton",
                           "lemaitre"])
ORTHOTROPIC = composed_name(["orthotropic", "fibre", "hahn_tsai", "hill48", "voce", "armstrong_frederick", "lemaitre"])
FREE_SURFACE = composed_name(["free_surface5", "voce", "prager"])
NONLINEAR = composed_name(["stiffening", "ramberg_osgood", "in_plane_shear", "power", "norton"])
DRAWN = sorted({drawn_terms(np.random.default_rng(seed)) for seed in range(12)} - {ALL_TERMS})
LAW_CASES = [(name, kinematics) for name, spec in all_laws().items() for kinematics in spec.kinematics]
COMPOSED = [pytest.param((name, "finite"), marks=pytest.mark.slow)  # 5 to 20 s to compile
            for name in (ALL_TERMS, ORTHOTROPIC, NONLINEAR, FREE_SURFACE, *DRAWN)]
MODES = {"3d": 0, "plane_strain": 1, "plane_stress": 2}


@pytest.fixture(params=[*LAW_CASES, *COMPOSED], ids=lambda case: "-".join(case))
def law(request):
    return compile(*request.param)


@pytest.fixture(params=list(MODES.values()), ids=list(MODES))
def mode(request):
    return request.param


@pytest.fixture
def params(law):
    return law.spec.defaults()


@pytest.fixture
def rng():
    return np.random.default_rng(20)
