"""A plan of the page becomes the experiment.toml that a person could write, and nothing else is written."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drawn_folder import make_folder, plan  # noqa: E402

from idic.draw.desk import Desk  # noqa: E402
from idic.draw.document import KEPT, drawn_before  # noqa: E402
from idic.draw.folder import run_folder  # noqa: E402
from idic.draw import list_folder  # noqa: E402
from idic.draw.watch import next_name, state_of  # noqa: E402
from idic.errors import InputError  # noqa: E402
from idic.experiment_file import load_experiment  # noqa: E402
from idic.run.store.result_file import write_result  # noqa: E402
from idic.run import run_lock  # noqa: E402

TYPED = """
[experiment]
title = 'strip "A"'
images = "images/*.tif"
loads = "loads.csv"
kind = "plane_stress"
thickness_mm = 2.0
mesh.outline_px = [[22, 32], [218, 32], [212, 80, 218, 128], [22, 128]]
mesh.holes_px = [[120, 80, 15]]
mesh.element_px = 16
mesh.edge_names = { LEFT = [4], RIGHT = [2] }
[camera]
pixel_size_mm = 0.1
origin_px = [22, 128]
axes = ["+col", "-row"]
[material.SPECIMEN]
law = "elastic"
E = { value = 70e3, unit = "MPa", identify = true }
nu = { value = 0.3, identify = true }
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = { column = "grip_displacement_mm" }
uy = 0.0
[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
"""


@pytest.fixture
def desk(tmp_path):
    return Desk(make_folder(tmp_path / "test"))


def content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_page_writes_the_experiment_that_a_person_types(desk, tmp_path):
    found = desk.write(plan(), replace=False)
    drawn = load_experiment(desk.folder)
    typed = make_folder(tmp_path / "typed")
    (typed / "experiment.toml").write_text(TYPED)
    other = load_experiment(typed)
    assert np.array_equal(drawn.model.mesh.nodes,
                          other.model.mesh.nodes) and drawn.model.parameters == other.model.parameters
    assert [sorted(drawn.model.mesh.node_sets)] == [sorted(other.model.mesh.node_sets)]
    assert repr(drawn.model.prescribed) == repr(other.model.prescribed) and drawn.title == other.title
    assert any(line.startswith("mesh ") for line in found["lines"])
    assert found["toml"] == (desk.folder / "experiment.toml").read_text()


@pytest.mark.parametrize("edge", ["HOLE1", "LEFT"])
def test_a_pressure_of_the_log_acts_on_an_edge_or_a_hole(desk, edge):
    loaded = {edge: {"kind": "pressure", "column": "p_bar"}, "RIGHT": {"kind": "fixed"}}
    desk.write(plan(motions=loaded, pixel_size_mm=None, thickness_mm=None, force=None), replace=False)
    load, = load_experiment(desk.folder).model.loads
    assert (load.kind, load.edges, load.follower) == ("pressure", edge, True)
    assert load.drive.values == pytest.approx([0.0, 0.2, 0.4])  # MPa; its log is in bar


def test_nothing_but_experiment_toml_is_written(desk):
    before = content(desk.folder)
    desk.write(plan(), replace=False)
    after = content(desk.folder)
    assert set(after) - set(before) == {"experiment.toml"} and all(after[name] == before[name] for name in before)


def test_an_earlier_experiment_is_kept_and_only_replaced_where_the_user_says_so(desk):
    target = desk.folder / "experiment.toml"
    target.write_text("# mine\n")
    with pytest.raises(InputError, match="already"):
        desk.write(plan(), replace=False)
    assert target.read_text() == "# mine\n"
    desk.write(plan(), replace=True)
    assert (desk.folder / KEPT).read_text() == "# mine\n"
    desk.write(plan(), replace=True)  # the same again: nothing is replaced
    desk.write(plan(title="b"), replace=True)  # what the page wrote itself needs no copy
    assert (desk.folder / KEPT).read_text() == "# mine\n" and not (desk.folder / f"{KEPT}-2").exists()
    target.write_text("# edited\n")
    desk.write(plan(), replace=True)
    assert (desk.folder / f"{KEPT}-2").read_text() == "# edited\n"


def test_a_link_in_the_place_of_experiment_toml_does_not_lead_the_writing_out(desk, tmp_path):
    outside = tmp_path / "outside.toml"
    outside.write_text("# not yours\n")
    (desk.folder / "experiment.toml").symlink_to(outside)
    desk.write(plan(), replace=True)
    assert outside.read_text() == "# not yours\n" and not (desk.folder / "experiment.toml").is_symlink()


@pytest.mark.parametrize("changes, key", [
    ({"images": "../*.tif"}, "images"), ({"images": "/etc/*"}, "images"), ({"loads": "../loads.csv"}, "loads"),
    ({"loads": "/etc/passwd"}, "loads"), ({"law": "no_such_law"}, None), ({"extra": 1}, "extra"),
    ({"parameters": {"E": {"value": 1.0}, "bogus": {"value": 2.0}}}, "material"), ({"motions": {}}, "boundary"),
    ({"motions": {"HOLE1": {"kind": "pressure", "column": "p_bar"}}}, "boundary"),
    ({"motions": {"LEFT": {"kind": "fixed"}, "HOLE2": {"kind": "pressure", "column": "p_bar"}}}, "boundary"),
    ({"motions": {"TOP": {"kind": "fixed"}}}, "boundary"), ({"pixel_size_mm": -1.0}, "pixel_size_mm"),
    ({"pixel_size_mm": None}, "pixel_size_mm"), ({"thickness_mm": None}, "thickness"),
    ({"motions": {'A"] x': {"kind": "fixed"}}}, "motions"), ({"origin_px": [float("nan"), 0.0]}, "origin_px"),
    ({"force": {"column": "no", "edge": "RIGHT", "component": "x"}}, "channel"),
])
def test_a_plan_that_does_not_work_is_refused_and_nothing_is_written(desk, changes, key):
    before = content(desk.folder)
    with pytest.raises(InputError) as caught:
        desk.write(plan(**changes), replace=True)
    assert key is None or key in str(caught.value.key)
    assert content(desk.folder) == before


def test_texts_of_a_user_stay_texts(desk):
    title = 'a "quoted" \\ title\'s µ ✓ ]\n[camera]\npixel_size_mm = 9'
    toml = tomllib.loads(desk.text(plan(title=title))["toml"])
    assert toml["experiment"]["title"] == title and toml["camera"]["pixel_size_mm"] == 0.1


def test_the_drawing_of_an_experiment_is_read_back(desk):
    assert drawn_before(desk.folder) is None
    desk.write(plan(), replace=False)
    assert drawn_before(desk.folder) == plan()["sketch"]


def test_the_mesh_preview_is_the_mesh_of_the_experiment(desk):
    shown = desk.mesh(plan()["sketch"], "images/*.tif")
    desk.write(plan(), replace=False)
    experiment = load_experiment(desk.folder)
    corners = experiment.model.camera.project(experiment.model.mesh.nodes)[: len(shown["nodes"])]
    np.testing.assert_allclose(shown["nodes"], corners, atol=0.006)  # rounded to hundredths of a pixel
    assert len(shown["floor"]) == experiment.model.mesh.n_elements and shown["smallest_angle"] > 25
    assert len(shown["sets"]["RIGHT"]) == len(experiment.model.mesh.edge_sets["RIGHT"])


def test_the_columns_of_the_log_are_held_against_the_frames(desk):
    log = desk.log("loads.csv", "images/*.tif")
    assert log["matches"] and [c["kind"] for c in log["columns"]] == ["", "", "force", "travel", "pressure"]
    (desk.folder / "loads.csv").write_text("time_s,force_N\n0,1\n1,2\n")
    log = desk.log("loads.csv", "images/*.tif")
    assert not log["matches"] and (log["rows"], log["frames"], log["time"]) == (2, 3, "time_s")


def test_every_law_that_is_offered_has_typical_values(desk):
    laws = {law["name"]: law for law in desk.files()["laws"]}
    assert {"elastic", "orthotropic", "j2_voce", "neo_hookean"} <= set(laws)
    assert all(isinstance(p["typical"], float | int) for law in laws.values() for p in law["parameters"])


def test_runs_are_named_within_the_folder(desk, tmp_path):
    assert next_name(("run-1", "run-2")) == "run-3"
    for name in ("..", "../x", "/etc", "a/b", "", ".hidden", "a\n", "x" * 80):
        with pytest.raises(InputError):
            run_folder(desk.folder, name)
    (tmp_path / "elsewhere").mkdir()
    (desk.folder / "runs").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError):
        run_folder(desk.folder, "run-1")
    assert list_folder(desk.folder).runs == ()


def test_the_page_says_how_a_run_stands_and_where_its_report_is(gallery, tmp_path):
    run = tmp_path / "runs" / "run-1"
    run.mkdir(parents=True)
    (run.parent / "run-1.console.txt").write_text("reading\n")
    assert state_of(tmp_path, "run-1") == {"name": "run-1", "status": "starting", "log": ["reading"], "report": False}
    (run / "state.json").write_text("{}")
    assert state_of(tmp_path, "run-1")["status"] == "stopped"
    with run_lock(run):
        assert state_of(tmp_path, "run-1")["status"] == "at work"
    result = gallery("step").result
    write_result(run, result)
    (run / "report.html").write_text("<p>done</p>")
    (run / "log.txt").write_text("done\n")
    assert state_of(tmp_path, "run-1") == {"name": "run-1", "status": result["status"], "log": ["done"],
                                            "report": True}


def test_a_folder_without_images_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "nothing"):
        with pytest.raises(InputError):
            list_folder(folder)


def test_a_folder_of_measured_fields_is_sent_to_init(tmp_path):
    rows = "\n".join(f"{x},{y},{0.01 * x},{-0.003 * y}" for x in range(6) for y in range(4))
    for k in range(2):
        (tmp_path / f"stage_{k}.csv").write_text(f"x,y,u,v\n{rows}\n", encoding="utf-8")
    with pytest.raises(InputError, match="idic init"):
        list_folder(tmp_path)


def test_a_mask_among_the_images_is_none_of_them(tmp_path):
    for name in ("shot_0.tif", "shot_1.tif", "mask.tif"):
        (tmp_path / name).write_bytes(b"")
    assert list(list_folder(tmp_path).images) == ["shot_*.tif"]
    (tmp_path / "shot_0.tif").rename(tmp_path / "reference.tif")
    assert list(list_folder(tmp_path).images) == ['["reference.tif", "shot_1.tif"]']


def test_several_patterns_of_a_group_are_written_as_a_list(desk):
    (desk.folder / "images" / "f_0.tif").rename(desk.folder / "images" / "reference.tif")
    (desk.folder / "images" / "mask.tif").write_bytes(b"")
    name = next(iter(desk.listing().images))
    text = desk.text(plan(images=name))["toml"]
    assert tomllib.loads(text)["experiment"]["images"] == ["images/f_*.tif", "images/reference.tif"]


def test_groups_with_as_many_images_each_may_be_cameras(tmp_path):
    for camera, n in (("cam0", 3), ("cam1", 3), ("still", 2)):
        (tmp_path / camera).mkdir()
        for k in range(n):
            (tmp_path / camera / f"{k}.tif").write_bytes(b"")
    assert list_folder(tmp_path).cameras == ("cam0/*.tif", "cam1/*.tif")
    (tmp_path / "cam1" / "2.tif").unlink()
    assert list_folder(tmp_path).cameras == ()


def test_a_solid_is_made_of_the_drawing_and_the_thickness(desk):
    """One face seen: FRONT; the held end is held along z, too."""
    desk.write(plan(kind="solid"), replace=False)
    text = (desk.folder / "experiment.toml").read_text()
    tables = tomllib.loads(text)
    assert tables["experiment"]["mesh"]["through_mm"] == 2.0 and "thickness_mm" not in tables["experiment"]
    model = load_experiment(desk.folder).model
    assert model.kind == "solid" and model.surface == "FRONT" and np.ptp(model.mesh.nodes[:, 2]) == 2.0
    assert [entry.nodes for entry in model.prescribed if entry.component == "z"] == ["LEFT"]
    assert drawn_before(desk.folder) is not None


def test_a_solid_without_its_thickness_is_refused(desk):
    with pytest.raises(InputError, match="a solid needs the thickness"):
        desk.write(plan(kind="solid", thickness_mm=None, force=None), replace=False)
