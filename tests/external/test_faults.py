"""A solver that crashes, hangs or writes garbage for some parameters: rejected steps, kept folders; the run goes on."""

import threading
from pathlib import Path

import pytest
from strip import TRUTH, write_strip
from test_process import gone

import idic
from idic.errors import InputError, NotConverged
from idic.experiment_file import load_experiment
from idic.fe.external.solver import MAX_KEPT_FOLDERS, _keep
from idic.model import build_forward, solve

BETWEEN = (1600.0, 1790.0)  # MPa: the first step from 1200 goes to 1703


def misbehaving(fault, mark="", **more):
    between = " ".join(map(str, more.pop("between", BETWEEN)))
    given = {"timeout_s": 30, "retries": 0} | more
    lines = [f"{key} = {value}" for key, value in given.items()]
    return "\n".join([*lines, f'environment = {{ FAULT = "{fault}", BETWEEN = "{between}", MARK = "{mark}", '
                              f'COUNT = "{mark}" }}'])


@pytest.mark.parametrize("fault, said", [
    ("crash", r"exit code 7; its last lines: strip: E .* \| .*the strip has had enough"),
    ("signal", "killed by signal"),
    ("nan", "not finite in frame 4"), ("huge", "a displacement of"),
    ("short", r"no displacements of frame 4 \(time 4\)"), ("node", "1 of 93 nodes are missing"),
    ("chatter", "exit code 1")])
def test_every_kind_of_failure_is_not_converged_and_keeps_its_folder_with_the_reason(tmp_path, fault, said):
    folder = write_strip(tmp_path / "strip", misbehaving(fault, between=(1.0, 1e6)))
    forward = build_forward(load_experiment(folder))
    with pytest.raises(NotConverged, match=said) as caught:
        solve(forward, forward.model.parameters)
    kept = Path(str(caught.value).rpartition("kept in ")[2].rstrip(")"))
    reason = (kept / "reason.txt").read_text()
    assert reason.splitlines()[0] in str(caught.value) and "BODY.E = 1200.0" in reason
    assert (kept / "strip.deck").read_text().startswith("E 1200\nnu 2.500000000e-01\n0, 0\n1, 0.03\n")


def test_a_hanging_solver_is_ended_with_its_children(tmp_path):
    mark = str(tmp_path / "mark")
    folder = write_strip(tmp_path / "strip", misbehaving("hang", mark, between=(1.0, 1e6), timeout_s=1.5))
    forward = build_forward(load_experiment(folder))
    with pytest.raises(NotConverged, match="ended after 1.5 s"):
        solve(forward, forward.model.parameters)
    assert gone(mark)


def test_a_failure_is_tried_again_as_often_as_configured(tmp_path):
    count = tmp_path / "count"
    folder = write_strip(tmp_path / "strip", misbehaving("crash", str(count), between=(1.0, 1e6), retries=2))
    forward = build_forward(load_experiment(folder))
    with pytest.raises(NotConverged):
        solve(forward, forward.model.parameters)
    assert len(count.read_text().splitlines()) == 3


def test_a_good_run_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "tmp").mkdir()
    forward = build_forward(load_experiment(write_strip(tmp_path / "strip")))
    solution = solve(forward, forward.model.parameters)
    assert solution.u.shape == (5, 93, 2) and not list((tmp_path / "tmp").iterdir())
    assert solution.channels[-1, 0] == pytest.approx(1200.0 * 0.12 / 6.0 * 4.0 * 1.5, rel=1e-12)


@pytest.mark.parametrize("fault", ["crash", *(pytest.param(f, marks=pytest.mark.slow) for f in ("", "nan", "hang"))])
def test_the_identification_avoids_parameters_that_cannot_be_simulated(tmp_path, fault):
    folder = write_strip(tmp_path / "strip", misbehaving(fault, str(tmp_path / "mark"), timeout_s=4))
    result = idic.identify(folder, tmp_path / "run")
    assert result["status"] == "converged" and result["sensitivity"] == "perturbed"
    for name, value in (("E", TRUTH["E"] / 1e3), ("nu", TRUTH["nu"])):  # E is given in GPa
        found = result["parameters"][f"BODY.{name}"]
        assert abs(found["value"] - value) < 4.0 * found["std"]
    failed = [entry for entry in result["history"] if entry["phi"] is None]
    assert len(failed) == (1 if fault else 0)
    kept = [path.parent.name for path in (tmp_path / "run" / "scratch").glob("*/reason.txt")]
    assert bool(kept) == bool(fault) and all(name.startswith("it001") for name in kept)
    assert gone(str(tmp_path / "mark"))


def test_where_the_start_cannot_be_simulated_the_run_says_so(tmp_path):
    folder = write_strip(tmp_path / "strip", misbehaving("crash", between=(1100.0, 1300.0)))
    result = idic.identify(folder, tmp_path / "run")
    assert result["status"] == "forward_failed"
    assert "had enough" in result["history"][0]["message"]


def test_without_permission_nothing_is_started_or_written(tmp_path, monkeypatch):
    count = tmp_path / "count"
    folder = write_strip(tmp_path / "strip", misbehaving("", str(count)))
    monkeypatch.setenv("IDIC_ALLOW_EXTERNAL", "ccx")
    with pytest.raises(InputError, match="not allowed"):
        idic.identify(folder, tmp_path / "run")
    forward = build_forward(load_experiment(folder))
    with pytest.raises(InputError, match="not allowed"):
        solve(forward, forward.model.parameters)
    assert not (tmp_path / "run").exists() and not count.exists()


def test_direct_differentiation_is_refused_before_anything_is_written(tmp_path):
    folder = write_strip(tmp_path / "strip")
    with pytest.raises(InputError, match="gives no derivatives"):
        idic.identify(folder, tmp_path / "run", sensitivity="direct")
    assert not (tmp_path / "run").exists()


def test_cleaning_up_after_failed_runs_fails_none_where_others_do_it_at_the_same_time(tmp_path):
    problems = []

    def fail_often(worker):
        for k in range(100):
            folder = tmp_path / f".{worker}.{k}"
            folder.mkdir()
            try:
                _keep(folder, tmp_path / f"it{k % 3}-{worker}", "crashed", ("a",), {"E": 1.0}, 1)
            except Exception as problem:  # noqa: BLE001 - any one would end the run
                problems.append(repr(problem))

    threads = [threading.Thread(target=fail_often, args=(worker,)) for worker in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []
    folder = tmp_path / ".last"
    folder.mkdir()
    kept = _keep(folder, tmp_path / "last", "crashed", ("a",), {"E": 1.0}, 1)
    assert kept == tmp_path / "last" and "crashed" in (kept / "reason.txt").read_text()
    assert len([path for path in tmp_path.iterdir() if path.name[0] != "."]) <= MAX_KEPT_FOLDERS
