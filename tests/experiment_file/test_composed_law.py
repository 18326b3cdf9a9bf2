"""``law = "elastoplastic"``: tables and lists of terms become the parameters of one law."""

from dataclasses import replace

import numpy as np
import pytest

from idic.errors import InputError
from idic.experiment_file import to_toml, validated, with_overrides
from idic.experiment_file.laws.composed_law import course_notes
from idic.experiment_file.laws.softening import softening_notes
from idic.experiment_file.laws.spectrum import spectrum_notes
from idic.experiment_file.tables.dofs import material
from idic.fe import make_mesh
from idic.model import Model
from idic.virtual_tests import Patch, mesh_patches

TERMS = {"law": "elastoplastic", "E": 70e3, "nu": 0.3, "yield_stress": {"value": 0.2, "unit": "GPa", "identify": True},
         "yield_surface": {"kind": "hill48", "r0": 1.4},
         "hardening": [{"kind": "voce", "Q": {"value": 80, "identify": True, "bounds": [0, 400]}, "b": 15},
                       {"kind": "linear", "H": {"value": 1, "unit": "GPa"}}],
         "backstress": [{"kind": "armstrong_frederick", "C": 5000, "gamma": {"value": 40, "identify": True}}],
         "rate": {"kind": "norton", "eta": 20, "m": 4}, "damage": {"kind": "lemaitre", "S": 0.5, "s": 1}}
HARDENING = "linear | voce | plateau | power | power_reference | swift | free"


def tables(**changes):
    own = {key: value for key, value in (TERMS | changes).items() if value is not None}
    return {"experiment": {"images": "*.tif", "mesh": "m.inp", "kind": "plane_stress"}, "camera": {"origin_px": [0, 0]},
            "material": {"SPECIMEN": own}}


def read(overrides=None, **changes):
    raw = with_overrides(tables(**changes), overrides)
    record, parameters, _ = material("SPECIMEN", validated(raw, "experiment.toml").material["SPECIMEN"],
                                     "experiment.toml")
    return record, {p.name.removeprefix("SPECIMEN."): p for p in parameters}


def test_terms_are_parameters_with_units_bounds_and_freedom():
    record, found = read()
    assert record.law == "elastoplastic(hill48+voce+linear+armstrong_frederick+norton+lemaitre)"
    assert [name for name, p in found.items() if p.free] == ["yield_stress", "hardening_1_Q", "backstress_1_gamma"]
    assert found["hardening_1_Q"].bounds == (0.0, 400.0) and found["hardening_2_H"].value == 1000.0
    assert (found["yield_surface_r0"].value, found["yield_surface_r90"].value) == (1.4, 1.0)
    assert (found["rate_m"].value, found["damage_S"].value) == (4.0, 0.5)


def test_an_override_names_a_parameter_of_a_term_as_the_result_does():
    assert read({"SPECIMEN.hardening_1_Q": 55.0})[1]["hardening_1_Q"].value == 55.0


def test_what_is_written_from_the_tables_is_read_again_as_the_same_law():
    import tomllib


    again = tomllib.loads(to_toml(with_overrides(tables(), None)))
    assert validated(with_overrides(again, None), "experiment.toml") == validated(with_overrides(tables(), None),
                                                                                  "experiment.toml")


def test_swifts_curve_takes_the_place_of_the_yield_stress():
    swift = {"kind": "swift", "K": {"value": 0.5, "unit": "GPa", "identify": True}, "eps0": 0.01, "n": 0.2}
    own = dict(hardening=[swift], backstress=None, rate=None, damage=None)
    record, found = read(**own, yield_stress=None)
    assert record.law == "elastoplastic(hill48+swift)" and found["hardening_1_K"].value == 500.0
    assert list(found)[:5] == ["E", "nu", "hardening_1_K", "hardening_1_eps0", "hardening_1_n"]
    with pytest.raises(InputError, match="yield_stress"):
        read(**own)


