"""A finished RUN as a diagnosis takes it up: the accepted point is simulated again from where its search found it."""

import shutil

import numpy as np
import pytest
from experiment_file.small_experiment import change, load_experiment, write_experiment
from material_twins import write_folder

import idic
from idic.run import BASE, RunStore, SerialRunner, group_name, open_source
from idic.run.diagnosis.source import Source
from idic.run.prepared.prepare import ingest, prepare


AS_GIVEN = {"options.element_order": "as_given"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("taken-up")
    write_folder(folder / "test", "clean_plastic", 0)  # an elastic body needs no search at all
    idic.identify(folder / "test", folder / "run")
    return folder / "run"


def solution_of(run):
    """Folder of the accepted point's displacements."""
    _, found = open_source(run)
    return next(run.glob(f"**/{group_name(found.state.accepted.number, BASE)}/u"))


@pytest.mark.slow  # an identification; every diagnosis does it
def test_the_accepted_point_is_found_again_without_a_search(run):
    _, found = open_source(run)
    stored, again = np.array(list(found.stored())), list(found.march())
    assert stored.shape == (found.experiment.model.n_frames, *found.experiment.model.mesh.nodes.shape)
    np.testing.assert_allclose([at.u for at in again], stored, atol=1e-7)  # mm
    np.testing.assert_array_equal(again[-1].steps.times, found.steps)
    cold = list(found.forward.march(found.parameters, (), found.local, found.steps))
    assert sum(at.n_newton for at in again) < sum(at.n_newton for at in cold)


@pytest.mark.slow  # shares that identification
def test_a_damaged_solution_is_not_begun_with(run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    chunk = max((p for p in solution_of(copy).rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
    chunk.write_bytes(b"\0" * chunk.stat().st_size)
    _, found = open_source(copy)
    assert found.stored is None
    np.testing.assert_allclose([at.u for at in found.march()], list(open_source(run)[1].stored()), atol=1e-7)


@pytest.mark.slow  # an identification with a free FE-DIC
def test_virtual_edges_of_a_run_keep_the_modes_that_it_measured(tmp_path):
    write_folder(tmp_path / "test", "clean", 0)
    edges = [{"nodes": name, "u": {"virtual": "dic", "modes": 1, "time_modes": 1}} for name in ("LEFT", "RIGHT")]
    idic.identify(tmp_path / "test", tmp_path / "run",
                             overrides={"boundary": edges, "options.max_iterations": 1})
    source, found = open_source(tmp_path / "run")
    for here, there in zip(source.load().model.prescribed, found.experiment.model.prescribed, strict=True):
        np.testing.assert_array_equal(here.drive.shapes, there.drive.shapes)
        np.testing.assert_array_equal(here.drive.courses, there.drive.courses)
    held = source.load({"boundary": [{"nodes": "LEFT", "ux": 0.0, "uy": 0.0}, edges[1]]})
    assert held.model.prescribed[-1].drive.shapes is not None


def test_a_folder_that_is_identified_again_is_read_again_by_workers_that_live_on(tmp_path):
    """Under the same RUN, after a change of each kind of file: a table of the experiment, the log, the mesh."""
    folder, run = write_experiment(tmp_path / "test"), tmp_path / "run"

    def read():
        shutil.rmtree(run, ignore_errors=True)
        experiment, store = load_experiment(folder, AS_GIVEN), RunStore(run)
        with store.claim(experiment.recording.identity):
            ingest(store, experiment, SerialRunner())
            prepare(str(run), str(folder), AS_GIVEN, SerialRunner())
        return Source(str(run), {}).load(), experiment

    read()
    for name, old, new in (("experiment.toml", "thickness_mm = 2.0", "thickness_mm = 4.0"),
                           ("loads.csv", "0.300", "0.400"), ("mesh.inp", "101, 0.0, 0.0", "101, 0.1, 0.0")):
        change(folder, name, old, new)
        seen, own = read()
        assert seen.model.thickness == own.model.thickness
        np.testing.assert_array_equal(seen.model.channels[0].values, own.model.channels[0].values)
        np.testing.assert_array_equal(seen.model.mesh.nodes, own.model.mesh.nodes)
