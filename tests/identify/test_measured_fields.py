"""Parameters from measured fields: a virtual test that another DIC has measured, a RUN from files, a real laminate."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.fe import find_holes, make_mesh
from idic.identification import Plan, identify, start
from idic.run import diagnose_run, identify_run
from idic_studies.cases.case import CaseJob, case_experiment, render, true_values, with_measured_start
from idic_studies.cases.registry import make_study
from idic_studies.cases.store import StudyStore


@pytest.fixture(scope="module")
def measured_by_subsets(tmp_path_factory):
    """Folder and experiment: images of a yielding strip from a finer mesh, measured by a subset DIC."""
    out = tmp_path_factory.mktemp("subsets")
    study, store = make_study("coverage", "sketch"), StudyStore(out)
    case = next(case for case in study.cases if case.group == "fields_grips-ordinary")
    case = replace(case, images="foreign")
    rendering = study.rendering(case.images)
    render(CaseJob(str(out), "coverage", "sketch", rendering.name))
    of_images = replace(case, disturbance=replace(case.disturbance, subsets=()))  # the same noise in the same images
    return out, case_experiment(store, rendering, case), case_experiment(store, rendering, of_images)


def test_parameters_from_fields_are_those_of_the_truth(measured_by_subsets):
    out, experiment, _ = measured_by_subsets
    truth = true_values(out, "foreign")
    found = identify(experiment).result
    assert found["status"] == "converged" and found["noise"]["unit"] == "µm"
    for name, entry in found["parameters"].items():
        if entry["free"]:
            assert abs(entry["value"] - truth[name]) < 4.0 * entry["std"], name
            assert entry["std"] < 0.35 * truth[name], name  # 64 subsets of 17 px


def test_parameters_from_fields_are_those_from_the_images(measured_by_subsets):
    _, of_fields, of_images = measured_by_subsets
    assert of_fields.recording.points is not None and of_images.recording.points is None
    fields, images = (identify(one).result["parameters"] for one in (of_fields, of_images))
    for name, entry in fields.items():
        if entry["free"]:
            std = np.hypot(entry["std"], images[name]["std"])
            assert abs(entry["value"] - images[name]["value"]) < 2.0 * std, name
            assert images[name]["std"] < entry["std"], name  # 64 subsets hold less than all pixels


def test_generalised_least_squares_are_refused(measured_by_subsets):
    _, experiment, _ = measured_by_subsets
    with pytest.raises(InputError, match="generalised least squares"):
        start(replace(experiment, options=replace(experiment.options, estimator="generalised")))


# files --------------------------------------------------------------------------------------------------
E_TRUE, NU_TRUE, WIDTH, HEIGHT, THICKNESS = 70_000.0, 0.3, 12.0, 36.0, 2.0


def write_stages(folder: Path, n: int = 6, sigma_um: float = 0.5, strain_per_stage: float = 4e-4) -> None:
    """ARAMIS stages of a strip in uniform tension, by hand: its motion is affine, so that no mesh is needed."""
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.arange(0.6, WIDTH, 1.2), np.arange(0.6, HEIGHT, 1.2))
    points = np.column_stack([x.ravel(), y.ravel()])
    (folder / "stages").mkdir(parents=True)
    for k in range(n):
        strain = strain_per_stage * k
        force = E_TRUE * strain * WIDTH * THICKNESS + rng.normal(0.0, 3.0)
        at = points + strain * points * [-NU_TRUE, 1.0] + [0.01 * k,
                                                           -0.02 * k] + rng.normal(0.0, 1e-3 * sigma_um, points.shape)
        lines = ["# Units: length:mm angle:deg time:s force:N", f"# Stage: {k}", "stage;index;relative_time;date",
                 f'"{k}";{k};{k}.0;"now"', "# Name : Analog 0", "force;untransformed;transformed",
                 f"{force:.4f};0;{force:.4f}",
                 "# Name : Surface 1", "id;x;y;z", *(f"{i};{a:.5f};{b:.5f};0.0" for i, (a, b) in enumerate(at))]
        (folder / "stages" / f"stage_{k:03d}.csv").write_text("\n".join(lines))


@pytest.fixture(scope="module")
def strip(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("strip")
    write_stages(folder)
    return folder


def run(*arguments: object):
    return CliRunner().invoke(app, [str(word) for word in arguments])


@pytest.fixture(scope="module")
def initialised(strip) -> Path:
    """`idic init`, and what it asks for filled in."""
    assert run("init", strip).exit_code == 0
    file = strip / "experiment.toml"
    text = file.read_text(encoding="utf-8")
    assert 'fields = "stages/*.csv"' in text and 'column = "force"' in text
    margin = "[0.6, 0.6]"
    assert f"around_points_mm = {margin}" in text  # half the distance of the points: as wide as the strip
    assert text.count("\n[[dof]]") == 1 and 'name = "geometry.outline"\nprior = { mean = 0.0, std = 1.2 }' in text
    first = text.index("# facets end half")
    text = text[:first] + text[text.index("# [[dof]]", first):]  # the margin is true
    file.write_text(text.replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 "), encoding="utf-8")
    return strip


def test_init_and_check_read_the_stages(initialised):
    shown = run("check", initialised)
    assert shown.exit_code == 0, shown.output
    assert "points       300 over" in shown.output and "warning" not in shown.output
    there = load_experiment(initialised)
    np.testing.assert_allclose(np.ptp(there.model.mesh.nodes, axis=0), [WIDTH, HEIGHT], atol=2e-3)


def test_a_hole_that_the_points_show_is_round_between_the_corners_of_elements(tmp_path):
    x, y = np.meshgrid(np.arange(0.3, 20.0, 0.6), np.arange(0.3, 30.0, 0.6))
    points = np.column_stack([x.ravel(), y.ravel()])
    points = points[np.hypot(*(points - [10.0, 15.0]).T) > 4.3]
    for k in range(2):
        rows = [f"{a:.4f},{b:.4f},0.0,{1e-3 * k * b:.6f}" for a, b in points]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    (tmp_path / "experiment.toml").write_text("""
