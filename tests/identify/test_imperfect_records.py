"""What is missing, wrong or noisy in the records of a test, and what the identification makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tifffile
from twin_bodies import PIXEL
from twin_runs import ELASTIC, FORCE, GRIPS, TRUTH, Twin, clean_images, judged, solved, write_folder

from idic.experiment_file import load_experiment
from idic.identification import FrameFit, identify, without_edges
from idic.identification.frame_fit import frame_entries
from idic.identification.result import shift_notes
from idic.images import Camera
from idic.model import Column, DriveTable, build_forward, solve
from idic.report.result.words import left_out, not_explained
from idic.report.result.record import FreeFields
from idic.run import prepare_in_memory
from idic.run.judgement.free import free_summary

WHOLE = ELASTIC + GRIPS + FORCE
SURE = 4.0  # standard deviations: one draw of noise, some ten parameters looked at; 4 is passed once in 16 000


def assert_true(result, truth):
    for name, value in truth.items():
        entry = result["parameters"][name]
        assert entry["std"] is not None and abs(entry["value"] - value) < SURE * entry["std"], (name, entry)


BODY = {f"BODY.{name}": value for name, value in TRUTH.items()}


# force ------------------------------------------------------------------------------------------------
def test_without_a_force_the_modulus_is_open_and_keeps_its_start_but_poissons_ratio_is_found(clean, tmp_path):
    state, result = solved(write_folder(tmp_path / "test", Twin(), ELASTIC + GRIPS, clean))
    assert state.status == "converged"
    modulus = result["parameters"]["BODY.E"]
    assert modulus["std"] is None and modulus["value"] == 1200.0
    assert [entry["name"] for entry in result["not_identifiable"]] == ["BODY.E"]
    assert "no force" in result["not_identifiable"][0]["reason"]
    assert_true(result, {"BODY.nu": TRUTH["nu"]})


def test_without_a_force_ratios_of_moduli_are_found_with_their_error(tmp_path):
    truth = {"E1": 2000.0, "E2": 1200.0, "nu12": 0.3, "G12": 500.0, "angle": 0.0}
    twin = Twin(law="orthotropic", truth=truth, noise=1.0)
    toml = """
