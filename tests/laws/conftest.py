"""Cases over all registered laws: a law is covered by the contract from the moment it is registered."""

import numpy as np
import pytest

from idic.materials import all_laws, compile

LAW_CASES = [(name, kinematics) for name, spec in all_laws().items() for kinematics in spec.kinematics]
MODES = {"3d": 0, "plane_strain": 1, "plane_stress": 2}


@pytest.fixture(params=LAW_CASES, ids=lambda case: "-".join(case))
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
