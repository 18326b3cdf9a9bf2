"""A diagnosis on the measured motion, where the images are out of register with the identified model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from material_twins import TRUTHS, write_folder

from idic.diagnose import (
    by_motion, candidate_library, holds_motion, identification_at, may_be_out_of_register, out_of_register,
    residual_evidence, thinned, with_edge_modes,
)
from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.diagnose.residual.measured_motion import MOTION_STD_PX
from idic.diagnose.residual.residual_maps import spread
from idic.diagnose.residual.thinning import CHOICE
from idic.diagnose.selection.rivals import other_laws
from idic.experiment_file import load_experiment
from idic.identification import Evaluation, identify
from idic.model import DriveTable, build_forward, solve

TRUTH = {f"BODY.{name}": value for name, value in TRUTHS["clean_rubber"].values.items()}
MEASURED = [{"nodes": name, "u": "measured"} for name in ("LEFT", "RIGHT")]


@pytest.fixture(scope="module")
def rubber(tmp_path_factory):
    """A strip that is pulled by 40 px, its file, and its motion at the true parameters  # (n_frames, n_nodes, 2) px"""
    file = write_folder(tmp_path_factory.mktemp("rubber") / "strip", "clean_rubber")
    experiment = load_experiment(file)
    forward = build_forward(experiment)
    u = np.array(solve(forward, experiment.model.parameters.with_values(TRUTH)).u)
    nodes = experiment.model.mesh.nodes
    u_px = np.array([experiment.model.camera.project(nodes + one) - experiment.model.camera.project(nodes)
                     for one in u])
    return file, experiment, u, u_px


def noisy(u_px):
    return u_px + 0.03 * np.random.default_rng(1).standard_normal(u_px.shape)


def identified(experiment, values, stored=None, rr=0.0):
    """As if an identification had ended there; stored : displacements, rr : weighted sum of squares of its images."""
    found = identification_at(experiment, experiment.model.parameters.as_values() | values,
                              np.zeros((experiment.model.n_frames, DriveTable.of(experiment).n_local)), None)
    system = SimpleNamespace(frames=(SimpleNamespace(n_pixels=1000),), phi_image=rr)
    return replace(found, stored=None if stored is None else lambda: iter(stored),
                   point=Evaluation(0, system, np.zeros((0, 0))))


def test_a_law_is_identified_from_the_measured_motion_as_from_images(rubber):
    _, experiment, _, u_px = rubber
    there = by_motion(experiment, noisy(u_px))
    found = identify(there)
    assert holds_motion(there.recording) and holds_motion(thinned(there, CHOICE, 1).recording)
    assert not holds_motion(experiment.recording)
    for name, value in TRUTH.items():  # the force of the recording has a noise of 0.2 %
        assert found.parameters[name].value == pytest.approx(value, rel=0.03), name


def test_an_error_of_pixels_counts_whole_on_the_motion_and_saturates_on_the_images(rubber):
    """The identified law moves at half the grip motion, then at 0.95 of it: 10 and 1 px off (rms)."""
    _, experiment, _, u_px = rubber

    def left(seen, share):
        channels = tuple(replace(one, values=0.0 * one.values) for one in seen.model.channels)
        drives = tuple(replace(entry, drive=replace(entry.drive, values=share * entry.drive.values))
                       if hasattr(entry.drive, "values") else entry for entry in seen.model.prescribed)
        found = identified(replace(seen, model=replace(seen.model, prescribed=drives, channels=channels)), TRUTH)
        residual = residual_evidence(found, light=False)
        one = misfit_of(residual, grid_of(residual))
        return one.gain.sum() - one.rank.sum()

    on_motion = [left(by_motion(experiment, u_px), share) for share in (0.5, 0.95)]
    on_images = [left(experiment, share) for share in (0.5, 0.95)]
    assert on_motion[1] == pytest.approx(on_motion[0] / 100.0, rel=0.2)  # of an error a tenth as large
    assert on_images[0] < 20.0 * on_images[1]  # 6.3 times


def test_images_are_out_of_register_where_the_model_is_a_pixel_off_the_motion(rubber):
    _, experiment, u, u_px = rubber
    near, far = identified(experiment, TRUTH, u, rr=1e6), identified(experiment, TRUTH, 0.8 * u, rr=1e6)
    assert may_be_out_of_register(far) and not may_be_out_of_register(replace(far, stored=None))
    assert not may_be_out_of_register(identified(experiment, TRUTH, 0.8 * u, rr=1e3))  # chi2 below 1
    assert out_of_register(near, u_px) is None
    found = out_of_register(far, u_px)
    expected = 0.2 * np.sqrt((u_px**2).sum(axis=2).mean(axis=1))
    np.testing.assert_allclose(found.gap_px, expected, rtol=1e-6, atol=1e-9)
    assert f"{expected.max():.2g} px" in found.words and "out of register" in found.words
    flash = u_px.copy()
    flash[3] += 5.0
    assert out_of_register(near, flash) is not None and out_of_register(near, flash, unexplained=[3]) is None


def test_a_boundary_without_nodes_is_no_measured_edge(rubber):
    tables = {"boundary": [{"nodes": "LEFT", "ux": 0.0}, {"edges": "TOP", "pressure": {"column": "p_MPa"}},
                           {"temperature": {"column": "T_C"}}]}
    assert with_edge_modes(tables, rubber[1], rubber[3]) == {}


def test_pictures_show_the_images_and_maps_are_without_gaps(rubber):
    _, experiment, _, u_px = rubber
    there = by_motion(experiment, u_px)
    np.testing.assert_array_equal(there.recording.picture(3), experiment.recording.stack.frame(3))
    points = np.array([[4.0, 4.0], [10.0, 4.0], [4.0, 10.0], [10.0, 10.0]])
    image = np.full((20, 20), np.nan)
    image[points[:, 1].astype(int), points[:, 0].astype(int)] = [1.0, 2.0, 3.0, 4.0]
    shown = spread(image, points)
    assert np.isfinite(shown[4:11, 4:11]).all() and shown[5, 5] == 1.0 and shown[9, 9] == 4.0
    assert np.isnan(shown[4, 16:]).all()


def test_measured_edges_become_the_modes_of_their_motion_and_stay_as_measured(rubber):
    file, _, u, u_px = rubber
    experiment = load_experiment(file, {"boundary": MEASURED})
    edits = with_edge_modes({"boundary": MEASURED}, experiment, u_px)
    assert [entry["u"]["virtual"] for entry in edits["boundary"]] == ["dic", "dic"]
    there = by_motion(load_experiment(file, edits), u_px)
    assert set(there.model.parameters.free) == set(TRUTH)
    moved = solve(build_forward(there), there.model.parameters.with_values(TRUTH)).u[-1]
    gap = np.abs(moved - u[-1]) / experiment.model.camera.pixel_size
    assert gap.max() < 3.0 * MOTION_STD_PX
    assert with_edge_modes({"boundary": [{"nodes": "LEFT", "ux": 0.0}]}, load_experiment(file), u_px) == {}


def test_where_the_model_is_pixels_off_all_significant_laws_are_refitted():
    library = {candidate.name: candidate for candidate in candidate_library()}
    names = ("heterogeneity", "plasticity", "grip_rotation", "nonlinear_elasticity", "lens_distortion", "orthotropy")
    significant = tuple(SimpleNamespace(candidate=library[name], gain=gain, key=(name, ""))
                        for gain, name in enumerate(names))
    chosen = other_laws(SimpleNamespace(significant=significant))
    assert [one.candidate.name for one in chosen] == ["orthotropy", "nonlinear_elasticity", "plasticity"]
