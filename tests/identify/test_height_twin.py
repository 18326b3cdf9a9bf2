"""Height images of solids: sensitivities, error bars and the identification against closed forms and other code."""

from dataclasses import replace

import height_bodies as bodies
import numpy as np
import pytest
from height_bodies import RMS, TRUTH, UM, Roughness, bent_plate, exact_images, photographed, pulled_block
from twin_bodies import context, extended, responses

from idic.correlation import frame_equations, view_of
from idic.correlation.height.gaps import fill_gaps
from correlation.height_pixel_equations import height_normal_equations
from idic.correlation.shared_noise import reference_gram
from idic.errors import InputError
from idic.identification import identify
from idic.images import ArrayStack
from idic.model import build_forward, solve
from idic.parameters import Parameter

CAMERA = {"camera.rotation_deg": 0.3, "camera.pixel_size": 0.02, "camera.shift_col": 0.4, "camera.tilt_x": 0.002}


def with_camera(body):
    scales = {"camera.rotation_deg": 1.0, "camera.pixel_size": 0.02, "camera.shift_col": 1.0, "camera.tilt_x": 0.01}
    return replace(body, model=replace(body.model, parameters=extended(
        body, [Parameter(name, value, free=True, scale=scales[name]) for name, value in CAMERA.items()])))


# the view -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_height_is_positive_where_the_surface_rises_towards_the_camera(up):
    body = bent_plate(up)
    view = view_of(body, body.model.camera)
    assert view.n_components == 3
    u = np.zeros_like(body.model.mesh.nodes)
    u[:, 2] = 0.005
    assert np.allclose(view.motion(body.model.mesh.nodes, u), [0.0, 0.0, up * 5.0], atol=1e-12)  # 5 um
    assert solve(build_forward(body), body.model.parameters).u[-1][:,
                                                                   2].mean() * up > 0.02  # pressed towards the camera


def test_a_surface_that_stands_upright_is_refused():
    plate = bent_plate()
    body = replace(plate, model=replace(plate.model, surface="END"))
    with pytest.raises(InputError, match="does not face the camera"):
        view_of(body, body.model.camera)


# sensitivities --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("make", [pytest.param(bent_plate, marks=pytest.mark.slow, id="up"),  # a slope of one sign
                                  pytest.param(lambda: bent_plate(-1.0), id="down")])
def test_the_right_hand_side_falls_by_the_gram_matrix_along_every_degree_of_freedom(make):
    """At the truth r = 0, so db/dlam = -M: material and camera, all through the height images."""
    body = photographed(with_camera(make()))
    shared, _, rows, _ = _rows(body, body.model.parameters)
    gram, worst = sum(r.gram for r in rows), 0.0
    for i, name in enumerate(shared.names):
        parameter = body.model.parameters[name]
        step = 1e-3 * (parameter.value if name.startswith("BODY") else parameter.scale)
        ahead, behind = (sum(r.rhs for r in _rows(
            body, body.model.parameters.with_values({name: parameter.value + s * step}))[2]) for s in (1, -1))
        quotient = (behind - ahead) / (2 * step)
        scale = np.sqrt(np.diagonal(gram) * gram[i, i])
        worst = max(worst, np.abs((quotient - gram[:, i]) / scale).max())
    # F and the slope of the rise are taken at the centre of each element; float32 sums over a step of 1e-3
    assert worst < 0.02


def _rows(body, parameters):
    shared = context(body, parameters)
    found, steps = responses(body, parameters, shared.moving)
    made = [frame_equations(shared, response, np.zeros(0))[1] for response in found if response.frame > 0]
    return shared, found, made, steps


def test_the_true_motion_leaves_nothing_but_interpolation():
    body = photographed(bent_plate())
    shared, found, _, _ = _rows(body, body.model.parameters)
    view = view_of(body, shared.camera)
    left = shared.reference.compare_pixels(body, 3, view.motion(body.model.mesh.nodes, found[-1].u), np.zeros(0))
    rise = np.ptp(view.motion(body.model.mesh.nodes, found[-1].u)[:, 2])
    assert rise > 10 * RMS and left.valid.mean() > 0.95
    # hex8 faces are flat facets here and in the images alike: what is left is the spline and float32 (340 um of rise),
    # and ten times as much where taps straddle the crease between two facets
    assert np.median(np.abs(left.r[left.valid])) < 3e-4 * RMS
    assert np.sqrt(np.mean(left.r[left.valid] ** 2)) < 3e-3 * RMS


