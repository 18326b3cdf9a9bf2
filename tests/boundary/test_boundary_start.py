"""Virtual boundaries start from the motion that the images show, and a run keeps that start to the last bit."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "identify"))

from twin_bodies import CAMERA, SHAPE, TIMES, held_left, plate  # noqa: E402
from twin_bodies import experiment as body  # noqa: E402
from twin_runs import ELASTIC, FORCE, TRUTH, Twin, clean_images, identify, judged, solved, write_folder  # noqa: E402

from idic.measure import BoundaryStart, with_boundary_start  # noqa: E402
from idic.errors import InputError  # noqa: E402
from idic.experiment_file import load_experiment  # noqa: E402
from idic.images import ArrayStack  # noqa: E402
from idic.model import DriveTable, Parametrised, Prescribed  # noqa: E402
from idic.report import undetermined
from idic.run.prepared.session import open_session  # noqa: E402
from idic.run.prepared.prepare import check_before_writing  # noqa: E402
from idic.run.store.layout import DESCRIPTION, DESCRIPTION_SCHEMA  # noqa: E402
from idic.run.store.checkpoint import from_hex, load_checkpoint  # noqa: E402
from idic.run import SerialRunner  # noqa: E402

CUTS = """
[[boundary]]
nodes = "LEFT"
u = DRIVE
[[boundary]]
nodes = "RIGHT"
u = DRIVE
"""
DIC = '{ virtual = "dic", modes = 2, time_modes = 2 }'


def moved(kind, modes, time_modes, given=()):
    """The plate with a virtual right edge, and images to satisfy the record."""
    prescribed = (*held_left(), *(Prescribed("RIGHT", c, Parametrised(kind, modes, time_modes)) for c in "xy"))
    made = body(prescribed=prescribed)
    return replace(made, model=replace(made.model, stated_values=given),
                   recording=replace(made.recording, stack=ArrayStack(np.zeros((len(TIMES), *SHAPE)))))


def seen(u):
    """Motion in mm as an FE-DIC would measure it  # (n_frames, n_nodes, 2) px"""
    nodes = plate().nodes
    return np.array([CAMERA.project(nodes + frame) - CAMERA.project(nodes) for frame in u])


def prescribed_motion(made):
    """(n_frames, n_p) mm at the parameters of an experiment, of the virtual edge only."""
    drives = DriveTable.of(made)
    return drives.histories(made.model.parameters) @ drives.basis.T, drives.dofs


def stretching():
    y = plate().nodes[:, 1]
    course = np.array([0.0, 0.3, 0.7, 1.0, 0.8])
    x_part = np.outer(course, 0.3 + 0.02 * y + 0.01 * y**2) + np.outer(course**2, 0.03 * y)
    return np.stack([x_part, np.outer(course, -0.05 * y)], axis=-1)


