"""Virtual experiments from an experiment file, and the experiment file they come with."""

from __future__ import annotations

import json
import shutil
import tomllib

import numpy as np
import pytest
import tifffile
from experiment_file.small_experiment import write_experiment
from virtual_tests.point_strip import write_point_strip
from virtual_tests.small_strip import SMALL

from idic.errors import InputError
from idic.experiment_file import load_experiment, to_toml
from idic.images import ArrayStack
from idic.model import Column, DriveTable
from idic.readers import Log
from idic.virtual_tests import EXAMPLES
from idic.virtual_tests import recorded_by, simulate, strip, write_example, write_loads


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    return write_example("demo", tmp_path_factory.mktemp("demo") / "reduced", reduced=True)


def test_an_example_folder_is_a_valid_experiment_whose_start_is_off_the_truth(demo):
    experiment = load_experiment(demo)
    truth = json.loads((demo.parent / "truth.json").read_text())
    assert set(truth["parameters"]) == set(experiment.model.parameters.free)
    for name, true in truth["parameters"].items():
        assert 0.1 < abs(experiment.model.parameters[name].shown / true - 1.0) < 0.5
    assert experiment.model.n_frames == 12 and experiment.recording.stack.shape == (125, 190)
    assert experiment.recording.noise.std_gv == pytest.approx(truth["noise_std_gv"], abs=1e-3)


@pytest.mark.slow  # two more renderings
def test_the_noise_of_an_example_is_the_requested_one(demo, tmp_path):
    clean = write_example("demo", tmp_path / "clean", reduced=True, noise=0.0, bits=16)
    loud = write_example("demo", tmp_path / "loud", reduced=True, noise=0.1, bits=16)
    truth = json.loads((loud.parent / "truth.json").read_text())
    a, b = (load_experiment(path).recording.stack.frame(3).astype(float) for path in (clean, loud))
    inside = np.s_[20:105, 12:70]  # on the specimen, beside the hole
    # 5000 pixels: the standard error of a standard deviation is 1 %; 3 of them
    assert (b - a)[inside].std() == pytest.approx(truth["noise_std_gv"], rel=0.03)
    assert truth["added_noise_std_gv"] == pytest.approx(0.1 * truth["contrast_gv"])


def test_the_same_seed_gives_the_same_files_and_another_seed_others(tmp_path, monkeypatch):
    monkeypatch.setitem(EXAMPLES, "small", lambda reduced, foreign: strip(SMALL))  # a tenth of the demo's time
    first, again, other = (write_example("small", tmp_path / str(k), seed=seed).parent
                           for k, seed in enumerate((0, 0, 1)))
    for name in ("loads.csv", "images/frame_005.tif"):
        assert (again / name).read_bytes() == (first / name).read_bytes() != (other / name).read_bytes()


@pytest.mark.parametrize("wrong", [{"name": "nothing"}, {"bits": 9}, {"noise": -0.1}])
def test_an_impossible_example_is_refused_before_anything_is_written(wrong, tmp_path):
    with pytest.raises(InputError):
        write_example(**({"name": "demo", "out": tmp_path / "new"} | wrong))
    assert not (tmp_path / "new").exists()


def test_measured_files_are_never_overwritten(demo):
    with pytest.raises(InputError, match="not empty"):
        simulate(demo, demo.parent)


def test_a_simulated_experiment_repeats_the_original_at_the_true_parameters(demo, tmp_path):
    truth = json.loads((demo.parent / "truth.json").read_text())["parameters"]
    path = simulate(demo, tmp_path / "virtual", overrides=truth, seed=3)
    virtual, original = load_experiment(path), load_experiment(demo)
    assert json.loads((path.parent / "truth.json").read_text())["parameters"] == truth
    assert virtual.model.n_frames == original.model.n_frames
    assert virtual.recording.stack.shape == original.recording.stack.shape
    assert np.array_equal(virtual.model.mesh.nodes, original.model.mesh.nodes)
    # two logs with 5 N of noise each, and the mesh's own 0.3 % of 4900 N
    assert np.abs(virtual.model.channels[0].values
                  - original.model.channels[0].values).max() < 4 * 5.0 * np.sqrt(2) + 15.0
    grips = [e.model.prescribed[2].drive.values for e in (virtual, original)]
    assert np.abs(grips[0] - grips[1]).max() < 4 * 0.0002 * np.sqrt(2) * 2  # relative to a noisy reference
    image = tifffile.imread(path.parent / "images" / "frame_000.tif")
    assert image.dtype == np.uint8 and image.std() > 30


