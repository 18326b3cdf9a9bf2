"""Diagnosis of volumes: a concealed inclusion is told, a clean test stays without an alarm."""

import numpy as np
import pytest
from volumes.test_volume_equations import scans, solid
from volumes.tomograms import FINE, Tomograms

from idic.correlation import VolumeReference, build_voxel_map
from idic.diagnose import JUDGEMENT, thinned
from idic.experiment_file import load_experiment
from idic.fe import Block
from idic.images import ArrayVolumes
from idic.run import diagnose_run, identify_run

RADIUS_MM, TRUE_MESH = 0.18, (12, 20)
STIFF_MIDDLE, SOFT_END = ((0.25, 0.46, 0.50), 2.5), ((0.36, 0.38, 0.08), 0.5)


def test_sums_of_a_residual_are_those_of_its_scan():
    """Under a translation F is the identity, and gradients are those of the reference."""
    f, g = scans()
    nodes, conn = solid("hex8", 0.5)
    volumes = ArrayVolumes([f, g])
    reference = VolumeReference.of(build_voxel_map(nodes, [Block("hex8", conn)], f.shape), volumes, (0,))
    u = np.tile([0.4, -0.3, 0.7], (len(nodes), 1))
    expected = reference.equations(volumes, 1, u, "frame")
    r, valid, _ = reference.voxel_residuals(volumes, 1, u)
    assert valid.all() and expected.n_lost == 0
    pm = reference.pixel_map
    sums = reference.equations_of_values(lambda k: r[slice(*pm.start[pm.blocks[k:k + 2]])], "frame")
    np.testing.assert_allclose(sums.q, expected.q, rtol=0, atol=1e-5 * np.abs(expected.q).max())
    np.testing.assert_allclose(sums.rb, expected.rb, rtol=1e-5)
    assert sums.rr == pytest.approx(expected.rr, rel=1e-6)


def test_what_scans_have_in_common_is_that_of_their_voxels(monkeypatch):
    """Block by block as from all voxels at once, which only a test can hold."""
    monkeypatch.setattr("idic.correlation.volume.voxel_map.VOXELS_PER_BLOCK", 8_000)
    monkeypatch.setattr("idic.correlation.volume.voxel_map.LEAST_BLOCK_PX", 8)
    f, g = scans()
    nodes, conn = solid("hex8", 0.5)
    volumes, kappa, motions = ArrayVolumes([f, g, f + 0.3 * (g - f)]), np.array([1.2, 1.5]), []
    reference = VolumeReference.of(build_voxel_map(nodes, [Block("hex8", conn)], f.shape), volumes, (0,))
    total, squares, is_shown = 0.0, 0.0, True
    for frame, k in zip((1, 2), kappa, strict=True):
        u = np.tile([0.4, -0.3, 16.0 * frame], (len(nodes), 1))  # voxels leave the scan
        motions.append(reference.motion(u))
        r, valid, _ = reference.voxel_residuals(volumes, frame, u)
        total, squares, is_shown = total + r / k, squares + np.sum(r.astype(float)**2) / k, is_shown & valid
    assert 0.1 < is_shown.mean() < 0.9
    total = np.where(is_shown, total, 0.0)
    chi2, q, rb = reference.lasting_residual(volumes, (1, 2), motions, kappa, "frame")
    assert chi2 == pytest.approx(squares - np.sum(total**2) / (1.0 + np.sum(1.0 / kappa)), rel=1e-6)
    pm = reference.pixel_map
    assert len(pm.blocks) > 2
    expected = reference.equations_of_values(lambda k: total[slice(*pm.start[pm.blocks[k:k + 2]])], "frame")
    np.testing.assert_allclose(q, expected.q, rtol=0, atol=1e-6 * np.abs(expected.q).max())
    np.testing.assert_allclose(rb, expected.rb, rtol=1e-6)


def test_two_copies_of_volumes_have_the_recording_as_their_mean(bar):
    experiment = load_experiment(bar)
    everything, std = (slice(None),) * 3, experiment.recording.noise.in_sums_gv
    copies = [thinned(experiment, sign, seed=5).recording for sign in (-JUDGEMENT, JUDGEMENT)]
    blocks = [copy.volumes.block(1, *everything) for copy in copies]
    recorded = experiment.recording.volumes.block(1, *everything)
    np.testing.assert_allclose(0.5 * (blocks[0] + blocks[1]), recorded, atol=2e-3)  # of 13000, in single precision
    noise = 0.5 * (blocks[0] - blocks[1])
    n = noise.size
    assert abs(noise.mean()) < 4 * std / np.sqrt(n)
    assert noise.std() == pytest.approx(std, rel=4 / np.sqrt(2 * n))
    for axis in range(3):  # independent from voxel to voxel
        assert abs(np.mean(noise * np.roll(noise, 1, axis))) < 4 * std**2 / np.sqrt(n)
    part = (slice(3, 20), slice(7, 44), slice(0, 31))
    np.testing.assert_array_equal(copies[0].volumes.block(1, *part), blocks[0][part])  # however it is cut
    assert copies[0].noise.std_gv == pytest.approx(np.sqrt(2.0) * experiment.recording.noise.std_gv)


