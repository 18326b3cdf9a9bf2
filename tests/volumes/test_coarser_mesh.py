"""The error by the mesh of a solid too large for a finer one, from its change by a coarser one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from idic.experiment_file import load_experiment
from idic.fe import halve, make_mesh, raise_order
from idic.model import build_drives, build_forward
from idic.simulation_error import ModelPoint, can_be_compared, mesh_error_in
from idic.simulation_error.coarsening import coarsened
from idic.simulation_error.limits import LIMITS, NodeLimits
from idic.virtual_tests import write_volume


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_volume(tmp_path_factory.mktemp("bar") / "test", reduced=True, noise=0.0).parent


@pytest.fixture(scope="module")
def elastic(folder):
    """The bar with a hole before it yields, 600 hex8."""
    text = (folder / "experiment.toml").read_text(encoding="utf-8").replace('"j2_linear"', '"elastic"')
    kept = [line for line in text.splitlines() if not line.startswith(("yield_stress", "hardening_modulus"))]
    (folder / "elastic.toml").write_text("\n".join(kept), encoding="utf-8")
    return load_experiment(folder / "elastic.toml")


def force_and_motion(experiment):
    last = list(build_forward(experiment).march(experiment.model.parameters, (), local_of(experiment)))[-1]
    return float(last.channels[0]), last.u


def cube_of(n):
    """n cubed hex8, 1 mm wide, with the sets of the bar."""
    z, y, x = (part.ravel() for part in np.indices((n + 1,) * 3))
    first = (x + (n + 1) * (y + (n + 1) * z))[(x < n) & (y < n) & (z < n)]
    corners = np.array([0, 1, n + 2, n + 1])
    cells = first[:, None] + np.concatenate([corners, corners + (n + 1) ** 2])
    return make_mesh(np.column_stack([x, y, z]) / n, [("hex8", cells)], element_sets={"BODY": np.arange(n**3)},
                     node_sets={"BOTTOM": np.flatnonzero(z == 0), "TOP": np.flatnonzero(z == n)})


def local_of(experiment):
    return np.zeros((experiment.model.n_frames, build_drives(experiment).n_local))


def test_a_field_of_the_coarser_mesh_is_carried_by_its_own_functions(elastic):
    test = coarsened(elastic)
    carry, coarse, fine = test.carry(), test.experiment.model.mesh.nodes, elastic.model.mesh.nodes
    assert test.growth == pytest.approx((600 / test.experiment.model.mesh.n_elements) ** (1 / 3))
    np.testing.assert_allclose(carry.sum(axis=1), 1.0, atol=1e-12)
    slope = np.array([[1.0, 0.2, 0.0], [0.0, -0.3, 0.1], [0.4, 0.0, 1.0]])
    np.testing.assert_allclose(carry @ (coarse @ slope), fine @ slope, atol=1e-9)


def test_measured_edges_keep_the_motion_of_the_nodes_that_stay(folder):
    text = (folder / "experiment.toml").read_text(encoding="utf-8")
    head, boundaries = text.split("[[boundary]]", 1)
    channel = boundaries[boundaries.index("[[channel]]"):]
    edges = "".join(f'[[boundary]]\nnodes = "{name}"\nu = "measured"\n\n' for name in ("BOTTOM", "TOP"))
    (folder / "measured.toml").write_text(head + edges + channel, encoding="utf-8")
    experiment = load_experiment(folder / "measured.toml")
    test = coarsened(experiment)
    slope = np.array([0.01, -0.02, 0.03])

    def stretched(one):  # every measured dof moves with its place
        drives, values = build_drives(one), np.zeros((one.model.n_frames, build_drives(one).n_local))
        for column, drive in enumerate(drives.local):
            dof = drives.dofs[np.flatnonzero(drives.basis[:, drive])[0]]
            values[:, column] = one.model.mesh.nodes[dof // 3] @ slope + dof % 3
        return values

    np.testing.assert_allclose(test.carried_local(stretched(experiment)), stretched(test.experiment), atol=1e-12)


def test_the_change_by_a_coarser_mesh_tells_the_size_of_the_error(elastic, monkeypatch):
    """Of a cube between rigid grips, against elements of half the size, whose own error is about two fifths."""
    monkeypatch.setattr("idic.simulation_error.mesh.LIMITS", NodeLimits(solid=0))
    cube = replace(elastic, model=replace(elastic.model, mesh=cube_of(8)))
    last = cube.model.n_frames - 1
    force, u = force_and_motion(cube)
    point = ModelPoint(cube, cube.model.parameters, local_of(cube))
    error = mesh_error_in(point, np.array([0, last]), [np.zeros_like(u), u])
    finer = halve(cube.model.mesh)
    fine_force, fine_u = force_and_motion(replace(cube, model=replace(cube.model, mesh=finer.mesh)))
    assert 1.0 < error.channels[-1, 0] / (fine_force - force) < 2.5
    # the nodes of hex8 move better than what lies between them, which counts too
    assert 1.0 < np.linalg.norm(error.u[-1]) / np.linalg.norm(fine_u[:len(u)] - u) < 5.0


def test_only_linear_bricks_are_made_coarser(elastic):
    large = halve(halve(elastic.model.mesh).mesh).mesh
    assert 4 * large.n_nodes > LIMITS.solid
    assert can_be_compared(replace(elastic.model, mesh=large))
    assert not can_be_compared(replace(elastic.model, mesh=raise_order(large)))
