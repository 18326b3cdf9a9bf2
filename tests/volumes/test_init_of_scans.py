"""`idic init` for a folder of scans, and axes of volumes that the motion contradicts."""

import shutil
import tomllib

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner
from volumes.tomograms import ORIGIN_PX, VOXEL_MM

from idic.cli.app import app

STRAIGHT = ["+col", "+row", "+slice"]


def run_cli(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def recorded(bar, tmp_path):
    """Scans, mesh and log without an experiment; air around the bar."""
    folder = tmp_path / "recorded"
    folder.mkdir()
    shutil.copy(bar / "mesh.inp", folder)
    shutil.copy(bar / "loads.csv", folder)
    low = np.rint(ORIGIN_PX).astype(int)
    high = 44 - np.array([10, 9, 7])
    for k, file in enumerate(sorted((bar / "scans").iterdir())):
        scan = np.full((44, 44, 44), 2000, np.uint16)
        inside = tuple(slice(low[d], high[d]) for d in (2, 1, 0))
        scan[inside] = np.load(file)[inside]
        (folder / "scans").mkdir(exist_ok=True)
        tifffile.imwrite(folder / "scans" / f"scan_{k}.tif", scan, imagej=True, resolution=(1 / VOXEL_MM,) * 2,
                         metadata={"spacing": VOXEL_MM, "unit": "mm", "axes": "ZYX"})
    return folder


def tables(folder):
    return tomllib.loads((folder / "experiment.toml").read_text())


def test_init_lays_the_mesh_on_the_specimen_and_check_accepts_it(recorded):
    result = run_cli("init", recorded)
    assert result.exit_code == 0, result.output
    written = tables(recorded)
    assert written["experiment"]["volumes"] == "scans/*.tif" and written["experiment"]["still_frames"] == [0, 1]
    assert written["scanner"]["axes"] == STRAIGHT
    np.testing.assert_allclose(written["scanner"]["origin_px"], ORIGIN_PX, rtol=0, atol=1.5)  # a blurred edge
    assert (recorded / "check" / "mesh.png").exists()
    assert run_cli("check", recorded).exit_code == 0


def test_init_finds_the_order_of_the_axes(recorded):
    """Scans whose slices run along mesh y: the sides of the mesh fit in this order alone."""
    for file in (recorded / "scans").iterdir():
        scan = np.ascontiguousarray(np.swapaxes(tifffile.imread(file), 0, 1))
        tifffile.imwrite(file, scan, imagej=True, resolution=(1 / VOXEL_MM,) * 2,
                         metadata={"spacing": VOXEL_MM, "unit": "mm", "axes": "ZYX"})
    result = run_cli("init", recorded)
    assert result.exit_code == 0, result.output
    assert tables(recorded)["scanner"]["axes"] == ["+col", "+slice", "+row"]


def test_init_leaves_a_voxel_of_unknown_size_open(recorded):
    for file in (recorded / "scans").iterdir():
        np.save(file.with_suffix(".npy"), tifffile.imread(file))
        file.unlink()
    result = run_cli("init", recorded)
    assert result.exit_code == 0
    assert "fill in      voxel_mm, E" in result.output
    text = (recorded / "experiment.toml").read_text()
    side = float(next(row for row in text.splitlines() if row.startswith("# voxel_mm")).split("=")[1].split("#")[0])
    assert side == pytest.approx(VOXEL_MM, rel=0.06)  # a voxel of the 24 across
    (recorded / "experiment.toml").write_text(text.replace("# voxel_mm", "voxel_mm"))
    assert run_cli("check", recorded).exit_code == 0


def test_init_takes_slices_in_folders_and_a_mask(recorded):
    for file in list((recorded / "scans").iterdir()):
        scan = tifffile.imread(file)
        file.with_suffix("").mkdir()
        for k, plane in enumerate(scan):
            tifffile.imwrite(file.with_suffix("") / f"slice_{k:03d}.tif", plane)
        file.unlink()
    np.save(recorded / "mask.npy", np.full((44, 44, 44), 255, np.uint8))
    (recorded / "experiment.toml").unlink(missing_ok=True)
    result = run_cli("init", recorded)
    assert result.exit_code == 0, result.output
    assert tables(recorded)["experiment"]["volumes"] == "scans/scan_*" and "mask" in tables(recorded)["experiment"]


DRIVEN = '[[boundary]]\nnodes = "BOTTOM"\nux = 0.0\nuy = 0.0\nuz = 0.0\n'


@pytest.mark.parametrize("ends", ["logged", "measured"])
def test_swapped_axes_are_refused_because_the_motion_shows_them(bar, tmp_path, ends):
    folder = tmp_path / "bar"
    shutil.copytree(bar, folder)
    file = folder / "experiment.toml"
    text = file.read_text().replace('"+row", "+slice"', '"+slice", "+row"')
    if ends == "measured":
        head, _, rest = text.partition("[[boundary]]")
        text = head + "".join(f'[[boundary]]\nnodes = "{name}"\nu = "measured"\n\n' for name in ("BOTTOM", "TOP"))
        text += rest[rest.index("[[channel]]"):]
    file.write_text(text)
    for command, options in (("check", []), ("identify", ["--out", tmp_path / "run"])):
        result = run_cli(command, folder, *options)
        assert result.exit_code == 2
        assert "axes of the volume are swapped" in result.output
        assert '"+col", "+row", "+slice"' in " ".join(result.output.split())
    assert not (tmp_path / "run").exists()
