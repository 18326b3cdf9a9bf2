"""A pattern with detail near two pixels: frames look blurred wherever it lies between the pixels."""

import numpy as np
import pytest

from idic.diagnose import candidate_library
from idic_studies.trial.scenes.effects import EFFECTS
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.scenes.worlds import world_scene
from idic_studies.trial.tool_run import run_tool

WORLD = {"specimen": "d_shape", "columns": 160, "frames": 14, "programme": "unloading", "thickness": 2.0,
         "solid": False, "finite": False, "noise": "white"}
FINE = Paint(5, 6, dots_px=0.6, noise_gv=1.2)


def defocus_of(folder, blur):
    """The answer on images whose blur grows to this variance (px²), and the entry of defocus in it."""
    scene = world_scene(WORLD, "elastic", 1.0, NULLS["elastic"].truth)
    if blur:
        scene = EFFECTS["defocus"].change(scene, blur, np.random.default_rng(3))
    write_public(folder, scene, solve(scene), FINE)
    answer = run_tool(folder, [c for c in candidate_library() if c.name in ("defocus", "illumination")]).content
    return answer, next(entry for entry in answer["candidates"] if entry["name"] == "defocus")


@pytest.mark.slow  # 6 s of CPU time
def test_sharp_images_of_a_fine_pattern_show_no_loss_of_focus(tmp_path):
    """0.019 px² and 24 standard deviations if what the pixels take were a blur of the lens."""
    answer, entry = defocus_of(tmp_path, 0.0)
    assert answer["verdict"] == "none"
    assert abs(next(iter(entry["expected_change"].values()))) < 0.006
    assert entry["score"] < 5.0


@pytest.mark.slow  # 8 s of CPU time
def test_a_loss_of_focus_is_named_on_a_fine_pattern(tmp_path):
    answer, entry = defocus_of(tmp_path, 0.06)
    assert answer["named"] == ["defocus"]
    assert next(iter(entry["expected_change"].values())) == pytest.approx(0.06, rel=0.1)
