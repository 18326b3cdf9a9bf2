"""Each law against its textbook curve."""

import numpy as np
import pulls
import pytest
from law_paths import follow, random_path

from idic.laws import all_laws, compile, directional_stresses, get_law, point_stresses, point_tangents
from idic.laws import point

STRAIN = np.linspace(0.0, 0.04, 21)


def test_linear_elastic_tension_follows_Hooke():
    law = compile("elastic", "small")
    curve = point.uniaxial(law, [70e3, 0.3], STRAIN)
    np.testing.assert_allclose(curve.P[:, 0, 0], 70e3 * STRAIN, rtol=1e-9, atol=1e-9)  # the driver's tolerance
    np.testing.assert_allclose(curve.F[:, 1, 1] - 1, -0.3 * STRAIN, atol=1e-12)
    np.testing.assert_allclose(curve.dP[:, 0, 0, 0], STRAIN, atol=1e-12)  # d sigma / dE


def test_St_Venant_Kirchhoff_tension_is_linear_in_Green_strain():
    curve = point.uniaxial(compile("elastic", "finite"), [70e3, 0.3], 10 * STRAIN)
    stretch = curve.F[:, 0, 0]
    np.testing.assert_allclose(curve.P[:, 0, 0], 70e3 * stretch * (stretch**2 - 1) / 2, rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, -45.0])
