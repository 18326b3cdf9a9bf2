"""Cracks of a sheet: opening and K against closed forms, tips on nodes and between them; derivatives by the tip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from idic.fe import (
    Body, Constraints, Direction, Loads, Section, cut_along, make_mesh, march, raise_order, ring_around, traction,
    with_seams,
)
from idic.laws import compile as compile_law

E, NU = 1000.0, 0.3
LAW = compile_law("elastic", "small")
PARAMS = {"SHEET": np.array([E, NU])}
PLANE_STRESS = E / (1.0 - NU**2) * (NU * np.einsum("ij,kl->ijkl", np.eye(2), np.eye(2)) + 0.5 * (1.0 - NU) * (
    np.einsum("ik,jl->ijkl", np.eye(2), np.eye(2)) + np.einsum("il,jk->ijkl", np.eye(2), np.eye(2))))


def squares(width, height, n):
    """Four-node squares, n over the width."""
    m = round(n * height / width)
    nodes = np.stack(np.meshgrid(np.linspace(0, width, n + 1), np.linspace(0, height, m + 1)), axis=-1).reshape(-1, 2)
    first = (np.arange(m)[:, None] * (n + 1) + np.arange(n)).ravel()
    return make_mesh(nodes, [("quad4", np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1))])


def body_of(mesh, cut, constraints, loads, tips):
    """The body under constant drives, its crack as long as `tips` (n,) after the reference frame."""
    times = np.arange(len(tips) + 1, dtype=float)
    body = Body(mesh, "plane_stress", (Section("SHEET", LAW, np.arange(mesh.n_elements)),), constraints, loads=loads)
    return with_seams(body, [cut], np.append(tips[0], tips)[:, None], PARAMS, times), times


def pulled_strip(n, tips, across, order=raise_order):
    """A strip 10 mm by 30 mm under 1 MPa with an edge crack; its states, mesh, cut and loads."""
    mesh, cut = cut_along(squares(10.0, 30.0, n), np.array([[0.0, across], [7.0, across]]))
    mesh = order(mesh)
    ends = np.array([[face for face in mesh.boundary_faces() if np.allclose(mesh.nodes[mesh.face_nodes(face), 1], y)]
                     for y in (0.0, 30.0)])
    force = traction(mesh, ends[1], [0.0, 1.0]) + traction(mesh, ends[0], [0.0, -1.0])
    corner, above = (int(np.argmin(np.abs(mesh.nodes - point).sum(axis=1))) for point in ([10.0, 0.0], [10.0, 30.0]))
    frames = len(tips) + 1
    held = Constraints(np.array([2 * corner, 2 * corner + 1, 2 * above]), np.zeros((3, 0)), np.zeros((frames, 0)))
    body, times = body_of(mesh, cut, held, Loads(force[:, None], np.ones((frames, 1))), np.asarray(tips))
    states = list(march(body, PARAMS, times, (Direction("length", d_tips=np.ones((frames, 1))),)))[1:]
    return states, mesh, cut, force


def edge_crack(a, width=10.0):
    """K_I under 1 MPa, MPa sqrt(mm), to half a percent: Tada, Paris & Irwin, The stress analysis of cracks handbook
    (2000), doi:10.1115/1.801535, 2.11."""
    x = a / width
    return np.sqrt(np.pi * a) * np.sqrt(2.0 / (np.pi * x) * np.tan(np.pi * x / 2.0)) * (
        0.752 + 2.02 * x + 0.37 * (1.0 - np.sin(np.pi * x / 2.0))**3) / np.cos(np.pi * x / 2.0)


@pytest.mark.parametrize("across", [15.0, 15.4])  # on a row of nodes, and between two
def test_an_edge_crack_opens_the_strip_and_loads_its_tip_as_the_handbook_says(across):
    tips = np.arange(3.0, 5.01, 0.125)
    states, mesh, cut, force = pulled_strip(20, tips, across)
    work = np.array([force @ state.u.ravel() for state in states])
    a = np.linspace(tips[0], tips[-1], 401)
    assert work[-1] - work[0] == pytest.approx(np.trapezoid(2.0 * edge_crack(a)**2 / E, a), rel=0.015)
    slopes = np.diff(work) / np.diff(tips)  # between nodes, too, the crack opens steadily
    assert slopes == pytest.approx(2.0 * edge_crack(0.5 * (tips[1:] + tips[:-1]))**2 / E, rel=0.12)
    for tip, state in zip(tips, states, strict=True):
        load = ring_around(mesh, cut, tip, [np.arange(mesh.n_elements)]).tip_load(state.u, PLANE_STRESS, (E, NU),
                        "plane_stress")
        assert load.K_I == pytest.approx(edge_crack(tip), rel=0.015)
        assert load.J == pytest.approx((load.K_I**2 + load.K_II**2) / E, rel=0.005)
        assert abs(load.K_II) < 0.005 * load.K_I


def test_linear_elements_open_alike_within_their_error():
    tips = np.array([3.0, 5.0])
    states, _, _, force = pulled_strip(40, tips, 15.0, order=lambda mesh: mesh)
    a = np.linspace(3.0, 5.0, 201)
    work = [force @ state.u.ravel() for state in states]
    assert work[1] - work[0] == pytest.approx(np.trapezoid(2.0 * edge_crack(a)**2 / E, a), rel=0.02)


def test_motion_is_differentiated_exactly_by_the_place_of_the_tip():
    step, middle = 1e-5, np.array([3.3, 4.71])
    states, *_ = pulled_strip(10, np.sort(np.concatenate([middle - step, middle, middle + step])), 15.0)
    for low, at, high in (states[:3], states[3:]):
        quotient = (high.u - low.u) / (2.0 * step)
        assert at.du[..., 0] == pytest.approx(quotient, abs=1e-5 * np.abs(quotient).max())


def williams(places, K, direction):
    """Motion of the field of a crack tip in plane stress  # (n, 2) mm; places : from the tip (doi:10.1115/1.4011454)"""
    turn = np.array([direction, [-direction[1], direction[0]]])
    x, y = turn @ places.T
    r, t = np.hypot(x, y), np.arctan2(y, x)
    kappa, factor = (3.0 - NU) / (1.0 + NU), np.sqrt(r / (2.0 * np.pi)) * (1.0 + NU) / E
    s, c = np.sin(0.5 * t), np.cos(0.5 * t)
    ux = factor * (K[0] * c * (kappa - np.cos(t)) + K[1] * s * (kappa + 2.0 + np.cos(t)))
    uy = factor * (K[0] * s * (kappa - np.cos(t)) - K[1] * c * (kappa - 2.0 + np.cos(t)))
    return np.stack([ux, uy], axis=1) @ turn


