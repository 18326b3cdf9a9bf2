"""Runs of volumes: a scan is a task; two workers, and a run that was killed, end with the bits of one process."""

import pytest
from faults.fault_runs import finish, kill, plain_run, stored_system, wait_for_evaluation
from volumes.tomograms import Tomograms

from idic.run import Workplace, identify_run, read_result


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return Tomograms(n_scans=6, extra='motion = "free"\n').write(folder / "experiment")


@pytest.fixture(scope="module")
def undisturbed(scans):
    run = scans.parent / "undisturbed"
    return identify_run(scans, run), run


def check_bits(run, undisturbed):
    """Values, error bars, and the matrix and right-hand side of the last point."""
    expected, quiet = undisturbed
    parameters = read_result(run)["parameters"]
    assert parameters.keys() == expected["parameters"].keys() and len(parameters) > 2
    for name, entry in expected["parameters"].items():
        assert (parameters[name]["value"], parameters[name]["std"]) == (entry["value"], entry["std"]), name
    system = stored_system(quiet)
    assert system and stored_system(run) == system


@pytest.mark.slow
def test_two_workers_end_with_the_bits_of_one_process(scans, undisturbed, tmp_path):
    identify_run(scans, tmp_path / "run", workplace=Workplace(workers=2))
    check_bits(tmp_path / "run", undisturbed)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_a_killed_run_resumes_to_the_same_bits(scans, undisturbed, tmp_path, monkeypatch, workers):
    monkeypatch.setenv("IDIC_TEST_SCRIPTS", str(tmp_path))
    process = plain_run(scans, tmp_path / "run", workers)
    wait_for_evaluation(tmp_path / "run", process, 1)
    kill(process)
    assert not (tmp_path / "run" / "result.json").exists()
    code, said = finish(plain_run(scans, tmp_path / "run", workers))
    assert code == 0, said
    check_bits(tmp_path / "run", undisturbed)
