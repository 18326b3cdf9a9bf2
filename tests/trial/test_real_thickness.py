"""Bricks of the specimen's real thickness in the place of plane stress: a bent beam."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose.discretisation.open_thickness import open_thickness
from idic.diagnose.discretisation.thickness_error import thickness_error
from idic.diagnose.discretisation.weight import change_matters, counts
from idic.diagnose.refit import identification_at
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.experiment_file.load import load_rendered
from idic.identify.systematic.real_thickness import MIDDLE, extruded
from idic.fe.mesh.mesh import check_elements
from idic.model.experiment import Prescribed
from idic.model.forward import build_forward
from idic.validation.trial.scenes.calculix import solve_with_calculix
from idic.validation.trial.scenes.recording import Paint, write_public
from idic.validation.trial.scenes.scene import NULLS
from idic.validation.trial.scenes.solve import Motion, solve, true_mesh
from idic.validation.trial.scenes.worlds import as_solid, world_scene

BENDING = {"specimen": "bending", "columns": 146, "frames": 3, "programme": "monotonic", "thickness": 2.81,
           "solid": True, "finite": False, "noise": "white"}
needs_calculix = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")


def scene_of_world(grip=None, **changes):
    scene = world_scene(BENDING | changes, "elastic", 1.0, NULLS["elastic"].truth)
    return scene if grip is None else replace(scene, times=np.arange(len(grip)) * 1.0, grip=np.array(grip))


def at_truth(folder, scene, motion, **other):
    experiment = load_rendered(folder, write_public(folder, scene, motion, Paint(1, 2)))
    values = {f"BODY.{name}": value for name, value in (NULLS["elastic"].truth | other).items()}
    return identification_at(experiment, values, np.zeros((experiment.n_frames, 1)), None)


def test_a_bar_that_may_contract_is_in_plane_stress_whatever_its_thickness(tmp_path):
    scene = scene_of_world((0.0, 0.2))
    mesh = true_mesh(scene.geometry)
    found = at_truth(tmp_path, scene, Motion(mesh, np.zeros((2, mesh.n_nodes, 2)), np.zeros(2)))
    experiment = found.experiment
    ends = tuple(replace(entry, component="x") for entry in experiment.prescribed
                 if (entry.nodes, entry.component) in (("LEFT", "x"), ("RIGHT", "y")))
    pulled = replace(experiment, mesh=replace(experiment.mesh, node_sets={
        **experiment.mesh.node_sets, "CORNER": experiment.mesh.node_sets["LEFT"][:1]}),
        prescribed=(*ends, Prescribed("CORNER", "y", ends[0].drive)),
        channels=tuple(replace(channel, component="x") for channel in experiment.channels))
    error = thickness_error(replace(found, experiment=pulled))
    assert np.abs(error.u).max() < 1e-9
    assert np.abs(error.channels).max() < 1e-6
    assert np.abs(thickness_error(found).u).max() > 1e-3  # the same beam, bent


def test_bricks_fill_the_body():
    sheet = true_mesh(scene_of_world().geometry)
    body = extruded(sheet, 1.4)
    check_elements(body)
    np.testing.assert_allclose(body.nodes[:sheet.n_nodes, :2], sheet.nodes)
    assert set(body.nodes[:sheet.n_nodes, 2]) == {1.4}
    assert set(body.nodes[body.node_sets[MIDDLE], 2]) == {0.0}
    right = body.nodes[body.node_sets["RIGHT"]]
    assert len(right) == (np.abs(body.nodes[:, 0] - right[0, 0]) < 1e-9).sum()


@pytest.mark.slow
@needs_calculix
def test_the_error_of_plane_stress_is_that_against_bricks_of_another_program(tmp_path):
    """Small motion: finite strains change it by less than 5 %."""
    scene = scene_of_world((0.0, 0.02, 0.05))
    plane, bricks = solve(scene), solve_with_calculix(as_solid(BENDING, scene))
    found = at_truth(tmp_path, scene, plane)
    error, nodes, own = thickness_error(found), plane.mesh.nodes, found.experiment.mesh.nodes
    nearest = np.argmin(((nodes[None] - own[:, None]) ** 2).sum(axis=2), axis=1)
    same = np.linalg.norm(nodes[nearest] - own, axis=1) < 1e-6
    known = (bricks.u - plane.u)[2][nearest][same]
    assert same.sum() > 50
    assert np.linalg.norm(error.u[2][same] - known) < 0.1 * np.linalg.norm(known)
    force = bricks.force[2] - plane.force[2]
    assert abs(error.channels[2, 0] - force) < 0.2 * force


@pytest.mark.slow
def test_an_error_that_the_stiffness_takes_up_is_counted_and_said(tmp_path):
    """A strip whose motion hardly tells bricks from plane stress, and whose force follows E."""
    scene = scene_of_world((0.0, 0.02, 0.04, 0.05), specimen="hole")
    motion = solve(scene)
    found = at_truth(tmp_path / "one", scene, motion)
    residual, error = residual_evidence(found), thickness_error(found)
    said = open_thickness(found, residual)
    assert 0.0 <= said.share <= 1.0 and 0.0 < said.share_std <= 0.5
    assert -0.04 < said.moves["BODY.E"] / 2000.0 < -0.01  # bricks are stiffer by 2 %
    lateral = thickness_error(at_truth(tmp_path / "two", scene, motion, nu=0.36))
    assert not counts(residual, type(error)(lateral.u - error.u, lateral.channels - error.channels))
    nothing = type(error)(np.zeros_like(error.u), np.zeros_like(error.channels))
    old, new = (nothing.with_thickness(one) for one in (error, lateral))
    assert change_matters(residual, old, new) and not change_matters(residual, old, old)
    experiment = replace(found.experiment, motion_error=old)
    knowing = replace(found, experiment=experiment, forward=build_forward(experiment))
    assert open_thickness(knowing, residual_evidence(knowing)) is None
