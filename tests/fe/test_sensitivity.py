"""Every derivative of the march meets the central difference of perturbed runs with frozen steps."""

from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import PARAMETERS, SHARP, body, faces_where, grid, held, skewed, where

from idic.errors import InputError
from idic.fe import Direction, Loads, Reaction, dofs_of, march, traction

TIMES = np.array([0.0, 1.0, 2.0, 2.5])
PULL = np.array([0.0, 0.02, 0.05, 0.04])  # loading and a little unloading
BODIES = {
    "plane stress": ("quad4", "plane_stress"), "plane strain F-bar": ("quad4", "plane_strain"),
    "solid F-bar": ("hex8", "solid"), "quad8": ("quad8", "plane_strain"), "tri3": ("tri3", "plane_stress"),
    "tet10": ("tet10", "solid"),
}
LAWS = ["elastic", "neo_hookean", "j2_linear"]
STEP = 1e-4
ROUNDING = 1e-15  # mm and N, of converged values of at most 0.1
TOLERANCE = 2e-6  # of the largest change: STEP² times a curvature of order 10, and SHARP over STEP


def model_of(cell, kind, law):
    """A block pulled at its right end, pushed by a dead load at the top and a follower pressure below."""
    mesh = grid(cell, (2, 2) if kind != "solid" else (2, 2, 1), mapping=skewed)
    d = mesh.n_dim
    left, right = (where(mesh, lambda x, *_, s=s: np.abs(x - s) < 1e-9) for s in (0, 1))
    parts = [(left, i, 0.0) for i in range(d)]
    parts += [(right, "x", PULL), (right, "y", 0.3 * PULL**2 / PULL.max())]
    top, below = (faces_where(mesh, lambda x, y, *_, s=s: np.abs(y - s) < 1e-9) for s in (1, 0))
    ramp = np.array([0.0, 0.5, 1.0, 1.2])[:, None]
    loads = Loads(traction(mesh, top, np.array([0.3, 1.0, 0.2])[:d], 0.8)[:, None], 0.4 * ramp,
                  (below,), 0.6 * ramp)
    return body(mesh, kind, law, None, held(mesh, parts, len(TIMES)), loads=loads, thickness=0.8 if d == 2 else 1.0,
                channels=(Reaction(dofs_of(right, "x", d)), Reaction(dofs_of(left, "y", d), 2.0)))


def run(model, params, **more):
    return list(march(model, {"BODY": params}, TIMES, control=SHARP, **more))


def assert_derivative(states, k, plus, minus, step, tolerance=TOLERANCE):
    for exact, a, b in zip(states, plus, minus, strict=True):
        for derivative, difference in ((exact.du[..., k], a.u - b.u), (exact.dchannels[:, k], a.channels - b.channels)):
            quotient = difference / (2 * step)
            size = max(np.abs(quotient).max(), np.abs(derivative).max(), 1e-6)  # SHARP over STEP
            assert np.abs(quotient - derivative).max() < tolerance * size + ROUNDING / (2 * step)


def scaled_histories(model, name, factor):
    """The model with one history multiplied by 1 + factor."""
    c, loads = model.constraints, model.loads
    if name == "pull":
        return replace(model, constraints=replace(c, histories=c.histories * (1 + factor * np.array([1, 0]))))
    if name == "dead":
        return replace(model, loads=replace(loads, dead_histories=loads.dead_histories * (1 + factor)))
    if name == "pressure":
        return replace(model, loads=replace(loads, pressure_histories=loads.pressure_histories * (1 + factor)))
    t = model.thickness * (1 + factor)  # a dead load is a force, it does not grow with the thickness
    return replace(model, thickness=t)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("where_", BODIES)
def test_material_derivatives_meet_central_differences(where_, law):
    model, params = model_of(*BODIES[where_], law), PARAMETERS[law]
    directions = [Direction(str(i), material=(0, i)) for i in range(len(params))]
    states = run(model, params, directions=directions)
    for i, value in enumerate(params):
        step = STEP * value * np.eye(len(params))[i]
        plus, minus = (run(model, params + s * step, steps=states[-1].steps) for s in (1, -1))
        assert_derivative(states, i, plus, minus, STEP * value)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("where_", BODIES)
def test_amplitude_load_pressure_and_thickness_derivatives_meet_central_differences(where_, law):
    model, params = model_of(*BODIES[where_], law), PARAMETERS[law]
    c, loads = model.constraints, model.loads
    none = np.zeros_like(loads.dead_histories)
    directions = {"pull": Direction("pull", d_histories=c.histories * np.array([1, 0])),
                  "dead": Direction("dead", d_loads=np.hstack([loads.dead_histories, none])),
                  "pressure": Direction("pressure", d_loads=np.hstack([none, loads.pressure_histories]))}
    if model.kind != "solid":
        directions["thickness"] = Direction("thickness", thickness=True)
    states = run(model, params, directions=tuple(directions.values()))
    for k, name in enumerate(directions):
        plus, minus = (run(scaled_histories(model, name, s * STEP), params, steps=states[-1].steps) for s in (1, -1))
        assert_derivative(states, k, plus, minus, STEP * (model.thickness if name == "thickness" else 1.0))


