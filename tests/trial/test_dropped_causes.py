"""Causes of drawn worlds that were clear on the other copy of the recording, and were dropped by a rule."""

import numpy as np
import pytest

from idic.diagnose.screen.candidate import candidates
from idic.validation.trial.scenes.effects import EFFECTS
from idic.validation.trial.scenes.recording import Paint, write_public
from idic.validation.trial.scenes.scene import NULLS
from idic.validation.trial.scenes.solve import solve
from idic.validation.trial.scenes.worlds import world_scene
from idic.validation.trial.tool_run import run_tool

WORLD = {"specimen": "d_shape", "columns": 160, "frames": 14, "programme": "unloading", "thickness": 2.0,
         "solid": False, "finite": False, "noise": "white"}


def told(folder, world, effect, amplitude, library):
    """The answer for a recording of an elastic test with one effect."""
    plain = world_scene(WORLD | world, "elastic", 1.0, NULLS["elastic"].truth)
    scene = EFFECTS[effect].change(plain, amplitude, np.random.default_rng(3))
    write_public(folder, scene, solve(scene), Paint(5, 6))
    return run_tool(folder, [c for c in candidates() if c.name in library]).content


@pytest.mark.slow  # 12 s of CPU time
def test_a_blur_that_moves_nothing_is_named(tmp_path):
    """It explained 2458 of chi-square on the other copy; on blocks, which see motions and readings, it was worse."""
    answer = told(tmp_path, {}, "defocus", 0.033, ("defocus", "illumination", "heterogeneity", "grip_rotation"))
    assert (answer["verdict"], answer["named"]) == ("single", ["defocus"])


@pytest.mark.slow  # 20 s of CPU time
def test_a_cause_that_the_parameters_imitate_is_searched_in_units_of_its_size(tmp_path):
    """Warmth between grips that the force shows as another stiffness: its search stopped short, in units of 1e-4."""
    answer = told(tmp_path, {"specimen": "two_holes", "frames": 20, "programme": "monotonic"}, "thermal_expansion",
                  -0.3, ("thermal_expansion", "force_drift", "grip_slip"))
    assert "thermal_expansion" in answer["named"]
    truth = NULLS["elastic"].truth["E"]
    before, after = (answer["model"][f"parameters_{when}"]["BODY.E"] for when in ("before", "after"))
    assert abs(before["value"] - truth) > 20.0 * before["std"]
    assert abs(after["value"] - truth) < 3.0 * after["std"] < 0.1 * truth
