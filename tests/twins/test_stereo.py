"""A solid before two cameras at an angle: joined sums, exchanged images, and what the folder of the example leads
to."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pinhole_twin import scores
from scipy.spatial.transform import Rotation
from wrong_calibration import write_wrongly_calibrated

sys.path.insert(0, str(Path(__file__).parents[1] / "diagnose"))
from side_twins import screening  # noqa: E402

from idic.correlation import (
    CorrelationContext, FrameResponse, build_experiment_reference, camera_at, frame_system, with_all_cameras,
)
from idic.correlation.pinhole.texture import texture_equations
from idic.correlation.shared_noise import reference_gram
from idic.diagnose import candidate_library, identification_at, maps_of_evidence, residual_evidence
from idic.diagnose.locate.adjoint_sources import image_adjoint
from idic.diagnose.locate.freedoms import in_images
from idic.diagnose import Situation
from idic.diagnose.residual.heldout import positions
from idic.errors import InputError
from idic.experiment_file import load_experiment, read_toml
from idic.identification import identify, noise_weights
from idic.identification.discrepancy.normal_equations import counts_mesh_error
from images.spline_reference import spline_slopes, spline_values
from idic.model import Column, build_forward
from idic.report.evidence.rig import rig_warnings
from idic.simulation_error import ModelPoint, mesh_error_in, refined
from idic.virtual_tests import PlateSize, PlateTest  # noqa: E402

SMALL = PlateSize(0.2, (100, 156), (2, 2, 2), (2, 3, 2, 1), (3, 4, 2, 1))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("stereo") / "test"
    where.mkdir()
    PlateTest.simulated(SMALL).write(where)
    return where


def context_of(experiment):
    forward = build_forward(experiment)
    names, camera = experiment.model.parameters.free, camera_at(experiment, experiment.model.parameters)
    return forward, CorrelationContext(experiment, experiment.model.parameters, names, names, camera,
                                       build_experiment_reference(experiment, camera), noise_weights(experiment),
                                       forward.drives.local_precision, local_scatter=forward.drives.local_scatter)


def test_the_equations_of_two_cameras_with_a_lens_add(folder):
    experiment = load_experiment(folder)
    forward, single = context_of(experiment)
    both = with_all_cameras(single)
    state = list(forward.march(experiment.model.parameters, single.moving, influence=True))[-1]
    response = FrameResponse(state.frame, state.u, state.channels, state.du, state.dchannels, state.local_du[..., :0],
                             state.local_dchannels[:, :0])
    bare = np.zeros((0, 0))
    parts = [replace(c, local_precision=bare, local_scatter=None, others=()) for c in both.cameras]
    joined, first, second = (frame_system(c, response, np.zeros(0))
                             for c in (replace(parts[0], others=(parts[1],)), *parts))
    of_channel = np.outer(*[response.dchannels[0]] * 2) / 10.0**2  # the force counts once
    assert np.allclose(joined.M + of_channel, first.M + second.M, rtol=1e-6)
    assert joined.n_pixels == first.n_pixels + second.n_pixels


def test_two_textures_compared_pixel_by_pixel_give_the_same_equations(folder):
    """Every pixel projected exactly, columns by difference quotients of the place that it shows in the other image."""
    names = ("left.fx", "left.k1", "left.t_z", "right.fx", "right.cy", "right.turn_y", "right.t_x", "placement.t_z",
             "placement.rotation_x")
    plain = load_experiment(folder, {"dof": [{"name": name} for name in names],
                                     "options": {"lowpass_px": 0.0, "substeps": 1}})
    experiment = replace(plain, cameras=(replace(plain.cameras[0], texture="left"),))

    def context_at(values):
        parameters = experiment.model.parameters.with_values(values)
        camera = camera_at(experiment, parameters)
        return with_all_cameras(CorrelationContext(experiment, parameters, names, (), camera,
            build_experiment_reference( experiment, camera), noise_weights(experiment), np.zeros((0, 0))))

    start = experiment.model.parameters.as_values()
    context = context_at(start)
    found = texture_equations(context, names)
    assert found.pairs[0].is_used and found.pairs[0].correlation > 0.99
    kept = context.reference.pixel_map
    pixels, (one, two) = kept.points(), context.cameras

    def shown(values):
        """Where the other camera shows the point that a pixel shows: rays meet the plane z = 0."""
        left, right = (camera_at(view, experiment.model.parameters.with_values(values)) for view in experiment.views)
        return right.project(left.inverse(pixels))

    at = shown(start)
    sees = two.reference.pixel_map.to_image(np.ones(two.reference.pixel_map.n_pixels), 0.0)
    column, row = np.rint(at).astype(int).T
    ok = sees[row, column] > 0
    columns = np.empty((len(pixels), 2, len(names)))
    for i, name in enumerate(names):
        step = 1e-3 * experiment.model.parameters[name].scale
        columns[:, :, i] = (shown({**start, name: start[name] + step}) - shown({**start, name: start[name] - step})
                            ) / (2.0 * step)
    across = np.stack([one.camera.inverse(pixels + h) - one.camera.inverse(pixels - h) for h in np.eye(2)], axis=2)
    F = two.camera.jacobian(one.camera.inverse(pixels))[:, :, :2] @ (0.5 * across[:, :2])
    images = [view.recording.stack.frame(0).astype(float) for view in experiment.views]
    degree, gain = context.reference.degree, found.pairs[0].gain
    slopes = np.linalg.solve(np.swapaxes(F, 1, 2), spline_slopes(images[0], pixels, degree)[:, :, None])[:, :, 0]
    r = context.reference.f - context.reference.level - gain * (
        spline_values(images[1], at, degree) - two.reference.level)
    L = np.einsum("xc,xci->xi", slopes, columns)[ok]
    patch = np.repeat(context.reference.layout("patch").patch, kept.pixels_per_element)[ok]
    of_patch = (patch[:, None] == np.arange(patch.max() + 1)).astype(float)
    light = np.linalg.qr(np.hstack([of_patch, of_patch * context.reference.f[ok, None]]))[0]
    L, r = L - light @ (light.T @ L), r[ok] - light @ (light.T @ r[ok])
    weight, excess = 1.0 / (1.0 + gain**2) / experiment.recording.noise.std_gv**2, found.pairs[0].excess
    M, b = weight / excess * L.T @ L, weight / excess * L.T @ r
    std = np.sqrt(np.diagonal(M))
    assert found.pairs[0].n_pixels == ok.sum()
    # one F per element, its middle's; M is of second order in the size of a face
    np.testing.assert_allclose(found.M / np.outer(std, std), M / np.outer(std, std), atol=5e-3)
    np.testing.assert_allclose(found.b / std, b / std, atol=0.1)  # in standard deviations
    assert found.phi == pytest.approx(weight * r @ r, rel=5e-3)
    # noise of both reference images scatters b as much as independent noise of every pixel does, the excess the rest
    assert 1.0 < excess < 2.0  # no low-pass here: the images alias
    scatter = experiment.recording.noise.std_gv**2 * reference_gram(context, found.shared) + found.spread
    np.testing.assert_allclose(scatter / np.outer(std, std), M / np.outer(std, std), atol=0.06)


def test_the_error_of_a_coarse_mesh_is_the_motion_of_a_finer_one_less_its_own(folder):
    experiment = load_experiment(folder)
    assert counts_mesh_error(experiment)
    forward, parameters, last = build_forward(experiment), experiment.model.parameters, 2  # elastic up to there
    local = np.zeros((experiment.model.n_frames, forward.drives.n_local))
    rest = np.zeros_like(experiment.model.mesh.nodes)
    found = mesh_error_in(ModelPoint(experiment, parameters, local), np.array([0, last]), [rest, rest])
    finer = refined(experiment)
    exact = list(build_forward(finer.experiment).march_at(parameters, local, np.array([0, last])))[-1]
    own = list(forward.march_at(parameters, local, np.array([0, last])))[-1]
    # 7 of 7704 N; the loose equilibrium is worth 1e-5 of the force
    assert found.channels[1][0] == pytest.approx(exact.channels[0] - own.channels[0], abs=2e-5 * own.channels[0])
    at_nodes = exact.u[:experiment.model.mesh.n_nodes] - own.u  # the projection is another mean of the same field
    assert np.corrcoef(found.u[1].ravel(), at_nodes.ravel())[0, 1] > 0.9
    assert np.allclose(found.at(1)[0], 0.5 * found.u[1]) and np.allclose(found.at(1)[1], 0.5 * found.channels[1])


def test_exchanged_images_are_refused(folder, tmp_path):
    swapped = shutil.copytree(folder, tmp_path / "swapped")
    (swapped / "images").rename(swapped / "kept")
    (swapped / "right").rename(swapped / "images")
    (swapped / "kept").rename(swapped / "right")
    with pytest.raises(InputError, match="swapped"):
        load_experiment(swapped)
    assert not any("different grey values" in note for note in load_experiment(folder).notes)


@pytest.mark.parametrize(("free", "open_ones"), [
    (("right.turn_y",), ()),
    # both cameras and the mesh moved alike leave every image as it is
    (("left.t_x", "left.t_y", "left.t_z", "right.t_x", "right.t_y", "right.t_z", "placement.t_z"), ("placement.t_z",)),
    # both scale the image; without a target nothing else tells a distance
    pytest.param(("right.fx", "right.fy", "right.t_z"), ("right.fx", "right.t_z"), marks=pytest.mark.slow),
])
def test_what_a_rig_leaves_open_is_said_before_the_run(folder, free, open_ones):
    experiment = load_experiment(folder, {"dof": [{"name": name} for name in free]})
    said = list(rig_warnings(experiment, 0.0))
    for name in open_ones:
        assert any(f"{name} " in text and ("will not be identified" in text or "hardly" in text) for text in said), said
    assert open_ones or not said


@pytest.mark.slow  # half a minute of processor time
def test_errors_of_the_calibration_come_back_with_its_deviations(tmp_path):
    """The file says 0.1 degrees more between the cameras and 0.3 % more focal length; its deviations are of that
    size."""
    file, true = write_wrongly_calibrated(tmp_path)
    found = identify(load_experiment(file)).result
    assert found["status"] == "converged"
    assert max(abs(score) for score in scores(found, true).values()) < 2.0
    assert found["parameters"]["left.fx"]["std_noise"] < 0.3 * 0.003 * true["left.fx"]  # images add to the file
    assert found["parameters"]["right.rotation_y"]["std_noise"] < 0.1 * 0.1


@pytest.mark.slow  # half a minute of processor time
def test_a_blow_after_the_calibration_is_found_as_a_turn_about_the_own_centre(tmp_path):
    test = PlateTest.simulated(PlateSize.of_example(reduced=True))
    right = test.rig.cameras[1]
    turn = Rotation.from_rotvec([0.0, np.deg2rad(0.1), 0.0]).as_matrix()
    before = replace(right, rotation=turn @ right.rotation, translation_mm=turn @ right.translation_mm)
    file = test.write(tmp_path, believed=replace(test.rig, cameras=(test.rig.cameras[0], before)))
    file.write_text(file.read_text() + "".join(f'\n[[dof]]\nname = "right.turn_{axis}"\n' for axis in "xyz"))
    found = identify(load_experiment(file)).result
    true = PlateTest.TRUTH | {"right.turn_x": 0.0, "right.turn_y": -0.1, "right.turn_z": 0.0}
    assert found["status"] == "converged"
    assert max(abs(score) for score in scores(found, true).values()) < 3.0
    assert found["parameters"]["right.turn_y"]["std"] < 0.01


@pytest.mark.slow  # half a minute of processor time
def test_a_camera_moved_about_the_specimen_leaves_the_material_as_it_is(tmp_path):
    """The turn that no candidate searches: 1.5 degrees about the specimen, which stays in its pixels."""
    test = PlateTest.simulated(replace(SMALL, frames=(3, 3, 3), true=SMALL.user))
    left, right = test.rig.cameras
    back = Rotation.from_rotvec([0.0, np.deg2rad(-1.5), 0.0]).as_matrix()
    believed = replace(test.rig, cameras=(left, replace(right, rotation=back @ right.rotation)))
    file = test.write(tmp_path, believed=believed)
    found = identify(load_experiment(file)).result
    assert found["status"] == "converged"
    assert max(abs(score) for score in scores(found, PlateTest.TRUTH).values()) < 3.0


@pytest.mark.slow
def test_parameters_of_the_stereo_test_are_within_their_stated_deviations(folder):
    found = identify(load_experiment(folder)).result
    assert found["status"] == "converged"
    # the coarse mesh of the user is wrong by some per cent: the stated deviations hold the misfit
    assert max(abs(score) for score in scores(found, PlateTest.TRUTH).values()) < 3.0


def test_the_evidence_of_a_diagnosis_joins_both_cameras(folder):
    experiment = load_experiment(folder)
    exact = tuple(replace(entry, drive=replace(entry.drive, noise_std=0.0)) if isinstance(entry.drive, Column)
                  else entry for entry in experiment.model.prescribed)  # no unknown of a frame that the cameras share
    experiment = replace(experiment, model=replace(experiment.model, prescribed=exact))
    left, right = (replace(view, cameras=()) for view in experiment.views)
    local = np.zeros((experiment.model.n_frames, 0))
    both, *alone = (residual_evidence(identification_at(one, PlateTest.TRUTH, local, None))
                    for one in (experiment, left, right))
    assert [len(one.cameras) for one in (both, *alone)] == [2, 1, 1]
    assert both.evidence.n_pixels == sum(one.evidence.n_pixels for one in alone)
    assert len(both.evidence.seen) == sum(len(one.evidence.seen) for one in alone)
    white = [one.evidence.whiten(one.null) for one in (both, *alone)]
    grams, scores = zip(*((one.evidence.products(own, one.evidence.weighed(own)), one.evidence.scores(own))
                          for one, own in zip((both, *alone), white, strict=True)), strict=True)
    force = white[0].channels.reshape(-1, len(PlateTest.TRUTH))  # counts once
    expected = grams[1] + grams[2] - both.evidence.channel_weight[0] * force.T @ force
    # the cameras have one noise gain in the sums of both, 2 % off their own
    assert np.allclose(grams[0], expected, rtol=0.03, atol=0.03 * np.sqrt(np.outer(*[np.diagonal(expected)] * 2)).max())
    of_force = sum(white[0].channels[t].T @ part.channel_q for t, part in enumerate(both.evidence.parts))
    assert np.all(np.abs(scores[0] - scores[1] - scores[2] + of_force) < 0.2 * np.sqrt(np.diagonal(expected)))
    # motion of the body to all images, and back by the transpose
    rng, n_nodes = np.random.default_rng(0), experiment.model.mesh.n_nodes
    moved, p = rng.normal(size=(n_nodes, 3, 1)), rng.normal(size=(len(both.evidence.seen), 1))
    back = image_adjoint(both, -1, p).reshape(moved.shape)
    assert np.sum(in_images(both, -1, moved) * p) == pytest.approx(np.sum(back * moved))
    at, two = positions(both), maps_of_evidence(both, int(both.evidence.frames[-1]))
    assert at[:n_nodes, 0].max() < at[n_nodes:, 0].min() and len(two) == 2
    assert all(np.nanstd(one) < 1.3 for one in two)  # the mesh is coarse


def test_candidates_of_the_calibration_speak_of_every_camera(folder):
    experiment = load_experiment(folder)
    where = Situation(read_toml(folder / "experiment.toml"), experiment, experiment.model.parameters.as_values(), {},
                      {},
                      np.zeros((experiment.model.n_frames, experiment.model.mesh.n_nodes, 3)),
                      np.zeros((experiment.model.n_frames, 1)))
    known = {candidate.name: candidate for candidate in candidate_library()}
    of_rig = [variant for name in ("focal_length", "stereo_angle") for variant in known[name].variants(where)]
    assert [variant.label for variant in of_rig] == ["another focal length of left", "another focal length of right",
                                                     "right is turned against left"]
    for variant in of_rig:
        assert set(variant.new) <= set(load_experiment(folder, variant.edits).model.parameters.free)


@pytest.mark.slow  # a minute of processor time
@pytest.mark.parametrize("fault", ["stereo_angle", "specimen_motion", "camera_time_offset"])
def test_a_fault_of_the_rig_or_of_the_grips_is_told_from_the_material(tmp_path, fault):
    """The right camera was turned by 0.1 degrees after the calibration, or the specimen comes 0.1 mm nearer, or the
    right camera is late by a frame."""
    test = PlateTest.simulated(replace(SMALL, frames=(3, 3, 3), true=(2, 3, 2, 1)))
    believed = test.rig
    if fault == "stereo_angle":
        right = believed.cameras[1]
        turn = Rotation.from_rotvec([0.0, np.deg2rad(0.1), 0.0]).as_matrix()
        turned = replace(right, rotation=turn @ right.rotation, translation_mm=turn @ right.translation_mm)
        believed = replace(believed, cameras=(believed.cameras[0], turned))
    elif fault == "specimen_motion":
        nearer = np.linspace(0.0, 0.1, len(test.grip))[:, None, None] * np.array([0.0, 0.0, 1.0])
        test = replace(test, displacements=test.displacements + nearer)
    folder = test.write(tmp_path, believed=believed)
    if fault == "camera_time_offset":
        files = sorted((tmp_path / "right").glob("*.tif"))
        images = [path.read_bytes() for path in files]
        for path, image in zip(files[1:], images, strict=False):
            path.write_bytes(image)
    _, result = screening(folder)
    best = result.ranked[0]
    assert best.candidate.name == fault and best.standing == "significant"
