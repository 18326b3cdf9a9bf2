"""The error of the model's own mesh, which no cause is blamed for: shear on the coarse mesh of the trial."""

from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose.discretisation.known_error import with_error
from idic.diagnose import identification_at, residual_evidence
from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.model import build_forward, solve
from idic.simulation_error import mesh_error, refined
from idic.simulation_error.refinement import projection
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
