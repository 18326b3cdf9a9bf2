"""Shorter increments are not tried where the error by the mesh, which no standard deviation counts, is larger."""

from __future__ import annotations

from dataclasses import replace

import pytest

from idic.experiment_file import load_experiment
from idic.fe import halve, raise_order
from idic.identification import planned_increments
from idic.virtual_tests import write_volume


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_volume(tmp_path_factory.mktemp("bar") / "test", reduced=True, noise=0.0).parent


@pytest.fixture(scope="module")
def meshes(folder):
    """Of hex8, as it is and too large for a finer one, and of as many hex20."""
    small = load_experiment(folder / "experiment.toml").model.mesh
    large = halve(small).mesh
    return {"small": small, "large": large, "quadratic": raise_order(large)}


@pytest.mark.parametrize(("mesh", "law", "most"), [
    ("small", "j2_linear", 64), ("large", "j2_linear", 2), ("quadratic", "j2_linear", 64),
    ("large", "viscoplastic", 64)])
def test_the_most_increments_are_told_before_a_run(folder, meshes, mesh, law, most):
    text = (folder / "experiment.toml").read_text(encoding="utf-8")
    (folder / f"{law}.toml").write_text(text.replace('"j2_linear"', f'"{law}"'), encoding="utf-8")
    experiment = load_experiment(folder / f"{law}.toml")
    said, = planned_increments(replace(experiment, model=replace(experiment.model, mesh=meshes[mesh])))
    assert said.endswith(f"by an error estimate, {most} at most")
