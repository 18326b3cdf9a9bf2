"""Thermal expansion of bodies: free, held back, with a gradient; its derivatives along a path with plasticity."""

from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import PARAMETERS, SHARP, affine_constraints, body, grid, held, last, outer_nodes, skewed, where

from idic.errors import InputError
from idic.fe import Direction, Reaction, dofs_of, march, nodal_field

ALPHA, WARMER = 2e-5, 150.0  # 1/K, K
FREE = ALPHA * WARMER
E, NU = PARAMETERS["elastic"]
CASES = {
    "plane stress": ("quad4", "plane_stress"), "plane stress quad8": ("quad8", "plane_stress"),
    "plane stress tri6": ("tri6", "plane_stress"), "solid F-bar": ("hex8", "solid"),
}
LAWS = [("elastic", "small"), ("elastic", "finite"), ("neo_hookean", "finite"), ("j2_linear", "finite")]
# of the largest value: Newton's tolerance is 1e-12 (SHARP), and the stiffness matrices are well conditioned
EXACT = 1e-10


def cells_of(kind):
    return (2, 2) if kind != "solid" else (2, 2, 2)


def expanding(model, temperature, alpha=ALPHA):
    """The model with a temperature (n_frames, n_nodes) and one coefficient for every section."""
    return replace(model, temperature=np.asarray(temperature, float),
                   sections=tuple(replace(s, expansion=alpha) for s in model.sections))


def uniform(mesh, *values):
    return np.outer(values, np.ones(mesh.n_nodes))


def on_rollers(mesh, n_frames=2):
    """Symmetry on the planes through the origin: nothing is held against expansion."""
    return held(mesh, [(where(mesh, lambda *x, i=i: np.abs(x[i]) < 1e-9), i, 0.0) for i in range(mesh.n_dim)], n_frames)


def largest_stress(frame):
    return max(np.abs(values.P).max() for values in frame.points)


@pytest.mark.parametrize("law, kinematics", LAWS)
@pytest.mark.parametrize("cell, kind", CASES.values(), ids=CASES)
def test_a_free_body_expands_by_alpha_times_the_change_and_feels_nothing(cell, kind, law, kinematics):
    mesh = grid(cell, cells_of(kind), mapping=skewed)
    model = expanding(body(mesh, kind, law, kinematics, on_rollers(mesh)), uniform(mesh, 0.0, WARMER))
    frame = last(model, PARAMETERS[law], control=SHARP)
    assert np.abs(frame.u - FREE * mesh.nodes).max() < EXACT * FREE
    assert largest_stress(frame) < EXACT * FREE * PARAMETERS[law].max()
    if kind == "plane_stress":  # the sheet grows thicker, too
        assert all(np.abs(values.state[:, -1] - 1.0 - FREE).max() < EXACT for values in frame.points)


@pytest.mark.parametrize("law, kinematics", LAWS)
@pytest.mark.parametrize("cell", ["quad4", "quad8"])
def test_plane_strain_expands_in_its_plane_as_a_solid_between_two_walls(cell, law, kinematics):
    flat = grid(cell, (2, 2))
    solid = grid("hex8", (2, 2, 1))
    walls = held(solid, [(where(solid, lambda *x, i=i: np.abs(x[i]) < 1e-9), i, 0.0) for i in (0, 1)]
                 + [(np.arange(solid.n_nodes), 2, 0.0)])
    plane = last(expanding(body(flat, "plane_strain", law, kinematics, on_rollers(flat)), uniform(flat, 0, WARMER)),
                 PARAMETERS[law], control=SHARP)
    full = last(expanding(body(solid, "solid", law, kinematics, walls), uniform(solid, 0, WARMER)), PARAMETERS[law],
                control=SHARP)
    assert plane.u[:, 0].max() == pytest.approx(full.u[:, 0].max(), rel=1e-9)
    if (law, kinematics) == ("elastic", "small"):
        assert plane.u[:, 0].max() == pytest.approx((1 + NU) * FREE, rel=1e-9)
    held_back = max(np.abs(values.P[:, 2, 2]).max() for values in full.points)
    assert held_back > 0.9 * FREE * (E if law != "neo_hookean" else 100.0)  # sigma_zz = -E alpha theta; C10 30: E ~ 160


@pytest.mark.parametrize("kind, stress", [("solid", -E * FREE), ("plane_stress", -E * FREE),
                                          ("plane_strain", -E * FREE * (1 + NU) / (1 - NU**2))])
