"""A cut is no spot of next to no stiffness, though such a spot explains nine tenths of it; a void is one."""

from dataclasses import replace

import numpy as np
import pytest

from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.tool_run import run_tool

LEFT_OF_A_VOID = 0.04  # of the stiffness
PLACE, RADIUS = np.array([-2.3, 1.0]), 1.1  # mm


def told(folder, change):
    """The diagnosis of a strip that is not as the user's plain model says."""
    scene = change(plain_scene("elastic", Geometry(), NULLS["elastic"].truth))
    write_public(folder, scene, solve(scene), Paint(3, 4))
    return run_tool(folder)


@pytest.mark.slow
def test_a_cut_is_unexplained_by_the_library_and_its_place_is_reported(tmp_path):
    found = told(tmp_path, lambda scene: replace(scene, slit=1.2))
    assert found.content["named"][0] == "heterogeneity"  # as nearest
    assert any(left.matters for left in found.diagnosis.remainder.local)
    assert found.content["verdict"] == "outside_library"
    assert any(text.startswith("It is no inclusion of another stiffness: 0.0") for text in found.content["cautions"])


@pytest.mark.slow
def test_a_void_is_named_with_its_place_and_size(tmp_path):
    def softer(X):
        return np.where(np.linalg.norm(X - PLACE, axis=1) < RADIUS, LEFT_OF_A_VOID, 1.0)

    found = told(tmp_path, lambda scene: replace(scene, modulus=softer))
    assert found.content["verdict"] == "single" and found.content["named"] == ["heterogeneity"]
    assert found.content["rounds"][0]["form"] == "void"
    assert not any(left.matters for left in found.diagnosis.remainder.local)
    values = found.diagnosis.state.final.fit.values
    at = np.array([values["BODY.inclusion.x"], values["BODY.inclusion.y"]])
    assert np.linalg.norm(at - PLACE) < 0.1 and abs(values["BODY.inclusion.radius"] / RADIUS - 1.0) < 0.2
