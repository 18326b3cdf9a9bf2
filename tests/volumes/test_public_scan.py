"""A real scan, moved rigidly: translations to 0.02 voxel, rotations to 0.02 degrees, noise from a pair at rest.

An X-ray tomogram of snow, 100 voxels cubed, 16 bit, is part of the package spam. These tests are skipped without it;
spam need not be installed:

    pip download --no-deps spam && unzip spam-*.whl 'spam/data/snow/*' -d FOLDER
    IDIC_PUBLIC_SCAN=FOLDER/spam/data/snow/snow.tif pytest tests/volumes/test_public_scan.py

The grains are real; further scans of the same snow are not public. SciPy's spline of fifth order makes them (the
correlator's is cubic), each with its own noise of a stated size. Interpolation of the sharp edges of grains leaves
chi-square 1.7, which is why the largest error, 0.0044 voxel, is three standard deviations.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import tifffile
from scipy import ndimage
from scipy.spatial.transform import Rotation

from idic.fe import Block, Mesh
from idic.run import identify_run
from idic.virtual_tests import write_inp

SCAN = Path(os.environ.get("IDIC_PUBLIC_SCAN", "snow.tif"))
pytestmark = pytest.mark.skipif(not SCAN.is_file(), reason="no public scan: IDIC_PUBLIC_SCAN, see the file")

VOXEL_MM, SIDE_PX, N_ELEMENTS = 0.02, 70, 5
NOISE_SHARE = 0.05  # of the standard deviation of the scan
TURNS_DEG = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.8, -0.5, 1.2]])
SHIFTS_PX = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.37, -1.26, 2.81], [-0.64, 0.45, 1.13]])  # along x, y, z
TOML = """\
[experiment]
volumes = "scans/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "solid"
reference = [0, 1]
still_frames = [0, 1]

[scanner]
voxel_mm = {voxel}
origin_px = {origin}
motion = "free"

[material.BODY]
law = "elastic"
E = 100
nu = 0.3

[[boundary]]
nodes = "BOTTOM"
ux = 0.0
uy = 0.0
uz = 0.0

[[boundary]]
nodes = "TOP"
ux = 0.0
uy = 0.0
uz = 0.0
"""


def cube(n, side_mm):
    """n cubed hex8 about the origin; BOTTOM and TOP are its ends along z."""
    z, y, x = np.meshgrid(*[np.linspace(-0.5, 0.5, n + 1) * side_mm] * 3, indexing="ij")
    number = np.arange(x.size).reshape(n + 1, n + 1, n + 1)
    corners = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = np.stack([number[c:n + c, b:n + b, a:n + a].ravel() for c, b, a in corners], axis=1)
    return Mesh(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), (Block("hex8", cells),),
                element_sets={"BODY": np.arange(len(cells))},
                node_sets={"BOTTOM": number[0].ravel(), "TOP": number[-1].ravel()})


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("snow")
    (folder / "scans").mkdir()
    snow = tifffile.imread(SCAN).astype(float)
    write_inp(cube(N_ELEMENTS, SIDE_PX * VOXEL_MM), folder / "mesh.inp", "Piece of snow")
    middle, rng = (np.array(snow.shape) - 1.0) / 2.0, np.random.default_rng(7)
    for k, (turn, shift) in enumerate(zip(TURNS_DEG, SHIFTS_PX, strict=True)):
        back = Rotation.from_rotvec(turn, degrees=True).inv().as_matrix()[::-1, ::-1]  # of slice, row, column
        moved = ndimage.affine_transform(snow, back, middle - back @ (middle + shift[::-1]), order=5, mode="nearest")
        noisy = moved + NOISE_SHARE * snow.std() * rng.standard_normal(snow.shape)
        tifffile.imwrite(folder / "scans" / f"scan_{k}.tif", np.clip(np.rint(noisy), 0, 65535).astype(np.uint16))
    np.savetxt(folder / "loads.csv", np.column_stack([np.arange(4), 60.0 * np.arange(4)]), delimiter=",",
               header="frame,time_s", comments="", fmt="%d")
    (folder / "experiment.toml").write_text(TOML.format(voxel=VOXEL_MM, origin=middle[::-1].tolist()))
    return snow.std(), identify_run(folder, folder / "run")


def test_scans_at_rest_show_the_noise(result):
    std, content = result
    assert content["noise"]["std_gv"] == pytest.approx(NOISE_SHARE * std, rel=0.05)


@pytest.mark.parametrize("scan", [2, 3])
def test_a_rigid_motion_is_found(result, scan):
    parameters = result[1]["parameters"]
    for axis, turn_deg, shift_px in zip("xyz", TURNS_DEG[scan], SHIFTS_PX[scan], strict=True):
        assert parameters[f"scanner.t_{axis}_at[{scan}]"]["value"] / VOXEL_MM == pytest.approx(shift_px, abs=0.02)
        assert parameters[f"scanner.rotation_{axis}_at[{scan}]"]["value"] == pytest.approx(turn_deg, abs=0.02)