def test_a_free_yield_surface_starts_as_misess_and_comes_back_from_its_law_file():
    import tomllib

    from idic.experiment_file import SPREAD
    from idic.run.reporting.law_files import law_table

    own = dict(hardening=None, backstress=None, rate=None, damage=None)
    record, found = read(**own, yield_surface={"kind": "free_surface", "knots": 5, "angle": 20.0, "u3": 0.5})
    weights = [p for name, p in found.items() if name.startswith("yield_surface_u")]
    assert record.law == "elastoplastic(free_surface5)" and len(weights) == 15
    assert [p.value for p in weights] == [1.0, 1.0, 0.5, *[1.0] * 12] and found["yield_surface_angle"].value == 20.0
    assert [p.free for p in weights] == [True, True, False, *[True] * 12] and weights[0].prior_std == SPREAD
    text = law_table("SPECIMEN", record.law, "finite", {name: p.value for name, p in found.items()},
                     {"parameters": {}})
    raw = tables() | {"material": {"SPECIMEN": tomllib.loads(text)}}
    again, values, _ = material("SPECIMEN", validated(with_overrides(raw, None), "f").material["SPECIMEN"], "f")
    assert again.law == record.law
    assert {p.name.removeprefix("SPECIMEN."): p.value for p in values} == {name: p.value for name, p in found.items()}
    for bad, key in (({"knots": 4}, "knots"), ({"smoothness": 0}, "smoothness"), ({"v1": 1.0}, "v1")):
        with pytest.raises(InputError) as error:
            read(**own, yield_surface={"kind": "free_surface"} | bad)
        assert error.value.key == f"material.SPECIMEN.yield_surface.{key}"


def test_comments_of_a_law_file_have_the_unit_and_the_state_of_its_values():
    """The result is in GPa, the file in MPa; what only ratios determine is no starting value."""
    from idic.run.reporting.law_files import law_table

    result = {"parameters": {
        "p.E1": {"value": 69.748, "std": 0.16, "unit": "GPa", "free": True},
        "p.nu12": {"value": 0.3, "std": 0.01, "unit": "", "free": True},
        "p.E2": {"value": 50.0, "std": None, "unit": "GPa", "free": True, "value_relative": 80.0},
        "p.G12": {"value": 26e3, "std": None, "unit": "MPa", "free": True}, "p.angle": {"free": False}}}
    text = law_table("p", "orthotropic", "small", {"E1": 69748.0, "nu12": 0.3, "E2": 80e3, "G12": 26e3, "angle": 0.0},
                     result)
    assert "#   E1 = 69748 ± 1.6e+02 MPa\n" in text and "#   nu12 = 0.3 ± 0.01\n" in text
    assert "#   E2: not determined by the test, its value is valid in ratio" in text
    assert "#   G12: not determined by the test, its starting value\n" in text and "angle:" not in text


def test_no_terms_are_perfect_plasticity():
    record, found = read(**dict.fromkeys(("yield_surface", "hardening", "backstress", "rate", "damage")))
    assert record.law == "elastoplastic" and list(found) == ["E", "nu", "yield_stress"]


@pytest.mark.parametrize(("changes", "key", "expected"), [
    ({"hardening": [{"Q": 3.0}]}, "hardening[0].kind", HARDENING),
    ({"hardening": [{"kind": "voice", "Q": 3.0, "b": 4.0}]}, "hardening[0].kind", HARDENING),
    ({"hardening": [{"kind": "voce", "Q": 3.0}]}, "hardening[0].b",
     "b (rate of the saturation over plastic strain, -)"),
    ({"hardening": [{"kind": "voce", "Q": 3.0, "b": 4.0, "H": 2.0}]}, "hardening[0].H", "Q, b"),
    ({"hardening": "voce"}, "hardening", '{ kind = "linear", ... }'),
    ({"rate": [{"kind": "norton", "eta": 1.0, "m": 2.0}]}, "rate", '{ kind = "..." }, one rate'),
    ({"yield_surface": {"kind": "drucker_prager"}}, "yield_surface", "mises or hill48 with a back stress or damage")])
def test_a_wrong_term_is_told_with_its_place(changes, key, expected):
    with pytest.raises(InputError) as error:
        read(**changes)
    assert (error.value.key, error.value.expected) == (f"material.SPECIMEN.{key}", expected)
    assert error.value.file == "experiment.toml" and error.value.remedy


