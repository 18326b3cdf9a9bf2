"""Cards of identified laws: CalculiX runs them on one element as idic's material point goes, and says what it lacks."""

import subprocess

import numpy as np
import pytest

from idic.laws import compile, get_law, material_card, point_tangents, terms_of
from idic.laws import point
from idic.laws.composed.written_terms import TERMS_OF_OTHERS, flow_stress

CUBE = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*ELEMENT, TYPE=C3D8, ELSET=CUBE
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=LEFT
1, 4, 5, 8
*NSET, NSET=RIGHT
2, 3, 6, 7
*NSET, NSET=FRONT
1, 2, 5, 6
*NSET, NSET=BELOW
1, 2, 3, 4
*NSET, NSET=ALL, GENERATE
1, 8
"""
STEP = """*SOLID SECTION, ELSET=CUBE, MATERIAL=M
*BOUNDARY
LEFT, 1, 1
FRONT, 2, 2
BELOW, 3, 3
*AMPLITUDE, NAME=PULL
{amplitude}
*TIME POINTS, NAME=FRAMES
{points}
*STEP, NLGEOM, INC=10000
{procedure}
{first}, {end}, 1e-9, {most}
*BOUNDARY, AMPLITUDE=PULL
RIGHT, 1, 1, 1
*NODE PRINT, NSET=LEFT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""


WARM = """*INITIAL CONDITIONS, TYPE=TEMPERATURE
ALL, {start}
*AMPLITUDE, NAME=WARM
{amplitude}
"""


