"""Templates: what is filled in, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from idic.errors import InputError, NotConverged
from idic.fe import ExternalSetup, ExternalSolver, inp_text, make_mesh, parse_deck
from idic.readers import read_mesh_file

VALUES = {"A.E": 70e3, "SET-1.nu": 0.3, "geometry.hole_x[1]": 2.5, "b": 2.0, "TABLE.grip": "0, 0\n1, 0.5"}


def render(text):
    deck = parse_deck(text, Path("x.template"))
    deck.check(VALUES)
    return deck.render(VALUES)


def test_names_formats_braces_and_tables_are_filled_in():
    assert render("{A.E}, {SET-1.nu:.3e} {{x}} {geometry.hole_x[1]:8.2f}|") == "70000, 3.000e-01 {x}     2.50|"
    assert render("*AMPLITUDE\n{TABLE.grip}\n") == "*AMPLITUDE\n0, 0\n1, 0.5\n"


@pytest.mark.parametrize("text, value", [
    ("A.E / (2 * (1 + SET-1.nu))", 70e3 / 2.6), ("A.E - b", 69998.0), ("-b**2", -4.0), ("2**-b", 0.25),
    ("b**b**b", 16.0), ("1 - exp(-b * 0.5)", 1 - math.exp(-1)), ("sqrt(b) * log(1e3)", math.sqrt(2) * math.log(1e3)),
    ("+b - 1", 1.0), ("8/b/2", 2.0), ("geometry.hole_x[1] *4", 10.0)])
def test_arithmetic_follows_the_usual_rules(text, value):
    assert float(render(f"{{{text}:.16e}}")) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text", [
    "{", "}", "{}", "{A.E", "{A.E!r}", "{A.E:>{b}}", "{A.E:999999999f}", "{A.E.__class__}", "{__import__('os')}",
    "{b b}", "{b(2)}", "{2 *}", "{(b}", "{exp}", "{b; b}", "{'x'}", "{[b]}", "{b:s}", "{b if b else b}",
    "{" + "(" * 401 + "}", "{" + "(" * 399 + "}", "{" + "(" * 150 + "b" + ")" * 150 + "}"])
def test_whatever_is_no_arithmetic_with_known_names_is_refused(text):
    with pytest.raises(InputError):
        render(text)


def test_an_unknown_name_is_refused_with_its_line_and_a_guess():
    with pytest.raises(InputError) as caught:
        render("first\n{A.e}\n")
    assert caught.value.key == "line 2" and "A.E" in caught.value.remedy


@pytest.mark.parametrize("text", ["{1 / (b - 2)}", "{log(b - 2)}", "{exp(1e6)}", "{1e308 * 1e308}", "{b + TABLE.grip}"])
def test_a_place_without_a_finite_value_makes_no_deck(text):
    with pytest.raises(NotConverged, match="line 1"):
        render(text)


def setup(deck_file, **more):
    words = tuple(parse_deck(word, Path("x")) for word in ("ccx", "-i", "{job}"))
    return ExternalSetup(Path("experiment.toml"), parse_deck("**", Path("x")), deck_file, words, "calculix_frd", **more)


@pytest.mark.parametrize("deck_file, job", [("plate.inp", "plate"), ("strip_0.5mm.inp", "strip_0.5mm"),
                                            ("plate", "plate")])
def test_the_job_is_the_name_of_the_deck_without_its_ending(deck_file, job):
    assert setup(deck_file).job == job and setup(deck_file).arguments == ("ccx", "-i", job)


def test_a_mesh_with_names_of_any_letters_is_written_as_the_deck_is(tmp_path):
    mesh = make_mesh(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), [("quad4", np.arange(4)[None])],
                     node_sets={"RÄNDER": np.array([0, 1])})
    solver = ExternalSolver(setup("plate.inp", mesh_file="mesh.inp"), None)
    solver._write(tmp_path, {}, {"mesh.inp": inp_text(mesh, "idic")})
    assert "RÄNDER" in (tmp_path / "mesh.inp").read_text(encoding="utf-8")
    assert "RÄNDER" in read_mesh_file(tmp_path / "mesh.inp").node_sets
