"""Plates with a notch that tear through, led by the opening of the notch: the work is that of the torn ligament.

The lower half of the symmetric plate is left out; the crack is the lowest row of elements, between the nodes of the
ligament, which are held, and those above.
"""

from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import grid, held, where
from test_crack_band import work

from idic.fe import Body, PathControl, Reaction, Section, dofs_of, make_mesh, march
from idic.laws import compile

pytestmark = pytest.mark.slow
WIDTH, HEIGHT, NOTCH = 8.0, 12.0, 4.0  # mm; the notch is half as long as the plate is wide
ABOVE = 1.0  # mm, of the nodes over the ligament whose mean motion is the gauge
STIFF, THRESHOLD, SOFTENING, LENGTH = 1000.0, 0.004, 220.0, 2.0


def with_notch(mesh):
    """Without the elements of the lowest row beside the ligament."""
    cells = mesh.blocks[0].connectivity
    x, y = mesh.nodes[cells].transpose(2, 0, 1)
    cells = cells[(y.min(axis=1) > 1e-9) | (x.min(axis=1) > NOTCH - 1e-9)]
    used, renumbered = np.unique(cells, return_inverse=True)
    return make_mesh(mesh.nodes[used], [("quad4", renumbered.reshape(cells.shape))])


def notched(n, law, kinematics, course):
    """n squares across, pulled at its upper edge; the opening of the mouth of the notch (mm) leads.

    Sections LIGAMENT, the row of the crack, and BODY.
    """
    mesh = with_notch(grid("quad4", (n, int(n * HEIGHT / WIDTH)), (WIDTH, HEIGHT)))
    ligament = where(mesh, lambda x, y: (np.abs(y) < 1e-9) & (x > NOTCH - 1e-9))
    corner = where(mesh, lambda x, y: (np.abs(x - WIDTH) < 1e-9) & (np.abs(y) < 1e-9))
    above = where(mesh, lambda x, y: (np.abs(y - ABOVE) < 1e-9) & (x > NOTCH - 1e-9))
    top = where(mesh, lambda x, y: np.abs(y - HEIGHT) < 1e-9)
    constraints = held(mesh, [(ligament, "y", 0.0), (corner, "x", 0.0), (top, "y", np.zeros(len(course)))],
                       len(course))
    compiled, every = compile(law, kinematics), np.arange(mesh.n_elements)
    crack = np.flatnonzero(mesh.nodes[mesh.blocks[0].connectivity, 1].min(axis=1) < 1e-9)
    gauge = np.zeros(2 * mesh.n_nodes)
    gauge[dofs_of(above, "y", 2)] = 1.0 / len(above)
    return replace(
        Body(mesh=mesh, kind="plane_stress", thickness=1.0, constraints=constraints,
              sections=(Section("LIGAMENT", compiled, crack), Section("BODY", compiled, np.delete(every, crack))),
              channels=(Reaction(dofs_of(top, "y", 2)),)),
        control=PathControl(gauge, course, drive=0)), dofs_of(top, "y", 2)


def torn(n, law, kinematics, ligament, body, course):
    """Force (N) and motion of the upper edge (mm) in every frame."""
    model, top = notched(n, law, kinematics, course)
    values = {"LIGAMENT": np.array(ligament), "BODY": np.array(body)}
    states = list(march(model, values, np.arange(len(course), dtype=float)))
    return np.array([s.channels[0] for s in states]), np.array([s.u.ravel()[top[0]] for s in states])


def work_of_a_band(h):
    """N mm per mm^2 of a row of elements of size h torn in tension: rising to the peak in h, opening behind it in
    `LENGTH`."""
    peak = 1.0 / SOFTENING
    x = np.linspace(0.0, 0.5, 400001)
    stress = STIFF * x * np.exp(-SOFTENING * np.maximum(x - THRESHOLD, 0.0))
    given_back = np.where(x > peak, stress / np.interp(peak, x, stress) * peak, x)
    return float(np.sum(0.5 * (stress[1:] + stress[:-1]) * np.diff(h * given_back + LENGTH * (x - given_back))))


def test_a_notched_plate_of_elastic_damage_does_the_work_of_its_ligament():
    """The upper edge moves back while the notch opens."""
    course, works = 0.2 * np.linspace(0.0, 1.0, 61) ** 2, []
    ligament = np.array([STIFF, 0.0, THRESHOLD, SOFTENING, 1.0, LENGTH])
    for n in (16, 32):
        force, end = torn(n, "elastic_damage", "small", ligament, ligament * [1.0, 1.0, 2.0, 0.5, 1.0, 1.0], course)
        assert force[-1] < 0.01 * force.max()
        tearing = force < 0.9 * force.max()
        assert np.diff(end[tearing & (np.arange(61) > force.argmax())]).min() < 0.0
        works.append(work(force, end))
        assert works[-1] == pytest.approx(work_of_a_band(WIDTH / n) * (WIDTH - NOTCH), rel=0.01)
    assert works[1] == pytest.approx(works[0], rel=0.03)


def test_a_notched_plate_of_plastic_damage_does_the_same_work_on_two_meshes():
    """Perfectly plastic but for damage; the ligament is the weaker part, as a groove makes it."""
    course, works, law = 0.03 * np.linspace(0.0, 1.0, 61) ** 2, [], "elastoplastic(lemaitre)"
    ligament = np.array([700e3, 0.3, 240.0, 0.0064, 1.0, 0.0, 0.1])
    for n in (24, 48):
        force, end = torn(n, law, "finite", ligament, ligament * [1, 1, 2.0, 1, 1, 1, 1], course)
        works.append(work(force, end))
        assert force[-1] < 0.03 * force.max()
    assert works[1] == pytest.approx(works[0], rel=0.03)
