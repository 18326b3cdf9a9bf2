"""Shorter increments are not tried where the error by the mesh, which no standard deviation counts, is larger."""

from __future__ import annotations

import pytest

from idic.experiment_file import load_experiment
from idic.fe import raise_order
from idic.identification import planned_increments
from idic.virtual_tests.meshes import write_inp
from idic.virtual_tests.volume_bar import bar, write_volume

SMALL, LARGE = (3, 4, 2, 5), (10, 8, 6, 20)  # elements around the hole, ...: 500 and 8000 nodes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_volume(tmp_path_factory.mktemp("bar") / "test", reduced=True, noise=0.0).parent


@pytest.mark.parametrize(("counts", "raised", "law", "most"), [
    (SMALL, False, "j2_linear", 64), (LARGE, False, "j2_linear", 2), (LARGE, True, "j2_linear", 64),
    (LARGE, False, "viscoplastic", 64)])
def test_the_most_increments_are_told_before_a_run(folder, counts, raised, law, most):
    mesh = bar("quad4", *counts)
    write_inp(raise_order(mesh) if raised else mesh, folder / "mesh.inp", "Bar")
    path = folder / "experiment.toml"
    text = path.read_text(encoding="utf-8")
    if law == "viscoplastic":
        text = text.replace('law = "j2_linear"', 'law = "viscoplastic"')
    (folder / f"{law}.toml").write_text(text, encoding="utf-8")
    said, = planned_increments(load_experiment(folder / f"{law}.toml"))
    assert said.endswith(f"by an error estimate, {most} at most")
