"""Parameters that are left out of a material take the value without effect, an infinite one included."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.experiment_file.schema.materials import MaterialTable
from idic.experiment_file.tables.dofs import material
from idic.identification.result import _with_slopes
from idic.laws import get_law
from idic.parameters import Parameter, ParameterSet


def read(**keys):
    return material("strip", MaterialTable.model_validate(keys), "experiment.toml")


def test_a_metal_without_yield_stress_is_elastic():
    _, parameters, notes = read(law="j2_linear", E=15700.0, nu=0.35)
    values = {p.name: p.value for p in parameters}
    assert (values["strip.yield_stress"], values["strip.hardening_modulus"]) == (np.inf, 0.0)
    assert not any(p.free for p in parameters)
    assert any("yield_stress not given: inf" in note for note in notes)


def test_a_parameter_without_such_a_value_is_asked_for():
    with pytest.raises(InputError, match="missing") as error:
        read(law="j2_power", E=15700.0, nu=0.35)
    assert error.value.key == "material.strip.n"


def test_the_factor_of_the_power_law_follows_from_its_reference_strain():
    """K = K0 ep0^-n: dK/dn = -ln(ep0) K, dK/dK0 = K / K0."""
    values = {"K0": 2.0, "n": 0.83, "ep0": 2e-3}
    parameters = ParameterSet([Parameter(f"strip.{name}", value) for name, value in values.items()])
    K, slopes = _with_slopes(get_law("j2_power_reference").derived["K"].value,
                             {name: f"strip.{name}" for name in values}, parameters)
    assert K == pytest.approx(2.0 * 2e-3**-0.83, rel=1e-14)
    assert slopes["strip.n"] == pytest.approx(-np.log(2e-3) * K, rel=1e-12)
    assert slopes["strip.K0"] == pytest.approx(K / 2.0, rel=1e-12)