def test_a_motion_that_is_to_be_measured_cannot_be_simulated(demo, tmp_path):
    with pytest.raises(InputError, match="nothing to simulate it from"):
        simulate(demo, tmp_path / "virtual", overrides={"boundary.1.ux": "measured"})


def test_tables_survive_the_way_to_toml_and_back():
    tables = {
        "experiment": {
            "title": 'a "quoted" µm',
            "images": ["a.tif", "b.tif"],
            "mesh": {"roi_px": [0, 1, 2, 3], "element_px": 20},
            "flag": True,
        },
        "material": {
            "A": {"law": "elastic", "E": {"value": 6e4, "bounds": [1e3, float("inf")]}, "nu": 0.3},
            "B C": {"law": "elastic", "E": 1},
        },
        "sets": {"TOP": {"where": "y > 1"}},
        "boundary": [{"nodes": "TOP", "uy": {"column": "d"}}, {"nodes": "BOTTOM", "ux": 0.0}],
        "stage": [{"free": ["A.E"]}, {"free": "all"}],
        "options": {},
    }
    assert tomllib.loads(to_toml(tables)) == tables


def test_the_new_log_is_in_the_units_of_its_columns(tmp_path):
    """A grip in µm, a force in kN; by the names of the columns, or by what the experiment file says of them."""
    small = write_experiment(tmp_path / "small")
    for name, old, new in (("by_name", "grip_um", "grip_um"), ("stated", "grip_um", "grip")):
        source = tmp_path / f"source_{name}"
        shutil.copytree(small, source)
        for file in ("experiment.toml", "loads.csv"):
            (source / file).write_text((source / file).read_text().replace(old, new))
        toml = (source / "experiment.toml").read_text()
        if new == "grip":
            toml = toml.replace('column = "grip",', 'column = "grip", unit = "um",')
        (source / "experiment.toml").write_text(toml)
        first = load_experiment(source)
        again = load_experiment(simulate(source, tmp_path / name))
        drives = [[p.drive for p in e.model.prescribed if isinstance(p.drive, Column)][0] for e in (first, again)]
        np.testing.assert_allclose(drives[1].values, drives[0].values, atol=5 * 0.2e-3)  # noise of the grip, mm
        force = again.model.channels[0].values
        stiffness = 70e3 * 2.0 * 4.0 / 3.0  # N/mm, of the block without its clamps: within 20 % of it
        assert force[-1] == pytest.approx(stiffness * drives[0].values[-1], rel=0.2)


@pytest.mark.parametrize("own_times", [False, True])
def test_the_log_of_a_simulated_experiment_is_on_time(tmp_path, own_times):
    """Its offset stayed in the file, and moved the grip a second time."""
    folder = write_experiment(tmp_path / "test")
    if own_times:
        toml = (folder / "experiment.toml").read_text()
        (folder / "experiment.toml").write_text(toml.replace("[experiment]", "[experiment]\nframe_interval_s = 1.0"))
    (folder / "loads.csv").write_text("time_s,force_kN,grip_um\n0,0,0\n1,0.1,2\n2,0.2,8\n3,0.3,18\n")
    late = {"dof": [{"name": "time.offset", "value": -0.25}], "boundary.1.uy": {"column": "grip_um"}}
    first = load_experiment(folder, late)
    path = simulate(folder, tmp_path / "out", late, noise_std_gv=0.0)
    again = load_experiment(path)
    moved = [DriveTable.of(e).histories(e.model.parameters)[-1, -1] for e in (first, again)]
    assert again.model.parameters["time.offset"].value == 0.0 != first.model.parameters["time.offset"].value
    assert json.loads((path.parent / "truth.json").read_text())["parameters"]["time.offset"] == 0.0
    np.testing.assert_allclose(moved[1], moved[0], rtol=1e-5)


