"""`controlled_by` in [[boundary]]: the same test as with the logged motion where the gauge is the grip; refusals."""

import numpy as np
import pytest
from small_experiment import TOML, write_experiment

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.model import build_forward, solve
from idic.virtual_tests import simulate

LOGGED = 'uy = { column = "grip_um", noise_std = 0.2 }'
GAUGE = '{ displacement = "TOP", component = "y", minus = "BOTTOM", column = "grip_um" }'
LED = f"uy = {{ controlled_by = {GAUGE} }}"
PULLED = f'edges = "UP"\nforce = {{ component = "y", controlled_by = {GAUGE} }}'
MORE = '\n[sets]\nUP = { where = "y > 2.9" }\n[[dof]]\nname = "time.offset"\nidentify = true\n'
REACTION = TOML.replace('reaction = "TOP", component = "y"', 'reaction = "BOTTOM", component = "y", factor = -1.0')


def solved(folder, text):
    """Motion, channels, and their derivatives by E and time.offset."""
    forward = build_forward(load_experiment(write_experiment(folder, text)))
    names, parameters = ("SPECIMEN.E", "time.offset"), forward.model.parameters
    states = list(forward.march(parameters, names))
    return [np.array([getattr(s, part) for s in states]) for part in ("u", "channels", "du", "dchannels")]


def test_a_motion_led_by_the_gauge_that_is_the_grip_is_the_logged_motion(tmp_path):
    logged = solved(tmp_path / "a", TOML.replace(LOGGED, 'uy = { column = "grip_um" }') + MORE)
    led = solved(tmp_path / "b", TOML.replace(LOGGED, LED) + MORE)
    for one, other in zip(logged, led, strict=True):
        assert np.abs(one).max() > 0.0
        np.testing.assert_allclose(other, one, atol=1e-10 * np.abs(one).max())


def test_a_force_led_by_a_gauge_keeps_it_on_its_course(tmp_path):
    text = REACTION.replace('nodes = "TOP"\nux = 0.0\n' + LOGGED, PULLED) + MORE
    u, channels, du, _ = solved(tmp_path, text)
    forward = build_forward(load_experiment(tmp_path / "experiment.toml"))
    top = np.asarray(forward.model.mesh.node_sets["TOP"])
    np.testing.assert_allclose(u[:, top, 1].mean(axis=1), [0.0, 0.0049, 0.0099, 0.0149], atol=1e-12)
    assert (np.diff(channels[:, 0]) > 0.0).all()
    np.testing.assert_allclose(du[1:, top, 1, 0].mean(axis=1), 0.0, atol=1e-12)  # whatever E is
    np.testing.assert_allclose(du[1:, top, 1, 1].mean(axis=1), 0.005, rtol=0.03)  # mm/s: a later log


def test_the_log_of_a_simulated_test_has_the_gauge(tmp_path):
    write_experiment(tmp_path / "a", TOML.replace(LOGGED, LED))
    simulate(tmp_path / "a" / "experiment.toml", tmp_path / "b")
    again = load_experiment(tmp_path / "b")
    assert again.model.prescribed[-1].drive.course == pytest.approx([0.0, 0.0049, 0.0099, 0.0149])
    found = solve(build_forward(again), again.model.parameters).channels[:, 0]
    np.testing.assert_allclose(again.model.channels[0].values, found, atol=4 * 5.0)  # its noise, N


@pytest.mark.parametrize("text, what", [
    (TOML.replace(LOGGED, LED.replace('"TOP", comp', '"NOWHERE", comp')), "NOWHERE"),
    (TOML.replace(LOGGED, LED.replace('"y"', '"z"')), "a plane model has no component z"),
    (TOML.replace(LOGGED, LED.replace("grip_um", "opening")), "opening"),
    (TOML.replace(LOGGED, LED.replace("{ controlled", '{ column = "grip_um", controlled')), "exactly one of"),
    (TOML.replace(LOGGED, LED.replace("{ controlled", '{ noise_std = 0.1, controlled')),
     "noise_std does not belong here"),
    (TOML.replace("ux = 0.0\n" + LOGGED, "ux" + LED[2:] + "\n" + LED), "two motions or forces that a gauge controls"),
    (TOML.replace(LOGGED, f'pressure = {{ edges = "UP", controlled_by = {GAUGE} }}') + MORE,
     "a pressure that a gauge controls"),
    (TOML.replace(LOGGED, f'force = {{ edges = "UP", component = "y", identify_scale = true, controlled_by = {GAUGE}'
                  " }") + MORE, "identify_scale does not belong here"),
])
def test_what_a_gauge_cannot_control_is_refused(tmp_path, text, what):
    assert "controlled_by" in text
    with pytest.raises(InputError) as caught:
        load_experiment(write_experiment(tmp_path / "a", text))
    assert what in str(caught.value)