def test_a_bar_held_at_both_ends_is_pressed_by_e_alpha_theta(kind, stress):
    mesh = grid("hex8" if kind == "solid" else "quad8", cells_of(kind))
    right = where(mesh, lambda x, *_: np.abs(x - 1) < 1e-9)
    sides = [(where(mesh, lambda *x, i=i: np.abs(x[i]) < 1e-9), i, 0.0) for i in range(mesh.n_dim)]
    model = body(mesh, kind, "elastic", None, held(mesh, [*sides, (right, "x", 0.0)]), thickness=0.5,
                 channels=(Reaction(dofs_of(right, "x", mesh.n_dim)),))
    frame = last(expanding(model, uniform(mesh, 0.0, WARMER)), PARAMETERS["elastic"], control=SHARP)
    assert frame.channels[0] == pytest.approx(stress * (1.0 if kind == "solid" else 0.5), rel=1e-9)
    assert nodal_field(model, frame, "stress")[:, 0, 0] == pytest.approx(stress, rel=1e-9)


@pytest.mark.parametrize("cell", ["quad8", "tri6"])
def test_a_linear_temperature_bends_a_free_plate_without_stress(cell):
    """u = alpha (x theta - (gx (x² + y²)/2, ...)): quadratic, so within quadratic elements with straight edges."""
    mesh = grid(cell, (3, 2))
    corner = where(mesh, lambda x, y: (x < 1e-9) & (y < 1e-9))
    low = where(mesh, lambda x, y: (np.abs(x - 1) < 1e-9) & (y < 1e-9))
    constraints = held(mesh, [(corner, "x", 0.0), (corner, "y", 0.0), (low, "y", 0.0)])
    x, y = mesh.nodes.T
    g, h = 40.0, -90.0  # K/mm
    model = expanding(body(mesh, "plane_stress", "elastic", "small", constraints),
                      np.stack([np.zeros(mesh.n_nodes), 20.0 + g * x + h * y]))
    frame = last(model, PARAMETERS["elastic"], control=SHARP)
    exact = ALPHA * np.stack([20 * x + g * (x * x - y * y) / 2 + h * x * y,
                              20 * y + h * (y * y - x * x) / 2 + g * x * y], axis=1)
    turn = exact[low[0], 1]  # the rigid rotation that the support at the right takes away
    exact += np.stack([turn * y, -turn * x], axis=1)
    assert np.abs(frame.u - exact).max() < 1e-9 * np.abs(exact).max()
    assert largest_stress(frame) < 1e-9 * E * ALPHA * 100.0


@pytest.mark.parametrize("kind", ["plane_stress", "plane_strain", "solid"])
def test_no_change_of_temperature_and_no_coefficient_change_nothing(kind):
    mesh = grid("hex8" if kind == "solid" else "quad8", cells_of(kind))
    H = np.diag([0.02, -0.01, 0.0][:mesh.n_dim])
    model = body(mesh, kind, "j2_linear", None, affine_constraints(mesh, outer_nodes(mesh), H))
    plain = last(model, PARAMETERS["j2_linear"])
    for temperature, alpha in ((0.0, ALPHA), (WARMER, 0.0)):
        other = last(expanding(model, uniform(mesh, 0.0, temperature), alpha), PARAMETERS["j2_linear"])
        assert np.abs(other.u - plain.u).max() <= 1e-14
        assert np.abs(other.points[0].P - plain.points[0].P).max() <= 1e-12


@pytest.mark.parametrize("law, kinematics", [("neo_hookean", "finite"), ("j2_linear", "finite")])
def test_stretching_an_expanded_body_gives_the_cauchy_stress_of_the_law_at_the_mechanical_part(law, kinematics):
    mesh = grid("hex8", (1, 1, 1))
    H = np.diag([0.03, -0.004, -0.006])
    s = 1.0 + FREE
    warm = body(mesh, "solid", law, kinematics, affine_constraints(mesh, outer_nodes(mesh), s * (np.eye(3) + H)
                                                                   - np.eye(3)))
    cold = body(mesh, "solid", law, kinematics, affine_constraints(mesh, outer_nodes(mesh), H))
    a = nodal_field(warm, last(expanding(warm, uniform(mesh, 0.0, WARMER)), PARAMETERS[law]), "stress")
    b = nodal_field(cold, last(cold, PARAMETERS[law]), "stress")
    assert np.abs(a - b).max() < 1e-12 * np.abs(b).max()