def test_orthotropic_tension_off_axis_has_the_transformed_compliance(angle):
    E1, E2, nu, G = 140e3, 10e3, 0.3, 5e3
    curve = point.uniaxial(compile("orthotropic", "small"), [E1, E2, nu, G, angle], STRAIN, mode=2)
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    Ex = 1 / (c**4 / E1 + s**4 / E2 + c**2 * s**2 * (1 / G - 2 * nu / E1))
    np.testing.assert_allclose(curve.P[:, 0, 0], Ex * STRAIN, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("E1, E2, nu", [(15e3, 15e3, 0.5), (15e3, 15e3, 0.75), (10e3, 140e3, 0.25),
                                        (140e3, 10e3, -0.9)])
def test_every_orthotropic_sheet_that_can_be_has_its_compliance_in_plane_stress_and_a_positive_energy(E1, E2, nu):
    """A laminate of +-45 degrees contracts by 0.75: no transversely isotropic body in space does."""
    law, params, strain = compile("orthotropic", "small"), np.array([E1, E2, nu, 5e3, 0.0]), np.array([1e-3, 2e-4])
    P, _, A, ok = point_tangents(law, 2, np.eye(2)[None] + np.diag(strain), np.ones((1, 1)), params, 0.0)
    compliance = np.array([[1 / E1, -nu / E1], [-nu / E1, 1 / E2]])
    assert ok and np.allclose(compliance @ np.diag(P[0]), strain, rtol=1e-9)
    space = point_tangents(law, 0, np.eye(3)[None], np.zeros((1, 0)), params, 0.0)[2][0]
    sizes = np.sort(np.linalg.eigvalsh(space))
    assert sizes[3] > 1.0  # behind three rotations
    assert sizes[-1] < 20.0 * max(E1, E2) or nu == 0.5  # incompressible with equal moduli
    change = np.array([[1.0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0], [0, 0, 1.0, 0, 0]])
    dP, dstate, _ = directional_stresses(law, 2, np.eye(2)[None] + np.diag(strain), np.ones((1, 1)), params, 0.0,
                                np.zeros((1, 3, 2, 2)), None, change)
    for k, step in enumerate((1.0, 1.0, 1e-6)):
        up, down = (point_stresses(law, 2, np.eye(2)[None] + np.diag(strain), np.ones((1, 1)),
                           params + s * step * change[k], 0.0)[:2] for s in (1.0, -1.0))
        assert np.allclose(dP[0, k], (up[0] - down[0])[0] / (2 * step), rtol=1e-5, atol=1e-7)
        assert np.isclose(dstate[0, k, 0], (up[1] - down[1])[0, 0] / (2 * step), rtol=1e-4, atol=1e-13)


def laminate(angle=0.0, **values):
    """(law at small strains, parameters) of a laminate that has nothing beyond orthotropy but these values."""
    law = compile("laminate", "small")
    given = {"E1": 60e3, "E2": 50e3, "nu12": 0.05, "G12": 4e3, "angle": angle} | values
    return law, np.array([given.get(p.name, p.null) for p in law.spec.parameters])


def test_fibres_stiffen_with_the_strain_along_either_axis():
    for angle, E, name, stiffening in ((0.0, 60e3, "stiffening_1", 6.0), (90.0, 50e3, "stiffening_2", -4.0)):
        law, params = laminate(angle, **{name: stiffening})
        curve = point.uniaxial(law, params, STRAIN, mode=2)
        np.testing.assert_allclose(curve.P[:, 0, 0], E * STRAIN * (1 + stiffening * STRAIN), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("damage", [0.0, 1.0, 0.3])
def test_shear_of_a_laminate_follows_Ramberg_and_Osgood_and_unloads_by_its_damage(damage):
    law, params = laminate(shear_softening=0.5, shear_exponent=3.0, shear_reference=50.0, shear_damage=damage)
    shear = np.concatenate([np.linspace(0.0, 0.04, 9), np.linspace(0.03, -0.02, 6)])
    stress = pulls.simple_shear(law, params, shear, mode=2).P[:, 0, 1]
    first = stress[:9]
    np.testing.assert_allclose(first / 4e3 + 0.5 * 50.0 / 4e3 * (first / 50.0)**3, shear[:9], rtol=1e-12)
    back = np.interp(np.abs(shear[9:]), shear[:9], first) * np.sign(shear[9:])  # its strains are among the first
    np.testing.assert_allclose(stress[9:], (1 - damage) * back + damage * first[-1] / 0.04 * shear[9:], rtol=1e-12)


def test_a_laminate_with_nothing_more_is_orthotropic(rng):
    path = random_path(rng, 4, 2)
    for kinematics in ("small", "finite"):
        plain, new = compile("orthotropic", kinematics), compile("laminate", kinematics)
        values = np.array([dict(zip(plain.spec.parameter_names, plain.spec.defaults(), strict=True)).get(p.name, p.null)
                           for p in new.spec.parameters])
        np.testing.assert_allclose(follow(new, 2, path, values)[0],
                                   follow(plain, 2, path, plain.spec.defaults())[0], atol=1e-7)


def test_an_orthotropic_body_that_cannot_be_has_no_stress():
    """E1 and E2 exchanged: nu12 = 0.3 would be a contraction of 4.2 along 1."""
    params = np.array([10e3, 140e3, 0.3, 5e3, 0.0])
    for kinematics in ("small", "finite"):
        law = compile("orthotropic", kinematics)
        for mode, F in ((0, np.eye(3)), (1, np.eye(2)), (2, np.eye(2))):
            assert not point_stresses(law, mode, F[None], law.initial_state(mode)[None], params, 0.0)[-1]
    assert "nu12 = 0.3" in get_law("orthotropic").why_impossible(params)


@pytest.mark.parametrize("kinematics", ["small", "finite"])
@pytest.mark.parametrize("mode", [0, 1, 2])
def test_orthotropic_with_equal_moduli_is_isotropic(kinematics, mode, rng):
    E, nu = 70e3, 0.33
    path = random_path(rng, 5, 3 if mode == 0 else 2)
    a, _ = follow(compile("orthotropic", kinematics), mode, path, np.array([E, E, nu, E / 2 / (1 + nu), 37.0]))
    b, _ = follow(compile("elastic", kinematics), mode, path, np.array([E, nu]))
    np.testing.assert_allclose(a, b, atol=1e-11 * E)  # rounding of the rotation


def test_nearly_incompressible_neo_Hookean_tension_biaxial_and_shear_follow_theory():
    C10, kappa = 0.4, 0.8e5  # kappa / mu = 1e5: compressibility changes the stress by mu / kappa times the stretch^2
    law = compile("neo_hookean")
    stretch = 1 + np.linspace(0, 2.0, 21)
    tension = point.uniaxial(law, [C10, kappa], stretch - 1)
    np.testing.assert_allclose(tension.P[:, 0, 0], 2 * C10 * (stretch - stretch**-2), atol=1e-4)
    biaxial = pulls.equibiaxial(law, [C10, kappa], stretch - 1)
    np.testing.assert_allclose(biaxial.P[:, 0, 0], 2 * C10 * (stretch - stretch**-5), atol=1e-4)
    shear = pulls.simple_shear(law, [C10, kappa], stretch - 1)
    np.testing.assert_allclose(shear.P[:, 0, 1], 2 * C10 * (stretch - 1), rtol=1e-9)  # isochoric: exact


def test_compressible_neo_Hookean_tension_satisfies_its_own_equations():
    C10, kappa = 3.3, 20.0
    curve = point.uniaxial(compile("neo_hookean"), [C10, kappa], np.linspace(0, 1.5, 16))
    a, b = curve.F[:, 0, 0], curve.F[:, 1, 1]
    J = a * b**2
    np.testing.assert_allclose(curve.cauchy[:, 0, 0], 2 * C10 * J ** (-5 / 3) * (a**2 - b**2), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(kappa * (J - 1), curve.cauchy[:, 0, 0] / 3, rtol=1e-8, atol=1e-8)


HARDENING = {
    "j2_linear": ([1000.0], lambda p: 200 + 1000 * p),
    "j2_plateau": ([1000.0, 0.015], lambda p: 200 + 1000 * np.maximum(p - 0.015, 0.0)),
    "j2_voce": ([100.0, 20.0, 200.0], lambda p: 200 + 100 * (1 - np.exp(-20 * p)) + 200 * p),
    "j2_power": ([300.0, 0.3], lambda p: 200 + 300 * p**0.3),
    "j2_power_reference": ([75.0, 0.3, 0.01], lambda p: 200 + 75 * (p / 0.01)**0.3),
    "j2_swift": ([0.02, 0.2], lambda p: 200 * (0.02 + p)**0.2),  # 200 is its K
}


@pytest.mark.parametrize("name", HARDENING)
def test_J2_tension_traces_the_hardening_curve(name):
    extra, flow = HARDENING[name]
    curve = point.uniaxial(compile(name), [70e3, 0.3, 200.0, *extra], np.linspace(0, 0.5, 101))
    kirchhoff = (curve.P @ curve.F.transpose(0, 2, 1))[:, 0, 0]
    p = curve.state[:, 6]
    plastic = p > 0
    assert plastic.sum() > 90
    np.testing.assert_allclose(kirchhoff[plastic], flow(p[plastic]), rtol=1e-8)  # the yield condition holds exactly
    assert (kirchhoff[~plastic] <= 200.0).all()
    # logarithmic strain = elastic + plastic: in this split up to about the elastic strain (0.9 %), in any step
    strain = np.log(curve.F[:, 0, 0])
    np.testing.assert_allclose(p[plastic], (strain - kirchhoff / 70e3)[plastic], rtol=1e-2, atol=2e-5)


def test_nearly_incompressible_Mooney_Rivlin_tension_biaxial_and_shear_follow_theory():
    C10, C01, kappa = 0.3, 0.1, 0.8e5  # kappa as above
    law, stretch = compile("mooney_rivlin"), 1 + np.linspace(0, 2.0, 21)
    tension = point.uniaxial(law, [C10, C01, kappa], stretch - 1)
    np.testing.assert_allclose(tension.P[:, 0, 0], 2 * (stretch - stretch**-2) * (C10 + C01 / stretch), atol=1e-4)
    biaxial = pulls.equibiaxial(law, [C10, C01, kappa], stretch - 1)
    expected = 2 * (stretch - stretch**-5) * (C10 + C01 * stretch**2)
    np.testing.assert_allclose(biaxial.P[:, 0, 0], expected, rtol=3e-4, atol=1e-4)  # Cauchy stress over kappa
    shear = pulls.simple_shear(law, [C10, C01, kappa], stretch - 1)
    np.testing.assert_allclose(shear.P[:, 0, 1], 2 * (C10 + C01) * (stretch - 1), rtol=1e-9)  # isochoric: exact


@pytest.mark.parametrize("name", HARDENING)
def test_J2_shear_yields_at_the_yield_stress_over_root_three(name):
    extra, flow = HARDENING[name]
    curve = pulls.simple_shear(compile(name), [70e3, 0.3, 200.0, *extra], np.linspace(0, 0.05, 51))
    kirchhoff = curve.P @ curve.F.transpose(0, 2, 1)
    deviator = kirchhoff - np.trace(kirchhoff, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    mises = np.sqrt(1.5 * (deviator**2).sum((1, 2)))
    p = curve.state[:, 6]
    np.testing.assert_allclose(mises[p > 0], flow(p[p > 0]), rtol=1e-10)
    np.testing.assert_allclose(mises[p > 0], np.sqrt(3) * kirchhoff[p > 0, 0, 1], rtol=2e-2)


def test_J2_unloads_elastically_and_yields_again_at_the_hardened_stress():
    law, params = compile("j2_linear"), [70e3, 0.3, 200.0, 1000.0]
    up, down = np.linspace(0, 0.03, 31), np.linspace(0.0299, 0.020, 100)
    curve = point.uniaxial(law, params, np.concatenate([up, down]))
    kirchhoff, p = curve.P[:, 0, 0] * curve.F[:, 0, 0], curve.state[:, 6]
    slope = np.diff(kirchhoff[30:40]) / np.diff(np.log(curve.F[30:40, 0, 0]))
    np.testing.assert_allclose(slope, 70e3, rtol=1e-2)  # elasticity in b differs from Hencky's by the elastic strain
    assert (p[30:60] == p[30]).all()
    assert p[-1] > p[30]  # yields in compression
    np.testing.assert_allclose(kirchhoff[-1], -(200 + 1000 * p[-1]), rtol=1e-8)


@pytest.mark.parametrize("case", [(n, k) for n, s in all_laws().items() for k in s.kinematics], ids="-".join)
def test_plane_stress_tension_is_the_tension_of_the_solid(case):
    law = compile(*case)
    params = law.spec.defaults()
    solid, sheet = (point.uniaxial(law, params, STRAIN, mode=mode) for mode in (0, 2))
    scale = np.abs(solid.P).max()
    np.testing.assert_allclose(sheet.P[:, 0, 0], solid.P[:, 0, 0], atol=1e-7 * scale)  # the driver's tolerance 1e-10
    np.testing.assert_allclose(sheet.state[:, -1], solid.F[:, 2, 2], atol=1e-9)        # times stiffness over stress
    # a sensitivity feels the last Newton error times the curvature, 1e3
    for k in range(len(params)):
        np.testing.assert_allclose(sheet.dP[:, k, 0, 0] * params[k], solid.dP[:, k, 0, 0] * params[k],
                                   atol=1e-5 * scale)


@pytest.mark.parametrize("case", [(n, k) for n, s in all_laws().items() for k in s.kinematics], ids="-".join)
def test_the_drivers_sensitivities_are_those_of_perturbed_curves(case):
    law = compile(*case)
    params = law.spec.defaults()
    curve = point.uniaxial(law, params, STRAIN, mode=2)
    h = 1e-6
    for k in range(len(params)):
        step = h * params * (np.arange(len(params)) == k)
        ahead, behind = (point.uniaxial(law, params + s * step, STRAIN, mode=2) for s in (1, -1))
        # the driver's tolerance 1e-10 over h = 1e-6 is 1e-4 of the stress at worst; in fact Newton ends far below it
        np.testing.assert_allclose(params[k] * curve.dP[:, k], (ahead.P - behind.P) / (2 * h),
                                   atol=1e-5 * np.abs(curve.P).max())


STORED = {  # P12, P11 in MPa at gamma = 0.1 in ten steps, default parameters: a change here is a change of the law
    ("creep", "finite"): (178.97227660238656, -15.119172047733905),
    ("elastic", "small"): (2692.3076923076924, 0.0),
    ("elastic", "finite"): (2739.423076923077, 471.15384615384727),
    ("elastic_damage", "small"): (860.7521819173347, 0.0),
    ("elastic_damage", "finite"): (871.0858829370583, 149.81821082455554),
    ("j2_chaboche", "finite"): (163.0492508498086, -12.705506885304978),
    ("j2_hill", "finite"): (183.85195948258718, -11.274979304689777),
    ("j2_kinematic", "finite"): (183.32003922275567, -14.306004257035491),
    ("j2_linear", "finite"): (146.9724677213777, -12.684794730988127),
    ("j2_power", "finite"): (187.49421645175175, -15.799636982474244),
    ("j2_power_reference", "finite"): (192.8697639338434, -16.20506893035307),
    ("j2_pressure", "finite"): (146.9724677213777, -12.684794730988127),
    ("j2_swift", "finite"): (166.6581439917027, -14.222793205084134),
    ("j2_voce", "finite"): (159.9749288300673, -13.704006403862165),
    ("maxwell", "finite"): (1753.887772748257, -69.55944492490192),
    ("mooney_rivlin", "finite"): (0.66, -0.024),
    ("neo_hookean", "finite"): (0.66, -0.021999999999999353),
    ("nonlinear_elastic", "small"): (1448.0604366085292, 0.0),
    ("nonlinear_elastic", "finite"): (1469.4178751004042, 252.7254330639517),
    ("orthotropic", "small"): (2843.9449064449063, 4200.268220069902),
    ("orthotropic", "finite"): (3078.280688861122, 4631.158046739493),
    ("viscoplastic", "finite"): (157.15972280071665, -13.485776200816714),
}


@pytest.mark.parametrize("case", STORED, ids="-".join)
def test_simple_shear_gives_the_stored_numbers(case):
    law = compile(*case)
    P = pulls.simple_shear(law, law.spec.defaults(), np.linspace(0, 0.1, 11)).P[-1]
    np.testing.assert_allclose([P[0, 1], P[0, 0]], STORED[case], rtol=1e-9, atol=1e-8)
