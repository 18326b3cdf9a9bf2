"""A folder of height images of a solid, from its files to result.json: nothing is handed over in memory."""

from __future__ import annotations

import json
import tomllib

import height_bodies as bodies
import numpy as np
import pytest
import tifffile
from height_bodies import RMS, SIZE, TENSION, TRUTH, Roughness, exact_images, pulled_block

import idic
from idic.errors import InputError
from idic.experiment_file import initial_experiment, inputs_of, load_experiment
from idic.report import check
from idic.run.prepared.prepare import check_before_writing
from idic.run.reporting.write import load_record
from idic.virtual_tests import simulate

TOML = """
[experiment]
title = "Block in tension, topography"
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "solid"
surface = "TOP"
quantity = "height"
height_unit = "um"

[camera]
pixel_size_mm = 0.02
origin_px = [10.3, 105.6]
axes = ["+col", "-row"]
noise_std_gv = 0.03

[material.BODY]
law = "neo_hookean"
C10 = { value = 4.3, unit = "MPa", identify = true }
kappa = { value = 46.0, unit = "MPa", identify = true }

[sets]
X0 = { where = "x < 1e-6" }
Y0 = { where = "y < 1e-6" }
Z0 = { where = "z < 1e-6" }
TOP = { where = "z > 0.499" }
END = { where = "x > 2.999" }

[[boundary]]
nodes = "X0"
ux = 0.0
[[boundary]]
nodes = "Y0"
uy = 0.0
[[boundary]]
nodes = "Z0"
uz = 0.0
[[boundary]]
traction = { column = "tension_MPa", edges = "END", component = "x" }
"""


