"""The error of the mesh of bricks: at a grip the strain changes within half the thickness."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from idic.diagnose.discretisation.known_error import MAX_FURTHER_SHARE, error_beside, further_share
from idic.diagnose import identification_at, residual_evidence
from idic.experiment_file import load_experiment
from idic.model import MotionError, build_forward, solve
from idic.simulation_error import brick_mesh_error, mesh_error, refined, thickness_error
from idic.simulation_error.real_thickness import thick
from idic.simulation_error.limits import NodeLimits
from idic.simulation_error.mesh import REACTION_LEFT, as_elastic, compared_frames
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import Motion, true_mesh
from idic_studies.trial.scenes.worlds import world_scene

BEAM = {"specimen": "bending", "columns": 146, "frames": 4, "programme": "monotonic", "thickness": 3.0, "solid": True,
        "finite": False, "noise": "white"}


def known(folder, null, motion=None, **changes):
    """The true parameters on the user's mesh; motion : of the recording, by the experiment, at rest by default"""
    scene = world_scene(BEAM | changes, null, 1.0, NULLS[null].truth)
    values = {f"BODY.{name}": value for name, value in NULLS[null].truth.items()}

    def at(experiment):
        return identification_at(experiment, experiment.model.parameters.as_values() | values,
                                 np.zeros((experiment.model.n_frames, 1)), None)

    def recorded(seen):
        return at(load_experiment(folder, stack=write_public(folder, scene, seen, Paint(1, 2, noise_gv=0.5))))

    mesh = refined(recorded(at_rest(scene)).experiment).experiment.model.mesh
    return recorded(Motion(mesh, *motion(recorded(at_rest(scene))))) if motion else recorded(at_rest(scene))


def at_rest(scene):
    mesh = true_mesh(scene)
    return Motion(mesh, np.zeros((len(scene.times), mesh.n_nodes, 2)), np.zeros(len(scene.times)))


def bricks(experiment, parameters):
    """Motion of the sheet's nodes, and readings  # (T, n_nodes, 2), (T, n_channels)"""
    found = solve(build_forward(thick(experiment)), parameters)
    return found.u[:, :experiment.model.mesh.n_nodes, :2], found.channels


def test_the_error_of_bricks_is_that_against_finer_ones(tmp_path):
    """Of a beam whose elements are as large as half its thickness."""
    found = known(tmp_path, "elastic")
    experiment = found.experiment
    error, twice = brick_mesh_error(found.model_point), refined(refined(experiment).experiment)
    (coarse, coarse_force), (finest, force) = (bricks(one, found.parameters) for one in (experiment, twice.experiment))
    lacks = finest[:, :experiment.model.mesh.n_nodes] - coarse
    assert np.linalg.norm(error.u - lacks) < 0.6 * np.linalg.norm(lacks)
    assert np.abs(error.channels - (force - coarse_force)).max() < 0.6 * np.abs(force - coarse_force).max()
    # and is larger than that of the sheet, which has no grip that keeps its thickness
    assert np.abs(error.channels).max() > 1.5 * np.abs(mesh_error(found.model_point).channels).max()


@pytest.mark.parametrize(("null", "share"), [("elastic", 0.1), pytest.param("plastic", 0.65, marks=pytest.mark.slow)])
def test_of_too_many_bricks_the_error_is_that_of_an_elastic_body(null, share, tmp_path, monkeypatch):
    """In proportion to the motion and to the readings: of a beam that yields, about half of it."""
    found = known(tmp_path, null, finite=True)
    whole = brick_mesh_error(found.model_point)
    reading = found.experiment.model.channels[0]
    (given,) = bricks(found.experiment, found.parameters)[1].T
    measured = replace(found.experiment, model=replace(found.experiment.model,
                                                       channels=(replace(reading, values=given),)))
    monkeypatch.setattr("idic.simulation_error.mesh.LIMITS", NodeLimits(solid_in_few_frames=0))
    elastic = brick_mesh_error(replace(found.model_point, experiment=measured))
    assert np.linalg.norm(elastic.u - whole.u) < share * np.linalg.norm(whole.u)
    assert np.abs(elastic.channels - whole.channels).max() < share * np.abs(whole.channels).max()


