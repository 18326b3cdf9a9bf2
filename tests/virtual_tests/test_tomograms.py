"""Virtual scans against what is known: points of a moved body, poses, partly filled voxels, spectra of the noise."""

from __future__ import annotations

import json

import numpy as np
import pytest

from idic.fe import make_mesh, raise_order
from idic.readers import Log, volume_entries
from idic.virtual_tests import GreyDrift, Pose, ReconstructionNoise, Tomograph, write_example

CUBE = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
TETS = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])
BODIES = {"hex8": make_mesh(CUBE, [("hex8", np.arange(8)[None])]), "tet4": make_mesh(CUBE, [("tet4", TETS)])}
BODIES |= {"hex20": raise_order(BODIES["hex8"]), "tet10": raise_order(BODIES["tet4"])}


def tomograph(**options):
    return Tomograph(**({"shape": (20, 24, 28), "voxel_mm": np.array([0.06, 0.07, 0.08]),
                         "origin_px": np.array([5.2, 4.1, 3.3]), "supersampling": 1, "air_gv": np.nan} | options))


def places(scanner):
    """Mesh points of the voxels  # (nz, ny, nx, 3) mm"""
    z, y, x = np.meshgrid(*(np.arange(n) for n in scanner.shape), indexing="ij")
    return (np.stack([x, y, z], axis=-1) - scanner.origin_px) * scanner.voxel_mm


@pytest.mark.parametrize("cell", BODIES)
def test_a_homogeneous_deformation_is_inverted(cell):
    mesh, scanner = BODIES[cell], tomograph()
    gradient = np.array([[0.05, 0.02, 0.0], [-0.03, 0.04, 0.01], [0.02, 0.0, -0.06]])
    shift = np.array([0.03, -0.02, 0.05])
    inverse = np.linalg.solve(np.eye(3) + gradient, (places(scanner) - shift).reshape(-1, 3).T).T
    inside = ((inverse > 1e-4) & (inverse < 1 - 1e-4)).all(axis=1)
    assert inside.sum() > 1000
    for component in range(3):
        scan = np.stack(list(scanner.clean(mesh, mesh.nodes @ gradient.T + shift, lambda X, c=component: X[:, c])))
        assert np.abs(scan.ravel() - inverse[:, component])[inside].max() < 1e-9
        assert np.isnan(scan.ravel()[~inside]).mean() > 0.99  # but for voxels on the faces


def test_a_quadratic_deformation_is_inverted():
    mesh, scanner = BODIES["hex20"], tomograph()
    x = mesh.nodes
    u = 0.05 * np.column_stack([x[:, 1] ** 2, x[:, 2] * x[:, 0], x[:, 0] ** 2 - x[:, 1]])  # of the element's space
    X = np.stack([np.stack(list(scanner.clean(mesh, u, lambda X, c=c: X[:, c]))) for c in range(3)], axis=-1)
    inside = ~np.isnan(X[..., 0])
    X = X[inside]
    again = X + 0.05 * np.column_stack([X[:, 1] ** 2, X[:, 2] * X[:, 0], X[:, 0] ** 2 - X[:, 1]])
    assert inside.sum() > 1000 and np.abs(again - places(scanner)[inside]).max() < 1e-9


def test_a_pose_turns_shifts_and_magnifies_about_the_middle():
    mesh, scanner = BODIES["hex8"], tomograph()
    pose = Pose((0.0, 0.0, 4.0), (0.02, 0.0, -0.03), 0.01)
    angle = np.radians(4.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    X = np.stack([np.stack(list(scanner.clean(mesh, 0 * mesh.nodes, lambda X, c=c: X[:, c], pose)))
                  for c in range(3)], axis=-1)
    inside = ~np.isnan(X[..., 0])
    there = 0.5 + 1.01 * (X[inside] - 0.5) @ turn.T + [0.02, 0.0, -0.03]
    assert np.abs(there - places(scanner)[inside]).max() < 1e-9


def test_a_voxel_at_the_edge_is_partly_filled():
    scanner = tomograph(supersampling=4, air_gv=0.0)
    scan = np.stack(list(scanner.clean(BODIES["hex8"], 0 * BODIES["hex8"].nodes, lambda X: np.ones(len(X)))))
    assert scan.sum() * np.prod(scanner.voxel_mm) == pytest.approx(1.0, rel=0.02)  # the volume of the cube
    assert 0.1 < ((scan > 0) & (scan < 1)).sum() / (scan > 0).sum() < 0.6


def test_the_noise_has_its_spectrum_and_the_grey_values_their_drift():
    noise = ReconstructionNoise(3.0)
    planes = np.stack(list(noise.planes(np.random.default_rng(0), (40, 64, 63))))
    assert planes.std() == pytest.approx(3.0, rel=0.02) and abs(planes.mean()) < 0.01
    assert (planes[:-1] * planes[1:]).mean() / 9.0 == pytest.approx(2 / 3, abs=0.02)  # of weights 1/4, 1/2, 1/4
    measured = (planes[:, :, :-1] * planes[:, :, 1:]).mean() / 9.0
    assert measured == pytest.approx(noise.correlation((64, 63), 2)[0, 1], abs=0.02)
    plane = np.full((5, 5), 100.0)
    assert GreyDrift(1.1, -3.0, 2.0).applied(plane)[2] == pytest.approx([109.0, 107.5, 107.0, 107.5, 109.0])


@pytest.mark.slow
def test_the_example_has_the_noise_and_the_files_that_it_states(tmp_path):
    folder = write_example("volume", tmp_path / "bar", reduced=True).parent
    entries = volume_entries(folder, "scans/*.tif")
    assert len(entries) == len(Log.read(folder / "loads.csv").rows) == 6
    assert entries[0].voxel_mm == pytest.approx((0.04, 0.04, 0.04), rel=1e-6)
    everything = slice(None)
    first, second = (entry.block(everything, everything, everything).astype(float) for entry in entries[:2])
    truth = json.loads((folder / "truth.json").read_text())
    air = first < 50
    gain, offset = np.polyfit(first.ravel(), second.ravel(), 1)
    assert np.std((second - first)[air]) / np.sqrt(2) == pytest.approx(truth["noise_std_gv"], rel=0.03)
    assert gain == pytest.approx(1.0, abs=0.05) and abs(offset) < 3.0
