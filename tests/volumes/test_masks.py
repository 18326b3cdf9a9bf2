"""Air in the mesh is left out, by a painted volume or by its grey value, in the identification and the free FE-DVC."""

import shutil

import numpy as np
import pytest
from volumes.tomograms import TRUTH, VOXEL_MM

import idic
from idic.correlation import build_experiment_reference
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.measure import volume_motion
from idic.report import check

HOLE = (slice(18, 26), slice(18, 26), slice(18, 26))  # slices, rows, columns, in the middle of the mesh
AIR_GV, TEXTURE_GV = 500, 6000  # of a hole that stays where it is; between it and the texture of 12800 +- 3000


@pytest.fixture(scope="module")
def porous(bar, tmp_path_factory):
    """The bar with a hole that does not follow the motion, and a volume that leaves it out."""
    folder = tmp_path_factory.mktemp("porous") / "bar"
    shutil.copytree(bar, folder)
    rng = np.random.default_rng(8)
    for file in sorted((folder / "scans").iterdir()):
        scan = np.load(file)
        scan[HOLE] = AIR_GV + np.rint(200.0 * rng.random(scan[HOLE].shape))
        np.save(file, scan)
    mask = np.full(scan.shape, 255, np.uint8)
    mask[HOLE] = 0
    np.save(folder / "mask.npy", mask)
    return folder


def edited(folder, target, old, new):
    shutil.copytree(folder, target)
    file = target / "experiment.toml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    return target


@pytest.fixture(scope="module", params=["painted", "grey value"])
def masked(porous, request, tmp_path_factory):
    target = tmp_path_factory.mktemp("masked") / "bar"
    if request.param == "painted":
        return load_experiment(edited(porous, target, "[experiment]\n", '[experiment]\nmask = "mask.npy"\n'))
    return load_experiment(edited(porous, target, "[scanner]\n", f"[scanner]\nair_below_gv = {TEXTURE_GV}\n"))


def test_no_voxel_of_the_hole_and_of_its_margin_is_compared(masked):
    compared = build_experiment_reference(masked, masked.model.camera).pixel_map.points()
    places = [compared[:, 2 - axis] for axis in range(3)]
    beside = 3 if masked.recording.voxel_mask.painted else 1  # the margin; a blurred grey value rounds corners by two
    in_hole = np.all([(at >= part.start - beside) & (at < part.stop + beside)
                      for at, part in zip(places, HOLE, strict=True)], axis=0)
    assert len(compared) > 2000 and not in_hole.any()


def test_the_law_is_found_beside_the_hole(masked, porous):
    """Without a mask the hole, which does not move, spoils the fit."""
    parameters, chi2 = _fit(masked)
    for name, truth in TRUTH.items():
        assert abs(parameters[f"BODY.{name}"]["value"] - truth) < 3.0 * parameters[f"BODY.{name}"]["std"]
    assert chi2 < 1.3 < 1.5 < _fit(load_experiment(porous))[1]  # of 4000 voxels: it scatters by 0.02


def _fit(experiment):
    content = idic.identify(experiment.folder).content
    return content["parameters"], content["residual"]["image_chi2_dof"]


def test_a_free_motion_is_measured_beside_the_hole(masked):
    measured = volume_motion(masked)
    model = masked.model
    stroke = model.prescribed[-1].drive.values[-1]
    gap_px = (measured.u_mm[-1][model.mesh.node_sets["TOP"]] - [0.0, 0.0, stroke]) / VOXEL_MM
    assert np.sqrt(np.mean(gap_px**2)) < 0.15


def test_the_picture_of_check_shades_the_hole(masked, porous):
    assert check(masked).overlay.png != check(load_experiment(porous)).overlay.png


@pytest.mark.parametrize("mask, words", [
    (np.full((44, 44, 43), 255, np.uint8), "the size differs from that of the scans"),
    (np.zeros((44, 44, 44), np.uint8), "mask and margin leave no voxel of the mesh")])
def test_a_mask_that_fits_no_scan_is_refused(porous, tmp_path, mask, words):
    folder = edited(porous, tmp_path / "bar", "[experiment]\n", '[experiment]\nmask = "mask.npy"\n')
    np.save(folder / "mask.npy", mask)
    with pytest.raises(InputError, match=words):
        experiment = load_experiment(folder)
        build_experiment_reference(experiment, experiment.model.camera)