def test_a_free_curve_starts_on_a_straight_line_of_identified_values():
    record, found = read(hardening=[{"kind": "free", "knots": 5, "range": 0.1, "H": 800.0, "s3": 240.0}])
    assert record.law == "elastoplastic(hill48+free5+armstrong_frederick+norton+lemaitre)"
    assert [found[f"hardening_1_s{k}"].value for k in (2, 3, 5)] == pytest.approx([205.0, 240.0, 280.0])
    assert found["hardening_1_s5"].free and not found["hardening_1_range"].free


FACTORS = [{"kind": "linear", "of": "E", "slope": -4e-4},
           {"kind": "johnson_cook", "of": ["yield_stress", "hardening_1_Q"], "m": {"value": 1.0, "identify": True},
            "melting": 640.0}]


def test_factors_of_the_temperature_name_what_they_multiply():
    record, found = read(temperature=FACTORS, reference_temperature={"value": 20.0, "unit": "C"})
    assert record.law.endswith("+lemaitre+linear*E+johnson_cook*yield_stress*hardening_1_Q)")
    assert (found["temperature_1_slope"].value, found["temperature_2_melting"].value) == (-4e-4, 640.0)
    assert found["temperature_2_m"].free and found["reference_temperature"].value == 20.0


@pytest.mark.parametrize(("changes", "key"), [
    ({"temperature": [{"kind": "linear", "slope": 1e-3}]}, "temperature[0].of"),
    ({"temperature": [{"kind": "linear", "of": "Q", "slope": 1e-3}]}, "temperature"),
    ({"temperature": FACTORS, "reference_temperature": {"value": 293.0, "unit": "K"}}, "reference_temperature.unit"),
    ({"temperature": FACTORS}, "reference_temperature"), ({"reference_temperature": 20.0}, "reference_temperature")])
def test_a_factor_without_its_parameter_or_reference_is_told(changes, key):
    with pytest.raises(InputError) as error:
        read(**changes)
    assert error.value.key == f"material.SPECIMEN.{key}" and error.value.remedy


def test_material_axes_of_the_elasticity_serve_hills_surface_too():
    record, found = read(E=None, nu=None, elasticity={"kind": "orthotropic", "E1": 140e3, "E2": 1e4, "nu12": 0.3,
                                                      "G12": 5e3, "angle": 30.0},
                         nonlinear_elasticity=[{"kind": "fibre", "gamma": 15.0}])
    assert record.law.startswith("elastoplastic(orthotropic+fibre+hill48+voce+linear")
    assert found["elasticity_angle"].value == 30.0 and "yield_surface_angle" not in found and "E" not in found
    with pytest.raises(InputError, match="fibre needs material axes"):
        read(nonlinear_elasticity=[{"kind": "fibre", "gamma": 15.0}])


def test_a_law_file_is_taken_in_and_keys_beside_it_win(tmp_path):
    from idic.experiment_file import read_toml

    (tmp_path
     / "sheet.toml").write_text('law = "j2_linear"\nE = 70e3\nnu = 0.3\nyield_stress = 200\nhardening_modulus = 900\n')
    main = tmp_path / "experiment.toml"
    main.write_text('[material.SHEET]\nfrom = "sheet.toml"\nnu = 0.33\n')
    assert read_toml(main)["material"]["SHEET"] == {"law": "j2_linear", "E": 70e3, "nu": 0.33, "yield_stress": 200,
                                                    "hardening_modulus": 900}
    main.write_text('[material.SHEET]\nfrom = "other.toml"\n')
    with pytest.raises(InputError, match="no such law file"):
        read_toml(main)


def test_an_exported_composed_law_is_read_as_the_same_law_with_the_same_values():
    import tomllib

    from idic.run.reporting.law_files import law_table

    record, found = read(hardening=[{"kind": "free", "knots": 4, "range": 0.1}], reference_temperature=25.0,
                         temperature=[{"kind": "arrhenius", "of": ["flow_stress", "rate_eta"], "activation": 900.0}])
    values = {name: p.value for name, p in found.items()}
    text = law_table("SPECIMEN", record.law, "finite", values,
                     {"parameters": {"SPECIMEN.yield_stress": {"std": 1.5, "unit": "MPa", "free": True}}})
    assert "#   yield_stress = 200 ± 1.5 MPa" in text
    raw = with_overrides(tables() | {"material": {"SPECIMEN": tomllib.loads(text)}}, None)
    again, kept, _ = material("SPECIMEN", validated(raw, "e").material["SPECIMEN"], "e")
    assert again.law == record.law
    assert {p.name.removeprefix("SPECIMEN."): p.value for p in kept} == pytest.approx(values)


