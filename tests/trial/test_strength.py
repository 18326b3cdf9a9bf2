"""The strength of an effect: of what the user's model lacks, and nothing else that its law brings."""

import numpy as np
import pytest

from idic_studies.trial.scenes.effects import EFFECTS
from idic_studies.trial.scenes.recording import Paint
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.worlds import world_scene
from idic_studies.trial.strength import Bench

WORLD = {"specimen": "bending", "columns": 146, "frames": 6, "programme": "hold", "thickness": 2.0, "solid": False,
         "finite": False, "noise": "white"}


def test_finite_strains_are_no_strength_of_a_law_that_has_no_others(tmp_path):
    scene = world_scene(WORLD, "elastic", 1.0, NULLS["elastic"].truth)
    bench = Bench.of(scene, tmp_path, Paint(1, 2))
    creep = EFFECTS["creep"]
    seen = {a: bench.measure_effect(creep, a).seen for a in (1e-6, 0.2)}
    assert seen[1e-6] < 0.1
    assert bench.measure(creep.change(scene, 1e-6, np.random.default_rng(5))).seen > 5.0
    assert seen[0.2] == pytest.approx(30.0, rel=0.5)