def test_a_traction_grows_with_the_thickness_through_d_loads():
    model, params = model_of("quad4", "plane_stress", "j2_linear"), PARAMETERS["j2_linear"]
    own = np.hstack([model.loads.dead_histories, np.zeros_like(model.loads.dead_histories)]) / model.thickness
    states = run(model, params, directions=(Direction("thickness", thickness=True, d_loads=own),))

    def thicker(factor):
        model_t = scaled_histories(model, "thickness", factor)
        return scaled_histories(model_t, "dead", factor)

    plus, minus = (run(thicker(s * STEP), params, steps=states[-1].steps) for s in (1, -1))
    assert_derivative(states, 0, plus, minus, STEP * model.thickness)
    assert all(np.abs(s.du).max() < 1e-10 for s in states)  # all forces per thickness: only the reactions change


@pytest.mark.parametrize("law", LAWS)
def test_a_time_offset_is_a_direction_of_the_histories(law):
    """Smooth in the offset as long as each frame stays in its interval: here the histories are given as functions."""
    model, params = model_of("quad4", "plane_stress", law), PARAMETERS[law]

    def shifted(offset):
        t = TIMES + offset
        histories = np.column_stack([0.02 * t + 0.004 * t**2, 0.01 * t**2])
        histories[0] = 0.0
        return replace(model, constraints=replace(model.constraints, histories=histories))

    rates = np.column_stack([0.02 + 0.008 * TIMES, 0.02 * TIMES])
    states = run(shifted(0.0), params, directions=(Direction("time.offset", d_histories=rates),))
    plus, minus = (run(shifted(s * STEP), params, steps=states[-1].steps) for s in (1, -1))
    assert_derivative(states, 0, plus, minus, STEP)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("where_", ["plane stress", "solid F-bar"])
def test_the_influence_of_a_local_drive_meets_a_change_at_that_frame_only(where_, law):
    model, params = model_of(*BODIES[where_], law), PARAMETERS[law]
    model = replace(model, local_drives=(1, 0))
    states = run(model, params)
    for m, drive in enumerate(model.local_drives):
        for frame in (1, 3):
            moved = []
            for s in (1, -1):
                histories = model.constraints.histories.copy()
                histories[frame, drive] += s * 1e-6
                changed = replace(model, constraints=replace(model.constraints, histories=histories))
                moved.append(run(changed, params, steps=states[-1].steps)[frame])
            quotient = (moved[0].u - moved[1].u) / 2e-6
            assert np.abs(quotient - states[frame].local_du[..., m]).max() < 1e-5  # SHARP / 1e-6 mm
            quotient = (moved[0].channels - moved[1].channels) / 2e-6
            exact = states[frame].local_dchannels[:, m]
            assert np.abs(quotient - exact).max() < 1e-5 * np.abs(exact).max()


def test_derivatives_hold_through_substeps_and_cut_steps():
    model, params = model_of("quad4", "plane_stress", "j2_linear"), PARAMETERS["j2_linear"]
    steps = run(model, params, substeps=3)[-1].steps
    ragged = replace(steps, times=tuple(t for k, t in enumerate(steps.times) if k != 1))
    directions = (Direction("H", material=(0, 3)), Direction("pull", d_histories=model.constraints.histories))
    states = run(model, params, directions=directions, steps=ragged)
    h = STEP * params[3] * np.eye(4)[3]
    plus, minus = (run(model, params + s * h, steps=ragged) for s in (1, -1))
    assert_derivative(states, 0, plus, minus, STEP * params[3])
    plus, minus = (run(replace(model, constraints=replace(
        model.constraints, histories=model.constraints.histories * (1 + s * STEP))), params, steps=ragged)
        for s in (1, -1))
    assert_derivative(states, 1, plus, minus, STEP)


def test_scaling_all_stiffnesses_scales_forces_and_leaves_displacements():
    """Exact identity: sum of value x derivative over E, yield stress, H is zero for u, the reaction for forces."""
    model, params = model_of("quad4", "plane_stress", "j2_linear"), PARAMETERS["j2_linear"]
    model = replace(model, loads=Loads())
    states = run(model, params, directions=[Direction(str(i), material=(0, i)) for i in (0, 2, 3)])
    weights = params[[0, 2, 3]]
    for state in states[1:]:
        assert np.abs(state.du @ weights).max() < 1e-12  # rounding, of single terms of 1e-2
        assert state.dchannels @ weights == pytest.approx(state.channels, rel=1e-9)


def test_directions_that_do_not_fit_are_refused():
    model = model_of("quad4", "plane_stress", "elastic")
    for bad in (Direction("none"), Direction("two", material=(0, 0), thickness=True),
                Direction("shape", d_histories=np.zeros((2, 1)))):
        with pytest.raises(InputError):
            run(model, PARAMETERS["elastic"], directions=(bad,))
    solid = model_of("hex8", "solid", "elastic")
    with pytest.raises(InputError, match="thickness"):
        run(solid, PARAMETERS["elastic"], directions=(Direction("t", thickness=True),))