def test_an_exported_free_curve_keeps_its_stated_smoothness():
    import tomllib


    from idic.experiment_file.laws.free_curves import free_curves, smoothness_priors
    from idic.run.reporting.law_files import law_table

    term = {"kind": "free", "knots": 4, "range": 0.1, "smoothness": 0.3, "smooth_over": "root", "H": 500.0}
    table = validated(with_overrides(tables(hardening=[term]), None), "e").material["SPECIMEN"]
    record, first, _ = material("SPECIMEN", table, "e")
    curves = free_curves([record], {"SPECIMEN": table}, first)
    steeper = {p.name.removeprefix("SPECIMEN."): p.value * (1.5 if "_s" in p.name else 1.0) for p in first}
    text = law_table("SPECIMEN", record.law, "finite", steeper, {"parameters": {}}, curves)
    raw = with_overrides(tables() | {"material": {"SPECIMEN": tomllib.loads(text)}}, None)
    again = validated(raw, "e").material["SPECIMEN"]
    record, kept, _ = material("SPECIMEN", again, "e")
    assert smoothness_priors(free_curves([record], {"SPECIMEN": again}, kept), kept) \
        == smoothness_priors(curves, first)


def test_a_load_that_never_turns_back_is_told_where_two_mechanisms_look_alike():
    record, found = read(damage={"kind": "lemaitre", "S": {"value": 0.5, "identify": True}, "s": 1})
    parameters = [replace(p, name=f"SPECIMEN.{name}") for name, p in found.items()]
    there, back = np.linspace(0.0, 0.3, 8), np.array([0.0, 0.1, 0.2, 0.1, 0.0])
    notes = course_notes([record], parameters, [there])
    assert ["back stress" in note for note in notes] == [True, False] and "damage" in notes[1]
    assert course_notes([record], parameters, [there, back]) == course_notes([record], parameters, []) == []
    assert course_notes([record], [replace(p, free=False) for p in parameters], [there]) == []


def test_what_softening_owes_to_the_mesh_is_told_with_the_size_of_the_elements():
    nodes, cells = mesh_patches([Patch(lambda s, t: (4.0 * s, 2.0 * t), 8, 4)], "quad8")
    mesh = make_mesh(nodes, [("quad8", cells)], element_sets={"SPECIMEN": np.arange(32)})
    for damage, said in (({}, "softening without a length: damage localises in one row of elements (0.25 mm)"),
                         ({"length": 0.4}, "softening for rows of 0.4 mm is scaled to elements of 0.25 mm")):
        record, found = read(damage={"kind": "lemaitre", "S": 0.5, "s": 1} | damage)
        parameters = [replace(p, name=f"SPECIMEN.{name}") for name, p in found.items()]
        (note,) = softening_notes([record], parameters, mesh, "mm")
        assert said in note
    assert softening_notes([replace(record, law="elastic")], parameters, mesh, "mm") == []


RUBBER = {"law": "free_rubber", "kappa": 600.0, "I1": {"knots": 5, "range": 4.0, "C10": 0.4, "g3": 0.5},
          "I2": {"knots": 3, "range": 3.0}}


def read_rubber(**changes):
    raw = {**tables(), "material": {"SPECIMEN": RUBBER | changes}}
    made, parameters, _ = material("SPECIMEN", validated(with_overrides(raw, None), "e").material["SPECIMEN"], "e")
    return made, {p.name.removeprefix("SPECIMEN."): p for p in parameters}


def test_a_free_rubber_starts_as_neo_hookes_law_with_identified_derivatives():
    made, found = read_rubber()
    assert made.law == "free_rubber(5+3)" and read_rubber(I2=None)[0].law == "free_rubber(5)"
    assert [found[f"I1_g{k}"].value for k in (1, 3, 5)] == [0.4, 0.5, 0.4] and found["I1_g5"].free
    assert found["I2_g2"].value == 0.0 and not found["I1_range"].free