def test_bodies_without_a_modulus_have_no_elastic_bricks(tmp_path):
    assert as_elastic(known(tmp_path, "rubber").experiment) is None


@pytest.mark.slow
def test_the_error_of_bricks_of_rubber_is_found_in_a_few_frames(tmp_path):
    found = known(tmp_path, "rubber", frames=17)
    error = brick_mesh_error(found.model_point)
    (_, coarse), (_, finer) = (bricks(one, found.parameters)
                               for one in (found.experiment, refined(found.experiment).experiment))
    limit = (1.0 + REACTION_LEFT) * (finer - coarse)
    np.testing.assert_allclose(error.channels, limit, atol=0.02 * np.abs(limit).max())


def test_bricks_that_are_too_many_keep_the_error_of_the_sheet(tmp_path, monkeypatch):
    found = known(tmp_path, "elastic")
    monkeypatch.setattr("idic.simulation_error.mesh.LIMITS", NodeLimits(superposed=1000))
    assert brick_mesh_error(found.model_point) is None
    sheet, of_bricks = mesh_error(found.model_point), thickness_error(found.model_point)
    both = error_beside(found, of_bricks)
    np.testing.assert_allclose(both.u, sheet.u + of_bricks.u, atol=1e-12)
    assert error_beside(found, of_bricks, of_bricks).u == pytest.approx(2.0 * of_bricks.u)  # known: not found again


def test_what_finer_bricks_lack_still_is_estimated_from_the_recording(tmp_path, monkeypatch):
    """Bricks whose elements are a quarter as large as the model's made the recording: as much is lacking again."""
    monkeypatch.setattr("idic.diagnose.discretisation.known_error.MIN_FURTHER_DROP", 2.0)  # images of 146 x 36 px
    def motion(found):
        once = refined(found.experiment).experiment
        u, channels = bricks(refined(once).experiment, found.parameters)
        return u[:, :once.model.mesh.n_nodes], channels[:, 0]

    found = known(tmp_path, "elastic", motion)
    mesh, of_bricks = brick_mesh_error(found.model_point), thickness_error(found.model_point)
    error = error_beside(found, of_bricks)
    share = np.vdot(error.of_mesh.u, mesh.u) / np.vdot(mesh.u, mesh.u) - 1.0
    assert 0.7 < share < 1.3
    np.testing.assert_allclose(error.of_mesh.u, (1.0 + share) * mesh.u, atol=1e-12)
    np.testing.assert_allclose(error.of_mesh.channels, mesh.channels, atol=1e-12)  # at their limit already
    (_, own), (_, force) = (bricks(one, found.parameters) for one in (found.experiment, refined(refined(
        found.experiment).experiment).experiment))
    assert error.of_mesh.channels[-1, 0] == pytest.approx(force[-1, 0] - own[-1, 0], rel=0.2)
    motions = mesh.without_reactions(found.experiment.model.channels)

    def beside(factor):
        held = of_bricks.plus(MotionError(0.0 * mesh.u, mesh.channels))
        there = replace(found.experiment, model=replace(found.experiment.model,
                                                        motion_error=held.on_top_of(motions.scaled(factor))))
        return residual_evidence(replace(found, experiment=there, forward=build_forward(there)), light=False)

    assert further_share(beside(1.0 + share), motions) == 0.0
    assert further_share(beside(-5.0), motions) == MAX_FURTHER_SHARE
    assert further_share(beside(4.0), motions) == 0.0  # less than the finer bricks say is no error of theirs


def histories(*columns):
    model = SimpleNamespace(constraints=SimpleNamespace(histories=np.column_stack(columns)),
                            loads=SimpleNamespace(dead_histories=None))
    return compared_frames(model).tolist()


def test_frames_are_compared_where_a_motion_turns_and_in_between():
    up = np.arange(17.0)
    assert histories(up) == [0, 2, 4, 6, 8, 10, 12, 14, 16]
    there_and_back = np.concatenate([up[:8], up[7::-1]])
    assert 7 in histories(there_and_back) and histories(there_and_back)[-1] == 15
    hold = np.concatenate([up[:6], np.full(11, 5.0)])
    assert {0, 5, 16} <= set(histories(hold, np.zeros(17)))
    assert histories(np.zeros(3)) == [0, 1, 2]
