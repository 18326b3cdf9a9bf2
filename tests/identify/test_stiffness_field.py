"""A field of the stiffness with hundreds of unknowns: its step is the dense one, and it finds what the images hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import twin_bodies

from idic.correlation import Weights, frame_equations, view_of
from idic.errors import InputError
from idic.fe import Direction, march
from idic.identification import many_unknowns, stiffness_field as fields
from idic.model import build_forward

NONE = np.zeros(0)


def problem(body, spacing=1.5, length=2.0, std=0.3):
    forward, parameters = build_forward(body), body.model.parameters
    context = twin_bodies.context(body, parameters)
    at = fields._checked_body(forward, parameters, context, "BODY", spacing, length, std)
    grid = fields._grid(at, "BODY", spacing)
    return fields._Problem(forward, parameters, context, range(1, 5), None, at, grid,
                           fields._prior(grid, length, std)[1])


@pytest.mark.parametrize("law, values", [("elastic", None), ("j2_linear", {"E": 1000.0, "nu": 0.3, "yield_stress": 6.0,
                                                                            "hardening_modulus": 50.0})])
@pytest.mark.parametrize("brightness", ["none", "frame"])
def test_the_step_is_that_of_the_dense_equations(law, values, brightness, monkeypatch):
    """Of direct derivatives, projected, weighed and summed as an identification does it."""
    body = twin_bodies.photographed(twin_bodies.experiment(law, values, prescribed=twin_bodies.pulled(0.08, False),
                                                           kinematics=None if values else "small",
                                                           brightness=brightness))
    given = problem(body)
    x = 0.5 * np.sin(np.arange(given.root.shape[1]))
    at = given.at(x)
    assert len(x) > 15
    field = replace(given.field, values={str(k): value for k, value in enumerate(given.root @ x)})
    directions = [Direction(str(k), variation=(0, str(k))) for k in range(len(x))]
    information, pull = np.zeros((len(x), len(x))), np.zeros(len(x))
    for state in march(replace(given.body, variations=(field,)), given.forward.law_values(given.parameters),
                       body.model.times, directions):
        if state.frame == 0:
            continue
        response = twin_bodies.FrameResponse(state.frame, state.u, state.channels, state.du[..., :0],
                                             state.dchannels[:, :0], state.local_du, state.local_dchannels)
        bare = replace(given.context, names=(), moving=())
        nodal, equations = frame_equations(bare, response, NONE)
        columns = view_of(body, given.context.camera).columns(body.model.mesh.nodes, state.u, state.du)
        gram, n, weight = nodal.gram(columns), len(x), given.context.weights.image
        light = np.linalg.pinv(gram.matrix[n:, n:])
        information += weight * (gram.matrix[:n, :n] - gram.matrix[:n, n:] @ light @ gram.matrix[n:, :n])
        pull += weight * (gram.rhs[:n] - gram.matrix[:n, n:] @ light @ gram.rhs[n:])
        of_channels = given.context.weights.channels
        information += state.dchannels.T @ (of_channels[:, None] * state.dchannels)
        pull += state.dchannels.T @ (of_channels * equations.channels.residual)
    whitened = given.root.T @ information @ given.root
    np.testing.assert_allclose(at.pull, given.root.T @ pull - x, rtol=0, atol=1e-8 * np.abs(at.pull).max())
    monkeypatch.setattr(many_unknowns, "TOLERANCE", 1e-12)
    step = many_unknowns.lanczos_step(at.curvature, at.pull)
    exact = np.linalg.solve(np.eye(len(x)) + whitened, given.root.T @ pull - x)
    np.testing.assert_allclose(step.x, exact, rtol=0, atol=1e-7 * np.abs(exact).max())


def test_a_step_stops_at_its_tolerance_and_knows_the_space_that_it_went_through():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((200, 200)))[0]
    H = turn * np.where(np.arange(200) < 12, np.logspace(6, 1, 200), 1e-3) @ turn.T
    rhs = H @ rng.standard_normal(200)
    step = many_unknowns.lanczos_step(lambda v: H @ v, rhs)
    residual = np.linalg.norm(step.x + H @ step.x - rhs)
    assert residual <= 1.1 * many_unknowns.TOLERANCE * np.linalg.norm(rhs) and step.vectors.shape[1] < 40
    np.testing.assert_allclose(step.vectors.T @ step.vectors, np.eye(step.vectors.shape[1]), atol=1e-12)
    nothing = many_unknowns.lanczos_step(lambda v: H @ v, np.zeros(200))
    assert not nothing.x.any() and nothing.vectors.shape == (200, 0)


def test_a_soft_spot_is_found_with_its_error_bars():
    even = twin_bodies.experiment(prescribed=twin_bodies.pulled(0.08, False))
    spot = twin_bodies.photographed(twin_bodies.uneven(even))
    noise = 0.5
    stack = spot.recording.stack
    images = np.array([stack.frame(k) for k in range(len(twin_bodies.TIMES))], dtype=float)
    images += noise * np.random.default_rng(1).standard_normal(images.shape)
    body = replace(even, recording=replace(spot.recording, stack=type(stack)(images.astype(np.float32))),
                   model=replace(even.model, channels=()))
    context = replace(twin_bodies.context(body, body.model.parameters),
                      weights=Weights(0.5 / noise**2, noise, NONE, NONE))
    result = fields.stiffness_field(build_forward(body), body.model.parameters, context, range(1, 5), None, "BODY", 0.6,
                                    1.5, 0.3)
    middles = np.array([body.model.mesh.nodes[nodes].mean(axis=0) for nodes in body.model.mesh.blocks[0].connectivity])
    truth = np.prod([v.factor(middles) for v in build_forward(spot).body_at(spot.model.parameters).variations], axis=0)
    assert result.converged and result.phi < 0.9 * result.start_phi and len(result.factor) > 60
    error = np.log(result.element_factor / truth)
    error -= error.mean()  # motion alone tells ratios
    assert np.corrcoef(np.log(result.element_factor), np.log(truth))[0, 1] > 0.9
    assert np.sqrt(np.mean((error / result.element_std) ** 2)) < 2.0
    assert (result.element_std < 0.3).all() and result.element_std.max() > 0.02


def test_the_error_bars_are_the_scatter_of_noise():
    """Of 24 draws, the noise of the reference among it; without the prior, whose part is no scatter."""
    even = twin_bodies.experiment(prescribed=twin_bodies.pulled(0.08, False))
    even = replace(even, model=replace(even.model, channels=()))
    stack, noise, steps = twin_bodies.photographed(even).recording.stack, 0.5, []
    clean = np.array([stack.frame(k) for k in range(len(twin_bodies.TIMES))], dtype=float)
    rng = np.random.default_rng(2)
    for _ in range(24):
        images = (clean + noise * rng.standard_normal(clean.shape)).astype(np.float32)
        drawn = problem(replace(even, recording=replace(even.recording, stack=type(stack)(images))), 0.8, 1.5)
        drawn = replace(drawn, context=replace(drawn.context, weights=Weights(0.5 / noise**2, noise, NONE, NONE)))
        at = drawn.at(np.zeros(drawn.root.shape[1]))
        steps.append(drawn.root @ many_unknowns.lanczos_step(at.curvature, at.pull).x)
    step = many_unknowns.lanczos_step(at.curvature, at.pull, complete=True)
    deviations, basis = at.deviations(step), step.vectors
    prior = np.linalg.inv(np.eye(basis.shape[1]) + basis.T @ np.array([at.curvature(v) for v in basis.T]).T)
    within = basis.T @ deviations @ deviations.T @ basis - prior @ prior
    predicted = np.einsum("ni,ij,nj->n", drawn.root @ basis, within, drawn.root @ basis)
    ratio = np.var(steps, axis=0, ddof=1) / predicted
    assert 0.7 < ratio.mean() < 1.4  # some ten fields are determined: 24 draws, 10 %


def test_what_has_no_field_is_said():
    body = twin_bodies.photographed(twin_bodies.experiment())
    forward, parameters = build_forward(body), body.model.parameters
    context = twin_bodies.context(body, parameters)

    def field(name="BODY", spacing=1.0, **more):
        return fields.stiffness_field(more.get("forward", forward), parameters, context, range(1, 5), None, name,
                                      spacing, 1.0, 0.3)

    with pytest.raises(InputError, match="no such element set"):
        field("LID")
    with pytest.raises(InputError, match="above zero"):
        field(spacing=0.0)
    with pytest.raises(InputError, match="too many unknowns"):
        field(spacing=0.05)
    unsure = twin_bodies.photographed(twin_bodies.experiment(prescribed=twin_bodies.pulled(noise_std=0.01)))
    with pytest.raises(InputError, match="no field of the stiffness") as problem_of_drive:
        field(forward=build_forward(unsure))
    assert "frame-local" in problem_of_drive.value.found