@pytest.mark.parametrize(("changes", "key"), [
    ({"I1": {"knots": 2, "range": 4.0}}, "I1.knots"), ({"I1": {"knots": 4}}, "I1.range"), ({"I1": None}, "I1"),
    ({"I1": {"range": 4.0, "C01": 1.0}}, "I1.C01"), ({"I1": {"range": 4.0, "C10": 0}}, "I1.C10")])
def test_a_wrong_free_rubber_is_told_with_its_place(changes, key):
    with pytest.raises(InputError) as error:
        read_rubber(**changes)
    assert error.value.key == f"material.SPECIMEN.{key}" and error.value.remedy


def test_knots_by_evidence_are_the_most_and_the_chosen_ones_replace_them():
    from idic.experiment_file.laws.free_curves import free_curves, knot_notes
    from idic.identification import ChosenKnots
    from idic.laws import Smoothness
    from idic.parameters import ParameterSet
    from idic.run.knots import _with_knots

    term = {"kind": "free", "knots": "evidence", "range": 0.1, "smoothness": 0.5, "smooth_over": "root"}
    raw = with_overrides(tables(hardening=[term]), None)
    table = validated(raw, "e").material["SPECIMEN"]
    record, found, _ = material("SPECIMEN", table, "e")
    curve, = free_curves([record], {"SPECIMEN": table}, found)
    assert curve.by_evidence and len(curve.names) == 24 and curve.smoothness == Smoothness(0.5, "root")
    chosen = ChosenKnots(4, Smoothness(0.1), np.array([200.0, 210.0, 220.0, 230.0]), {4: 0.0, 6: -5.0})
    made = _with_knots(raw["material"]["SPECIMEN"], curve, chosen, ParameterSet(found))
    edited = validated(with_overrides(raw, {"material.SPECIMEN": made}), "e").material
    record, found, _ = material("SPECIMEN", edited["SPECIMEN"], "e")
    curve, = free_curves([record], edited, found)
    levels = {p.name: p for p in found}
    assert record.law.startswith("elastoplastic(hill48+free4+") and not curve.by_evidence
    assert [levels[name].value for name in curve.names] == [200.0, 210.0, 220.0, 230.0]
    assert curve.smoothness == Smoothness(0.1) and levels[curve.names[-1]].free
    assert "4 +0.0, 6 -5.0; smoothness 0.1" in knot_notes(edited)[0]


@pytest.mark.parametrize(("written", "key", "most", "n", "law"), [
    ({"law": "free_relaxation", "E": 1000.0, "nu": 0.4, "spectrum": {"times": "evidence", "shortest": 1.0,
                                                                     "longest": 50.0}},
     "spectrum", 24, 6, "free_relaxation(6)"),
    ({"law": "elastoplastic", "E": 7e4, "nu": 0.3, "yield_stress": 200.0,
      "yield_surface": {"kind": "free_surface", "knots": "evidence"}, "hardening": [{"kind": "free", "knots": 9}]},
     "yield_surface", 27, 5, "elastoplastic(free_surface5+free9)")])
def test_knots_of_a_spectrum_and_a_yield_surface_by_evidence_are_replaced_and_start_at_their_values(written, key, most,
                                                                                                 n, law):
    from idic.experiment_file.laws.free_curves import free_curves
    from idic.identification import ChosenKnots
    from idic.laws import Smoothness
    from idic.parameters import ParameterSet
    from idic.run.knots import _with_knots

    raw = with_overrides({**tables(), "material": {"SPECIMEN": written}}, None)
    table = validated(raw, "e").material["SPECIMEN"]
    record, found, _ = material("SPECIMEN", table, "e")
    curve = next(c for c in free_curves([record], {"SPECIMEN": table}, found) if c.key == key)
    assert curve.by_evidence and len(curve.names) == most
    levels = np.linspace(0.0, 0.3, 3 * n if key == "yield_surface" else n)
    chosen = ChosenKnots(n, Smoothness(0.1, curve.over[0]), levels, {n: 0.0})
    made = _with_knots(raw["material"]["SPECIMEN"], curve, chosen, ParameterSet(found))
    edited = validated(with_overrides(raw, {"material.SPECIMEN": made}), "e").material
    record, found, _ = material("SPECIMEN", edited["SPECIMEN"], "e")
    curve = next(c for c in free_curves([record], edited, found) if c.key == key)
    values = {p.name: p for p in found}
    assert record.law == law and not curve.by_evidence and curve.smoothness.strength == 0.1
    np.testing.assert_allclose([values[name].value for name in curve.names], levels)
    assert len({values[name].scale for name in curve.names}) == 1  # a start at zero has the step of any other