def pulled_by_calculix(folder, card, strain, warm=None, times=None, procedure="*STATIC"):
    """Nominal stress of one element in tension along x at every strain but the first, MPa; warm : °C at every
    strain; times : s, one by one where not given."""
    times = np.arange(len(strain)) if times is None else times
    course = lambda values: "\n".join(f"{t:.9g}, {e:.9g}" for t, e in zip(times, values, strict=True))  # noqa: E731
    step = STEP.format(amplitude=course(strain), points="\n".join(f"{t:.9g}" for t in times[1:]), first=times[1],
                       end=times[-1], most=np.diff(times).max(), procedure=procedure)
    if warm is not None:
        step = step.replace("*TIME POINTS", WARM.format(start=warm[0], amplitude=course(warm)) + "*TIME POINTS")
        step = step.replace("*NODE PRINT", "*TEMPERATURE, AMPLITUDE=WARM\nALL, 1\n*NODE PRINT")
    (folder / "cube.inp").write_text(CUBE + card + step)
    done = subprocess.run(["ccx", "-i", "cube"], cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    rows = [line.split() for line in (folder / "cube.dat").read_text().splitlines()]
    numbers = [[float(x) for x in row] for row in rows if len(row) == 3 and row[0][0] in "-0123456789"]
    return -np.array(numbers)[:, 0]


def compared(folder, law, values, strain):
    """(theirs, ours, card): nominal stress in MPa."""
    card = material_card("M", law, values, "calculix", reached=0.2)
    ours = point.uniaxial(compile(law, get_law(law).kinematics[-1]), list(values.values()), strain).P[1:, 0, 0]
    return pulled_by_calculix(folder, card.text, strain), ours, card


THERE_AND_BACK = np.concatenate([np.linspace(0.0, 0.03, 16), np.linspace(0.03, -0.01, 21)[1:]])
KIRCHHOFF = 1.5e-3  # J - 1 = (1 - 2 nu) stress / E = 0.4 * 250 / 70e3: Cauchy stress in the yield condition there


@pytest.mark.parametrize("law", ["j2_voce", pytest.param("elastoplastic(free)", marks=pytest.mark.slow)])
def test_one_element_of_calculix_goes_as_the_law_with_the_exported_card(ccx, tmp_path, law):
    spec = get_law(law)
    values = dict(zip(spec.parameter_names, spec.defaults(), strict=True))
    theirs, ours, card = compared(tmp_path, spec.name, values, THERE_AND_BACK)
    assert card.missing == ()
    assert np.abs(theirs - ours).max() < 2.0 * KIRCHHOFF * np.abs(ours).max()


WARMED = "elastoplastic(voce+linear*E+linear*flow_stress)"
WARMED_VALUES = dict(zip(get_law(WARMED).parameter_names, (70e3, 0.3, 200.0, 80.0, 20.0, -5e-4, -2e-3, 20.0),
                         strict=True))
COURSE = np.concatenate([np.linspace(0.0, 0.01, 11), np.full(10, 0.01), np.linspace(0.01, 0.03, 11)[1:],
                         np.linspace(0.03, 0.02, 11)[1:]])
WARM_COURSE = np.interp(np.arange(len(COURSE)), [0, 10, 20, 30, 40], [20.0, 20.0, 170.0, 170.0, 60.0])
THERMAL = 2e-5  # 1/K


def test_a_warmed_element_of_calculix_goes_as_the_law_with_tables_over_the_temperature(ccx, tmp_path):
    """Pulled, warmed by 150 K under load, pulled on and unloaded while it cools; tables are linear in between, as the
    law."""
    card = material_card("M", WARMED, WARMED_VALUES, "calculix", reached=0.1, temperatures=(20.0, 170.0))
    assert card.missing == ()
    theirs = pulled_by_calculix(tmp_path, card.text, COURSE, WARM_COURSE)
    ours = warmed(np.zeros(len(COURSE)))
    cold = point.uniaxial(compile(WARMED), list(WARMED_VALUES.values()), COURSE).P[1:, 0, 0]
    assert np.abs(cold - ours).max() > 40.0  # the temperature matters
    assert np.abs(theirs - ours).max() < 2.0 * KIRCHHOFF * np.abs(ours).max()


@pytest.mark.parametrize("program", ["abaqus", "calculix"])
def test_a_card_at_one_temperature_says_so_in_plain_letters(program):
    card = material_card("M", WARMED, WARMED_VALUES, program)
    assert "** NOT IN THIS CARD: temperature: the values are those at 20 deg C" in card.text and card.text.isascii()
    assert "20 °C" in card.missing[-1]


def test_thermal_strain_in_calculix_is_taken_from_the_displacement_gradient(ccx, tmp_path):
    """With that the law follows; the expanded body of idic is off by e E strain where it is unloaded, by e stress."""
    card = material_card("M", WARMED, WARMED_VALUES, "calculix", reached=0.1, temperatures=(20.0, 170.0))
    theirs = pulled_by_calculix(tmp_path, card.text + f"*EXPANSION, ZERO=20\n{THERMAL}\n", COURSE, WARM_COURSE)
    e = THERMAL * (WARM_COURSE - 20.0)
    ours, exact = warmed(e), warmed(e, exact=True)
    assert np.abs(theirs - ours).max() < 2.0 * KIRCHHOFF * np.abs(ours).max()
    assert np.abs(ours - exact).max() > 2.0 * np.abs(theirs - ours).max()


def warmed(e, exact=False):
    """Nominal stress of the law along the course, e : free thermal strain  # (n - 1,) MPa

    F - e I strains the material, and its second Piola-Kirchhoff stress acts on F, as in CalculiX; exact: F / (1 + e),
    and the Cauchy stress is the law's (`idic.fe.assembly.expansion`).
    """
    law, own, dependence = compile(WARMED), np.array(list(WARMED_VALUES.values())), get_law(WARMED).temperature
    sides, state, found = np.ones(2), law.initial_state(0)[None], []
    for strain, T, own_e in zip(COURSE[1:], WARM_COURSE[1:], e[1:], strict=True):
        strained = (1.0 + strain) / (1.0 + own_e) if exact else 1.0 + strain - own_e
        sides, state, P = free_sides(law, strained - 1.0, state, dependence.values(own, np.array([T])), sides)
        found.append(P * (1.0 + own_e) ** 2 if exact else P * (1.0 + strain) / strained)
    return np.array(found)


@pytest.mark.parametrize(("law", "values"), [
    ("mooney_rivlin", (0.3, 0.05, 300.0)), ("neo_hookean", (0.35, 300.0)),
    ("free_rubber(4+3)", (300.0, 3.0, 0.2, 0.21, 0.24, 0.29, 2.0, 0.03, 0.027, 0.018))])
def test_rubber_in_calculix_goes_as_the_law(ccx, tmp_path, law, values):
    values = dict(zip(get_law(law).parameter_names, values, strict=True))
    strain = np.linspace(0.0, 1.0, 21)
    theirs, ours, card = compared(tmp_path, law, values, strain)
    lost = 0.02 if card.missing else 1e-4  # a polynomial in the place of four chords; digits that CalculiX prints
    assert len(card.missing) == (law == "free_rubber(4+3)")
    assert np.abs(theirs - ours).max() < lost * np.abs(ours).max()


def free_sides(law, strain, state, values, sides):
    """One step in tension: (F22 and F33, state, nominal stress) by Newton on the lateral stresses."""
    for _ in range(30):
        F = np.diag([1.0 + strain, *sides])[None]
        P, new, A, ok = point_tangents(law, 0, F, state, values, 1.0)
        assert ok
        side = np.array([P[0, 1, 1], P[0, 2, 2]])
        if np.abs(side).max() < 1e-9:
            return sides, new, P[0, 0, 0]
        sides = sides - np.linalg.solve(A[0][np.ix_([4, 8], [4, 8])], side)
    raise AssertionError("no equilibrium")


@pytest.mark.slow  # the law takes 20 s to compile
def test_plasticity_on_orthotropic_elasticity_goes_as_in_calculix(ccx, tmp_path):
    law = "elastoplastic(orthotropic+linear)"
    values = {"elasticity_E1": 120e3, "elasticity_E2": 60e3, "elasticity_nu12": 0.3, "elasticity_G12": 25e3,
              "elasticity_angle": 0.0, "yield_stress": 300.0, "hardening_1_H": 2000.0}
    assert get_law(law).parameter_names == tuple(values)
    strain = np.linspace(0.0, 0.01, 21)
    theirs, ours, card = compared(tmp_path, law, values, strain)
    assert card.missing == ()
    stretch = 1.0 + strain[1:]
    # CalculiX takes the second Piola-Kirchhoff stress of Green's strain for such a body, idic the Kirchhoff stress of
    # the
    # logarithmic strain: the strains differ by strain^2, at yield 0.0025^2 E1 = 0.75 MPa
    assert np.abs(theirs / stretch - ours * stretch).max() < 0.75


CREEPING = {  # law: (its parameters, lines of CalculiX after *ELASTIC): rate A (stress beyond yield)^n t^0
    "creep": ((70e3, 0.3, 1e-4, 4.0, 100.0), f"*CREEP\n{1e-4 / 100.0**4}, 4, 0\n"),
    "elastoplastic(linear+norton)": ((70e3, 0.3, 200.0, 2000.0, 100.0, 4.0),
                                     f"*PLASTIC\n200, 0\n600, 0.2\n*CREEP\n{100.0**-4}, 4, 0\n"),
}
PULLED_HELD_PRESSED = ([0.0, 5.0, 45.0, 65.0], [0.0, 0.012, 0.012, -0.01])  # s, strain


@pytest.mark.parametrize("law", CREEPING)
def test_creep_and_overstress_go_as_in_calculix(ccx, tmp_path, law):
    """Norton's creep without and with a yield stress, in the place of a card, which idic does not write for a rate."""
    values, lines = CREEPING[law]
    times = np.concatenate([np.linspace(0.0, 5.0, 21), np.linspace(5.0, 45.0, 31)[1:], np.linspace(45.0, 65.0, 31)[1:]])

    def ours(steps):
        ends = np.interp(np.arange(steps * (len(times) - 1) + 1) / steps, np.arange(len(times)), times)
        return point.uniaxial(compile(law), values, np.interp(ends, *PULLED_HELD_PRESSED), times=ends).P[steps::steps]

    expected = (2.0 * ours(16) - ours(8))[:, 0, 0]  # backward Euler, extrapolated in time
    theirs = pulled_by_calculix(tmp_path, f"*MATERIAL, NAME=M\n*ELASTIC\n70000, 0.3\n{lines}",
                                np.interp(times, *PULLED_HELD_PRESSED), times=times, procedure="*VISCO, CETOL=1e-6")
    assert expected.max() - expected[times[1:] <= 45.0][-1] > 0.05 * expected.max()  # relaxes: ten times the limit
    # Cauchy stress in their rate, and the error of their steps, 0.2 %: less than half with a tenth of CETOL
    assert np.abs(theirs - expected).max() < (2.0 * KIRCHHOFF + 2e-3) * np.abs(expected).max()


@pytest.mark.parametrize("program", ["abaqus", "calculix"])
def test_a_term_without_a_card_is_named_in_the_card(program):
    law = get_law("elastoplastic(in_plane_shear+voce+norton+lemaitre)")
    card = material_card("M", law.name, dict(zip(law.parameter_names, law.defaults(), strict=True)), program)
    assert [what.split(":")[0] for what in card.missing] == ["rate norton", "damage lemaitre",
                                                             "yield_surface in_plane_shear"]
    assert all(f"** NOT IN THIS CARD: {what}" in card.text for what in card.missing)
    egp = get_law("egp")
    assert material_card("M", "egp", dict(zip(egp.parameter_names, egp.defaults(), strict=True)), program).missing


def test_the_ratios_of_hills_card_are_the_yield_stresses_of_the_law():
    """Abaqus divides by R: a strip across the rolling direction yields at R22 times the yield stress."""
    law = get_law("j2_hill")
    values = dict(zip(law.parameter_names, law.defaults(), strict=True))
    card = material_card("M", "j2_hill", values, "abaqus")
    ratios = [float(x) for x in card.text.split("*POTENTIAL\n")[1].split("\n")[0].split(",")]
    r0, r90 = values["r0"], values["r90"]
    assert ratios[1] == pytest.approx(np.sqrt(r90 * (1.0 + r0) / (r0 * (1.0 + r90))))


def test_the_written_flow_stress_is_that_of_the_law_in_tension():
    for name in ("j2_linear", "j2_voce", "j2_power"):
        law = compile(name)
        values = law.spec.defaults()
        curve = point.uniaxial(law, values, np.linspace(0.0, 0.03, 7))
        yields = curve.state[:, 6] > 0
        ours = flow_stress(name, dict(zip(law.spec.parameter_names, values, strict=True)), curve.state[:, 6])
        np.testing.assert_allclose((curve.P * curve.F)[yields, 0, 0], ours[yields], rtol=1e-8)


def test_every_older_law_has_the_parameters_of_its_terms():
    for name in TERMS_OF_OTHERS:
        law = get_law(name)
        terms = terms_of(name, dict(zip(law.parameter_names, law.defaults(), strict=True)))
        named = {parameter for term in terms for parameter in term.names.values()}
        assert named | {"E", "nu", "yield_stress"} >= set(law.parameter_names)
