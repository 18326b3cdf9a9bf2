"""The known error of the mesh in the parameters of a model that lacks nothing."""

from dataclasses import replace

import numpy as np
import pytest

from idic_studies.trial.scenes import recording
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import solve, true_mesh
from idic_studies.trial.scenes.worlds import world_scene
from idic_studies.trial.tool_run import run_tool

WORLD = {"specimen": "hole", "columns": 132, "frames": 16, "programme": "monotonic", "thickness": 1.5, "solid": False,
         "finite": False, "noise": "white"}


@pytest.mark.slow  # 8 s of CPU time
def test_a_coarse_mesh_that_lacks_nothing_else_says_what_it_moved(tmp_path, monkeypatch):
    """A strip of rubber with a hole and little noise; truth on another mesh."""
    monkeypatch.setattr(recording, "FORCE_NOISE", 1e-4)
    true = NULLS["rubber"].truth
    scene = world_scene(WORLD, "rubber", 1.0, true)
    scene = replace(scene, times=np.arange(5) * 1.0, grip=np.linspace(0.0, 2.0, 5))
    truth = solve(scene, true_mesh(scene, (10, 12, 8)))  # the readings of 5, 6, 4 are 1.5 standard deviations off
    write_public(tmp_path, scene, truth, Paint(1, 2, noise_gv=0.5))
    answer = run_tool(tmp_path, library=()).content
    before, after = answer["model"]["parameters_before"]["BODY.C10"], answer["model"]["parameters_of_real_body"]
    off = [abs(entry["value"] - true["C10"]) / entry["std"] for entry in (before, after["BODY.C10"])]
    assert off[1] < 1.0 and off[0] > 2.0, off
    assert any("The mesh is coarse" in caution for caution in answer["cautions"])