def diagnosed(folder, hidden, quick=True, curvature=0.0, **scanner):
    """curvature : of the load cell, share of the force at the largest reading"""
    test = Tomograms(side=56, n_scans=6, strain=0.04, mesh=FINE, true_mesh=TRUE_MESH, hidden=hidden, **scanner)
    experiment = test.write(folder / "experiment")
    log, header = experiment / "loads.csv", "time_s,stroke_mm,force_N"
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    rows[:, 2] *= 1.0 + curvature * rows[:, 2] / rows[:, 2].max()
    np.savetxt(log, rows, delimiter=",", header=header, comments="")
    identify_run(experiment, folder / "run")
    return diagnose_run(folder / "run", quick=quick), folder / "run"


def inclusion(centre_mm, stiffness):
    return (f'\n[[heterogeneity]]\nset = "BODY"\nform = "inclusion"\ncentre_mm = {list(centre_mm)}\n'
            f"radius_mm = {RADIUS_MM}\nstiffness = {stiffness}\n")


@pytest.mark.slow
def test_a_clean_test_has_no_alarm(tmp_path):
    verdict, _ = diagnosed(tmp_path, "")
    assert verdict["verdict"] == "none" and not verdict["named"] and not verdict["notes"]


@pytest.mark.slow
@pytest.mark.parametrize("centre_mm, stiffness", [STIFF_MIDDLE, SOFT_END])
def test_a_concealed_inclusion_is_found_at_its_place(tmp_path, centre_mm, stiffness):
    """In so short a bar a stiff inclusion moves the scans nearly as soft ends do."""
    verdict, run = diagnosed(tmp_path, inclusion(centre_mm, stiffness), quick=False)
    assert verdict["verdict"] == "single" and verdict["named"] == ["heterogeneity"] and not verdict["notes"]
    assert verdict["mismatch"]["side"] == "bulk" and verdict["mismatch"]["p_value"] < 1e-6
    parameters = verdict["model"]["parameters_after"]
    for name, true in zip(("x", "y", "z", "radius", "stiffness"), (*centre_mm, RADIUS_MM, stiffness), strict=True):
        entry = parameters[f"BODY.inclusion.{name}"]
        assert entry["value"] == pytest.approx(true, abs=3.0 * entry["std"]), name
    assert parameters["BODY.inclusion.z"]["std"] < 0.06
    assert parameters["BODY.E"]["value"] == pytest.approx(70000.0, abs=3.0 * parameters["BODY.E"]["std"])
    assert (run / "figures" / "diagnosis_where.png").exists() and (run / "diagnosis.html").exists()


@pytest.mark.slow
def test_a_concealed_gradient_is_found_along_its_axis(tmp_path):
    verdict, _ = diagnosed(tmp_path, '\n[[heterogeneity]]\nset = "BODY"\nform = "gradient"\nalong_z = 0.6\n')
    assert verdict["named"] == ["heterogeneity"] and verdict["candidates"][0]["form"] == "gradient"
    assert "along z" in verdict["candidates"][0]["label"]


DRIFT_PX = np.array([[0, 0, 0], [0, 0, 0], [3, -2, 1], [-2, 3, 2], [4, 1, -3], [1, -4, 2]]) / 20


@pytest.mark.slow
@pytest.mark.parametrize("name, scanner", [
    ("scanner_motion", {"drift": DRIFT_PX}),
    ("scanner_magnification", {"growth": 1e-3 * np.array([0.0, 0.0, 1.0, 2.5, 3.0, 4.5])}),
])
def test_a_concealed_fault_of_the_scanner_is_named(tmp_path, name, scanner):
    verdict, _ = diagnosed(tmp_path, "", **scanner)
    assert name in (*verdict["named"], *verdict["indistinguishable"]), verdict["headline"]
    assert verdict["mismatch"]["p_value"] < 1e-6


@pytest.mark.slow
def test_a_solid_that_yields_is_no_creep(tmp_path):
    """E comes out at half: creep with a large exponent imitates yielding, and promises more."""
    verdict, _ = diagnosed(tmp_path, "", quick=False,
                           law='law = "j2_linear"\nyield_stress = 1150.0\nhardening_modulus = 4600.0')
    assert verdict["verdict"] in ("single", "set") and verdict["named"] == ["plasticity"], verdict["headline"]
    modulus = verdict["model"]["parameters_after"]["BODY.E"]
    assert abs(modulus["value"] - 70000.0) < 3.0 * modulus["std"]


@pytest.mark.slow
def test_a_load_cell_that_bends_is_one_of_a_set(tmp_path):
    """Finite strains, which the model neglects, bend the force as much: they are a candidate, and no small error."""
    verdict, _ = diagnosed(tmp_path, "", quick=False, curvature=0.08)
    assert verdict["verdict"] == "set" and verdict["mismatch"]["located_side"] == "force", verdict["headline"]
    (members,) = verdict["indistinguishable"]
    assert {"load_cell_curvature", "nonlinear_elasticity", "geometric_nonlinearity"} <= {*members}


@pytest.mark.slow
def test_a_magnification_that_jumps_gets_its_own_course(tmp_path):
    """A growth with time leaves a third of it, for which warmth and a force offset were told."""
    growth = -1e-3 * np.array([0.0, 0.0, 3.8, 3.9, 4.5, 4.6])
    verdict, _ = diagnosed(tmp_path, "", quick=False, growth=growth)
    assert (verdict["verdict"], verdict["named"]) == ("single", ["scanner_magnification"]), verdict["headline"]
    (course,) = verdict["courses"]
    assert course["free"]
    np.testing.assert_allclose(np.array(course["value"])[2:], growth[2:], atol=4.0 * max(course["std"]))
