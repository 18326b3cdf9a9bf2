"""J v and J^T w without J: the same as with the derivatives of the march, and each the transpose of the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import PARAMETERS, body, grid, held, where
from test_sensitivity import BODIES, TIMES, model_of

from idic.errors import InputError
from idic.fe import Direction, Linearisation, PathControl, Reaction, Variation, dofs_of, march

MEMORY = {"maxwell": np.array([200.0, 0.3, 0.3, 0.5, 0.2, 2.0, 0.0, 10.0]),
          "j2_kinematic": np.array([200.0, 0.3, 1.0, 10.0, 20.0, 5.0])}


def with_fields(model, n_histories=2):
    """The model with two factor fields, and directions of every kind that has products."""
    nodes = model.mesh.nodes
    spot = Variation("BODY", "spot", {"amount": 1.3, "x": 0.4, "y": 0.6, "radius": 0.3})
    n = int(np.prod([3] * nodes.shape[1]))
    field = Variation("BODY", "field", {str(k): 0.1 * np.sin(k) for k in range(n)}, nodes.mean(axis=0),
                      np.ptp(nodes, axis=0) / 2, (2,) * nodes.shape[1])
    slope = Variation("BODY", "gradient", {"along_x": 0.2, "along_y": -0.1}, nodes.mean(axis=0),
                      np.ptp(nodes, axis=0) / 2)
    histories, rng = model.constraints.histories, np.random.default_rng(5)
    directions = [Direction("spot", variation=(0, "amount")),
                  *(Direction(f"m{i}", material=(0, i))
                    for i in range(len(model.sections[0].law.spec.parameter_names))),
                  Direction("radius", variation=(0, "radius")), Direction("slope", variation=(1, "along_y")),
                  *(Direction(f"h{k}", d_histories=rng.standard_normal(histories.shape)) for k in range(n_histories))]
    if model.loads.dead is not None:
        n_pressure = len(model.loads.pressure_faces)
        changes = np.hstack([rng.standard_normal(model.loads.dead_histories.shape),
                             np.zeros((len(histories), n_pressure))])
        directions.append(Direction("load", d_loads=changes, d_histories=0.1 * histories))
    directions += [Direction(f"f{k}", variation=(2, str(k))) for k in range(n)]
    return replace(model, variations=(spot, slope, field)), directions


def check(model, params, times=TIMES, **more):
    model, directions = with_fields(model)
    states = list(march(model, {"BODY": params}, times, directions, **more))
    at, rng = Linearisation.of(model, {"BODY": params}, times, directions, **more), np.random.default_rng(0)
    assert np.array_equal(at.motion.u, [state.u for state in states]) and at.steps == states[-1].steps
    assert np.array_equal(at.motion.channels, [state.channels for state in states])
    du, dchannels = (np.array([getattr(state, name) for state in states]) for name in ("du", "dchannels"))
    v = rng.standard_normal(len(directions)) / np.maximum(np.abs(du).max(axis=(0, 1, 2)), 1e-300)
    w_u, w_channels = (rng.standard_normal(shape) for shape in (at.motion.u.shape, at.motion.channels.shape))
    w_channels /= np.maximum(np.abs(dchannels @ v).max(), 1e-300)
    moved, gradient = at.tangent(v), at.adjoint(w_u, w_channels)
    for product, exact in ((moved.u, du @ v), (moved.channels, dchannels @ v),
                           (gradient, np.tensordot(w_u, du, 3) + np.tensordot(w_channels, dchannels, 2))):
        np.testing.assert_allclose(product, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
    pairs = ((w_u, moved.u), (w_channels, moved.channels))
    weighted, size = sum(np.vdot(*pair) for pair in pairs), sum(np.prod([*map(np.linalg.norm, pair)]) for pair in pairs)
    assert abs(weighted - gradient @ v) < 1e-10 * size
    return at, moved, gradient


@pytest.mark.parametrize("law", ["elastic", "neo_hookean", "j2_linear"])
@pytest.mark.parametrize("shape", BODIES)
def test_products_are_those_with_the_derivatives(shape, law):
    check(model_of(*BODIES[shape], law), PARAMETERS[law])


@pytest.mark.parametrize("law", MEMORY)
@pytest.mark.parametrize("shape", ["plane stress", "plane strain F-bar"])
def test_laws_that_remember_more_have_products_too(shape, law):
    check(model_of(*BODIES[shape], law), MEMORY[law])


def test_increments_inside_of_a_frame_interval_are_gone_through():
    check(model_of(*BODIES["plane stress"], "j2_linear"), PARAMETERS["j2_linear"], substeps=3)


def test_what_is_not_kept_is_made_again(monkeypatch):
    model, params = model_of(*BODIES["solid F-bar"], "j2_linear"), PARAMETERS["j2_linear"]
    _, moved, gradient = check(model, params)
    monkeypatch.setattr("idic.fe.products.MAX_KEPT_BYTES", 0)
    at, again, gradient_again = check(model, params)
    assert all(linear is None for linear in at._linear)
    np.testing.assert_allclose(again.u, moved.u, rtol=0, atol=1e-9 * np.abs(moved.u).max())
    np.testing.assert_allclose(gradient_again, gradient, rtol=0, atol=1e-9 * np.abs(gradient).max())


def test_what_has_no_products_is_said():
    model = model_of(*BODIES["plane stress"], "elastic")
    for direction, word in ((Direction("t", thickness=True), "thickness"),
                            (Direction("p", d_loads=np.ones((len(TIMES), 2))), "pressure")):
        with pytest.raises(InputError, match="no products") as problem:
            Linearisation.of(model, {"BODY": PARAMETERS["elastic"]}, TIMES, [direction])
        assert word in problem.value.found
    mesh = grid("quad4", (2, 2))
    left, right = (where(mesh, lambda x, *_, s=s: np.abs(x - s) < 1e-9) for s in (0, 1))
    drives = held(mesh, [(left, "x", 0.0), (left, "y", 0.0), (right, "x", np.zeros(2))])
    gauge = np.zeros(2 * mesh.n_nodes)
    gauge[dofs_of(right, "x", 2)[0]] = 1.0
    model = body(mesh, "plane_stress", "elastic", None, drives, channels=(Reaction(dofs_of(right, "x", 2)),),
                 control=PathControl(gauge, np.array([0.0, 0.01]), drive=0))
    with pytest.raises(InputError, match="gauge"):
        Linearisation.of(model, {"BODY": PARAMETERS["elastic"]}, np.arange(2.0), [])
