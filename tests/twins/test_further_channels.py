"""Twins in which a second load cell, a gauge or a pressure log changes what can be determined."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "identify"))

from twin_bodies import TIMES, column, experiment, held_left, photographed, plate  # noqa: E402

from idic.fe import make_mesh  # noqa: E402
from idic.identification import identify  # noqa: E402
from idic.images import ArrayStack  # noqa: E402
from idic.model import (  # noqa: E402
    Channel, Column, Constant, Load, Material, Noise, Prescribed, build_forward, load_parameters, solve,
)
from idic.parameters import Parameter, ParameterSet  # noqa: E402

NOISE = 1.0  # grey values


def recorded(body, channels=(), seed=1):
    """The body with images of its own motion, what these channels read of it, and noise on both."""
    body = replace(body, model=replace(body.model, channels=tuple(channels)))
    rng = np.random.default_rng(seed)
    truth = solve(build_forward(body), body.model.parameters).channels
    made = tuple(replace(channel, values=truth[:, i] + channel.noise_std * rng.standard_normal(len(TIMES)))
                 for i, channel in enumerate(channels))
    clean = photographed(replace(body, model=replace(body.model, channels=())))
    images = np.array([clean.recording.stack.frame(k) for k in range(len(TIMES))])
    stack = ArrayStack(images + NOISE * rng.standard_normal(images.shape))
    return replace(body, recording=replace(body.recording, stack=stack, noise=Noise(NOISE)),
                   model=replace(body.model, channels=made))


def reading(kind, nodes, component, noise, **more):
    return Channel(f"{kind}_{nodes}", np.zeros(len(TIMES)), noise, nodes, component, kind=kind, **more)


def started(body, **values):
    """The same with other starting values."""
    return replace(body, model=replace(body.model, parameters=body.model.parameters.with_values(values)))


def outcome(body):
    result = identify(body).result
    return result["parameters"], {entry["name"]: entry["reason"] for entry in result["not_identifiable"]}, result


# two load cells ---------------------------------------------------------------------------------------------
def two_bodies(channels):
    """Two plates side by side, each in its own grip: nothing but its own load cell tells its modulus."""
    one = plate()
    n = one.n_nodes
    conn = one.blocks[0].connectivity
    nodes = np.vstack([one.nodes * [1.0, 0.45] - [0.0, 1.1], one.nodes * [1.0, 0.45] + [0.0, 1.1]])
    sets = {f"{name}{k}": np.asarray(one.node_sets[name]) + k * n for name in ("LEFT", "RIGHT") for k in (0, 1)}
    mesh = make_mesh(nodes, [("quad8", np.vstack([conn, conn + n]))], node_sets=sets,
                     element_sets={"LOWER": np.arange(len(conn)), "UPPER": len(conn) + np.arange(len(conn))})
    grip = column("grip", 0.05)
    prescribed = [Prescribed(f"{side}{k}", c, drive) for k in (0, 1)
                  for side, c, drive in (("LEFT", "x", Constant(0.0)), ("LEFT", "y", Constant(0.0)),
                                         ("RIGHT", "x", grip), ("RIGHT", "y", Constant(0.0)))]
    body = experiment(prescribed=())
    values = {"LOWER": 1000.0, "UPPER": 2500.0}
    parameters = [Parameter(f"{name}.E", value, "MPa", True, transform="log") for name, value in values.items()]
    parameters += [Parameter(f"{name}.nu", 0.3) for name in values]
    body = replace(body, model=replace(body.model, mesh=mesh, prescribed=tuple(prescribed),
                                       parameters=ParameterSet(parameters),
                                       materials=tuple(Material(name, "elastic", "small") for name in values),
                                       channels=()))
    return recorded(body, channels)


CELLS = (reading("reaction", "RIGHT0", "x", 0.3), reading("reaction", "RIGHT1", "x", 0.3))


def test_a_second_load_cell_determines_the_modulus_that_the_first_leaves_open():
    one, both = two_bodies(CELLS[:1]), two_bodies(CELLS)
    starts = {"LOWER.E": 1300.0, "UPPER.E": 2000.0}
    found, open_names, _ = outcome(started(one, **starts))
    assert set(open_names) == {"UPPER.E"} and found["UPPER.E"]["std"] is None
    assert found["LOWER.E"]["value"] == pytest.approx(1000.0, abs=3 * found["LOWER.E"]["std"])
    found, open_names, _ = outcome(started(both, **starts))
    assert not open_names
    for name, truth in (("LOWER.E", 1000.0), ("UPPER.E", 2500.0)):
        assert found[name]["value"] == pytest.approx(truth, abs=3 * found[name]["std"])


def test_a_third_of_the_noise_in_a_load_cell_is_a_third_of_the_error_of_its_modulus():
    """Noise weighting: images do not tell a modulus here, so that its error is that of its own load cell."""
    stds = []
    for noise in (0.3, 0.1):
        cells = (CELLS[0], reading("reaction", "RIGHT1", "x", noise))
        stds.append(outcome(two_bodies(cells))[0])
    assert stds[1]["UPPER.E"]["std"] == pytest.approx(stds[0]["UPPER.E"]["std"] / 3, rel=1e-2)
    assert stds[1]["LOWER.E"]["std"] == pytest.approx(stds[0]["LOWER.E"]["std"], rel=1e-2)


# gauges --------------------------------------------------------------------------------------------------------
def pulled_by_force(top=60.0):
    load = Load("RIGHT", "force", column("force", top), "x")
    return experiment(prescribed=held_left(), loads=(load,))


def test_an_extensometer_reads_the_mean_motion_between_two_sets():
    pulled = pulled_by_force()
    body = replace(pulled, model=replace(pulled.model,
                                         channels=(reading("displacement", "RIGHT", "x", 1e-4, minus="LEFT"),)))
    solution = solve(build_forward(body), body.model.parameters)
    nodes = body.model.mesh.node_sets["RIGHT"]
    assert solution.channels[:, 0] == pytest.approx(solution.u[:, nodes, 0].mean(axis=1), rel=1e-12)


# pressure ------------------------------------------------------------------------------------------------------
def inflated(scale=1.0, log=False, noise_std=0.0, seed=1, follower=True):
    """A soft plate pushed at its right end by a pressure that is known up to a factor; with a log of it where `log`."""
    drive = column("pump", -0.9, noise_std)
    load = Load("RIGHT", "pressure", drive, follower=follower, identify_scale=True)
    values = {"C10": 3.0, "kappa": 30.0}
    body = experiment(law="neo_hookean", values=values, prescribed=held_left(), loads=(load,), kinematics="finite")
    parameters = [replace(p, transform="log") for p in body.model.parameters.values()]
    parameters += [replace(p, value=scale) for p in load_parameters((load,)) if p.name.endswith("scale")]
    body = replace(body, model=replace(body.model, parameters=ParameterSet(parameters)))
    return recorded(body, (reading("pressure", "RIGHT", None, 0.005),) if log else (), seed)


SCALE = "boundary.RIGHT.pressure.scale"


def test_with_an_unknown_pressure_moduli_are_determined_up_to_its_factor_only():
    body = inflated(1.2)
    found, reasons, result = outcome(started(body, **{SCALE: 1.0, "BODY.C10": 2.5, "BODY.kappa": 36.0}))
    assert set(reasons) == {SCALE, "BODY.C10", "BODY.kappa"}
    assert reasons["BODY.C10"] == f"determined only up to the factor {SCALE}: no channel measures that load"
    ratio = result["derived"][f"BODY.C10/{SCALE}"]
    assert ratio["value"] == pytest.approx(3.0 / 1.2, abs=3 * ratio["std"])


def test_a_log_of_the_pressure_determines_the_moduli():
    body = inflated(1.2, log=True)
    found, reasons, _ = outcome(started(body, **{SCALE: 1.0, "BODY.C10": 2.5, "BODY.kappa": 36.0}))
    assert not reasons
    for name, truth in ((SCALE, 1.2), ("BODY.C10", 3.0), ("BODY.kappa", 30.0)):
        assert found[name]["value"] == pytest.approx(truth, abs=3 * found[name]["std"])
    assert found["BODY.C10"]["std"] < 0.02 * 3.0


@pytest.mark.parametrize("follower", [True, False])
def test_influence_of_a_load_of_one_frame_meets_a_difference_quotient(follower):
    """Elastic: nothing remembers earlier frames, so that the same-frame influence is the whole."""
    body = inflated(follower=follower)
    body = replace(body, recording=replace(body.recording, stack=None))
    drive = replace(body.model.loads[0].drive, noise_std=0.01)
    body = replace(body, model=replace(body.model, loads=(replace(body.model.loads[0], drive=drive),),
                                       channels=(reading("displacement", "RIGHT", "x", 1e-3),
                                                 reading("pressure", "RIGHT", None, 1e-3),
                             reading("reaction", "LEFT", "x", 0.1))))
    forward, step = build_forward(body), 1e-4
    none = np.zeros((len(TIMES), 1))
    states = list(forward.march(body.model.parameters, (SCALE,), none, influence=True))
    ends = [solve(forward, body.model.parameters, none + sign * step) for sign in (1, -1)]
    for state in states[1:]:
        k = state.frame
        quotient = (ends[0].u[k] - ends[1].u[k]) / (2 * step)
        assert np.abs(state.local_du[..., 0] - quotient).max() < 1e-6 * np.abs(quotient).max()  # O(step²)
        quotient = (ends[0].channels[k] - ends[1].channels[k]) / (2 * step)
        assert state.local_dchannels[:, 0] == pytest.approx(quotient, rel=1e-6, abs=1e-6 * np.abs(quotient).max())
    at = lambda value: solve(forward, body.model.parameters.with_values({SCALE: value}))  # noqa: E731
    plus, minus = at(1 + step), at(1 - step)
    for state in states[1:]:
        for found, upper, lower in ((state.du[..., 0], plus.u, minus.u),
                                    (state.dchannels[:, 0], plus.channels, minus.channels)):
            quotient = (upper[state.frame] - lower[state.frame]) / (2 * step)
            assert np.abs(found - quotient).max() < 1e-6 * np.abs(quotient).max()


def test_the_noise_of_a_pressure_log_is_taken_out_frame_by_frame():
    """A log that is 5 % off at random moves the modulus by many standard deviations unless its noise is told."""
    clean = inflated()
    rng = np.random.default_rng(5)
    values = clean.model.loads[0].drive.values * 1.0
    noisy = values + 0.05 * rng.standard_normal(len(TIMES)) * (values != 0)
    errors, free = {}, ("BODY.C10",)
    for told in (0.0, 0.05):
        drive = Column("pump", noisy, told)
        body = replace(clean, model=replace(clean.model, loads=(replace(clean.model.loads[0], drive=drive),),
                                            parameters=clean.model.parameters.with_free(free)))
        found = outcome(started(body, **{"BODY.C10": 2.7}))[0]["BODY.C10"]
        errors[told] = abs(found["value"] - 3.0) / found["std_noise"]
    assert errors[0.05] < 3.0
    assert errors[0.0] > 5.0


@pytest.mark.slow
def test_alpha_towards_zero_forgets_the_channel(tmp_path):
    """The paper's weighting: with a share of 1e-12 the force leaves the modulus as open as without a load cell."""
    from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder
    from twin_runs import identify as identify_folder

    path = write_folder(tmp_path / "test", Twin(), ELASTIC + GRIPS + FORCE)
    _, forgotten = identify_folder(path, tmp_path / "forgotten", options__weighting="paper", options__alpha=1e-12)
    _, heard = identify_folder(path, tmp_path / "heard", options__weighting="paper", options__alpha=0.5)
    assert [entry["name"] for entry in forgotten["not_identifiable"]] == ["BODY.E"]
    assert heard["parameters"]["BODY.E"]["value"] == pytest.approx(2000.0, abs=3 * heard["parameters"]["BODY.E"]["std"])