def write_folder(folder, toml=TOML, gaps=0.002):
    """Images of the closed form with noise and gaps; another mesh than any that made them (none did)."""
    (folder / "images").mkdir(parents=True)
    mesh, rng = bodies.block(SIZE, (4, 2, 2)), np.random.default_rng(11)
    images = exact_images(pulled_block(), Roughness(3))
    images = images + 0.01 * RMS * rng.standard_normal(images.shape)
    images[rng.random(images.shape) < gaps] = np.nan
    images[2:, 40:44, 60:70] = np.nan  # a spot that the instrument lost
    for k, image in enumerate(images):
        tifffile.imwrite(folder / "images" / f"map_{k:02d}.tif", image.astype(np.float32))
    lines = ["*NODE", *(f"{i + 1}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(mesh.nodes)),
             "*ELEMENT, TYPE=C3D8, ELSET=BODY"]
    lines += [", ".join(map(str, (e + 1, *(row + 1)))) for e, row in enumerate(mesh.blocks[0].connectivity)]
    (folder / "mesh.inp").write_text("\n".join(lines) + "\n")
    (folder / "loads.csv").write_text("frame,time_s,tension_MPa\n" + "".join(
        f"{k},{k},{value}\n" for k, value in enumerate(TENSION)))
    (folder / "experiment.toml").write_text(toml)
    return folder


def test_height_images_of_a_solid_are_identified_from_their_folder(tmp_path):
    folder = write_folder(tmp_path / "test")
    result = idic.identify(folder, tmp_path / "run")
    assert result["status"] == "converged"
    for name, true in TRUTH.items():
        found = result["parameters"][f"BODY.{name}"]
        assert abs(found["value"] - true) < 3 * found["std"] and found["std"] < 3e-3 * true
    assert result["noise"] == {"std_gv": 0.03, "source": "given", "unit": "µm"}
    assert result["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.03)  # 80000 px: 1 %, and the filled gaps
    assert 0.03 < result["residual"]["image_rms_gv"] < 0.045 and result["residual"]["lost_pixels"] > 1000
    assert {frame["status"] for frame in result["frames"]} == {"ok"}
    record = load_record(tmp_path / "run")
    rise = record.fields.extra["rise [µm]"][-1]
    seen = load_experiment(folder).model.mesh.nodes[:, 2] > 0.499
    l2 = bodies.stretches(TENSION[-1], **TRUTH)[1]
    assert rise[seen].mean() == pytest.approx(1e3 * SIZE[2] * (l2 - 1.0), rel=1e-3)
    assert record.sensitivities.phi_px.shape[2] == 3


def test_check_reports_height_images_in_their_unit(tmp_path):
    report = check(load_experiment(write_folder(tmp_path / "test")))
    text = "\n".join(report.lines())
    assert "µm" in text and "grey" not in text and np.isfinite(report.contrast_gv)
    assert report.contrast_gv == pytest.approx(RMS, rel=0.2)  # one draw of a roughness over a few correlation lengths


def as_xyz(folder, units="mm mm um"):
    """The folder with its height images as XYZ text."""
    for path in sorted((folder / "images").glob("*.tif")):
        rows = [f"{0.02 * column:.6g} {0.02 * row:.6g} " + ("No Data" if np.isnan(height) else f"{height:.9g}")
                for (row, column), height in np.ndenumerate(tifffile.imread(path))]
        path.with_suffix(".xyz").write_text("\n".join([f"# units: {units}", *rows, ""]))
        path.unlink()
    toml = folder / "experiment.toml"
    toml.write_text(toml.read_text().replace("*.tif", "*.xyz"))
    return folder


def test_xyz_grids_give_what_the_same_heights_as_tiff_give(tmp_path):
    folder = write_folder(tmp_path / "test")
    heights = [load_experiment(folder).recording.stack.frame(k) for k in range(len(TENSION))]
    experiment = load_experiment(as_xyz(folder))
    for k, image in enumerate(heights):
        np.testing.assert_array_equal(experiment.recording.stack.frame(k), image)
    assert experiment.recording.quantity == "height" and not any("pixel" in note for note in experiment.notes)
    sent = {path for path in inputs_of(folder, {}).read_files if path.suffix == ".xyz"}
    assert len(sent) == len(heights)  # whole, to workers that do not see the folder


def test_units_and_pitch_of_xyz_grids_are_compared_with_the_experiment_file(tmp_path):
    folder = as_xyz(write_folder(tmp_path / "test"))
    toml = folder / "experiment.toml"
    text = toml.read_text()
    for key, other, message in (('height_unit = "um"', 'height_unit = "nm"', "unit of the heights"),
                                ("pixel_size_mm = 0.02", "pixel_size_mm = 0.01", "pitch of the height images"),
                                ("pixel_size_mm = 0.02", "matrix_px_per_unit = [[50.0, 0.0], [0.0, -20.0]]", "pitch")):
        toml.write_text(text.replace(key, other).replace('axes = ["+col', '# axes = ["+col' if "matrix" in other
                                                         else 'axes = ["+col'))
        with pytest.raises(InputError, match=message) as refused:
            load_experiment(folder)
        assert refused.value.found and refused.value.remedy
    toml.write_text(text.replace("pixel_size_mm = 0.02", "pixel_size_mm = 0.0201"))
    assert [note for note in load_experiment(folder).notes if "0.0201 mm per pixel" in note and "0.02 mm" in note]
    as_if_still = text.replace('height_unit = "um"', 'height_unit = "um"\nstill_frames = "still/*.xyz"')
    toml.write_text(as_if_still)
    (folder / "still").mkdir()
    for name in ("map_00.xyz", "map_01.xyz"):
        (folder / "still" / name).write_text((folder / "images" / name).read_text().replace("mm mm um", "mm mm nm"))
    with pytest.raises(InputError, match="unit of the heights") as refused:
        load_experiment(folder)
    assert refused.value.key == "experiment.still_frames"


def test_init_takes_unit_and_pitch_of_xyz_grids(tmp_path):
    folder = as_xyz(write_folder(tmp_path / "test"))
    (folder / "experiment.toml").unlink()
    path, lines = initial_experiment(folder)
    table = tomllib.loads(path.read_text())
    assert table["experiment"]["images"] == "images/*.xyz" and table["experiment"]["quantity"] == "height"
    assert table["experiment"]["height_unit"] == "um" and table["camera"]["pixel_size_mm"] == 0.02
    assert "origin_px" in lines[-1] and "height_unit" not in lines[-1]


def test_height_images_need_their_noise_and_cannot_measure_an_edge(tmp_path):
    folder = write_folder(tmp_path / "test", TOML.replace("noise_std_gv = 0.03\n", ""))
    with pytest.raises(InputError, match="noise of the height images"):
        check_before_writing(load_experiment(folder))
    still = write_folder(tmp_path / "still", TOML.replace("noise_std_gv = 0.03\n", "").replace(
        'height_unit = "um"', 'height_unit = "um"\nstill_frames = "still/*.tif"'))
    (still / "still").mkdir()
    image = tifffile.imread(still / "images" / "map_00.tif")
    for k in range(2):
        noisy = image + 0.05 * np.random.default_rng(k).standard_normal(image.shape)
        tifffile.imwrite(still / "still" / f"{k}.tif", noisy.astype(np.float32))
    assert load_experiment(still).recording.noise.std_gv == pytest.approx(0.05, rel=0.03)  # 20000 px; gaps left out
    measured = write_folder(tmp_path / "edge", TOML.replace("ux = 0.0", 'ux = "measured"'))
    with pytest.raises(InputError, match="measured"):
        check_before_writing(load_experiment(measured))


@pytest.mark.parametrize("mark", [-9999.0, 1e38, 0.0])
def test_a_number_in_the_place_of_a_missing_height_is_refused(tmp_path, mark):
    folder = write_folder(tmp_path / "test")
    for path in (folder / "images").iterdir():  # the instrument stands 5 mm above the specimen
        image = tifffile.imread(path) + 5000.0
        tifffile.imwrite(path, np.where(np.isnan(image), mark, image).astype(np.float32))
    with pytest.raises(InputError, match="a number in the place of missing heights") as refused:
        load_experiment(folder)
    assert f"pixels of {mark:g} µm" in str(refused.value) and "map_00.tif" in str(refused.value)
    for path in (folder / "images").iterdir():
        image = tifffile.imread(path)
        tifffile.imwrite(path, np.where(image == np.float32(mark), np.nan, image).astype(np.float32))
    assert load_experiment(folder).recording.quantity == "height"


def test_a_simulated_folder_of_height_images_gives_its_parameters_back(tmp_path):
    folder = write_folder(tmp_path / "test", gaps=0.0)
    truth = {"BODY.C10": 3.0, "BODY.kappa": 60.0}
    path = simulate(folder, tmp_path / "virtual", overrides=truth, seed=2)
    image = tifffile.imread(path.parent / "images" / "frame_005.tif")
    assert image.dtype == np.float32 and np.isnan(image[0, 0])  # beside the specimen there is nothing
    assert json.loads((path.parent / "truth.json").read_text())["noise_std_gv"] == pytest.approx(0.03)
    result = idic.identify(path, overrides={"BODY.C10": 3.6, "BODY.kappa": 50.0})
    for name, true in truth.items():
        assert abs(result["parameters"][name]["value"] - true) < 3 * result["parameters"][name]["std"]
