"""CalculiX beside the built-in solver: the same mesh, the same elements, the same parameters; files that ccx wrote."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strange_solver import THICKNESS, WIDTH
from strip import strip_mesh, write_strip

from idic.errors import InputError, NotConverged
from idic.experiment_file import load_experiment
from idic.fe import PERMISSION
from idic.model import build_forward, solve

J2 = """
E = { value = 70e3, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 150, unit = "MPa", identify = true }
hardening_modulus = { value = 1500, unit = "MPa", identify = true }
"""
CLAMPED = """
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
uy = 0.0
"""
GUIDED = """
[sets]
BOTTOM = { where = "y < -1.99" }
[[boundary]]
nodes = "LEFT"
ux = 0.0
[[boundary]]
nodes = "BOTTOM"
uy = 0.0
"""
SOLVER = """
[solver]
kind = "external"
template = "plate.inp.template"
mesh = "plate_mesh.inp"
element_types = { quad8 = "CPS8R" }
command = ["ccx", "-i", "{job}"]
reader = "calculix_dat"
timeout_s = 300
"""
DECK = """*INCLUDE, INPUT=plate_mesh.inp
*MATERIAL, NAME=M
*ELASTIC
{BODY.E}, {BODY.nu}
*PLASTIC
{BODY.yield_stress}, 0
{BODY.yield_stress + BODY.hardening_modulus}, 1
*SOLID SECTION, ELSET=BODY, MATERIAL=M
{geometry.thickness / 100}
*BOUNDARY
LEFT, 1, 2
RIGHT, 2, 2
*AMPLITUDE, NAME=GRIP
{TABLE.boundary.RIGHT.x}
*TIME POINTS, NAME=FRAMES
{TIME.points}
*STEP, NLGEOM, INC=10000
*STATIC
{TIME.end / TIME.frames}, {TIME.end}, 1e-6, {TIME.end / TIME.frames}
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*NODE FILE, OUTPUT=2D, TIME POINTS=FRAMES
U, RF
*END STEP
"""


@pytest.fixture
def plate(tmp_path, ccx, monkeypatch):
    """An elastoplastic strip between clamps, and how to load it with an option changed."""
    monkeypatch.setenv(PERMISSION, ccx)
    folder = write_strip(tmp_path / "plate", deck="")
    text = (folder / "experiment.toml").read_text()
    material, rest = text.index("law = "), text.index("[[boundary]]")
    text = text[:material] + 'law = "j2_linear"' + J2 + CLAMPED + text[rest:text.index("[solver]")] + SOLVER
    text = text.replace('component = "x" }', 'component = "x", factor = 100 }')
    (folder / "experiment.toml").write_text(text)
    (folder / "plate.inp.template").write_text(DECK)
    return folder


def built_in(experiment):
    """The same with the solver of idic, on the whole thickness."""
    channels = tuple(replace(channel, factor=1.0) for channel in experiment.model.channels)
    here = replace(experiment, model=replace(experiment.model, solver=None, channels=channels))
    return solve(build_forward(here), here.model.parameters)


@pytest.mark.parametrize("reader", ["calculix_dat", "calculix_frd"])
def test_calculix_and_the_built_in_solver_move_alike(plate, reader):
    """The strip yields throughout (2 % of strain) and is held at its ends, so that nothing is homogeneous. What remains
    is the thickness: CalculiX makes solids of plane elements, whose thickness is continuous from element to element."""
    experiment = load_experiment(plate, {"solver.reader": reader})
    theirs, ours = solve(build_forward(experiment), experiment.model.parameters), built_in(experiment)
    assert np.abs(ours.u).max() == pytest.approx(0.12)
    assert np.abs(theirs.u - ours.u).max() < 3e-3 * 0.12  # mm, at the corners of the clamps; 2.3e-4 mm measured
    assert theirs.channels[1:] == pytest.approx(ours.channels[1:], rel=1.5e-3)  # of which 0.8e-3 are the next test's


def test_the_flow_stress_of_calculix_is_cauchy_that_of_the_built_in_law_kirchhoff_stress(plate):
    """tau = J sigma, J = 1 + (1 - 2 nu) sigma / E, in a homogeneous strip: the only difference between the laws."""
    text = (plate / "experiment.toml").read_text()
    assert CLAMPED in text
    (plate / "experiment.toml").write_text(text.replace(CLAMPED, GUIDED))
    (plate / "plate.inp.template").write_text(DECK.replace("LEFT, 1, 2\nRIGHT, 2, 2", "LEFT, 1, 1\nBOTTOM, 2, 2"))
    experiment = load_experiment(plate)
    theirs, ours = solve(build_forward(experiment), experiment.model.parameters), built_in(experiment)
    volume = 1.0 + (1.0 - 2.0 * 0.33) * ours.channels[1:] / (WIDTH * THICKNESS) / 70e3
    assert theirs.channels[1:] == pytest.approx(volume * ours.channels[1:], rel=5e-5)  # the area changes, 2 % of 8e-4
    assert np.abs(theirs.u - ours.u).max() < 1e-5  # mm


def test_a_deck_that_writes_too_little_gets_a_list_of_missing_output(plate):
    deck = plate / "plate.inp.template"
    deck.write_text(DECK.replace("*NODE PRINT, NSET=ALL", "*NODE PRINT, NSET=RIGHT"))
    experiment = load_experiment(plate, {"solver.retries": 0})
    with pytest.raises(NotConverged, match=r"displacements of \d+ of 93 nodes are missing, first node 1"):
        solve(build_forward(experiment), experiment.model.parameters)


def test_a_deck_that_calculix_refuses_is_told_in_its_own_words(plate):
    deck = plate / "plate.inp.template"
    deck.write_text(DECK.replace("MATERIAL=M\n{geometry", "MATERIAL=N\n{geometry"))
    experiment = load_experiment(plate, {"solver.retries": 0})
    with pytest.raises(NotConverged, match="ccx ended with exit code .*its last lines"):
        solve(build_forward(experiment), experiment.model.parameters)


# tables ----------------------------------------------------------------------------------------------
CASES = [
    ("{BODY.hardening_modulus}", "{BODY.nu}", "BODY.hardening_modulus", "does not read"),
    ("{TABLE.boundary.RIGHT.x}", "0, 0\n4, 0.12", "TABLE.boundary.RIGHT.x", "does not read"),
    ("{BODY.E}", "{BODY.Young}", "line 4", "an unknown name"),
    ("{BODY.nu}", "{BODY.nu / 0}", "strip.deck.template", "cannot be made"),
]


@pytest.mark.parametrize("old, new, place, what", CASES)
def test_a_deck_that_does_not_fit_the_experiment_is_refused(tmp_path, old, new, place, what):
    deck = DECK.replace("BODY.yield_stress + BODY.hardening_modulus", "BODY.hardening_modulus").replace(old, new)
    folder = write_strip(tmp_path / "plate", deck=deck, more='\n')
    text = (folder / "experiment.toml").read_text()
    law = 'law = "external"\nyield_stress = 20\nhardening_modulus = { value = 2, identify = true }'
    text = text.replace('law = "external"', law).replace('reader = "csv"', 'reader = "csv"\nmesh = "plate_mesh.inp"')
    (folder / "experiment.toml").write_text(text)
    with pytest.raises(InputError, match=what) as caught:
        build_forward(load_experiment(folder))
    assert place in str(caught.value)


@pytest.mark.parametrize("old, new, key", [
    ('template = "strip.deck.template"', 'template = "../strip.deck.template"', "solver.template"),
    ('template = "strip.deck.template"', 'template = "/etc/passwd"', "solver.template"),
    ('"nodes.txt", ', '"../nodes.txt", ', "solver.files[0]"), ('"nodes.txt", ', '"nothing.txt", ', "solver.files[0]"),
    ('"nodes.txt", ', '"nodes.txt", "nodes.txt", ', "solver"), ('reader = "csv"', 'reader = "pickle"', "solver.reader"),
    ('reader = "csv"', 'reader = "csv"\nmesh = "a/b.inp"', "solver.mesh"),
    ('reader = "csv"', 'reader = "csv"\ntimeout_s = 0', "solver.timeout_s"),
    ('reader = "csv"', 'reader = "csv"\nshell = true', "solver.shell"),
    ('reader = "csv"', 'reader = "csv"\nenvironment = { LD_PRELOAD = "x.so" }', "solver.environment.LD_PRELOAD"),
    ('"{deck}"]', '"{deck} {BODY.E}"]', "line 1"), ('kind = "external"', 'kind = "shell"', "solver.kind"),
    ('E = { value = 1.2, unit = "GPa"', 'E = { value = 1.2, unit = "GPaa"', "material.BODY.E.unit")])
def test_a_table_that_says_something_wrong_is_refused(tmp_path, old, new, key):
    folder = write_strip(tmp_path / "strip")
    text = (folder / "experiment.toml").read_text()
    assert old in text
    (folder / "experiment.toml").write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_experiment(folder)
    assert key in str(caught.value.key)


def test_an_external_law_without_a_solver_is_refused(tmp_path):
    folder = write_strip(tmp_path / "strip")
    text = (folder / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(text[:text.index("[solver]")])
    with pytest.raises(InputError, match="an external law"):
        load_experiment(folder)


def test_template_and_files_belong_to_the_identity_of_an_experiment(tmp_path):
    folder = write_strip(tmp_path / "strip")
    before = load_experiment(folder).recording.identity
    deck = folder / "strip.deck.template"
    deck.write_text(deck.read_text() + "\n")
    assert load_experiment(folder).recording.identity != before


def test_the_noise_of_a_logged_grip_is_estimated_with_an_external_solver_too(tmp_path):
    """Perturbed runs with the grip shifted in all frames: for a strip that remembers nothing that is exact."""
    folder = write_strip(tmp_path / "strip", grip=", noise_std = 0.0005")
    forward = build_forward(load_experiment(folder))
    last = list(forward.march(forward.model.parameters, ("BODY.E",), influence=True))[-1]
    right = strip_mesh().node_sets["RIGHT"]
    assert last.local_du[right, 0, 0] == pytest.approx(1.0, rel=1e-9)
    assert last.local_dchannels[0, 0] == pytest.approx(1200.0 / 6.0 * 4.0 * 1.5, rel=1e-9)
    assert last.dchannels[0, 0] == pytest.approx(0.12 / 6.0 * 4.0 * 1.5, rel=1e-9) and not last.du.any()
