"""Lists of runs and random starts: what is accepted, what is refused, how runs are named."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest

from idic.errors import InputError
from idic.parameters import Parameter
from idic.run import batch_runs
from idic.parameters import drawn_start


@pytest.fixture(scope="module")
def top(strips, tmp_path_factory):
    """Two experiments, side by side, the other one without its files."""
    top = tmp_path_factory.mktemp("top")
    shutil.copytree(strips / "strip", top / "strip")
    (top / "other strip").mkdir()
    shutil.copy(top / "strip" / "experiment.toml", top / "other strip")
    return top


def write(top, name, text):
    (top / name).write_text(text)
    return top / name


def test_a_toml_list_gives_runs_with_common_and_own_settings(top):
    file = write(top, "list.toml", """
        set = { "options.max_iterations" = 9, "sheet.nu" = 0.3 }
        [[run]]
        experiment = "strip"
        [[run]]
        experiment = "strip"
        name = "stiff"
        set = { "sheet.E" = 80e3, "sheet.nu" = 0.4 }
        """)
    plain, stiff = batch_runs([file], {"sheet.nu": "0.2", "options.lowpass_px": "0"})
    assert (plain.name, stiff.name) == ("strip", "stiff")
    assert plain.experiment == stiff.experiment == str(top / "strip" / "experiment.toml")
    assert plain.overrides == {"sheet.nu": 0.3, "options.lowpass_px": "0", "options.max_iterations": 9}
    assert stiff.overrides["sheet.E"] == 80e3 and stiff.overrides["sheet.nu"] == 0.4


def test_a_csv_list_says_the_same_and_an_empty_cell_is_no_setting(top):
    file = write(top, "list.csv", "\ufeffexperiment,name,sheet.E\nstrip,soft,60e3\n\nother strip,,\n")
    soft, other = batch_runs([file])
    assert (soft.name, dict(soft.overrides)) == ("soft", {"sheet.E": "60e3"})
    assert (other.name, dict(other.overrides)) == ("other_strip", {})


def test_experiments_and_lists_mix_and_no_name_is_used_twice(top):
    file = write(top, "mix.csv", "experiment,name\nstrip,strip-2\n")
    names = [run.name for run in batch_runs([top / "strip", top / "strip" / "experiment.toml", file, top / "strip"])]
    assert names == ["strip", "strip-3", "strip-2", "strip-4"]


@pytest.mark.parametrize("text, words", [
    ('run = 3', "not a list of runs"),
    ('[[run]]\nname = "a"', "without an experiment"),
    ('[[run]]\nexperiment = "strip"\nnmae = "a"', "unknown key"),
    ('[[run]]\nexperiment = "strip"\nset = 3', "not a table of settings"),
    ('[[run]]\nexperiment = "nowhere"', "no such experiment"),
    ('[[run]]\nexperiment = "strip"\nname = "a"\n[[run]]\nexperiment = "strip"\nname = "A"', "two runs of one name"),
    ('run = []', "empty batch"), ('[[run', "not valid TOML")])
def test_a_list_that_is_not_one_is_refused(top, text, words):
    with pytest.raises(InputError, match=words):
        batch_runs([write(top, "bad.toml", text)])


@pytest.mark.parametrize("name", ["../outside", "a/b", "..", "/tmp/x", "-x", ".hidden", "a\\b", "x" * 200])
def test_a_name_that_would_leave_the_folder_is_refused(top, name):
    with pytest.raises(InputError, match="not a usable name"):
        batch_runs([write(top, "bad.csv", f'experiment,name\nstrip,"{name}"\n')])


@pytest.mark.parametrize("text, words", [("", "no usable header"), ("name,sheet.E\na,1\n", "no usable header"),
                                         ("experiment,a,a\n", "no usable header"),
                                         ("experiment\nstrip,1,2\n", "more cells"),
                                         ("name,experiment\nsoft\n", "row 2: a run without an experiment")])
def test_a_table_that_is_none_is_refused(top, text, words):
    with pytest.raises(InputError, match=words):
        batch_runs([write(top, "bad.csv", text)])


# starts ---------------------------------------------------------------------------------------------
def test_starts_vary_free_parameters_only_and_can_be_repeated(top):
    runs = batch_runs([top / "strip"], {"material.sheet.nu.identify": "false"}, 4, 0.3, seed=5)
    assert [run.name for run in runs] == [f"strip-start{k:02d}" for k in range(4)]
    changed = {"sheet.E", "sheet.yield_stress", "sheet.hardening_modulus"}
    assert all(set(run.overrides) == changed | {"material.sheet.nu.identify"} for run in runs)
    more = batch_runs([top / "strip"], {"material.sheet.nu.identify": "false"}, 9, 0.3, seed=5)
    assert [run.overrides for run in more[:4]] == [run.overrides for run in runs], "start k does not depend on N"
    assert len({run.overrides["sheet.E"] for run in more}) == 9


def test_a_start_is_log_uniform_around_the_value_and_inside_the_bounds():
    modulus = Parameter("A.E", 70e3, "GPa", True, (0.0, 80e3), transform="log", factor=1e3)
    starts = [drawn_start(modulus, 0.3, place) for place in np.linspace(0.0, 1.0, 101)]
    assert starts[0] > 70.0 / 1.3 and starts[-1] < 80.0
    gaps = np.diff(np.log(starts))
    assert np.allclose(gaps, gaps[0], rtol=1e-4), "even on a log scale (eight digits are kept)"
    angle = Parameter("camera.rotation_deg", 0.0, "deg", True, (-math.inf, math.inf), transform="linear", scale=10.0)
    assert drawn_start(angle, 0.3, 0.5) == 0.0
    assert 0.0 < drawn_start(angle, 0.3, 1.0) <= 3.0


def test_an_experiment_that_cannot_be_read_stays_one_run(top, tmp_path):
    text = (top / "strip" / "experiment.toml").read_text().replace('images = "images/*.tif"', 'images = "none/*.tif"')
    (tmp_path / "experiment.toml").write_text(text)
    runs = batch_runs([tmp_path, top / "strip"], None, 2, 0.3)
    assert [run.name for run in runs] == [tmp_path.name, "strip-start00", "strip-start01"]


@pytest.mark.parametrize("starts, spread, words",
                         [(2, 0.0, "--spread"), (2, math.nan, "--spread"), (0, 0.3, "--starts")])
def test_numbers_that_are_no_starts_are_refused(top, starts, spread, words):
    with pytest.raises(InputError, match=words):
        batch_runs([top / "strip"], None, starts, spread)


def test_starts_of_nothing_free_are_refused(top):
    locked = {f"material.sheet.{name}.identify": "false" for name in ("E", "nu", "yield_stress", "hardening_modulus")}
    with pytest.raises(InputError, match="no start value to vary"):
        batch_runs([top / "strip"], locked, 2, 0.3)