def test_the_noise_of_the_reference_is_shared_as_the_pixels_share_it():
    """S^T S with S = sum_t L_t, pixel by pixel, against the summed nodal columns on the undeformed blocks."""
    body = photographed(bent_plate())
    shared, found, rows, _ = _rows(body, body.model.parameters)
    view, nodes, S = view_of(body, shared.camera), body.model.mesh.nodes, 0.0
    for response in found[1:]:
        motion = view.motion(nodes, response.u)
        phi = view.columns(nodes, response.u, response.du).reshape(len(nodes), 3, -1)
        f, g = body.recording.stack.frame(0), body.recording.stack.frame(response.frame)
        f, g = (fill_gaps(image, np.isnan(image)) if np.isnan(image).any() else image for image in (f, g))
        S = S + height_normal_equations(shared.reference.pixel_map, f, g, motion, phi, 5).L
    exact = S.T @ S
    nodal = reference_gram(shared, sum(r.shared for r in rows))
    # F^-1 and the slope of the rise are averaged over the elements around each node
    assert np.abs(nodal - exact).max() < 0.01 * np.abs(exact).max()


# error bars and identification ----------------------------------------------------------------------------
def noisy(body, images, seed, gaps=0.0):
    rng = np.random.default_rng(seed)
    images = images + 0.01 * RMS * rng.standard_normal(images.shape)
    images[rng.random(images.shape) < gaps] = np.nan
    return replace(body, recording=replace(body.recording, stack=ArrayStack(images.astype(np.float32))))


@pytest.mark.parametrize("gaps", [0.0, 0.003], ids=["whole", "with gaps"])
def test_a_block_in_tension_is_identified_from_its_heights(gaps):
    start = {"C10": 1.3 * TRUTH["C10"], "kappa": 0.7 * TRUTH["kappa"]}
    body = pulled_block(start)
    found = identify(noisy(body, exact_images(body, Roughness()), 7, gaps))
    assert found.state.status == "converged"
    parameters = found.result["parameters"]
    for name, true in TRUTH.items():
        value, std = (parameters[f"BODY.{name}"][key] for key in ("value", "std"))
        assert abs(value - true) < 3 * std and std < 2e-3 * true
    # nothing but noise is left: sum r^2 over 1.7 sigma^2 per pixel
    share = found.point.system
    assert share.phi_image / share.n_pixels == pytest.approx(0.5 * 1.76 / 1.0, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("levelling", ["none", "frame"])
def test_the_scatter_of_many_repetitions_is_the_predicted_standard_deviation(levelling):
    body = pulled_block(brightness=levelling)
    images, values, stds = exact_images(body, Roughness()), [], []
    for seed in range(40):
        found = identify(noisy(body, images, 100 + seed)).result["parameters"]
        values.append([found[f"BODY.{name}"]["value"] for name in TRUTH])
        stds.append([found[f"BODY.{name}"]["std"] for name in TRUTH])
    scatter, predicted = np.std(values, axis=0, ddof=1), np.mean(stds, axis=0)
    ratio = scatter / predicted
    # 40 draws: 11 % statistical; 2.5 of it, and the interpolator smooths the noise of the frames by some per cent
    assert (np.abs(ratio - 1.0) < 0.3).all(), ratio
    quiet = identify(replace(body, recording=replace(body.recording,
                                                     stack=ArrayStack(images.astype(np.float32))))).result["parameters"]
    found = np.array([quiet[f"BODY.{name}"]["value"] for name in TRUTH])
    added = (np.mean(values, axis=0) - found) / predicted
    assert (np.abs(added) < 3 / np.sqrt(40)).all(), added  # the noise itself adds no bias
    bias = (found - list(TRUTH.values())) / predicted
    assert (np.abs(bias) < 1.0).all(), bias  # interpolation: 1e-5 of C10, as much as its std


def test_an_offset_of_the_instrument_is_taken_for_a_rise_unless_it_is_freed():
    body = pulled_block()
    images = exact_images(body, Roughness())
    images[1:] += np.array([2.0, -1.0, 3.0, 1.0, -2.0])[:, None, None]  # um
    fixed = identify(noisy(body, images, 1)).result["parameters"]["BODY.kappa"]
    freed = identify(noisy(pulled_block(brightness="frame"), images, 1)).result["parameters"]["BODY.kappa"]
    assert abs(fixed["value"] - TRUTH["kappa"]) > 10 * fixed["std"]
    assert abs(freed["value"] - TRUTH["kappa"]) < 3 * freed["std"] and freed["std"] > fixed["std"]


def test_the_view_of_a_still_body_is_zero_in_every_component():
    body = pulled_block()
    nodes = body.model.mesh.nodes
    assert not view_of(body, body.model.camera).motion(nodes, np.zeros_like(nodes)).any()
    assert bodies.stretches(0.0, **TRUTH) == pytest.approx((1.0, 1.0), abs=1e-12)
    assert UM == body.recording.height_unit


def test_frames_with_gaps_lose_pixels_but_no_motion():
    body = pulled_block()
    images = exact_images(body, Roughness())
    holed = noisy(body, images, 3, 0.003)
    shared, found, _, _ = _rows(holed, holed.model.parameters)
    share = shared.reference.compare(holed, 5, view_of(holed, shared.camera).motion(holed.model.mesh.nodes,
                                                                                    found[-1].u))
    assert 0.05 < share.n_lost / (share.n_lost + share.n_valid) < 0.2
    assert share.rr / share.n_valid == pytest.approx(1.76 * (0.01 * RMS) ** 2, rel=0.1)
