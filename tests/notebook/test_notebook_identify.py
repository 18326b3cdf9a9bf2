"""An identification from arrays: in memory the numbers of a RUN, and what a result gives."""

import re
import shutil
import sys
import tomllib
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import arrays
import numpy as np
import pytest

import idic
from idic.errors import InputError
from idic.notebook.optional import optional
from idic.parameters import ParameterSet
from idic.report.tables import frames
from idic.run.reporting.write import load_record

sys.path.insert(0, str(Path(__file__).parents[1] / "twins"))

import camera_twin  # noqa: E402

EYES = [camera_twin.LEFT_EYE, camera_twin.RIGHT_EYE]


@pytest.fixture(scope="module")
def experiment():
    return idic.Experiment(**arrays.recorded().tables())


@pytest.fixture(scope="module")
def in_memory(experiment):
    return idic.identify(experiment)


@pytest.fixture(scope="module")
def run(experiment, tmp_path_factory):
    return tmp_path_factory.mktemp("notebook") / "run"


@pytest.fixture(scope="module")
def from_run(experiment, run):
    return idic.identify(experiment, run)


def test_the_truth_lies_within_four_standard_deviations(in_memory):
    """The images come from another, finer mesh; 4: two parameters, and E 0.1 % too low by the mesh of the user."""
    assert in_memory.converged and set(in_memory.determined) == set(arrays.TRUTH)
    for name, truth in arrays.TRUTH.items():
        estimate = in_memory.parameters[name]
        assert 0.0 < estimate.std < 0.05 * truth and abs(estimate.value - truth) < 4.0 * estimate.std
        assert estimate.ci95 == pytest.approx((estimate.value - 1.96 * estimate.std,
                                               estimate.value + 1.96 * estimate.std))
    assert in_memory.parameters["sheet.E"].unit == "MPa" and in_memory.parameters["sheet.E"].start == 60e3
    assert in_memory["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.03)  # 8000 pixels in 3 frames: 0.01
    assert [frame["status"] for frame in in_memory["frames"]] == ["ok"] * 4


def test_a_field_of_the_stiffness_is_even_where_the_sheet_is(in_memory, from_run):
    field = in_memory.stiffness_field("sheet", spacing_mm=2.0, length_mm=3.0)
    assert field.converged and len(field.factor) == len(field.places) > 20
    assert np.abs(np.log(field.factor)).max() < 4.0 * field.std.max() and (field.std < 0.3).all()
    with pytest.raises(InputError, match="no identification of this process"):
        from_run.stiffness_field("sheet", 2.0, 3.0)


def test_a_run_folder_gives_the_numbers_of_the_memory(in_memory, from_run, run):
    """To the 9 digits of the coordinates in the mesh file that the run reads."""
    for name, estimate in in_memory.parameters.items():
        other = from_run.parameters[name]
        assert abs(other.value - estimate.value) < 1e-5 * estimate.std and other.unit == estimate.unit
        assert other.std == pytest.approx(estimate.std, rel=1e-5)
        assert other.std_model == pytest.approx(estimate.std_model, rel=1e-3, abs=1e-9 * estimate.value)
    np.testing.assert_allclose(from_run.covariance, in_memory.covariance, rtol=1e-4)
    for key in ("image_rms_gv", "image_chi2_dof"):
        assert from_run["residual"][key] == pytest.approx(in_memory["residual"][key], rel=1e-5)
    shared = {"schema", "status", "title", "iterations", "noise", "notes", "derived", "not_identifiable", "has_force"}
    assert shared <= set(in_memory.content) <= set(from_run.content)
    for frame in (1, -1):
        np.testing.assert_allclose(from_run.fields.u(frame), in_memory.fields.u(frame), atol=1e-8)
        np.testing.assert_allclose(from_run.fields.residual(frame), in_memory.fields.residual(frame), atol=1e-3)  # GV
    np.testing.assert_allclose(from_run.fields.simulated, in_memory.fields.simulated, atol=1e-3)  # N
    assert (from_run.fields.measured == in_memory.fields.measured).all()


def test_a_run_is_loaded_and_resumed_as_any_other(experiment, from_run, run):
    assert idic.load_result(run).content == from_run.content
    assert idic.identify(experiment, run, resume=True).content == from_run.content
    assert idic.identify(str(run / "experiment-from-python"), run, resume=True).content == from_run.content
    with pytest.raises(InputError, match="exists already"):
        idic.identify(experiment, run)


def test_a_run_that_was_moved_takes_its_saved_experiment_along(from_run, run, tmp_path):
    moved = shutil.copytree(run, tmp_path / "elsewhere", symlinks=True)
    hidden = run.rename(run.with_name("hidden"))
    try:
        assert load_record(moved).result["parameters"] == from_run["parameters"]
    finally:
        hidden.rename(run)


def test_a_channel_in_kN_is_told_in_kN(in_memory, tmp_path):
    """Noise, residual, note, table and figure have the unit that the column names; the numbers are those of N."""
    loads = arrays.recorded().loads
    tables = arrays.recorded().tables(
        loads={"grip_mm": loads["grip_mm"], "force_kN": loads["force_N"] / 1e3, "time_s": 1.7e9 + np.arange(4) / 8},
        channels=[{"column": "force_kN", "simulated": {"reaction": "RIGHT", "component": "x"},
                   "noise_std": arrays.FORCE_NOISE / 1e3}])
    result = idic.identify(idic.Experiment(**tables), tmp_path / "run")
    for key, size in (("channel_rms", 1e3), ("channel_noise_std", 1e3), ("channel_chi2_dof", 1.0)):
        there = in_memory["residual"][key]["force_N"] / size
        assert result["residual"][key]["force_kN"] == pytest.approx(there, rel=1e-3)  # the start differs
    record = load_record(tmp_path / "run")
    assert "Noise of force_kN: 0.005 kN, as given in the experiment file." in record.notes
    rows = [line.split(",") for line in frames(record).splitlines()]
    read = [float(row[rows[0].index("force_kN_measured")]) for row in rows[1:]]
    np.testing.assert_allclose(read, loads["force_N"] / 1e3, rtol=1e-9)  # 10 digits
    assert [row[rows[0].index("time_[s]")] for row in rows[1:]] == ["1700000000", "1700000000.125", "1700000000.25",
                                                                    "1700000000.375"]
    labels = [axis.get_ylabel() for axis in result.plot.channels().axes]
    assert labels == ["force [kN]", "difference [kN]"]
    if find_spec("xarray"):
        data = result.to_xarray(residual=False)
        np.testing.assert_allclose(data.measured.sel(channel="force_kN"), loads["force_N"] / 1e3, rtol=1e-12)
        np.testing.assert_allclose(data.simulated[:, 0], result.fields.simulated[:, 0] / 1e3, rtol=1e-12)
        assert data.channel_units.values.tolist() == ["kN"]


@pytest.mark.slow  # a further case of the bits in memory and on disk
def test_the_same_numbers_with_a_measured_edge_and_noise_that_nobody_knows(tmp_path):
    """Both begin with a free FE-DIC."""
    tables = arrays.recorded().tables(
        camera={"pixel_size_mm": arrays.PIXEL, "origin_px": arrays.ORIGIN},
        boundaries=[{"nodes": "LEFT", "ux": 0.0, "uy": 0.0}, {"nodes": "RIGHT", "ux": "measured", "uy": 0.0}])
    experiment = idic.Experiment(**tables)
    here, there = idic.identify(experiment), idic.identify(experiment, tmp_path / "run")
    assert here["noise"]["source"] == there["noise"]["source"] == "residual_of_free_dic"
    assert here["noise"]["std_gv"] == pytest.approx(there["noise"]["std_gv"], rel=1e-6)
    of_noise = 2e-6  # chi2 is divided by the square of the noise, whose bound is 1e-6
    assert here["residual"]["free_dic_chi2_dof"] == pytest.approx(there["residual"]["free_dic_chi2_dof"], rel=of_noise)
    for name, estimate in here.parameters.items():
        assert abs(there.parameters[name].value - estimate.value) < 1e-3 * estimate.std
        assert abs(estimate.value - arrays.TRUTH[name]) < 4.0 * estimate.std


def test_the_parameters_are_a_table(in_memory):
    pytest.importorskip("pandas")
    frame = in_memory.to_frame()
    assert list(frame.index) == list(in_memory.parameters) and frame.index.name == "parameter"
    assert frame.loc["sheet.E", "std"] == in_memory.parameters["sheet.E"].std
    assert frame.loc["sheet.E", "unit"] == "MPa" and bool(frame.loc["sheet.nu", "free"])
    assert (frame["ci95_low"] < frame["value"]).all() and (frame["value"] < frame["ci95_high"]).all()


def test_a_locked_parameter_has_no_standard_deviation(experiment):
    pytest.importorskip("pandas")
    result = idic.identify(experiment, overrides={"sheet.nu.identify": False, "sheet.nu.value": 0.3})
    assert result.parameters["sheet.nu"].std is None and not result.parameters["sheet.nu"].free
    assert result.determined == ("sheet.E",) and "sheet.nu = 0.3  (locked)" in repr(result.parameters)
    assert np.isnan(result.to_frame().loc["sheet.nu", "std"])


def test_a_notebook_shows_the_result(in_memory):
    page = in_memory._repr_html_()
    assert "sheet.E" in page and "Converged in" in page and "GPa" in page
    assert "converged" in repr(in_memory) and "sheet.nu" in repr(in_memory)


def test_identify_is_a_function_and_a_package_whatever_was_imported_first(experiment):
    from idic.identification import start

    assert start(experiment.record).status == "running" and callable(idic.identify)
    with pytest.raises(InputError, match="without a RUN folder") as told:
        idic.identify(experiment, workers=2)
    assert "out=" in told.value.remedy
    with pytest.raises(InputError, match="not an experiment") as told:
        idic.identify([experiment, experiment])
    assert "out=run" in told.value.remedy


def test_a_simulation_that_fails_is_told_and_has_no_fields(experiment):
    """The grip goes through the other one; a few elements show it as well."""
    loads = arrays.recorded().loads | {"grip_mm": -30.0 * np.arange(4)}
    law = {"law": "neo_hookean", "C10": {"value": 1.0, "unit": "MPa", "identify": True}, "kappa": 10.0}
    coarse = {"roi_px": [10, 10, 120, 85], "element_px": 40}
    result = idic.identify(idic.Experiment(**arrays.recorded().tables(mesh=coarse, loads=loads,
                                                                      materials={"sheet": law})))
    assert result.status == "forward_failed" and "no equilibrium" in repr(result)
    assert "no equilibrium" in result._repr_html_()
    assert result.determined == () and result.parameters["sheet.C10"].std is None
    tables = (result.to_xarray,) if find_spec("xarray") else ()
    for show in (result.plot.residual, result.plot.channels, lambda: result.fields.u(-1), *tables):
        with pytest.raises(InputError, match="no field to show") as told:
            show()
        assert "no equilibrium" in told.value.found
    with pytest.raises(InputError, match="does not determine"):
        result.plot.corner()


def test_a_law_with_start_values_is_searched_first_and_the_result_names_the_start_that_was_given(experiment):
    """As laws of polymers have them; here E was given them, and a start of 40 times its value."""
    far = experiment.changed({"sheet.E": 2.8e6})
    far.record = replace(far.record, model=replace(far.record.model, parameters=ParameterSet(
        replace(p, start_values=(1e4, 6e4, 3e5)) if p.name == "sheet.E" else p for p in far.parameters.values())))
    said = []
    result = idic.identify(far, say=said.append)
    assert said[0].startswith("search 1: start") and any(line.startswith("evaluation   0") for line in said)
    assert result.parameters["sheet.E"].start == 2.8e6
    assert abs(result.parameters["sheet.E"].value - arrays.TRUTH["sheet.E"]) < 4.0 * result.parameters["sheet.E"].std


def test_two_cameras_give_the_same_bits_in_memory_and_in_a_run(tmp_path):
    """The second camera's images stay paths below `folder`; they are saved with the rest."""
    folder = camera_twin.write_folder(tmp_path / "test", EYES, camera_twin.clean_views(EYES)).parent
    tables = tomllib.loads((folder / "experiment.toml").read_text())
    experiment = idic.Experiment(
        images=folder / "images", mesh=folder / "mesh.inp", loads=folder / "loads.csv", kind="plane_stress",
        thickness_mm=1.0, mesh_unit="mm", camera=tables["camera"], materials=tables["material"],
        boundaries=tables["boundary"], folder=folder)
    here, there = idic.identify(experiment), idic.identify(experiment, tmp_path / "run")
    assert set(here["cameras"]) == {"camera", "behind"}
    saved = tmp_path / "run" / "experiment-from-python"
    # no second copy
    assert (saved / "images" / "frame_000.tif").resolve() == (folder / "images" / "frame_000.tif").resolve()
    for key in ("cameras", "parameters", "correlation", "noise", "discrepancy"):
        assert here[key] == there[key]
    assert here["residual"].items() <= there["residual"].items()  # a run also looks for clusters
    for name, truth in camera_twin.TRUTH.items():
        found = here.parameters[f"{name}.E"]
        assert abs(found.value - truth) < 3.0 * found.std


def test_every_evaluated_point_is_told(experiment):
    said = []
    idic.identify(experiment, overrides={"options.max_iterations": 1}, say=said.append)
    assert said[0].startswith("evaluation   0") and said[-1] == "max_iterations"


def test_a_frame_that_is_not_there_is_refused(in_memory):
    for frame in (4, -5):
        with pytest.raises(InputError, match="no such frame"):
            in_memory.fields.u(frame)
    with pytest.raises(InputError, match="no such frame"):
        in_memory.fields.residual(0)  # the reference has no residual


def test_a_missing_package_is_named_with_the_command_that_installs_it():
    with pytest.raises(InputError, match="a_package_of_notebooks is not installed") as told:
        optional("a_package_of_notebooks")
    assert "idic[notebook]" in told.value.remedy


def test_the_page_on_python_runs_as_it_is_printed():
    """docs/python.md: its code, and the values below the first block."""
    page = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
    code, free, further, flow = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    (printed,) = re.findall(r"^```text\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    data = arrays.recorded()
    names = {"images": data.images, "mesh": data.mesh, "loads": data.loads}
    exec(compile(code, "docs/python.md", "exec"), names)
    assert repr(names["result"].parameters) == printed.strip()
    exec(compile(free, "docs/python.md", "exec"), names)
    assert names["motion"].status == ["ok"] * len(data.images)
    pytest.importorskip("xarray")
    exec(compile(further, "docs/python.md", "exec"), names)
    exec(compile(flow, "docs/python.md", "exec"), names)
    assert names["overnight"].name == "overnight" and callable(names["idic"].flow.identify)