@pytest.mark.parametrize("kind, modes, time_modes", [("bspline", 4, 4), ("polynomial", 3, 4), ("dic", 2, 2)])
def test_a_motion_that_the_modes_hold_is_the_start_exactly(kind, modes, time_modes):
    made, u = moved(kind, modes, time_modes), stretching()
    begun = with_boundary_start(made, BoundaryStart.of(made, seen(u)))
    motion, dofs = prescribed_motion(begun)
    right = np.isin(dofs // 2, plate().node_sets["RIGHT"])
    assert np.abs(motion[:, right] - u.reshape(len(TIMES), -1)[:, dofs[right]]).max() < 1e-9
    assert begun.notes[-1].startswith(f"boundary.RIGHT.y: {modes * time_modes} modes start from")


def test_lost_frames_and_nodes_out_of_view_are_bridged_and_said():
    made, u_px = moved("dic", 2, 2), seen(stretching())
    u_px[2] = np.nan
    u_px[:, plate().node_sets["RIGHT"][:2]] = np.nan
    u_px[4] += 50.0  # an unexplained frame
    begun = with_boundary_start(made, BoundaryStart.of(made, u_px, excluded=(4,)))
    motion, _ = prescribed_motion(begun)
    assert np.isfinite(motion).all() and np.abs(motion).max() < 0.5
    assert "% of its nodes are not seen" in begun.notes[-1]


def test_an_edge_that_no_image_shows_starts_from_rest_and_is_named():
    made = moved("bspline", 3, 2)
    start = BoundaryStart.of(made, np.full((len(TIMES), len(plate().nodes), 2), np.nan))
    assert start.values == {} and all("starts from rest" in note for note in start.notes)


def test_values_of_the_user_win_and_the_others_are_fitted_with_them():
    made = moved("bspline", 3, 4, given=("boundary.RIGHT.x.s1t3",))
    made = replace(made, model=replace(made.model,
                                       parameters=made.model.parameters.with_values({"boundary.RIGHT.x.s1t3": 0.123})))
    start = BoundaryStart.of(made, seen(stretching()))
    assert "boundary.RIGHT.x.s1t3" not in start.values and "1 of them as given" in start.notes[0]
    assert with_boundary_start(made, start).model.parameters["boundary.RIGHT.x.s1t3"].value == 0.123
    free = BoundaryStart.of(moved("bspline", 3, 4), seen(stretching())).values
    assert abs(free["boundary.RIGHT.x.s0t3"] - start.values["boundary.RIGHT.x.s0t3"]) > 1e-3


@pytest.fixture(scope="module")
def clean():
    return clean_images(Twin())


def test_a_run_with_measured_modes_finds_the_truth_and_keeps_its_start_to_the_last_bit(tmp_path, clean):
    path = write_folder(tmp_path / "test", Twin(), ELASTIC + CUTS.replace("DRIVE", DIC) + FORCE, clean)
    state, result = identify(path, tmp_path / "first")
    assert result["status"] == "converged" and result["iterations"] <= 5  # 3 or 4 with gripped ends
    for name, true in TRUTH.items():
        p = result["parameters"][f"BODY.{name}"]
        assert abs(p["value"] - true) < 4.0 * p["std"]  # the noise of fixed shapes is not in std
    values = load_checkpoint(tmp_path / "first" / DESCRIPTION, DESCRIPTION_SCHEMA)["boundary"]["values"]
    context = open_session(tmp_path / "first", SerialRunner(), "direct").context
    assert values and all(from_hex(v) == context.experiment.model.parameters[n].value for n, v in values.items())
    assert any("modes start from" in note for note in result["notes"])
    again, second = identify(path, tmp_path / "second")
    assert again.accepted == state.accepted and second["eigenvalues"] == result["eigenvalues"]


def test_modes_keep_the_order_of_the_file_in_every_process(tmp_path, clean):
    many = '{ virtual = "bspline", modes = 6, time_modes = 5 }'
    path = write_folder(tmp_path / "test", Twin(), ELASTIC + CUTS.replace("DRIVE", many) + FORCE, clean)
    names = [name for name in load_experiment(path).model.parameters.free if name.startswith("boundary")]
    assert names == [f"boundary.{end}.{c}.s{i}t{j}" for end in ("LEFT", "RIGHT") for c in "xy" for i in range(6)
                     for j in range(5)]


def test_more_modes_than_the_images_separate_do_not_change_the_material_and_are_reported(tmp_path, clean):
    many = '{ virtual = "bspline", modes = 14, time_modes = 2 }'  # 9 nodes along each edge
    toml = ELASTIC + CUTS.replace("u = DRIVE", f"ux = {many}\nuy = 0.0") + FORCE
    _, result = solved(write_folder(tmp_path / "test", Twin(), toml, clean))
    opened = [entry["name"] for entry in result["not_identifiable"]]
    assert len(opened) >= 2 * 2 * (14 - 9) and not any(name.startswith("BODY") for name in opened)
    for name, true in TRUTH.items():
        p = result["parameters"][f"BODY.{name}"]
        assert abs(p["value"] - true) < 4.0 * p["std"]
    text = undetermined(result)
    assert f"boundary.RIGHT.x: {sum(n.startswith('boundary.RIGHT.x') for n in opened)} of 28 modes" in text
    assert len(text) < 400


def test_measured_modes_of_an_edge_out_of_view_are_refused_before_anything_is_written(tmp_path, clean):
    path = write_folder(tmp_path / "test", Twin(), ELASTIC + CUTS.replace("DRIVE", DIC) + FORCE, clean)
    path.write_text(path.read_text().replace("origin_px = [69.3", "origin_px = [109.3"))
    with pytest.raises(InputError, match="do not show"):
        check_before_writing(load_experiment(path))


def test_modes_that_lack_some_of_the_motion_mislead_generalised_least_squares_so_auto_stays_ordinary(tmp_path):
    """Straight lines in time for grips that turn back a little: chi^2 per pixel is 1.08, and only 0.96 without."""
    times = np.arange(6.0)
    turning = np.array(Twin().grip)
    straight = times * (times @ turning) / (times @ times)
    twin = Twin(grip=tuple(straight + 0.3 * (turning - straight)))
    virtual = '{ virtual = "bspline", modes = 6, time_modes = 2 }'
    cuts = CUTS.replace("u = DRIVE", f"ux = {virtual}\nuy = 0.0")
    path = write_folder(tmp_path / "test", twin, ELASTIC + cuts + FORCE)
    off = {}
    for name in ("auto", "generalised"):
        _, result = solved(path, options__estimator=name)
        p = result["parameters"]["BODY.E"]
        off[name] = abs(p["value"] - TRUTH["E"]) / p["std_noise"]
        assert result["estimator"] == {"auto": "ordinary"}.get(name, name)
    assert off["auto"] < 2.0 and off["generalised"] > 2.5  # 0.4 and 3.4 measured


@pytest.mark.parametrize("k1, chosen", [(0.0, "generalised"), (3e-5, "ordinary")])
def test_measured_edges_are_generalised_where_the_model_leaves_nothing_but_noise(tmp_path, k1, chosen):
    """A lens whose distortion (3 px at the corners) nobody has told the model of leaves more than half of the noise."""
    twin = Twin(camera=replace(Twin().camera, k1=k1))
    measured = CUTS.replace("u = DRIVE", 'u = "measured"')
    result = judged(write_folder(tmp_path / "test", twin, ELASTIC + measured + FORCE))
    assert result["status"] == "converged" and result["estimator"] == chosen
    assert (result["residual"]["image_chi2_dof"] > 1.4) == (chosen == "ordinary")
