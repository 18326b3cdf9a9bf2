"""Elasticity terms of the composed law: closed forms, and what they become without their extra parameters."""

import numpy as np
import pulls
import pytest
from numba import njit

from idic.laws import compile, point
from idic.laws.composed.elasticity import FIBRE, HAHN_TSAI, ORTHOTROPIC, RAMBERG_OSGOOD, elastic_stress

E1, E2, NU12, G12 = 140e3, 10e3, 0.3, 5e3
PLY = {"elasticity_E1": E1, "elasticity_E2": E2, "elasticity_nu12": NU12, "elasticity_G12": G12,
       "elasticity_angle": 0.0}


@njit
def compiled(symmetry, terms, strain, params, t, D):
    elastic_stress(symmetry, terms, strain, params, t, D)


def stress(symmetry, terms, strain, params):
    """(t, D) of a strain (6,), tensor components 11, 22, 33, 12, 13, 23."""
    t, D = np.empty(6), np.empty((6, 6))
    compiled(symmetry, (*terms, 0, 0), np.asarray(strain, dtype=float), np.asarray(params, dtype=float), t, D)
    return t, D


def test_softening_shear_of_a_ply_and_its_stiff_fibre_follow_their_equations():
    params = [E1, E2, NU12, G12, 0.0, 20.0, 100.0, 2.5, 3e-8]  # gamma, K, n, alpha
    terms = (FIBRE, 5, RAMBERG_OSGOOD, 6, HAHN_TSAI, 8)
    strain = np.array([0.008, -0.001, 0.0005, -0.02, 0.001, 0.0])
    t, D = stress(ORTHOTROPIC, terms, strain, params)
    x = t[3] / G12
    assert 2.0 * strain[3] == pytest.approx(-(abs(x) + 100.0 * abs(x) ** 2.5) + 3e-8 * t[3] ** 3, rel=1e-12)
    linear = stress(ORTHOTROPIC, terms, strain, [*params[:5], 0.0, 0.0, 2.5, 0.0])[0]
    assert t[0] - linear[0] == pytest.approx(20.0 * E1 * 0.008**2, rel=1e-12)
    np.testing.assert_allclose(t[[1, 2, 4]], linear[[1, 2, 4]])
    quotient = [(stress(ORTHOTROPIC, terms, strain + h, params)[0] - stress(ORTHOTROPIC, terms, strain - h, params)[0])
                / 2e-7
                for h in 1e-7 * np.eye(6)]
    np.testing.assert_allclose(D, np.transpose(quotient), atol=1e-7 * E1)  # rounding 1e-16 / 1e-7, truncation less


@pytest.mark.slow  # a law to compile
def test_an_isotropic_body_stiffens_and_softens_by_its_terms_in_tension():
    law = compile("elastoplastic(stiffening)")
    curve = point.uniaxial(law, [70e3, 0.3, 1e9, 8.0], np.linspace(0.0, 0.02, 5))
    e = 0.25 * (curve.F[:, 0, 0] ** 2 - curve.F[:, 0, 0] ** -2)  # elastic strain of the law, ln(stretch) to third order
    kirchhoff = curve.P[:, 0, 0] * curve.F[:, 0, 0]
    conjugate = 0.5 * (curve.F[:, 0, 0] ** 2 + curve.F[:, 0, 0] ** -2)  # d e / d ln(stretch)
    np.testing.assert_allclose(kirchhoff[1:], (70e3 * e * (1.0 + 8.0 * e) * conjugate)[1:], rtol=1e-9)


@pytest.mark.slow  # two laws to compile
def test_orthotropic_elasticity_of_an_isotropic_body_flows_as_the_isotropic_law():
    new, old = compile("elastoplastic(orthotropic+hill48+voce)"), compile("elastoplastic(hill48+voce)")
    E, nu = 70e3, 0.3
    plastic = {"yield_stress": 200.0, "r0": 1.6, "r45": 1.2, "r90": 2.0}
    hardening = [90.0, 20.0]
    strain = np.linspace(0.0, 0.05, 26)
    ours = point.uniaxial(new, [E, E, nu, E / (2.0 * (1.0 + nu)), 30.0, *plastic.values(), *hardening], strain)
    theirs = point.uniaxial(old, [E, nu, *plastic.values(), 30.0, *hardening], strain)
    scale = np.abs(theirs.P).max()
    # neo-Hookean against logarithmic elasticity: they differ by the elastic strain, 4e-3
    np.testing.assert_allclose(ours.P[:, 0, 0], theirs.P[:, 0, 0], atol=6e-3 * scale)
    np.testing.assert_allclose(ours.F[:, 1, 1], theirs.F[:, 1, 1], atol=2e-4)


@pytest.mark.slow  # a law to compile
def test_in_plane_shear_yields_at_the_shear_stress_alone():
    law = compile("elastoplastic(orthotropic+in_plane_shear+linear)")
    values = [*PLY.values(), 40.0, 300.0]
    pulled = point.uniaxial(law, values, np.linspace(0.0, 0.01, 6))
    assert pulled.state[:, 6].max() == 0.0  # along the fibres nothing yields
    sheared = pulls.simple_shear(law, values, np.linspace(0.0, 0.02, 11), mode=2)
    p = sheared.state[-1, 6]
    assert p == pytest.approx((0.02 - 40.0 / G12) / (1.0 + 300.0 / G12), rel=5e-3)  # rotation: (shear)^2
    # the fibres turn by half the shear and are pressed by its square / 8: E1 shear^3 / 8 = 0.14 MPa
    assert sheared.P[-1, 0, 1] == pytest.approx(40.0 + 300.0 * p, abs=0.3)

