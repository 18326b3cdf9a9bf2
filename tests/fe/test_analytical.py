"""Analytical solutions, orders of convergence, and locking."""

import numpy as np
import pytest
from fe_bodies import body, faces_where, grid, held, l2_error, last, pressed_ring, quarter_ring, where
from scipy.integrate import quad

from idic.fe import Loads, Reaction, cell_type, dofs_of, nodal_field, traction

A, B = 1.0, 2.0


def lame_ring(E, nu, p):
    """Displacement of a plane-strain ring under internal pressure (Timoshenko & Goodier, section 28)."""

    def exact(x):
        r = np.hypot(x[:, 0], x[:, 1])
        ur = (1 + nu) * p * A**2 / (E * (B**2 - A**2)) * ((1 - 2 * nu) * r + B**2 / r)
        return np.column_stack([ur * x[:, 0] / r, ur * x[:, 1] / r, *np.zeros((x.shape[1] - 2, len(x)))])

    return exact


def ring_errors(cell, sizes, nu, locking="auto"):
    kind = "solid" if cell_type(cell).dim == 3 else "plane_strain"
    errors = []
    for n in sizes:
        mesh = quarter_ring(cell, n, A, B)
        # the follower pressure is made so small that the ring stays linear
        frame = last(pressed_ring(mesh, kind, "elastic", "small", pressure=1e-5, locking=locking), [100.0, nu])
        errors.append(l2_error(mesh, frame.u, lame_ring(100.0, nu, 1e-5)))
    return np.array(errors)


@pytest.mark.parametrize("cell, order, sizes", [
    ("tri3", 2, (8, 16)), ("quad4", 2, (8, 16)), ("hex8", 2, (6, 12)), ("quad8", 3, (3, 6)), ("tri6", 3, (3, 6)),
    ("tet4", 2, (8, 16)), ("tet10", 3, (3, 6))])
def test_the_displacement_error_of_the_thick_cylinder_falls_with_the_order_of_the_cell(cell, order, sizes):
    coarse, fine = ring_errors(cell, sizes, 0.3)
    assert order - 0.1 < np.log2(coarse / fine) < order + 0.6  # not asymptotic yet; tri6 does better than it must
    assert fine < 6e-3


@pytest.mark.parametrize("cell, sizes", [("quad4", (6, 12)), ("hex8", (4, 8)), ("tet10", (3, 6))])
def test_mean_dilatation_keeps_second_order_where_the_plain_cell_locks(cell, sizes):
    coarse, fine = ring_errors(cell, sizes, 0.49999)
    assert np.log2(coarse / fine) == pytest.approx(3 if cell == "tet10" else 2, abs=0.35)
    assert ring_errors(cell, sizes[-1:], 0.49999, "none")[0] > 20 * fine


def cook(cell, n, nu, locking="auto", E=240.565):
    """Cook's membrane in plane strain, shear load 6.25 MPa x 16 mm: mean lift of the right edge."""

    def membrane(x):
        low = 44.0 * x[:, 0]
        return np.column_stack([48.0 * x[:, 0], low + x[:, 1] * (44.0 - 28.0 * x[:, 0])])

    mesh = grid(cell, (n, n), mapping=membrane)
    right = faces_where(mesh, lambda x, y: np.abs(x - 48) < 1e-9)
    left = where(mesh, lambda x, y: np.abs(x) < 1e-9)
    load = traction(mesh, right, [0, 1.0])[:, None]
    model = body(mesh, "plane_strain", "elastic", "small", held(mesh, [(left, "x", 0.0), (left, "y", 0.0)]),
                 locking=locking, loads=Loads(dead=load, dead_histories=np.array([[0.0], [1.0]])))
    frame = last(model, [E, nu])
    return float(load[:, 0] @ frame.u.ravel()) / load.sum()


def test_cooks_membrane_does_not_lock_when_nearly_incompressible():
    reference = cook("quad8", 16, 0.4999)
    assert cook("quad4", 16, 0.4999) == pytest.approx(reference, rel=0.02)  # discretisation error, as when nu = 0.3
    assert cook("quad4", 16, 0.4999, "none") < 0.85 * reference
    assert cook("quad4", 16, 0.3) == pytest.approx(cook("quad8", 16, 0.3), rel=0.02)


@pytest.mark.parametrize("cell, n, tolerance", [("quad4", (80, 16), 0.01), ("quad8", (20, 4), 2e-3)])
def test_a_cantilever_bends_as_the_theory_of_elasticity_says(cell, n, tolerance):
    E, nu, length, height, force = 1000.0, 0.25, 10.0, 1.0, 0.01
    mesh = grid(cell, n, (length, height))
    right = faces_where(mesh, lambda x, y: np.abs(x - length) < 1e-9)
    left = where(mesh, lambda x, y: np.abs(x) < 1e-9)
    load = traction(mesh, right, [0, 1.0])[:, None]
    model = body(mesh, "plane_stress", "elastic", "small", held(mesh, [(left, "x", 0.0), (left, "y", 0.0)]),
                 loads=Loads(dead=load, dead_histories=np.array([[0.0], [force]])),
                 channels=(Reaction(dofs_of(left, "y", 2)),))
    frame = last(model, [E, nu])
    inertia, shear = height**3 / 12, E / 2 / (1 + nu)
    theory = force * length**3 / (3 * E * inertia) + 1.2 * force * length / (shear * height)
    tip = where(mesh, lambda x, y: x > length - 1e-9)
    assert frame.u[tip, 1].mean() == pytest.approx(theory, rel=tolerance)
    assert frame.channels[0] == pytest.approx(-force, rel=1e-8)  # the solver's tolerance


