"""The error of the model's own mesh, which no cause is blamed for: shear on the coarse mesh of the trial."""

from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose.discretisation.known_error import with_error
from idic.diagnose import identification_at, residual_evidence
from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.fe import halve, make_mesh, raise_order
from idic.model import Controlled, DriveTable, build_forward, solve
from idic.simulation_error import ModelPoint, mesh_error, mesh_error_in, refined
from idic.simulation_error.coarsening import coarsened
from idic.simulation_error.limits import LIMITS
from idic.simulation_error.refinement import projection
from idic.virtual_tests import write_volume
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import solve as solve_scene
from idic_studies.trial.scenes.worlds import world_scene

SHEAR = {"specimen": "shear", "columns": 166, "programme": "monotonic", "thickness": 1.5, "solid": False,
         "finite": False, "noise": "white"}


class _Edited:
    """A source that knows one experiment."""

    def __init__(self, experiment):
        self.experiment = experiment

    def with_motion_error(self, error):
        return _Edited(replace(self.experiment, motion_error=error))


def recorded(folder, null, frames, noise_gv):
    """A clean recording, rendered from a finer mesh of other elements."""
    scene = world_scene(SHEAR | {"frames": frames}, null, 1.0, NULLS[null].truth)
    stack = write_public(folder, scene, solve_scene(scene), Paint(1, 2, noise_gv=noise_gv))
    return load_experiment(folder, stack=stack)


def test_the_error_of_a_mesh_is_that_against_elements_of_a_quarter_of_its_size(tmp_path):
    experiment = recorded(tmp_path, "elastic", 2, 2.0)
    values = {f"BODY.{name}": value for name, value in NULLS["elastic"].truth.items()}
    found = identification_at(experiment, values, np.zeros((2, 1)), None)
    error, first = mesh_error(found.model_point), refined(experiment)
    second = refined(first.experiment)
    coarse, finest = (solve(build_forward(one), found.parameters) for one in (experiment, second.experiment))
    carry = second.carry @ first.carry
    known = projection(second.experiment.model.mesh, carry)(finest.u[1] - carry @ coarse.u[1])
    # corners of held edges: halving the elements takes two thirds of the error away
    assert np.linalg.norm(error.u[1] - known) < 0.5 * np.linalg.norm(known)
    # a reaction converges slower: what smaller elements still change is estimated, and a tenth of it all is left
    channel = finest.channels[1] - coarse.channels[1]
    assert np.abs(error.channels[1] - channel).max() < 0.2 * np.abs(channel).max()
    knowing = replace(found, experiment=replace(experiment, model=replace(experiment.model, motion_error=error)))
    knowing = replace(knowing, forward=build_forward(knowing.experiment))
    residual = residual_evidence(knowing)
    np.testing.assert_allclose(residual.u[0], coarse.u[1] + error.u[1], atol=1e-12)
    np.testing.assert_allclose(residual.solved_u[0], coarse.u[1], atol=1e-12)


@pytest.mark.slow
def test_rubber_in_shear_leaves_nothing_once_the_error_of_its_mesh_is_known(tmp_path):
    """By 0.006 px: with noise of 2.5 GV a tilted camera explained 6 standard deviations of it, and was named."""
    experiment = recorded(tmp_path, "rubber", 12, 0.3)
    found = identify(experiment)
    before = residual_evidence(found, light=False)
    _, there, _ = with_error(_Edited(experiment), found)
    after, grid = residual_evidence(there, light=False), grid_of(before)
    assert misfit_of(before, grid).excess_z > 10.0
    assert misfit_of(after, grid).excess_z < 4.0


# solids too large for a finer mesh ---------------------------------------------------------------------
@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    return write_volume(tmp_path_factory.mktemp("bar") / "test", reduced=True, noise=0.0).parent


@pytest.fixture(scope="module")
def elastic(bar):
    """The bar with a hole before it yields, 600 hex8."""
    text = (bar / "experiment.toml").read_text(encoding="utf-8").replace('"j2_linear"', '"elastic"')
    kept = [line for line in text.splitlines() if not line.startswith(("yield_stress", "hardening_modulus"))]
    (bar / "elastic.toml").write_text("\n".join(kept), encoding="utf-8")
    return load_experiment(bar / "elastic.toml")


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
    return np.zeros((experiment.model.n_frames, DriveTable.of(experiment).n_local))


