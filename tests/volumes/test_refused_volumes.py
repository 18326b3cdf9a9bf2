"""Bad input of volumes: one message with the reason, exit code 2, nothing written."""

import shutil

import numpy as np
import pytest

from idic.cli.app import app


@pytest.fixture
def folder(bar, tmp_path):
    shutil.copytree(bar, tmp_path / "bar")
    return tmp_path / "bar"


def refusal(folder, run_cli, command="check"):
    result = run_cli(command, str(folder), *(["--out", str(folder.parent / "run")] if command == "identify" else []))
    assert result.exit_code == 2
    assert not (folder.parent / "run").exists()
    return result.output


@pytest.fixture
def run_cli():
    from typer.testing import CliRunner

    return lambda *arguments: CliRunner().invoke(app, list(arguments))


def edited(folder, old, new):
    file = folder / "experiment.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_scans_of_different_size(folder, run_cli):
    scan = folder / "scans" / "scan_03.npy"
    np.save(scan, np.load(scan)[:-1])
    assert "the volumes differ in size" in refusal(folder, run_cli)


def test_micrometres_taken_as_millimetres(folder, run_cli):
    edited(folder, "voxel_mm = 0.02", "voxel_mm = 20")
    output = refusal(folder, run_cli)
    assert "different units" in output and "12 µm are 0.012" in output


def test_a_mesh_beside_the_volume(folder, run_cli):
    edited(folder, "origin_px = [10.0, 9.0, 7.0]", "origin_px = [400.0, 9.0, 7.0]")
    assert "the mesh lies outside the volume" in refusal(folder, run_cli)


def test_two_axes_along_one(folder, run_cli):
    edited(folder, '["+col", "+row", "+slice"]', '["+col", "+col", "+slice"]')
    assert "two mesh axes along one axis of the volume" in refusal(folder, run_cli)


@pytest.mark.parametrize("old, new, words", [
    ('kind = "solid"', 'kind = "solid"\nsurface = "FRONT"', "a key of images next to volumes"),
    ('kind = "solid"', 'kind = "plane_stress"\nthickness_mm = 1', "volumes of a plane model"),
    ("[scanner]", '[camera]\npixel_size_mm = 1.0\n\n[scanner]', "tables that volumes do not have"),
    ("voxel_mm = 0.02\n", "", "the size of a voxel is not known"),
    ("still_frames = [0, 1]\n", "", "the noise of the scans is not known"),
    ("[material.BODY]", '[options]\nmethod = "two_step"\n\n[material.BODY]', "two steps on volumes"),
])
def test_keys_that_do_not_go_together(folder, run_cli, old, new, words):
    edited(folder, old, new)
    assert words in refusal(folder, run_cli)


def test_a_scan_that_is_a_copy_is_no_noise(folder, run_cli):
    shutil.copy(folder / "scans" / "scan_00.npy", folder / "scans" / "scan_01.npy")
    assert "two scans at rest show no noise" in refusal(folder, run_cli)


def test_check_tells_scans_and_mesh(folder, run_cli):
    result = run_cli("check", str(folder))
    assert result.exit_code == 0, result.output
    assert "4, 44 x 44 x 44 voxels of 0.02 mm" in result.output
    assert (folder / "check" / "mesh.png").exists()