def test_one_layer_of_quadratic_bricks_bends_as_the_theory_of_beams_says():
    """A cantilever; 2 %: effects of the clamped end. Linear bricks need more layers."""
    E, nu, length, height, width, force = 1000.0, 0.3, 10.0, 1.0, 0.5, 0.005

    def tip(cell, n):
        mesh = grid(cell, n, (length, height, width))
        left = where(mesh, lambda x, y, z: np.abs(x) < 1e-9)
        load = traction(mesh, faces_where(mesh, lambda x, *_: np.abs(x - length) < 1e-9), [0, 1.0, 0])[:, None] / width
        model = body(mesh, "solid", "elastic", "small", held(mesh, [(left, axis, 0.0) for axis in "xyz"]),
                     loads=Loads(dead=load, dead_histories=np.array([[0.0], [force]])))
        return float(load[:, 0] @ last(model, [E, nu]).u.ravel())

    theory = force * length**3 / (3 * E * width * height**3
                                  / 12) + 1.2 * force * length / (E / 2 / (1 + nu) * width * height)
    assert tip("hex20", (10, 1, 1)) == pytest.approx(theory, rel=0.02)
    assert abs(tip("hex8", (10, 1, 1)) / theory - 1.0) > 0.2


def test_uniaxial_tension_of_a_neo_hookean_block_matches_the_incompressible_solution():
    C10, stretch = 30.0, 1.8
    mesh = grid("hex8", (1, 1, 1))
    left, right = (where(mesh, lambda x, y, z, s=s: np.abs(x - s) < 1e-9) for s in (0, 1))
    parts = [(left, "x", 0.0), (right, "x", [0, stretch - 1]), (where(mesh, lambda x, y, z: y < 1e-9), "y", 0.0),
             (where(mesh, lambda x, y, z: z < 1e-9), "z", 0.0)]
    model = body(mesh, "solid", "neo_hookean", "finite", held(mesh, parts),
                 channels=(Reaction(dofs_of(right, "x", 3)),))
    frame = last(model, [C10, 1e6])
    assert frame.channels[0] == pytest.approx(2 * C10 * (stretch - stretch**-2), rel=2e-4)  # C10 / kappa = 3e-5
    sheet = grid("quad4", (1, 1))
    parts = [(where(sheet, lambda x, y: x < 1e-9), "x", 0.0), (where(sheet, lambda x, y: x > 1 - 1e-9), "x", [0, 0.8]),
             (where(sheet, lambda x, y: y < 1e-9), "y", 0.0)]
    model = body(sheet, "plane_stress", "neo_hookean", "finite", held(sheet, parts))
    frame2 = last(model, [C10, 1e6])
    assert nodal_field(model, frame2, "stress")[:, 0, 0] == pytest.approx(
        2 * C10 * (stretch**2 - 1 / stretch), rel=2e-4)


@pytest.mark.parametrize("cell, n", [("quad4", 12), ("quad8", 4), ("hex8", 10)])
def test_an_inflated_neo_hookean_tube_follows_the_incompressible_solution(cell, n):
    """Follower pressure at finite strain: p = integral of mu (l² - l^-2) / r over the wall, l = r / R."""
    C10, inner = 30.0, 1.25
    growth = inner**2 - A**2
    p = quad(lambda r: 2 * C10 * (r**2 / (r**2 - growth) - (r**2 - growth) / r**2) / r, inner,
             np.sqrt(B**2 + growth))[0]
    mesh = quarter_ring(cell, n, A, B)
    model = pressed_ring(mesh, "solid" if cell == "hex8" else "plane_strain", "neo_hookean", "finite", pressure=p,
                         n_frames=4)
    frame = last(model, [C10, 1e5], np.arange(4.0))
    R = np.hypot(*mesh.nodes.T[:2])
    r = np.hypot(*(mesh.nodes + frame.u).T[:2])
    assert r[R < A + 1e-6] == pytest.approx(inner, rel=2e-3)  # discretisation error
    assert r[R > B - 1e-6] == pytest.approx(np.sqrt(B**2 + growth), rel=1e-3)


def test_a_bar_of_linear_hardening_plasticity_follows_its_curve():
    """Uniaxial tension: true stress = yield + H ep, ln(stretch) = stress / E + ep, up to the elastic strain, 1.5e-3."""
    E, nu, yield_stress, H = 70e3, 0.3, 100.0, 1000.0
    sheet = grid("quad4", (2, 1))
    pull = np.array([0, 0.001, 0.005, 0.01])
    parts = [(where(sheet, lambda x, y: x < 1e-9), "x", 0.0), (where(sheet, lambda x, y: x > 1 - 1e-9), "x", pull),
             (where(sheet, lambda x, y: y < 1e-9), "y", 0.0)]
    model = body(sheet, "plane_stress", "j2_linear", None, held(sheet, parts, 4))
    frame = last(model, [E, nu, yield_stress, H], np.arange(4.0), substeps=30)  # the radial return is of first order
    plastic = (np.log(1.01) - yield_stress / E) / (1 + H / E)
    assert nodal_field(model, frame, "plastic_strain") == pytest.approx(plastic, rel=2e-3)  # elastic strain
    assert nodal_field(model, frame, "stress")[:, 0, 0] == pytest.approx(yield_stress + H * plastic, rel=3e-3)