@pytest.mark.parametrize(("changes", "key"), [
    ({"knots": "many"}, "knots"), ({"smoothness": 0.0}, "smoothness"), ({"smooth_over": "time"}, "smooth_over")])
def test_a_wrong_smoothness_is_told(changes, key):
    with pytest.raises(InputError) as error:
        read(hardening=[{"kind": "free", "range": 0.1} | changes])
    assert error.value.key == f"material.SPECIMEN.hardening[0].{key}"


def test_knots_by_evidence_of_a_curve_with_a_locked_value_are_refused():
    from types import SimpleNamespace

    from idic.experiment_file.laws.free_curves import free_curves
    from idic.parameters import ParameterSet
    from idic.run.knots import chosen_tables

    term = {"kind": "free", "knots": "evidence", "range": 0.1}
    raw = with_overrides(tables(yield_stress=200.0, hardening=[term]), None)
    table = validated(raw, "e").material["SPECIMEN"]
    record, found, _ = material("SPECIMEN", table, "e")
    curves = free_curves([record], {"SPECIMEN": table}, found)
    model = Model("plane_stress", None, 1.0, (record,), ParameterSet(found), (), (), (), None, np.arange(2.0),
                  free_curves=curves)
    with pytest.raises(InputError) as error:
        chosen_tables(SimpleNamespace(model=model), raw)
    assert error.value.key == "material.SPECIMEN.yield_stress"


SPECTRUM = {"times": 4, "shortest": 0.5, "longest": {"value": 2.0, "unit": "min"}, "share": 0.4, "smoothness": 0.5}


def read_spectrum(**changes):
    raw = {**tables(), "material": {"SPECIMEN": {"law": "free_relaxation", "E": 1000.0, "nu": 0.4,
                                                 "spectrum": {**SPECTRUM, **changes}}}}
    table = validated(with_overrides(raw, None), "e").material["SPECIMEN"]
    made, parameters, _ = material("SPECIMEN", table, "e")
    return made, {p.name.removeprefix("SPECIMEN."): p for p in parameters}, table


def test_a_free_spectrum_starts_level_with_its_smoothness_and_tells_what_the_frames_do_not_show():
    from idic.experiment_file.laws.free_curves import free_curves, smoothness_priors

    made, found, table = read_spectrum(g_2=0.3)
    assert made.law == "free_relaxation(4)" and found["longest"].value == 120.0 and not found["longest"].free
    assert [found[f"g_{k}"].value for k in (1, 2, 3, 4)] == [0.1, 0.3, 0.1, 0.1] and found["g_1"].free
    parameters = [replace(p, name=f"SPECIMEN.{name}") for name, p in found.items()]
    curve, = free_curves([made], {"SPECIMEN": table}, parameters)
    prior, = smoothness_priors([curve], parameters)
    # second differences of the weights: half of their mean at the start, 0.15
    np.testing.assert_allclose(prior.bends, np.diff(np.eye(4), 2, axis=0) / (0.5 * 0.15))
    assert spectrum_notes([made], parameters, np.linspace(0.0, 100.0, 101)) == []
    for times in (np.linspace(0.0, 40.0, 41), np.linspace(0.0, 100.0, 51)):
        note, = spectrum_notes([made], parameters, times)
        assert "relaxation times of 0.5 to 120 s" in note


@pytest.mark.parametrize(("changes", "key"), [
    ({"times": 2}, "times"), ({"times": "many"}, "times"), ({"shortest": 0}, "shortest"),
    ({"longest": None}, "longest"), ({"longest": 0.4}, "longest"), ({"share": 1.0}, "share"), ({"g_5": 0.1}, "g_5"),
    ({"smoothness": -1}, "smoothness")])
def test_a_wrong_spectrum_is_told_with_its_place(changes, key):
    with pytest.raises(InputError) as error:
        read_spectrum(**changes)
    assert error.value.key == f"material.SPECIMEN.spectrum.{key}" and error.value.remedy