# derivatives ----------------------------------------------------------------------------------------------
TIMES = np.array([0.0, 1.0, 2.0, 2.5])
PULL = np.array([0.0, 0.02, 0.05, 0.04])  # far beyond yield (0.5 % strain), then back
PATHS = {"plane stress": ("quad8", "plane_stress"), "plane strain F-bar": ("quad4", "plane_strain"),
         "solid F-bar": ("hex8", "solid"), "plane strain": ("quad8", "plane_strain")}
BIG = 4e-5  # 1/K: with 200 K the expansion is of the size of the yield strain
STEP, TOLERANCE = 1e-4, 2e-6  # as in test_sensitivity.py


def warmed_and_pulled(cell, kind, law, kinematics):
    mesh = grid(cell, (2, 2) if kind != "solid" else (2, 2, 1), mapping=skewed)
    d = mesh.n_dim
    left, right = (where(mesh, lambda x, *_, s=s: np.abs(x - s) < 1e-9) for s in (0, 1))
    model = body(mesh, kind, law, kinematics, held(mesh, [(left, i, 0.0) for i in range(d)] + [(right, "x", PULL)], 4),
                 channels=(Reaction(dofs_of(right, "x", d)),))
    shape = 1.0 + mesh.nodes[:, 0] - 0.5 * mesh.nodes[:, 1] ** 2
    return expanding(model, np.outer([0.0, 80.0, 60.0, 200.0], shape), BIG)


def frames(model, params, **more):
    return list(march(model, {"BODY": params}, TIMES, control=SHARP, **more))


@pytest.mark.parametrize("law, kinematics", [("elastic", "small"), ("neo_hookean", "finite"), ("j2_linear", "finite")])
@pytest.mark.parametrize("cell, kind", PATHS.values(), ids=PATHS)
def test_derivatives_by_the_coefficient_the_law_and_the_temperature_meet_differences(cell, kind, law, kinematics):
    model, params = warmed_and_pulled(cell, kind, law, kinematics), PARAMETERS[law]
    bump = np.outer([0.0, 1.0, 3.0, 2.0], np.cos(model.mesh.nodes[:, 0]))
    directions = [Direction("alpha", expansion=0), Direction("T", d_temperature=bump)]
    directions += [Direction(str(i), material=(0, i)) for i in range(len(params))]
    states = frames(model, params, directions=directions)
    changes = [(BIG, lambda h: (expanding(model, model.temperature, BIG + h), params)),
               (10.0, lambda h: (replace(model, temperature=model.temperature + h * bump), params))]
    changes += [(value, lambda h, i=i: (model, params + h * np.eye(len(params))[i])) for i, value in enumerate(params)]
    for k, (value, changed) in enumerate(changes):
        step = STEP * value
        plus, minus = (frames(*changed(s * step), steps=states[-1].steps) for s in (1, -1))
        for exact, a, b in zip(states, plus, minus, strict=True):
            for derivative, difference in ((exact.du[..., k], a.u - b.u),
                                           (exact.dchannels[:, k], a.channels - b.channels)):
                quotient = difference / (2 * step)
                size = max(np.abs(quotient).max(), 1e-6 / value)
                assert np.abs(quotient - derivative).max() < TOLERANCE * size, (k, exact.frame)


def test_moduli_scaled_together_leave_the_warmed_body_where_it_is():
    model = warmed_and_pulled("quad8", "plane_stress", "j2_linear", "finite")
    params = PARAMETERS["j2_linear"]
    moduli = params * np.array([1, 0, 1, 1])
    plain, scaled = frames(model, params)[-1], frames(model, params + moduli)[-1]
    assert np.abs(plain.u - scaled.u).max() < 1e-10 * np.abs(plain.u).max()
    assert scaled.channels == pytest.approx(2 * plain.channels, rel=1e-9)


def test_wrong_temperatures_are_refused():
    mesh = grid("quad4", (1, 1))
    model = body(mesh, "plane_stress", "elastic", None, on_rollers(mesh))
    with pytest.raises(InputError, match="inconsistent size"):
        last(expanding(model, np.zeros((3, 4))), PARAMETERS["elastic"])
    with pytest.raises(InputError, match="not a number at frame 1"):
        last(expanding(model, [[0.0] * 4, [0, 0, np.nan, 0]]), PARAMETERS["elastic"])
    with pytest.raises(InputError, match="no temperature"):
        last(model, PARAMETERS["elastic"], directions=[Direction("alpha", expansion=0)])
