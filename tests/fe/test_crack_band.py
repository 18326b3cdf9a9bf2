"""Bars that soften and tear: the work of the band does not depend on the size of the elements, with exact derivatives.

Displacement is prescribed, so that the peak is passed; the weak middle decides where the band is.
"""

import math

import numpy as np
import pytest
from fe_bodies import grid, held, where

from idic.errors import NotConverged
from idic.fe import Direction, Body, Reaction, Section, dofs_of, march
from idic.laws import compile, directional_stresses, element_sizes, point_stresses

LENGTH, STIFF, THRESHOLD, SOFTENING = 3.0, 1000.0, 0.004, 100.0
WEAKER = 0.99  # threshold of the middle
TORN = 0.12  # mm


def bar(n, law="elastic_damage", kinematics="small", cell="quad4", end=TORN, frames=61):
    """n squares along 3 mm, the middle one weaker, section 1 mm^2; no lateral contraction: nu = 0."""
    mesh = grid(cell, (n, 1), (LENGTH, LENGTH / n))
    left, right = (where(mesh, lambda x, *_, s=s: np.abs(x - s) < 1e-9) for s in (0.0, LENGTH))
    below = where(mesh, lambda x, y: (np.abs(y) < 1e-9) & (np.abs(x) < 1e-9))
    drive = np.linspace(0.0, end, frames)
    constraints = held(mesh, [(left, "x", 0.0), (below, "y", 0.0), (right, "x", drive)], frames)
    middle, compiled = n // 2, compile(law, kinematics)
    rest = np.delete(np.arange(n), middle)
    sections = (Section("WEAK", compiled, np.array([middle])), Section("BODY", compiled, rest))
    return Body(mesh=mesh, kind="plane_stress", sections=sections, thickness=n / LENGTH, constraints=constraints,
                 channels=(Reaction(dofs_of(right, "x", 2)),)), drive


def damaging(length, compression=1.0, **more):
    values = {"threshold": THRESHOLD, "softening": SOFTENING} | more
    body = np.array([STIFF, 0.0, values["threshold"], values["softening"], compression, length])
    return {"BODY": body, "WEAK": body * [1.0, 1.0, WEAKER, 1.0, 1.0, 1.0]}


def pulled(model, values, frames=61, directions=(), steps=None):
    states = list(march(model, values, np.arange(frames, dtype=float), directions, steps))
    return np.array([s.channels[0] for s in states]), states


def work(force, drive):
    return float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(drive)))


def closed_form(elongation, h):
    """Force of the bar, 1 mm^2: a band of size h that opens as one of 1 mm does, the rest unloads to the origin."""
    stress = lambda k, threshold: STIFF * k * np.exp(-SOFTENING * np.maximum(k - threshold, 0.0))  # noqa: E731
    rising, peak = np.linspace(0.0, 1.0 / SOFTENING, 20001), 1.0 / SOFTENING
    before = stress(rising, WEAKER * THRESHOLD)  # of the band
    rest = np.interp(before, stress(rising, THRESHOLD), rising)
    x = np.linspace(peak, 0.5, 20001)[1:]
    behind = stress(x, WEAKER * THRESHOLD)
    intact = behind / before[-1] * peak
    elongations = np.concatenate([h * rising + (LENGTH - h) * rest,
                                  h * intact + (x - intact) + (LENGTH - h) * behind / before[-1] * rest[-1]])
    assert (np.diff(elongations) > 0.0).all()  # no snap-back
    return np.interp(elongation, elongations, np.concatenate([before, behind]))


def test_a_torn_bar_has_its_closed_form_and_two_meshes_the_same_work():
    works = []
    for n in (3, 15):
        model, drive = bar(n, frames=241)
        force, _ = pulled(model, damaging(1.0), 241)
        works.append(work(force, drive))
        assert force[-1] < 0.05 * force.max()  # far past the peak
        expected = closed_form(drive, LENGTH / n)
        assert works[-1] == pytest.approx(work(expected, drive), rel=0.01)
        if n == 3:
            np.testing.assert_allclose(force, expected, atol=0.005 * force.max())  # the peak is between two frames
    assert works[1] == pytest.approx(works[0], rel=0.02)
    with pytest.raises(NotConverged, match="no equilibrium beyond"):  # without a length a band of 0.43 mm is so brittle
        pulled(bar(7, frames=241)[0], damaging(0.0), 241)  # that the rest of the bar snaps back