def test_a_law_with_a_memory_is_integrated_finely_unless_increments_are_given(tmp_path):
    """Forces over one increment per frame are wrong where the law depends on the rate: the model would seem wrong."""
    material = {"law": "viscoplastic", "E": 2000.0, "nu": 0.35, "eta": 40.0, "m": 4.0, "hardening_modulus": 50.0,
                "yield_stress": {"value": 3.0, "unit": "MPa", "identify": True}}
    folder = write_experiment(tmp_path / "test")

    def force(name, **options):
        overrides = {"material.SPECIMEN": material} | {f"options.{key}": value for key, value in options.items()}
        path = simulate(folder, tmp_path / name, overrides)  # one seed: the same noise of the force
        return np.genfromtxt(path.parent / "loads.csv", delimiter=",", names=True)["force_kN"]

    fine, coarse, chosen = force("fine", substeps=128), force("coarse", substeps=1), force("chosen")
    assert np.abs(chosen - fine).max() < 0.1 * np.abs(coarse - fine).max()
    assert np.abs(coarse - fine).max() > 0.02 * np.ptp(fine)


def test_times_come_back_from_the_written_log(tmp_path):
    times = 1000.0 + 0.002 * np.arange(5)
    write_loads(tmp_path, times, {"force_N": np.arange(5.0)})
    np.testing.assert_allclose(Log.read(tmp_path / "loads.csv").times(), times, rtol=1e-14)  # 15 digits


def test_measured_fields_are_refused_before_anything_is_written(tmp_path):
    """Their ends are held and pulled, so that nothing else is to be measured."""
    folder = write_point_strip(tmp_path / "fields", "ux = 0.0\nuy = 0.0", "ux = 0.0\nuy = 0.02")
    with pytest.raises(InputError, match="fields of another DIC") as told:
        simulate(folder, tmp_path / "out")
    assert told.value.found == "4 stages of 300 points" and not (tmp_path / "out").exists()


@pytest.mark.parametrize("levels", [4096, 65536])
def test_the_noise_of_a_deeper_camera_keeps_its_share_of_the_range(tmp_path, levels):
    """It was added in the grey values of 16 bit to images of 8: a noise of 500 left no pattern."""
    folder, factor = write_experiment(tmp_path / "real"), levels // 256
    for path in (folder / "images").glob("*.tif"):
        tifffile.imwrite(path, tifffile.imread(path).astype(np.uint16) * factor + factor - 1)
    file = folder / "experiment.toml"
    file.write_text(file.read_text().replace("noise_std_gv = 2.0", f"noise_std_gv = {2.0 * factor}"))
    told = tomllib.loads(simulate(folder, tmp_path / "virtual").read_text())
    assert told["camera"]["noise_std_gv"] == pytest.approx(np.hypot(2.0, 12**-0.5), rel=1e-3)  # and rounding
    deep = tomllib.loads(simulate(folder, tmp_path / "deep", bits=16).read_text())
    assert deep["camera"]["noise_std_gv"] == pytest.approx(2.0 * 256.0, rel=1e-3)


@pytest.mark.parametrize("sensor", ["white", "blurred", "grey_level"])
def test_the_noise_of_a_frame_depends_on_seed_and_frame_alone(sensor):
    still = ArrayStack(np.full((3, 40, 50), 100.0, np.float32))
    stack, another = (recorded_by(sensor, still, 2.0, seed) for seed in (1, 2))
    noise = stack.frame(2) - 100.0
    assert np.array_equal(recorded_by(sensor, still, 2.0, 1).frame(2) - 100.0, noise)
    for other in (stack.frame(1), another.frame(2)):  # 2000 pixels: a correlation of 0.02 by chance
        assert abs(np.corrcoef(noise.ravel(), other.ravel())[0, 1]) < 0.1