[material.BODY]
law = "orthotropic"
E1 = { value = 1500, identify = true }
E2 = { value = 1500, identify = true }
nu12 = { value = 0.25, identify = true }
G12 = { value = 700, identify = true }
angle = 0.0
"""
    state, result = solved(write_folder(tmp_path / "test", twin, toml + GRIPS))
    assert state.status == "converged"
    assert {entry["name"] for entry in result["not_identifiable"]} == {"BODY.E1", "BODY.E2", "BODY.G12"}
    for label, true in (("BODY.E1/E2", 2000 / 1200), ("BODY.E1/G12", 4.0), ("BODY.E2/G12", 2.4)):
        entry = result["derived"][label]
        assert 0.0 < entry["std"] < 0.3 * true
        assert abs(entry["value"] - true) < SURE * entry["std"], (label, entry)
    assert_true(result, {"BODY.nu12": 0.3})


def test_the_noise_of_a_channel_is_estimated_where_it_is_not_given(tmp_path):
    times = np.arange(14.0)
    twin = Twin(grip=tuple(0.12 * (times / 13)), times=tuple(times))
    toml = ELASTIC + GRIPS + FORCE.replace("noise_std = 1.0\n", "")
    result = judged(write_folder(tmp_path / "test", twin, toml))
    # 11 third differences that share readings: a median of so few is known to some 40 %
    assert 0.3 < result["residual"]["channel_noise_std"]["force_N"] < 2.5
    assert_true(result, BODY)


# frames ---------------------------------------------------------------------------------------------------
def spoil(path, number, image=None):
    """Another image in the place of one."""
    files = sorted((path.parent / "images").glob("*.tif"))
    old = tifffile.imread(files[number])
    rng = np.random.default_rng(5)
    tifffile.imwrite(files[number], rng.integers(0, 255, old.shape, dtype=np.uint8) if image is None else image(old))


def test_an_excluded_frame_plays_no_part_and_is_listed_as_excluded(clean, tmp_path):
    path = write_folder(tmp_path / "test", Twin(), WHOLE, clean, experiment="exclude_frames = [3]\n")
    _, good = solved(path)
    spoil(path, 3)
    result = judged(path)
    assert result["status"] == "converged"
    assert [frame["status"] for frame in result["frames"]] == ["ok", "ok", "ok", "excluded", "ok", "ok"]
    for name, entry in good["parameters"].items():
        assert result["parameters"][name]["value"] == pytest.approx(entry["value"], rel=1e-12)


@pytest.mark.parametrize("light", ["frame", "none"])
def test_a_black_frame_is_lost_and_its_sums_do_not_count(clean, plain, tmp_path, light):
    """Whether gain and offset of a frame are unknown or not: with neither, a black one took the search with it."""
    path = write_folder(tmp_path / "test", Twin(), WHOLE + f'[options]\nbrightness = "{light}"\n', clean)
    spoil(path, 2, lambda image: np.zeros_like(image))
    result = judged(path)
    assert result["status"] == "converged"
    assert result["frames"][2]["status"] == "lost"
    assert_true(result, BODY)
    # the other four frames see what five saw, and the standard deviation owns up to the loss
    assert result["parameters"]["BODY.nu"]["std"] > 0.999 * plain[2]["parameters"]["BODY.nu"]["std"]


def test_a_frame_that_the_model_cannot_explain_is_named(clean, tmp_path):
    path = write_folder(tmp_path / "test", Twin(), WHOLE, clean)
    spoil(path, 4, lambda image: np.roll(image, 3, axis=0))  # somebody hit the camera
    result = judged(path)
    # no endless search for the impossible
    assert result["status"] in ("converged", "stalled") and result["forward_runs"] < 25
    assert result["frames"][4]["status"] == "unexplained"
    assert [frame["status"] for frame in result["frames"][:4]] == ["ok"] * 4


def test_frames_are_named_where_the_model_explains_only_a_few(clean, tmp_path):
    """The log of the grip is half as large again from the third frame on: the images alone are explained throughout."""
    wrong = Twin(grip=tuple(grip * (1.5 if k > 1 else 1.0) for k, grip in enumerate(Twin().grip)))
    path = write_folder(tmp_path / "test", wrong, WHOLE, clean, camera="# noise_std_gv is left to a free FE-DIC\n")
    result = judged(path)
    assert result["residual"]["free_dic_chi2_dof"] < 1.5
    named = [frame["status"] for frame in result["frames"]]
    assert named == ["ok"] * 2 + ["unexplained"] * 4, [frame["chi2_dof"] for frame in result["frames"]]
    assert all(frame["used"] for frame in result["frames"][1:])
    assert not_explained(result).startswith("The model does not explain frames 2 ")


def test_images_are_taken_in_the_order_of_their_numbers(clean, plain, tmp_path):
    names = [f"shot{k}.tif" for k in (8, 9, 10, 11, 100, 101)]
    result = judged(write_folder(tmp_path / "test", Twin(), WHOLE, clean, names))
    assert [frame["label"] for frame in result["frames"]] == names
    expected = plain[2]["parameters"]["BODY.E"]["value"]
    assert result["parameters"]["BODY.E"]["value"] == pytest.approx(expected, rel=1e-12)


def test_a_reference_in_the_middle_leaves_earlier_frames_out(tmp_path):
    grip = (0.0, 0.0, 0.04, 0.08, 0.12)
    twin = Twin(grip=grip, times=(0.0, 1.0, 2.0, 3.0, 4.0))
    result = judged(write_folder(tmp_path / "test", twin, WHOLE, experiment="reference = 1\n"))
    assert [frame["status"] for frame in result["frames"]] == ["excluded", "ok", "ok", "ok", "ok"]
    assert_true(result, BODY)


# light ------------------------------------------------------------------------------------------------------
def test_frames_whose_mean_is_the_reference_are_references_and_not_left_out(tmp_path):
    twin = Twin(grip=(0.0, 0.0, 0.06, 0.12), times=(0.0, 1.0, 2.0, 3.0))
    path = write_folder(tmp_path / "test", twin, WHOLE, experiment="reference = [0, 1]")
    result = judged(path)
    assert [f["reference"] for f in result["frames"]] == [True, True, False, False]
    assert all(f["status"] == "ok" for f in result["frames"]) and left_out(result) == ""
    assert_true(result, BODY)


def test_gain_and_offset_that_change_from_frame_to_frame_do_no_harm(clean, plain, tmp_path):
    gains = ((1.0, 0.0), (0.95, 3.0), (1.04, -2.0), (0.9, 5.0), (0.85, 12.0), (1.02, 0.0))
    result = judged(write_folder(tmp_path / "test", Twin(gains=gains), WHOLE, clean))
    assert result["status"] == "converged"
    assert_true(result, BODY)
    assert result["residual"]["image_chi2_dof"] < 1.15  # noise is not scaled with the light: dim frames look quieter
    assert result["parameters"]["BODY.nu"]["std"] == pytest.approx(plain[2]["parameters"]["BODY.nu"]["std"], rel=0.1)


# camera -----------------------------------------------------------------------------------------------------
def test_a_camera_that_is_turned_and_shifted_is_found_together_with_the_modulus(tmp_path):
    from twin_runs import ORIGIN

    twin = Twin(camera=Camera.from_table(PIXEL, ORIGIN, rotation_deg=0.8))
    dofs = "".join(f'[[dof]]\nname = "camera.{name}"\nvalue = 0.0\n'
                   for name in ("rotation_deg", "shift_col", "shift_row"))
    state, result = solved(write_folder(tmp_path / "test", twin, WHOLE + dofs))
    assert state.status == "converged"
    assert_true(result, {"BODY.E": TRUTH["E"], "camera.rotation_deg": 0.8, "camera.shift_col": 0.0,
                         "camera.shift_row": 0.0})
    assert result["parameters"]["camera.rotation_deg"]["std"] < 0.2  # 0.8 deg is more than four of these


# log ----------------------------------------------------------------------------------------------------------
def test_the_offset_of_a_late_log_is_found(tmp_path):
    times = np.arange(12.0)
    grip = 0.12 * np.sin(0.5 * np.pi * (times / 11)) ** 2  # starts and ends at rest: interpolation is no issue
    twin = Twin(grip=tuple(grip), times=tuple(times), log_late=0.2)
    toml = WHOLE + '[[dof]]\nname = "time.offset"\nvalue = 0.0\n'
    state, result = solved(write_folder(tmp_path / "test", twin, toml))
    assert state.status == "converged"
    found = result["parameters"]["time.offset"]
    assert abs(found["value"] - 0.2) < 0.03, found  # rates are central differences over 2 s of a motion that curves
    assert_true(result, {"BODY.nu": TRUTH["nu"]})


def test_a_log_that_is_late_by_several_images_is_found_from_a_start_near_it(tmp_path):
    """From a start at zero its columns are straight over two images, and E is a tenth off; the note names the start."""
    times, late = np.arange(12.0), 2.2
    grip = 0.12 * np.maximum(0.0, np.minimum(times - 1.0, 10.0 - times)) / 4.5
    twin = Twin(grip=tuple(grip), times=tuple(times))
    toml = WHOLE + '[[dof]]\nname = "time.offset"\nvalue = 2.1\n'
    path = write_folder(tmp_path / "test", twin, toml, experiment="frame_interval_s = 1.0")
    own = np.genfromtxt(path.parent / "loads.csv", delimiter=",", names=True)
    clock = np.arange(-1.0, 16.0, 0.05)
    course = [np.interp(clock - late, times, own[name]) for name in ("force_N", "grip_mm")]
    np.savetxt(path.parent / "loads.csv", np.column_stack([clock, *course]), "%.8f", ",", comments="",
               header="time_s,force_N,grip_mm")
    state, result = solved(path)
    assert state.status == "converged"
    found = result["parameters"]["time.offset"]
    assert abs(found["value"] - late) < SURE * found["std"] < 0.08, found
    assert_true(result, BODY)
    experiment = load_experiment(path, {"dof": [{"name": "time.offset", "value": 0.0}]})
    far = experiment.model.parameters.with_values({"time.offset": 1.7})
    note, = shift_notes(experiment, far, {"time.offset": {"value": 1.7, "std": 0.01, "free": True}})
    assert "1.7 of the time between two images" in note and "write value = 1.7 in its [[dof]]" in note
    assert not shift_notes(load_experiment(path), load_experiment(path).model.parameters,
                           {"time.offset": {"value": 2.1, "std": 0.01, "free": True}})


def test_a_black_image_leaves_measured_edges_between_their_neighbours(clean, tmp_path):
    """The prior of a measured edge, its smoothness, took it back to rest in a frame that shows nothing."""
    images, force = clean
    edges = "".join(f'\n[[boundary]]\nnodes = "{name}"\nu = "measured"\n' for name in ("LEFT", "RIGHT"))
    black = images.copy()
    black[3] = 0
    folder = write_folder(tmp_path / "test", Twin(), ELASTIC + edges + FORCE, (black, force))
    prepared = prepare_in_memory(load_experiment(folder))
    found = identify(prepared.start, prepared.local)
    drives = DriveTable.of(prepared.experiment)
    right = [i for i, drive in enumerate(drives.local) if ".RIGHT.x" in drives.names[drive]]
    motion = found.local[:, right].mean(axis=1)
    assert prepared.experiment.recording.excluded == (3,)
    assert without_edges(prepared.experiment, np.array([False, True, False, True, False, False])) == [1]
    assert motion[3] == pytest.approx(0.5 * (motion[2] + motion[4]), rel=0.1)
    entries = frame_entries(prepared.experiment, {3: FrameFit(3, 0, float("nan"), float("nan"))}, ())
    assert entries[3]["status"] == "lost"


def test_a_late_log_of_a_steady_motion_changes_nothing_from_a_reference_on_the_way(clean, tmp_path):
    """What is logged later counts from a zero that is logged later."""
    toml = WHOLE + '[[dof]]\nname = "time.offset"\nvalue = 0.0\n'
    experiment = load_experiment(write_folder(tmp_path / "test", Twin(), toml, clean), {"experiment.reference": 2})
    steady = 0.01 * (np.arange(experiment.model.n_frames) - 2.0)
    drives = [replace(entry, drive=replace(entry.drive, values=steady, rates=np.full(len(steady), 0.01)))
              if isinstance(entry.drive, Column) else entry for entry in experiment.model.prescribed]
    forward = build_forward(replace(experiment, model=replace(experiment.model, prescribed=tuple(drives))))
    on_time, late = (solve(forward, experiment.model.parameters.with_values({"time.offset": offset}))
                     for offset in (0.0, 0.4))
    np.testing.assert_allclose(late.u, on_time.u, atol=1e-9)
    assert np.abs(on_time.u[-1]).max() > 0.01


def test_unknown_noise_of_the_grip_in_every_frame_makes_fit_and_error_bars_honest(tmp_path):
    times = np.arange(12.0)
    twin = Twin(grip=tuple(0.1 * times / 11), times=tuple(times), grip_noise=0.004, noise=1.0)
    clean = clean_images(twin)
    known = GRIPS.replace('"grip_mm"', '"grip_mm", noise_std = 0.004')
    naive = judged(write_folder(tmp_path / "naive", twin, WHOLE, clean))
    honest = judged(write_folder(tmp_path / "honest", twin, ELASTIC + known + FORCE, clean))
    assert honest["status"] == "converged"
    assert honest["residual"]["image_chi2_dof"] < 1.1 < naive["residual"]["image_chi2_dof"]
    # what the images say about the grip (0.01 px) is better than its log (0.07 px), so the force becomes explicable
    assert honest["residual"]["channel_chi2_dof"]["force_N"] < 3.0 < naive["residual"]["channel_chi2_dof"]["force_N"]
    assert_true(honest, BODY)


def test_a_logged_motion_with_an_offset_from_play_in_the_grips_is_corrected(clean, tmp_path):
    images, force = clean
    twin = Twin()
    grips = GRIPS.replace('"grip_mm"', '"grip_mm", identify_offset = true')
    path = write_folder(tmp_path / "test", twin, ELASTIC + grips + FORCE, (images, force))
    table = np.genfromtxt(path.parent / "loads.csv", delimiter=",", names=True)
    table["grip_mm"][1:] += 0.015  # the machine moved before the specimen did
    names = ",".join(table.dtype.names)
    np.savetxt(path.parent / "loads.csv", table, delimiter=",", header=names, comments="", fmt="%.8g")
    state, result = solved(path)
    assert state.status == "converged"
    assert_true(result, BODY | {"boundary.RIGHT.x.offset": -0.015})


def test_a_lost_frame_is_not_compared_with_a_free_motion():
    """A black frame has χ² 8924 for the model and, of no pixel, 0 for any motion."""
    free = FreeFields((3, 6, 9), np.zeros((3, 4, 2)), np.zeros((3, 5, 5)), np.array([1.01, 0.0, 1.03]), 1.0)
    assert free_summary(free, {3: 1.02, 9: 1.04}) == {"frames": [3, 9], "chi2_dof": pytest.approx(1.02),
                                                      "model_chi2_dof": pytest.approx(1.03)}
    assert free_summary(free, {}) is None and free_summary(None, {3: 1.0}) is None
