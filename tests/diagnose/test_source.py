"""A finished RUN as a diagnosis takes it up: the accepted point is simulated again from where its search found it."""

import shutil

import numpy as np
import pytest
from material_twins import write_folder

import idic
from idic.run.diagnosis.source import open_source
from idic.store.layout import BASE, group_name


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("taken-up")
    write_folder(folder / "test", "clean", 0)
    idic.identify_experiment(folder / "test", folder / "run")
    return folder / "run"


def solution_of(run):
    """Folder of the accepted point's displacements."""
    _, found = open_source(run)
    return next(run.glob(f"**/{group_name(found.state.accepted.number, BASE)}/u"))


def test_the_accepted_point_is_found_again_without_a_search(run):
    _, found = open_source(run)
    stored, again = np.array(list(found.stored())), list(found.march())
    assert stored.shape == (found.experiment.n_frames, *found.experiment.mesh.nodes.shape)
    np.testing.assert_allclose([at.u for at in again], stored, atol=1e-7)  # mm
    np.testing.assert_array_equal(again[-1].steps.times, found.steps)
    cold = list(found.forward.march(found.parameters, (), found.local, found.steps))
    assert sum(at.n_newton for at in again) < sum(at.n_newton for at in cold)


def test_a_damaged_solution_is_not_begun_with(run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    chunk = max((p for p in solution_of(copy).rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
    chunk.write_bytes(b"\0" * chunk.stat().st_size)
    _, found = open_source(copy)
    assert found.stored is None
    np.testing.assert_allclose([at.u for at in found.march()], list(open_source(run)[1].stored()), atol=1e-7)