[experiment]
fields = "stage_*.csv"
fields_noise_um = 1.0
mesh = { outline_points_mm = 0.3, element_mm = 2 }
kind = "plane_stress"
[material.ALL]
law = "elastic"
E = 1000.0
nu = { value = 0.3, identify = true }
[[boundary]]
nodes = "TOP"
u = "measured"
[[boundary]]
nodes = "BOTTOM"
u = "measured"
""")
    there = load_experiment(tmp_path)
    mesh = there.model.mesh
    assert there.model.outline_share == pytest.approx(0.6 / 12.0, rel=0.1)  # a distance, of the width at the hole
    assert "the narrowest width of 12" in " ".join(there.notes) or "the narrowest width of 11" in " ".join(there.notes)
    rim = mesh.nodes[mesh.node_sets["HOLE1"]]
    centre = np.linalg.lstsq(np.column_stack([2 * rim, np.ones(len(rim))]), (rim**2).sum(axis=1), rcond=None)[0][:2]
    radius = np.hypot(*(rim - centre).T)
    assert radius.mean() == pytest.approx(4.0, abs=0.3)  # half a distance of the points
    assert np.ptp(radius) < 1e-9  # straight edges of 2 mm: 0.12


def test_init_tells_a_notched_shear_test_from_tension(tmp_path):
    """A V-notched specimen along x, sheared evenly; the machine counts compression positive."""
    (tmp_path / "stages").mkdir()
    x, y = np.meshgrid(np.arange(0.3, 40.0, 0.6), np.arange(0.3, 20.0, 0.6))
    points = np.column_stack([x.ravel(), y.ravel()])
    depth = np.maximum(4.0 - np.abs(points[:, 0] - 20.0), 0.0)
    points = points[(points[:, 1] > depth + 0.3) & (points[:, 1] < 19.7 - depth)]
    for k in range(3):
        at = points + 1e-3 * k * np.column_stack([np.zeros(len(points)), -points[:, 0]])
        lines = ["# Units: length:mm time:s force:N", f"# Stage: {k}", "stage;index;relative_time;date",
                 f'"{k}";{k};{k},5;"now"',
                 "# Name : Analog 0", "force;untransformed;transformed", f"{k}00,5;0;{k}00,5", "# Name : Fläche",
                 "id;x;y;z",
                 *(f"{i};{a:.6f};{b:.6f};0.0".replace(".", ",") for i, (a, b) in enumerate(at))]
        (tmp_path / "stages" / f"Fläche {k}.csv").write_text("\n".join(lines), encoding="latin-1")
    assert run("init", tmp_path).exit_code == 0
    text = (tmp_path / "experiment.toml").read_text(encoding="utf-8")
    assert "outline_points_mm = 0.3" in text
    assert 'simulated = { reaction = "RIGHT", component = "y", factor = -1.0 }   # shear' in text
    assert text.count('name = "geometry.outline.EDGE') == text.count("prior = { mean = 0.0, std = 0.6 }") >= 4
    (tmp_path / "experiment.toml").write_text(text.replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 "),
                                              encoding="utf-8")
    there = load_experiment(tmp_path, {"experiment.fields_noise_um": 1.0})
    assert {"LEFT", "RIGHT", "TOP", "BOTTOM"} <= set(there.model.mesh.node_sets)
    area = sum(abs(np.linalg.det(there.model.mesh.nodes[block.connectivity[:, [1, 3 if block.cell.startswith("quad")
                                                                               else 2]]]
                                 - there.model.mesh.nodes[block.connectivity[:, :1]])).sum()
               / (1 if block.cell.startswith("quad") else 2) for block in there.model.mesh.blocks)
    assert area == pytest.approx(40.0 * 20.0 - 2 * 16.0, abs=0.3 * 120.0)  # two notches; edges within half a distance


def test_the_error_bar_counts_a_section_that_the_outline_of_points_leaves_open(initialised, tmp_path):
    """The outline is 7 % too narrow, as where subsets end before the edge: E by the force is as much too large."""
    folder = tmp_path / "narrow"
    shutil.copytree(initialised, folder)
    file = folder / "experiment.toml"
    lines = file.read_text(encoding="utf-8").splitlines()
    k = next(k for k, line in enumerate(lines) if line.startswith("mesh = "))
    lines[k] = "mesh = { outline_points_mm = 0.18, element_mm = 4 }"
    file.write_text("\n".join(lines), encoding="utf-8")
    sure = identify(*with_measured_start(load_experiment(folder))).result["parameters"]["ALL.E"]
    dof = f'[[dof]]\nname = "geometry.thickness"\nvalue = {THICKNESS}\nprior = {{ mean = {THICKNESS}, std = 0.2 }}\n'
    file.write_text("\n".join([*lines, dof]), encoding="utf-8")
    open_ = identify(*with_measured_start(load_experiment(folder))).result["parameters"]["ALL.E"]
    assert sure["value"] == pytest.approx(E_TRUE * WIDTH / 11.16, rel=0.01)
    assert abs(sure["value"] - E_TRUE) > 5.0 * sure["std"]
    assert open_["std"] == pytest.approx(0.1 * open_["value"], rel=0.1)  # a distance of 1.2 mm, of 11.2 mm
    assert abs(open_["value"] - E_TRUE) < open_["std"]


def test_a_round_hole_around_points_is_round_between_its_corners_too(initialised, tmp_path):
    folder = tmp_path / "hole"
    shutil.copytree(initialised, folder)
    text = (folder / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(text.replace("around_points_mm",
                                                         "holes_mm = [[6.0, 18.0, 3.0]], around_points_mm"))
    mesh = load_experiment(folder).model.mesh
    (hole,) = find_holes(mesh)
    np.testing.assert_allclose(np.hypot(*(mesh.nodes[hole.rim] - [6.0, 18.0]).T), 3.0, rtol=1e-9)
    assert len(hole.rim) == 12  # six of them between corners


def test_of_a_long_series_init_keeps_stages_by_strain_and_the_log_follows(tmp_path):
    write_stages(tmp_path, 210, strain_per_stage=2e-5)
    assert run("init", tmp_path).exit_code == 0
    file = tmp_path / "experiment.toml"
    text = file.read_text(encoding="utf-8")
    assert "one each time that the mean strain has changed by" in text
    file.write_text(text.replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 "), encoding="utf-8")
    there = load_experiment(tmp_path)
    assert 50 < there.model.n_frames < 150 and there.recording.labels[0] == "stage_000.csv"
    assert there.recording.labels[-1] == "stage_209.csv"
    kept = [int(label[6:9]) for label in there.recording.labels]
    np.testing.assert_allclose(there.model.times, kept)
    np.testing.assert_allclose(there.model.channels[0].values, E_TRUE * 2e-5 * np.array(kept) * WIDTH * THICKNESS,
                               atol=15.0)
    rows = "\n".join(f"{k},{0.5 * k}" for k in range(210))
    (tmp_path / "log.csv").write_text(f"frame,force_N\n{rows}\n")
    # one row per recorded stage
    own = load_experiment(tmp_path, {"experiment.loads": "log.csv", "channel.0.column": "force_N"})
    np.testing.assert_allclose(own.model.channels[0].values, 0.5 * np.array(kept))


def test_a_run_from_files_ends_with_parameters_and_a_report(initialised, tmp_path):
    out = tmp_path / "run"
    ended = run("identify", initialised, "--out", out, "--no-prefect")
    assert ended.exit_code == 0, ended.output
    found = json.loads((out / "result.json").read_text())
    for name, truth in (("ALL.E", E_TRUE), ("ALL.nu", NU_TRUE)):
        entry = found["parameters"][name]
        assert abs(entry["value"] - truth) < 4.0 * entry["std"] and entry["std"] < 0.04 * truth
    assert found["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.15)
    assert found["noise"]["std_gv"] == pytest.approx(0.5, rel=0.1)
    assert (out / "report.html").exists() and (out / "figures" / "residual_maps.png").exists()


GRIPS = """
[experiment]
fields = "stages/*.csv"
loads = "loads.csv"
mesh = { around_points_mm = [0.6, 0.6], element_mm = 4.0 }
kind = "plane_stress"
thickness_mm = 2.0
[camera]
motion = "free"
[material.ALL]
law = "elastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.35, identify = true }
[sets]
CORNER = { where = "x < 0.1 and y < 0.1" }
[[boundary]]
nodes = "CORNER"
ux = 0.0
[[boundary]]
nodes = "BOTTOM"
uy = 0.0
[[boundary]]
nodes = "TOP"
uy = { column = "grip_mm" }
[[channel]]
column = "force_N"
simulated = { reaction = "TOP", component = "y" }
noise_std = 3.0
"""


@pytest.fixture(scope="module")
def between_grips(strip, tmp_path_factory) -> Path:
    """The strip, which drifts as a whole against the cameras, with the way of the crosshead."""
    folder = tmp_path_factory.mktemp("grips")
    (folder / "stages").symlink_to(strip / "stages")
    rows = [f"{k},{4e-4 * k * HEIGHT},{E_TRUE * 4e-4 * k * WIDTH * THICKNESS}" for k in range(6)]
    (folder / "loads.csv").write_text("\n".join(["frame,grip_mm,force_N", *rows]))
    (folder / "experiment.toml").write_text(GRIPS)
    return folder


def test_grips_by_the_crosshead_with_a_free_rigid_motion_of_the_specimen(between_grips):
    run_ = identify(load_experiment(between_grips))
    found = run_.result
    assert found["status"] == "converged"
    for name, truth in (("ALL.E", E_TRUE), ("ALL.nu", NU_TRUE)):
        entry = found["parameters"][name]
        assert abs(entry["value"] - truth) < 4.0 * entry["std"] and entry["std"] < 0.03 * truth
    fixed = identify(load_experiment(between_grips, {"camera": {}}))  # the drift of 100 µm is then a misfit
    assert fixed.point.system.phi_image > 100.0 * run_.point.system.phi_image


def test_a_free_rigid_motion_next_to_a_measured_side_is_refused(between_grips):
    with pytest.raises(InputError, match="next to a measured side"):
        load_experiment(between_grips, {"boundary.2.uy": "measured"})


def test_design_of_a_recorded_field_predicts_its_error_bars(initialised):
    plan = Plan.of(initialised)
    assert plan.experiment.recording.points is not None and plan.pattern == "measured fields"
    assert plan.experiment.model.channels[0].values.max() == pytest.approx(E_TRUE * 2e-3 * WIDTH * THICKNESS, rel=1e-3)


BRICK = """
[experiment]
fields = "stages/*.csv"
mesh = "brick.inp"
kind = "solid"
surface = "FRONT"
[material.ALL]
law = "elastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.35, identify = true }
[sets]
LOW = { where = "y < 0.01" }
HIGH = { where = "y > 35.99" }
CORNER = { where = "x < 0.01 and y < 0.01 and z < 0.01" }
EDGE = { where = "x < 0.01 and y < 0.01" }
[camera]
motion = "free"
[[boundary]]
nodes = "CORNER"
ux = 0.0
uz = 0.0
[[boundary]]
nodes = "EDGE"
ux = 0.0
[[boundary]]
nodes = "LOW"
uy = 0.0
[[boundary]]
nodes = "HIGH"
uy = { column = "grip_mm" }
[[channel]]
column = "force_N"
simulated = { reaction = "HIGH", component = "y" }
noise_std = 3.0
"""


def test_the_surface_of_a_solid_is_compared_with_the_points(between_grips, tmp_path):
    """The same strip as a body of hexahedra that is free to thin."""
    (tmp_path / "stages").symlink_to(between_grips / "stages")
    text = BRICK.replace('fields = "stages/*.csv"', 'fields = "stages/*.csv"\nloads = "loads.csv"')
    shutil.copy(between_grips / "loads.csv", tmp_path / "loads.csv")
    body = brick(3, 6, 1)
    nodes = body.nodes * [WIDTH / 3, HEIGHT / 6, THICKNESS]
    lines = ["*NODE", *(f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(nodes, 1)),
             "*ELEMENT, TYPE=C3D8, ELSET=ALL",
             *(f"{k}, " + ", ".join(str(n + 1) for n in row) for k, row in enumerate(body.blocks[0].connectivity, 1)),
             "*SURFACE, NAME=FRONT", "ALL, S2"]
    (tmp_path / "brick.inp").write_text("\n".join(lines) + "\n")
    (tmp_path / "experiment.toml").write_text(text)
    found = identify(load_experiment(tmp_path)).result
    assert found["status"] == "converged"
    for name, truth in (("ALL.E", E_TRUE), ("ALL.nu", NU_TRUE)):
        entry = found["parameters"][name]
        assert abs(entry["value"] - truth) < 4.0 * entry["std"] and entry["std"] < 0.03 * truth


def brick(nx: int, ny: int, nz: int):
    """Hexahedra with edges of 1."""
    i, j, k = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), np.arange(nz + 1), indexing="ij")
    number = np.arange(i.size).reshape(i.shape)
    low, high = slice(0, -1), slice(1, None)
    places = [(low, low, low), (high, low, low), (high, high, low), (low, high, low)]
    places += [(a, b, high) for a, b, _ in places]
    nodes = np.stack([i, j, k], axis=-1).reshape(-1, 3).astype(float)
    return make_mesh(nodes, [("hex8", np.stack([number[at].ravel() for at in places], axis=1))])


def _half_written(stages: Path) -> None:
    (stages / "stage_004.csv").write_text((stages / "stage_004.csv").read_text()[:-9])


def _more_columns(stages: Path) -> None:
    head, rows = (stages / "stage_004.csv").read_text().split("id;x;y;z\n")
    (stages / "stage_004.csv").write_text(head + "id;x;y;z\n" + rows.replace("\n", ";0.0\n") + ";0.0")


def _no_force(stages: Path) -> None:
    lines = (stages / "stage_004.csv").read_text().splitlines()
    (stages / "stage_004.csv").write_text("\n".join([*lines[:4], *lines[7:]]))


def _a_point_twice(stages: Path) -> None:
    text = (stages / "stage_004.csv").read_text()
    (stages / "stage_004.csv").write_text(text + "\n" + text.splitlines()[-1])


def _another_specimen(stages: Path) -> None:
    head, rows = (stages / "stage_004.csv").read_text().split("id;x;y;z\n")
    (stages / "stage_004.csv").write_text(head + "id;x;y;z\n" + "\n".join(f"9{row}" for row in rows.splitlines()))


@pytest.mark.parametrize("spoil", [_half_written, _more_columns, _no_force, _a_point_twice, _another_specimen])
def test_a_bad_stage_ends_with_code_2_one_message_and_nothing_written(initialised, tmp_path, spoil):
    folder = tmp_path / "bad"
    shutil.copytree(initialised, folder)
    spoil(folder / "stages")
    before = sorted(path.relative_to(folder) for path in folder.rglob("*"))
    ended = run("identify", folder, "--out", tmp_path / "run", "--no-prefect")
    assert ended.exit_code == 2 and not (tmp_path / "run").exists()
    assert "stage_004.csv" in ended.output and ended.output.count("what to do:") == 1
    assert sorted(path.relative_to(folder) for path in folder.rglob("*")) == before


@pytest.mark.parametrize("change, message", [
    (("[experiment]", '[experiment]\nimages = "x/*.tif"'), "images and fields"),
    (("[experiment]", '[experiment]\nmask = "mask.png"'), "a key of images"),
    (('kind = "plane_stress"', 'kind = "solid"'), "without the surface"),
    (("[[boundary]]\nnodes = \"TOP\"", "[options]\nlowpass_px = 1.0\n[[boundary]]\nnodes = \"TOP\""),
     "an option of images"),
    (("mesh = { around_points_mm = [0.6, 0.6]", "mesh = { roi_px = [0, 0, 5, 5], around_points_mm = [0.6, 0.6]"),
     "mesh"),
    (('kind = "plane_stress"', 'kind = "plane_stress"\nmesh_unit = "px"'), "by pixel_size_mm, leave mesh_unit out"),
])
def test_keys_that_do_not_go_with_fields_are_refused(initialised, tmp_path, change, message):
    text = (initialised / "experiment.toml").read_text(encoding="utf-8")
    assert change[0] in text
    (tmp_path / "stages").symlink_to(initialised / "stages")
    (tmp_path / "experiment.toml").write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_experiment(tmp_path)


@pytest.mark.parametrize("corner, message", [
    ([200.0, 600.0], "it is 16.7 times as large as the field (of a mesh in px multiply every length by pixel_size_mm)"),
    ([0.5, 1.5], "the field, which is 24.0 times as large as the mesh: pixel_size_mm"),
    ([10.0, 30.0], "check origin_mm, axes, mesh_unit, and pixel_size_mm")])
def test_a_mesh_off_the_points_tells_which_scale_to_check(initialised, tmp_path, corner, message):
    text = (initialised / "experiment.toml").read_text(encoding="utf-8")
    (w, h), (x, y) = corner, (100.0, 100.0)
    mesh = f"outline_mm = {[[x, y], [x + w, y], [x + w, y + h], [x, y + h]]}, element_mm = {w / 4}"
    changed = re.sub(r"around_points_mm = [^}]*", mesh, text)
    assert changed != text
    (tmp_path / "stages").symlink_to(initialised / "stages")
    (tmp_path / "experiment.toml").write_text(changed, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)) as error:
        load_experiment(tmp_path)
    assert "outside the measured points" in error.value.what


LAMINATE = """
[experiment]
fields = "stages/*.csv"
mesh = { around_points_mm = [0.98, 0.7], element_mm = 6.0 }
kind = "plane_stress"
thickness_mm = 1.89
exclude_frames = ["Flächenkomponente 1_0886.csv"]
[material.ALL]
law = "orthotropic"
E1 = { value = 50e3, unit = "MPa", identify = true }
E2 = { value = 50e3, unit = "MPa" }
nu12 = { value = 0.1, identify = true }
G12 = { value = 4e3, unit = "MPa" }
angle = 90.0
[[boundary]]
nodes = "TOP"
u = "measured"
[[boundary]]
nodes = "BOTTOM"
u = "measured"
[[channel]]
column = "force"
simulated = { reaction = "TOP", component = "y" }
"""


def test_a_real_laminate(shared_data, tmp_path):
    """Public course data; by hand the slope of stress over mean strain is 54 to 61 GPa, nu about 0.05."""
    stages = shared_data("laminate-tension-0") / "stages"
    (tmp_path / "stages").symlink_to(stages)
    (tmp_path / "experiment.toml").write_text(LAMINATE, encoding="utf-8")
    experiment, local = with_measured_start(load_experiment(tmp_path))
    found = identify(experiment, local).result["parameters"]
    E1, nu = found["ALL.E1"], found["ALL.nu12"]
    assert 54e3 < E1["value"] < 61e3 and 0.03 < nu["value"] < 0.07
    assert E1["std"] > 1e3  # the law is linear, the laminate is not: the noise alone (50 MPa) is not the uncertainty
    assert E1["ci95"][0] < 57.5e3 < E1["ci95"][1]


@pytest.mark.slow
def test_what_a_real_laminate_conceals_is_told_as_a_set(shared_data, tmp_path):
    """A uniform strip: fibres that stiffen and a load cell that bends give the same force over motion. Without either
    E1 is the slope of a chord; that of the tangent at no load is 55 to 59 GPa by hand."""
    (tmp_path / "stages").symlink_to(shared_data("laminate-tension-0") / "stages")
    (tmp_path / "experiment.toml").write_text(LAMINATE, encoding="utf-8")
    identify_run(tmp_path, tmp_path / "run")
    content = diagnose_run(tmp_path / "run")
    assert content["verdict"] == "set"
    assert content["indistinguishable"] == [["fibre_stiffening", "load_cell_curvature"]]
    E1 = content["model"]["parameters_after"]["ALL.E1"]
    assert 55e3 < E1["value"] < 59e3 and E1["std"] > 1e3
    assert "load cell" in content["next_experiment"]


def test_a_mesh_file_with_axes_of_its_own_is_laid_onto_the_points(strip, initialised, tmp_path):
    """Shifted and turned by 20 degrees, with bars of quadrangles; its sets come with it."""
    (tmp_path / "stages").symlink_to(strip / "stages")
    turn = np.radians(-20.0)
    x, y = np.meshgrid(np.linspace(0.0, WIDTH, 7), np.linspace(0.0, HEIGHT, 19))
    flat = np.column_stack([x.ravel(), y.ravel()])
    nodes = (flat - [40.0, 5.0]) @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]).T
    number = np.arange(1, len(flat) + 1).reshape(19, 7)
    cells = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    lines = ["*NODE", *(f"{k}, {a}, {b}" for k, (a, b) in enumerate(nodes, 1)), "*ELEMENT, TYPE=CPS4, ELSET=ALL",
             *(f"{k}, " + ", ".join(map(str, row)) for k, row in enumerate(cells, 1)),
             "*NSET, NSET=TOP", ", ".join(map(str, number[-1])), "*NSET, NSET=BOTTOM", ", ".join(map(str, number[0]))]
    (tmp_path / "strip.inp").write_text("\n".join(lines) + "\n")
    ends = "\n".join(f'[[boundary]]\nnodes = "{name}"\nu = "measured"' for name in ("TOP", "BOTTOM"))
    (tmp_path / "experiment.toml").write_text(f"""
[experiment]
fields = "stages/*.csv"
mesh = "strip.inp"
kind = "plane_stress"
thickness_mm = 2.0
[camera]
placement = "outline"
[material.ALL]
law = "elastic"
E = {{ value = 60e3, unit = "MPa", identify = true }}
nu = {{ value = 0.35, identify = true }}
{ends}
[[channel]]
column = "force"
simulated = {{ reaction = "TOP", component = "y", factor = 0.93969 }}
""")
    there = load_experiment(tmp_path)
    place = there.model.camera.project(nodes)
    grid = (flat - [0.6, HEIGHT - 0.6]) / 1.2 * [1.0, -1.0]  # of the points; the first one is 0.6 mm from the left edge
    np.testing.assert_allclose(place, grid, atol=0.3)  # distances of neighbours
    assert "turned by 180°" in next(note for note in there.notes if "outline" in note)
    with pytest.raises(InputError, match="placement by the outline"):
        load_experiment(initialised, {"camera.placement": "outline"})  # its mesh is made of the points
