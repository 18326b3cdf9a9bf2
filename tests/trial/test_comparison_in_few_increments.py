"""A model with many increments in a frame is compared with bricks and with a finer mesh in few."""

from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose.discretisation import bricks, increments, mesh_error
from idic.diagnose import identification_at
from idic.experiment_file import load_experiment
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import Motion, true_mesh
from idic_studies.trial.scenes.worlds import world_scene

WORLD = {"specimen": "bending", "columns": 146, "frames": 4, "programme": "monotonic", "thickness": 2.81,
         "solid": True, "finite": False, "noise": "white"}
YIELDS = (0.0, 0.45, 0.9, 0.3)  # mm, loaded and unloaded


def with_increments(per_frame):
    """The end times of so many increments per frame and of half as many."""
    return np.concatenate([np.linspace(0.0, 3.0, 3 * n + 1)[1:] for n in (per_frame, per_frame // 2)])


@pytest.fixture(scope="module")
def yields(tmp_path_factory):
    folder = tmp_path_factory.mktemp("yields")
    scene = world_scene(WORLD, "plastic", 1.0, NULLS["plastic"].truth)
    scene = replace(scene, times=np.arange(4) * 1.0, grip=np.array(YIELDS))
    mesh = true_mesh(scene)
    stack = write_public(folder, scene, Motion(mesh, np.zeros((4, mesh.n_nodes, 2)), np.zeros(4)), Paint(1, 2))
    experiment = load_experiment(folder, stack=stack)
    values = {f"BODY.{name}": value for name, value in NULLS["plastic"].truth.items()}
    return identification_at(experiment, values, np.zeros((4, 1)), with_increments(16))


@pytest.mark.parametrize("compared", [bricks.thickness_error, mesh_error.motion_error], ids=["bricks", "finer mesh"])
def test_few_increments_compare_as_many_do(yields, compared, monkeypatch):
    few = compared(yields)
    monkeypatch.setattr(increments, "MAX_INCREMENTS_WITHOUT_TIME", 64)
    many = compared(yields)
    for one, other in ((few.u, many.u), (few.channels, many.channels)):
        assert np.abs(one - other).max() > 0.0
        assert np.abs(one - other).max() < 0.05 * np.abs(other).max()


@pytest.mark.parametrize("own", [2, 16])
def test_a_model_is_compared_in_one_increment_per_frame_where_it_took_more(yields, own):
    found = replace(yields, steps=with_increments(own))
    np.testing.assert_allclose(increments.compared_increments(found), [1.0, 2.0, 3.0])


@pytest.mark.parametrize("own", [None, np.arange(1.0, 4.0), np.array([1.0, 1.5, 2.0, 3.0])],
                         ids=["none known", "one per frame", "one of them cut"])
def test_a_model_with_few_increments_is_compared_in_its_own(yields, own):
    assert increments.compared_increments(replace(yields, steps=own)) is own


def test_a_law_with_time_keeps_two_simulations(yields, monkeypatch):
    monkeypatch.setattr(increments, "rate_dependent_laws", lambda experiment: ("of_time",))
    np.testing.assert_allclose(increments.compared_increments(yields), with_increments(2))
    own = with_increments(2)
    assert increments.compared_increments(replace(yields, steps=own)) is own
