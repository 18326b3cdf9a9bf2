"""From recorded temperatures to the model: sets, conduction between them, the reference, the clock of the log."""

from dataclasses import replace

import numpy as np
import pytest
from twin_bodies import column, experiment, extended

from idic.errors import InputError
from idic.model import Column, Temperature, TemperatureField, build_forward, nodal_temperature, solve
from idic.parameters import Parameter

ALPHA = ("BODY.alpha", 3e-4, 1e-5)


def warmed(*temperatures, extra=(ALPHA,), **more):
    there = experiment(extra=extra, **more)
    return replace(there, model=replace(there.model, temperatures=temperatures))


def test_only_the_change_since_the_reference_counts():
    readings = np.array([300.0, 310.0, 305.0, 330.0, 320.0])
    model = replace(warmed(Temperature(None, Column("T", readings))).model, reference=1)
    field = nodal_temperature(model)
    np.testing.assert_allclose(field.values, np.outer(readings - 310.0, np.ones(model.mesh.n_nodes)), atol=1e-12)
    assert field.rates is None and nodal_temperature(experiment().model) is None


def test_two_thermocouples_make_a_course_between_them_and_later_records_win():
    hot = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    body = warmed(Temperature("LEFT", Column("a", hot)), Temperature("RIGHT", Column("b", 0 * hot)))
    T = nodal_temperature(body.model).values
    x = body.model.mesh.nodes[:, 0]
    assert T[4, body.model.mesh.node_sets["LEFT"]] == pytest.approx(40.0)
    assert T[4].min() > -1e-9 and T[4].max() < 40.0 + 1e-9
    assert np.corrcoef(T[4], -x)[0, 1] > 0.99
    over = replace(body, model=replace(body.model,
                                       temperatures=(Temperature(None, Column("room", hot)), *body.model.temperatures)))
    T = nodal_temperature(over.model).values
    assert T[2, body.model.mesh.node_sets["RIGHT"]] == pytest.approx(0.0) and np.median(T[2]) == pytest.approx(20.0)


def test_gaps_of_a_field_are_closed_and_a_field_of_another_size_is_refused():
    body = warmed()
    values = np.outer(np.arange(5.0), 1.0 + body.model.mesh.nodes[:, 0])
    values[:, ::7] = np.nan
    T = nodal_temperature(replace(body, model=replace(body.model,
                                                      temperatures=(Temperature(None, TemperatureField(values)),
                                                                    ))).model).values
    assert np.isfinite(T).all()
    known = ~np.isnan(values[1])
    np.testing.assert_allclose(T[:, known], values[:, known], atol=1e-12)
    with pytest.raises(InputError, match="another size"):
        nodal_temperature(replace(body, model=replace(body.model,
                                                      temperatures=(Temperature(None, TemperatureField(values[:3])),
                                                                    ))).model)


def test_without_alpha_a_temperature_does_nothing_and_without_temperature_alpha_does_not_move():
    silent = warmed(Temperature(None, column("T", 80.0)), extra=())
    plain = experiment()
    np.testing.assert_array_equal(solve(build_forward(silent), silent.model.parameters).u,
                                  solve(build_forward(plain), plain.model.parameters).u)
    cold = warmed()
    assert not build_forward(cold).moves("BODY.alpha")
    assert build_forward(warmed(Temperature(None, column("T", 80.0)))).moves("BODY.alpha")


@pytest.mark.parametrize("law, values, kinematics", [
    ("elastic", {"E": 1000.0, "nu": 0.3}, "small"),
    ("j2_linear", {"E": 1000.0, "nu": 0.3, "yield_stress": 4.0, "hardening_modulus": 60.0}, "finite")])
def test_alpha_and_the_clock_of_the_log_are_differentiated_with_everything_else(law, values, kinematics):
    body = warmed(Temperature("LEFT", column("T", 60.0)), Temperature("RIGHT", column("U", 10.0)), law=law,
                  values=values, kinematics=kinematics, extra=(ALPHA, ("time.offset", 0.0, 1.0)))
    forward, parameters = build_forward(body), body.model.parameters
    names = tuple(name for name in parameters.free if forward.moves(name))
    assert {"BODY.alpha", "time.offset", "BODY.E"} <= set(names)
    states = list(forward.march(parameters, names))
    steps = np.array(states[-1].steps.times)
    for k, name in enumerate(names):
        h = 1e-5 * max(abs(parameters[name].value), 1.0 if name == "time.offset" else 1e-3)
        ends = [list(forward.march(parameters.with_values({name: parameters[name].value + s * h}), steps=steps))
                for s in (1, -1)]
        for state, a, b in zip(states, *ends, strict=True):
            quotient = (a.u - b.u) / (2 * h)
            # Newton stops at 1e-8 of the force, so u is known to some 1e-10 mm
            assert np.abs(state.du[:, :, k] - quotient).max() < 1e-4 * np.abs(quotient).max() + 1e-10 / h, name


def test_a_locked_alpha_of_zero_is_an_isothermal_body():
    body = warmed(Temperature(None, column("T", 60.0)), extra=())
    zero = replace(body, model=replace(body.model, parameters=extended(body, [Parameter("BODY.alpha", 0.0, "1/K")])))
    a, b = (solve(build_forward(e), e.model.parameters).u for e in (body, zero))
    np.testing.assert_allclose(a, b, atol=1e-14)
