"""The free yield surface: convex, Mises's where all weights are alike, near Hill's where fitted; where it flows."""

import numpy as np
import pytest
from scipy.optimize import nnls

from idic.errors import InputError
from idic.laws import point
from idic.laws import (
    POWER, RINGS, RING_KNOTS, classical_fits, classical_surfaces, compile, composed_name, equivalent, powers,
)
from idic.laws.plasticity.free_locus import neighbours
from idic.report.evidence.yield_surface import std_of, surface_fits
from idic.laws.free_forms.surface_forms import hill48, hosford

HILL = (1.6, 1.2, 2.0)


def stresses(number=2000, seed=0):
    return np.random.default_rng(seed).standard_normal((number, 3))


@pytest.mark.parametrize("n", range(RING_KNOTS[0], RING_KNOTS[1] + 1))
def test_weights_that_are_alike_are_mises_and_have_no_differences(n):
    stress = stresses()
    np.testing.assert_allclose(equivalent(np.full(RINGS * n, 0.7), stress)[0], hosford(stress, 2.0), rtol=1e-12)
    assert np.abs(neighbours(n) @ np.ones(RINGS * n)).max() < 1e-14


def test_the_surface_is_convex_for_any_weights_that_are_not_negative():
    rng = np.random.default_rng(1)
    for _ in range(20):
        weights = rng.exponential(size=18) * (rng.random(18) < 0.5) + 1e-3
        a, b = stresses(seed=2), stresses(seed=3)
        ends = equivalent(weights, a)[0] + equivalent(weights, b)[0]
        assert (equivalent(weights, a + b)[0] <= ends * (1.0 + 1e-12)).all()


def fitted(q, stress, n=6):
    return nnls(powers(n, stress) / q[:, None] ** POWER, np.ones(len(q)))[0]


def test_hills_surface_is_among_them_within_a_fifth_of_a_percent():
    stress = stresses()
    q = hill48(stress, *HILL)
    weights = fitted(q, stress)
    along = hill48(np.array([[1.0, 0.0, 0.0]]), *HILL)
    found = equivalent(weights, stress)[0] * along  # q is that of a strip along axis 1, and so is Hill's
    assert 0.0 < np.abs(found / q - 1.0).max() < 0.004  # 0.2 % of the sum, and as much of the strip


def test_derivatives_by_the_weights_are_differences():
    weights, stress = np.random.default_rng(4).uniform(0.5, 2.0, 18), stresses(5)
    found = equivalent(weights, stress)[1]
    for k in range(18):
        step = 1e-6 * np.eye(18)[k]
        quotient = (equivalent(weights + step, stress)[0] - equivalent(weights - step, stress)[0]) / 2e-6
        np.testing.assert_allclose(found[:, k], quotient, atol=1e-8 * np.abs(found).max())


def test_the_right_classical_surface_lies_inside_a_narrow_band_and_the_others_do_not():
    stress = stresses(30, seed=5)
    radius = 180.0 / hill48(stress, *HILL)
    noise = 0.005 * radius
    measured = radius + noise * np.random.default_rng(6).standard_normal(30)
    fits = classical_fits(np.arange(30.0), measured, np.diag(noise**2), np.arange(30), classical_surfaces(stress))
    assert [fit.form for fit in fits if fit.inside] == ["hill48"]
    found = fits[0].parameters
    np.testing.assert_allclose([found[name] for name in ("yield_stress", "r0", "r45", "r90")], [180.0, *HILL], rtol=0.1)


def test_directions_that_the_weights_tie_together_do_not_decide_between_the_classical_surfaces():
    """40 directions of 18 weights: combinations without variance are not held against a surface that they cannot be."""
    stress = stresses(40, seed=7)
    weights = fitted(hill48(stresses(), *HILL) / hill48(np.array([[1.0, 0.0, 0.0]]), *HILL), stresses())
    fits = surface_fits(stress, *radius_of(weights, 200.0, stress))
    assert fits[0].form == "hill48" and fits[0].inside and fits[0].chi2 < 10.0
    assert not any(fit.inside for fit in fits if fit.form in ("mises", "tresca"))


def test_a_band_holds_surfaces_of_hill_that_the_weights_cannot_be():
    """The weights have no error of their own here; the band is that of the family alone."""
    stress, along = stresses(), np.array([[1.0, 0.0, 0.0]])
    held = []
    for seed in range(20):
        r = np.random.default_rng(seed).uniform(0.6, 2.2, 3)
        q = hill48(stress, *r)
        found = equivalent(fitted(q / hill48(along, *r), stress), stress)[0] * hill48(along, *r)
        held.append(np.abs(q / found - 1.0) < 1.959964 * std_of(1.0 / found, np.zeros((len(q), len(q)))) * found)
    assert np.mean(held) > 0.93


def radius_of(weights, start, stress):
    """Radius and covariance of weights that are known to a fifth"""
    q, dq = equivalent(weights, stress)
    J = np.column_stack([1.0 / q, -start / (q * q)[:, None] * dq])
    return start / q, J @ np.diag([1.0, *(0.2 * np.maximum(weights, 0.05)) ** 2]) @ J.T


def test_what_does_not_go_with_a_free_surface_is_refused():
    for kinds in (["orthotropic", "free_surface"], ["free_surface", "stiffening"]):
        with pytest.raises(InputError) as error:
            composed_name(kinds)
        assert error.value.found == "free_surface6" and error.value.remedy
    with pytest.raises(InputError):
        composed_name(["free_surface4"])


@pytest.mark.slow  # 45 s to compile
def test_a_strip_at_an_angle_flows_at_the_radius_of_the_surface():
    law = compile("elastoplastic(free_surface5+voce+prager)")
    names, values = law.spec.parameter_names, law.spec.defaults()
    weights = np.array([value for name, value in zip(names, values, strict=True) if "_u" in name])
    values[[i for i, name in enumerate(names) if name.startswith(("hardening", "backstress"))]] = 1e-6
    for angle in (0.0, 30.0, 90.0):
        values[names.index("yield_surface_angle")] = angle
        curve = point.uniaxial(law, values, np.linspace(0.0, 0.01, 21), mode=2)
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        q = equivalent(weights, np.array([[c * c, s * s, -c * s]]))[0][0]
        kirchhoff = curve.P[-1, 0, 0] * curve.F[-1, 0, 0]
        assert abs(kirchhoff * q / values[names.index("yield_stress")] - 1.0) < 1e-3  # the strip shears a little