def test_derivatives_past_the_peak_are_those_of_perturbed_bars():
    model, _ = bar(5, kinematics="finite", frames=13)
    values = damaging(1.2, compression=0.5)
    names = compile("elastic_damage", "finite").spec.parameter_names
    free = ("E", "threshold", "softening", "length")
    directions = [Direction(name, material=(1, names.index(name))) for name in free]
    _, states = pulled(model, values, 13, directions)
    exact = np.array([s.dchannels[0] for s in states])
    for k, direction in enumerate(directions):
        place, found = direction.material[1], []
        for sign in (1.0, -1.0):
            factor = 1.0 + sign * 1e-6 * (np.arange(6) == place)
            found.append(pulled(model, values | {"BODY": values["BODY"] * factor}, 13,
                                steps=states[-1].steps)[0])
        quotient = (found[0] - found[1]) / (2e-6 * values["BODY"][place])
        np.testing.assert_allclose(exact[:, k], quotient, atol=1e-5 * np.abs(quotient).max())


@pytest.mark.parametrize("ratio", [0.8, 3.0])  # length over size
@pytest.mark.parametrize("threshold", [0.004, 0.03])  # before and behind 1 / softening
def test_derivatives_of_a_point_behind_the_peak_are_those_of_differences(ratio, threshold):
    law = compile("elastic_damage", "small")
    params = np.array([STIFF, 0.2, threshold, 60.0, 0.5, ratio])
    F, state = np.diag([1.05, 1.0, 0.99])[None], law.initial_state(0)[None]
    exact, _, ok = directional_stresses(law, 0, F, state, params, 1.0, np.zeros((1, 6, 3, 3)), None, np.eye(6))
    assert ok
    for k in range(6):
        step = 1e-6 * params * (np.arange(6) == k)
        ahead, behind = (point_stresses(law, 0, F, state, params + sign * step, 1.0)[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(exact[:, k] * params[k], (ahead - behind) / 2e-6, atol=1e-6 * STIFF * 0.05)


def test_an_element_that_would_snap_back_is_named_with_the_size_that_would_not():
    model, _ = bar(3)  # elements of 1 mm, softening from the threshold on: 1.28 lengths at most
    values = damaging(0.5, threshold=0.04, softening=100.0)
    with pytest.raises(NotConverged, match="an element of 1 mm would snap back.*0.669 mm"):
        pulled(model, values)


def test_compression_damages_by_its_share():
    model, drive = bar(3, end=-TORN)
    intact, _ = pulled(model, damaging(1.0, compression=0.0))
    np.testing.assert_allclose(intact, STIFF * drive / LENGTH, rtol=1e-9)
    half, _ = pulled(model, damaging(0.0, compression=0.25))
    k = 0.5 * np.abs(drive) / LENGTH  # sqrt of the share
    early = k < THRESHOLD
    np.testing.assert_allclose(half[early], (STIFF * drive / LENGTH)[early], rtol=1e-9)
    assert abs(half[~early][-1]) < abs(intact[~early][-1])
    back = pulled(bar(3)[0], damaging(1.0, compression=0.0))[0]
    np.testing.assert_array_equal(back, pulled(bar(3)[0], damaging(1.0))[0])  # tension: nothing changes


@pytest.mark.parametrize(("cell", "volume", "n_dim", "size"), [
    ("quad4", 4.0, 2, 2.0), ("quad8", 4.0, 2, 1.0), ("tri3", 2.0, 2, 2.0), ("tet4", 8.0 / 6.0, 3, 2.0)])
def test_the_size_of_an_element_is_the_row_that_opens(cell, volume, n_dim, size):
    assert math.isclose(element_sizes(cell, np.array([volume]), n_dim)[0], size)


@pytest.mark.slow  # a law to compile
def test_plastic_opening_of_two_meshes_does_the_same_work():
    """Perfectly plastic but for damage: it softens from the threshold on, and all flow is in the weak element.

    1.8 % apart: smaller elements thin by more strain, and their neighbours hold their width.
    """
    works, compiled = [], compile("elastoplastic(lemaitre)", "finite")
    assert compiled.spec.parameter_names == ("E", "nu", "yield_stress", "damage_S", "damage_s", "damage_threshold",
                                             "damage_length")
    body = np.array([700e3, 0.3, 300.0, 0.0064, 1.0, 0.0, 0.1])
    weak = body * [1.0, 1.0, 0.8, 1.0, 1.0, 1.0, 1.0]
    for n in (3, 9):
        model, drive = bar(n, "elastoplastic(lemaitre)", "finite", end=0.02, frames=121)
        force, _ = pulled(model, {"BODY": body, "WEAK": weak}, 121)
        assert force[-1] < 0.02 * force.max()
        works.append(work(force, drive))
    assert works[1] == pytest.approx(works[0], rel=0.03)