@pytest.mark.parametrize("start, end, length", [((0.0, 10.0), (15.0, 10.0), 10.0), ((0.0, 9.0), (15.0, 13.0), 9.6),
                                                ((0.0, 10.0), (15.0, 10.0), 9.45)])
def test_both_modes_come_back_from_their_field_around_a_tip(start, end, length):
    K, start, end = np.array([50.0, 20.0]), np.array(start), np.array(end)
    direction = (end - start) / np.linalg.norm(end - start)
    mesh, cut = cut_along(squares(20.0, 20.0, 20), np.array([start, end]))
    mesh = raise_order(mesh)
    tip = start + length * direction
    # of the two nodes on the mouth each moves with its own side
    centres = np.full((mesh.n_nodes, 2), np.nan)
    for block in mesh.blocks:
        middle = mesh.nodes[block.connectivity].mean(axis=1)
        for nodes in block.connectivity.T:
            centres[nodes] = middle
    outer = np.flatnonzero((np.abs(mesh.nodes - 10.0) > 10.0 - 1e-9).any(axis=1))
    nudged = mesh.nodes[outer] + 1e-9 * (centres[outer] - mesh.nodes[outer])
    motion = williams(nudged - tip, K, direction)
    dofs = (2 * outer[:, None] + np.arange(2)).ravel()
    held = Constraints(dofs, motion.ravel()[:, None], np.array([[0.0], [1.0]]))
    body, times = body_of(mesh, cut, held, Loads(), np.array([length]))
    (_, state) = march(body, PARAMS, times)
    ring = ring_around(mesh, cut, length, [np.arange(mesh.n_elements)])
    load = ring.tip_load(state.u, PLANE_STRESS, (E, NU), "plane_stress")
    assert [load.K_I, load.K_II] == pytest.approx(K, rel=0.025)
    assert load.J == pytest.approx(K @ K / E, rel=0.045)


def test_a_crack_without_length_leaves_the_body_whole():
    states, mesh, _, _ = pulled_strip(10, np.array([0.0, 3.0]), 15.0)
    assert states[0].u[:, 1] - states[0].u[:, 1].min() == pytest.approx(mesh.nodes[:, 1] / E, abs=2e-5 * 30.0 / E)
    assert np.abs(states[1].u).max() > 1.1 * np.abs(states[0].u).max()


def test_a_ring_has_no_room_at_an_edge_and_none_in_two_materials():
    _, mesh, cut, _ = pulled_strip(10, np.array([3.0]), 15.0)
    every = np.arange(mesh.n_elements)
    assert ring_around(mesh, cut, 0.7, [every]) is None
    x = np.concatenate([mesh.nodes[block.connectivity].mean(axis=1)[:, 0] for block in mesh.blocks])
    assert ring_around(mesh, cut, 4.0, [every]).radius > ring_around(mesh, cut, 4.0, [every[x < 7.0],
                                                                                     every[x > 7.0]]).radius
    assert replace(ring_around(mesh, cut, 4.0, [every])).shifted(0.1).tip == pytest.approx([4.1, 15.0])