def test_a_field_of_the_coarser_mesh_is_carried_by_its_own_functions(elastic):
    test = coarsened(elastic)
    carry, coarse, fine = test.carry(), test.experiment.model.mesh.nodes, elastic.model.mesh.nodes
    assert test.growth == pytest.approx((600 / test.experiment.model.mesh.n_elements) ** (1 / 3))
    np.testing.assert_allclose(carry.sum(axis=1), 1.0, atol=1e-12)
    slope = np.array([[1.0, 0.2, 0.0], [0.0, -0.3, 0.1], [0.4, 0.0, 1.0]])
    np.testing.assert_allclose(carry @ (coarse @ slope), fine @ slope, atol=1e-9)


def test_measured_edges_keep_the_motion_of_the_nodes_that_stay(bar):
    text = (bar / "experiment.toml").read_text(encoding="utf-8")
    head, boundaries = text.split("[[boundary]]", 1)
    channel = boundaries[boundaries.index("[[channel]]"):]
    edges = "".join(f'[[boundary]]\nnodes = "{name}"\nu = "measured"\n\n' for name in ("BOTTOM", "TOP"))
    (bar / "measured.toml").write_text(head + edges + channel, encoding="utf-8")
    experiment = load_experiment(bar / "measured.toml")
    test = coarsened(experiment)
    slope = np.array([0.01, -0.02, 0.03])

    def stretched(one):  # every measured dof moves with its place
        drives, values = DriveTable.of(one), np.zeros((one.model.n_frames, DriveTable.of(one).n_local))
        for column, drive in enumerate(drives.local):
            dof = drives.dofs[np.flatnonzero(drives.basis[:, drive])[0]]
            values[:, column] = one.model.mesh.nodes[dof // 3] @ slope + dof % 3
        return values

    np.testing.assert_allclose(test.carried_local(stretched(experiment)), stretched(test.experiment), atol=1e-12)


def test_the_change_by_a_coarser_mesh_tells_the_size_of_the_error(elastic, monkeypatch):
    """Of a cube between rigid grips, against elements of half the size, whose own error is about two fifths."""
    monkeypatch.setattr("idic.simulation_error.mesh.LIMITS", replace(LIMITS, solid=0))
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


def test_a_gauge_of_motion_reads_the_coarser_mesh_at_the_same_places(elastic, monkeypatch):
    """The mean of the nodes of a slab, of which the coarser mesh has some."""
    monkeypatch.setattr("idic.simulation_error.mesh.LIMITS", replace(LIMITS, solid=0))
    mesh = cube_of(7)
    mesh = replace(mesh, node_sets=mesh.node_sets | {"SLAB": np.flatnonzero(mesh.nodes[:, 2] < 0.5)})
    gauge = replace(elastic.model.channels[0], kind="displacement", nodes="SLAB", factor=1.0, unit="mm")
    cube = replace(elastic, model=replace(elastic.model, mesh=mesh, channels=(gauge,)))
    last = cube.model.n_frames - 1
    _, u = force_and_motion(cube)
    error = mesh_error_in(ModelPoint(cube, cube.model.parameters, local_of(cube)), np.array([0, last]),
                          [np.zeros_like(u), u])
    read = error.u[:, mesh.node_sets["SLAB"], 2].mean(axis=1)
    assert np.abs(read).max() > 0.0
    np.testing.assert_allclose(error.channels[:, 0], read, rtol=1e-9, atol=1e-15)


def test_only_linear_bricks_that_no_gauge_drives_are_made_coarser(elastic):
    gauge = Controlled("gauge_mm", np.zeros(elastic.model.n_frames), "TOP", "z")
    driven = tuple(replace(entry, drive=gauge) if entry.nodes == "TOP" and entry.component == "z" else entry
                   for entry in elastic.model.prescribed)
    assert coarsened(replace(elastic, model=replace(elastic.model, prescribed=driven))) is None
    assert coarsened(replace(elastic, model=replace(elastic.model, mesh=raise_order(elastic.model.mesh)))) is None
