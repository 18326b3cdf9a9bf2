"""A bar that tears with a snap-back, its path led by the opening of the crack: closed form, energy of two meshes,
derivatives.

The end of the bar moves back while the crack opens, so that neither its motion nor its force could lead.
"""

from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import SHARP, where
from test_crack_band import LENGTH, STIFF, THRESHOLD, WEAKER, bar, damaging, work

from idic.errors import InputError, NotConverged
from idic.fe import Constraints, Direction, Loads, PathControl, dofs_of, march, traction
from idic.laws import compile

SOFTENING = 220.0  # the peak is at a strain of 0.0045, an opening of 0.001 to 0.003 mm
OPENING, FRAMES = 0.05, 121  # mm at the end: nothing is left of the force
COURSE = np.linspace(0.0, OPENING**0.5, FRAMES) ** 2


def brittle(length, **more):
    return damaging(length, softening=SOFTENING, **more)


def led(n, course=COURSE, kinematics="small", by_force=False):
    """The bar of n squares; the opening of the middle one leads the motion of the end, or the force on it."""
    model, _ = bar(n, kinematics=kinematics, frames=len(course))
    mesh, h, gauge = model.mesh, LENGTH / n, np.zeros(model.n_dof)
    for x0, weight in (((n // 2 + 1) * h, 0.5), (n // 2 * h, -0.5)):  # two nodes each
        gauge[dofs_of(where(mesh, lambda x, *_, x0=x0: np.abs(x - x0) < 1e-9), "x", 2)] = weight
    right = dofs_of(where(mesh, lambda x, *_: np.abs(x - LENGTH) < 1e-9), "x", 2)
    c = model.constraints
    c = replace(c, histories=np.zeros_like(c.histories))
    if not by_force:
        drive = int(np.flatnonzero(c.basis[np.isin(c.dofs, right)][0])[0])
        return replace(model, constraints=c, control=PathControl(gauge, course, drive=drive)), right
    kept = ~np.isin(c.dofs, right)
    faces = np.array([f for f in mesh.boundary_faces()
                      if np.isin(mesh.face_nodes(f) * 2, right).all()])
    unit = traction(mesh, faces, (1.0, 0.0), model.thickness)[:, None]
    left = dofs_of(where(mesh, lambda x, *_: np.abs(x) < 1e-9), "x", 2)
    return replace(model, constraints=Constraints(c.dofs[kept], c.basis[kept], c.histories),
                   loads=Loads(dead=unit, dead_histories=np.zeros((len(course), 1))),
                   channels=(replace(model.channels[0], dofs=left, factor=-1.0),),
                   control=PathControl(gauge, course, load=0)), right


def torn(model, right, values, directions=(), steps=None, control=None):
    """Force and motion of the end in every frame, and the states."""
    times = np.arange(len(model.control.readings), dtype=float)
    states = list(march(model, values, times, directions, steps, control=control))
    return np.array([s.channels[0] for s in states]), np.array([s.u.ravel()[right[0]] for s in states]), states


def closed_form(opening, h):
    """Force (1 mm^2) and motion of the end: a band of size h, the rest unloads along the secant behind the peak."""
    stress = lambda k, threshold: STIFF * k * np.exp(-SOFTENING * np.maximum(k - threshold, 0.0))  # noqa: E731
    peak, strain = 1.0 / SOFTENING, opening / h
    rising = np.linspace(0.0, peak, 20001)
    force, highest = stress(strain, WEAKER * THRESHOLD), stress(peak, WEAKER * THRESHOLD)
    strongest = np.interp(highest, stress(rising, THRESHOLD), rising)  # of the rest, at the peak
    rest = np.where(strain < peak, np.interp(force, stress(rising, THRESHOLD), rising), force / highest * strongest)
    return force, opening + (LENGTH - h) * rest


@pytest.mark.parametrize("by_force", [False, True])
def test_the_path_behind_the_peak_is_the_closed_form_with_its_snap_back(by_force):
    course = 0.5 * COURSE
    force, end, states = torn(*led(5, course, by_force=by_force), brittle(0.0))
    expected, motion = closed_form(course, LENGTH / 5)
    np.testing.assert_allclose(force, expected, atol=1e-7 * expected.max())
    np.testing.assert_allclose(end, motion, atol=2e-3 * motion.max())  # the rest tears a little until the next frame
    assert (force[np.argmax(end):] < 0.99 * force.max()).all() and end[-40:].min() < 0.6 * end.max()  # it moves back
    assert len(states[-1].steps.times) < 1.2 * len(course)


def test_two_meshes_dissipate_the_same_through_a_snap_back():
    """The length makes the crack of both the same; the weak element, of another size, damages before the peak."""
    works = [work(*torn(*led(n), brittle(0.5))[:2]) for n in (5, 15)]
    print(works)
    assert works[1] == pytest.approx(works[0], rel=0.03)


@pytest.mark.parametrize("by_force", [False, True])
def test_derivatives_along_the_path_are_those_of_perturbed_bars(by_force):
    course = 0.15 * np.linspace(0.0, OPENING**0.5, 13) ** 2
    model, right = led(5, course, "finite", by_force)
    values = brittle(0.5, compression=0.5)
    names = compile("elastic_damage", "finite").spec.parameter_names
    late = np.gradient(course)
    late[0] = 0.0
    free = (("WEAK", "E"), ("WEAK", "softening"), ("WEAK", "length"), ("BODY", "E"))
    directions = [Direction(name, material=(("WEAK", "BODY").index(part), names.index(name))) for part, name in free]
    directions.append(Direction("late", d_readings=late))
    _, _, states = torn(model, right, values, directions, control=SHARP)
    exact = np.array([[s.dchannels[0], s.du.reshape(model.n_dof, -1)[right[0]]] for s in states])
    for k, direction in enumerate(directions):
        found = []
        for sign in (1.0, -1.0):
            varied, other = model, dict(values)
            if direction.material is None:
                varied = replace(model, control=replace(model.control, readings=course + sign * 1e-6 * late))
            else:
                part, place = free[k][0], direction.material[1]
                other[part] = values[part] * (1.0 + sign * 1e-6 * (np.arange(6) == place))
            found.append(np.array(torn(varied, right, other, steps=states[-1].steps, control=SHARP)[:2]).T)
        size = 2e-6 * (1.0 if direction.material is None else values[free[k][0]][direction.material[1]])
        quotient = (found[0] - found[1]) / size
        for i, rounding in enumerate((1e-10, 1e-13)):  # force (N), motion of the end (mm)
            assert i == 0 or np.abs(quotient[:, i]).max() > 1e4 * rounding / size
            np.testing.assert_allclose(exact[:, i, k], quotient[:, i],
                                       atol=2e-5 * np.abs(quotient[:, i]).max() + rounding / size)


def test_a_gauge_that_does_not_feel_what_it_controls_is_told():
    model, right = led(5)
    gauge = np.zeros(model.n_dof)
    gauge[dofs_of(where(model.mesh, lambda x, *_: np.abs(x) < 1e-9), "x", 2)] = 0.5  # at the held end
    with pytest.raises(NotConverged, match="the gauge does not respond to the motion or force"):
        torn(replace(model, control=replace(model.control, gauge=gauge)), right, brittle(0.5))
    for control, what in ((PathControl(gauge[1:], COURSE, drive=0), "does not fit the model"),
                          (PathControl(gauge, COURSE), "one drive or one load"),
                          (PathControl(gauge, COURSE + 0.1, drive=0), "does not read zero"),
                          (PathControl(gauge, COURSE * np.nan, drive=0), "not a number at frame 0")):
        with pytest.raises(InputError, match=what):
            torn(replace(model, control=control), right, brittle(0.5))
