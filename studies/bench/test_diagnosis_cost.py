"""What a diagnosis costs beside the identification that it starts from, and beside another version of idic."""

import os
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
import pytest
from scipy import sparse

import idic
from idic.diagnose import Columns, null_model, score
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.run import Console, diagnose_run
from idic.virtual_tests import strip_with_hole, write_inp

pytestmark = [pytest.mark.bench, pytest.mark.slow]

# an installed idic may come first on the path
RUN_CHECKOUT = "import runpy, sys; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('idic', run_name='__main__')"


def cpu(function, *arguments, **options):
    start = time.process_time()
    return function(*arguments, **options), time.process_time() - start


def timed_by_stage(run):
    """A diagnosis, its CPU seconds, and those of its longest screening."""
    moments, stages = [time.process_time()], ["start"]

    def stage(text):
        moments.append(time.process_time())
        stages.append(text)

    content = diagnose_run(run, console=Console(stage))
    moments.append(time.process_time())
    spent = [(b - a, text) for a, b, text in zip(moments[1:-1], moments[2:], stages[1:], strict=True)]
    screenings = [seconds for seconds, text in spent if text.startswith("screening")]
    return content, moments[-1] - moments[0], max(screenings)


def test_a_diagnosis_costs_a_few_identifications(measured, tmp_path, monkeypatch):
    """Less than one for a screening of the library, less than three for the whole.

    The twin is small (16 frames of 116 x 184 px), so that building 140 models weighs more than their simulation.
    Medians of three, each beside an identification of the same minute: a shared processor is not equally fast for long.
    """
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tests" / "diagnose")
    from material_twins import write_folder

    write_folder(tmp_path / "test", "plasticity", 3)
    idic.identify(tmp_path / "test", tmp_path / "warm-up")  # compiled laws
    idic.identify(tmp_path / "test", tmp_path / "run")
    diagnose_run(tmp_path / "run")  # compiled laws of the candidates
    pairs = [(cpu(idic.identify, tmp_path / "test", tmp_path / f"run{k}")[1],
              timed_by_stage(tmp_path / "run")) for k in range(3)]
    diagnosis_cost, screening_cost = (median(diagnosed[kind] / identify_s for identify_s, diagnosed in pairs)
                                      for kind in (1, 2))
    identify_s = median(identify_s for identify_s, _ in pairs)
    measured("diagnosis of a small twin, whole library", f"{diagnosis_cost * identify_s:.1f} s",
             f"{diagnosis_cost:.1f} identifications")
    measured("one screening of the whole library", f"{screening_cost * identify_s:.1f} s",
             f"{screening_cost:.2f} identifications")
    assert all(content["named"] == ["plasticity"] for _, (content, _, _) in pairs)
    assert screening_cost < 1.0
    assert diagnosis_cost < 3.0


def test_columns_of_few_motions_cost_little_more_than_their_motions(measured, monkeypatch):
    """400 columns that are 130 motions times courses, in 29 frames at 4400 nodes, beside the same as 400 motions."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tests" / "diagnose")
    from test_evidence import made

    rng, (T, n_nodes, P, K) = np.random.default_rng(0), (29, 4400, 130, 400)
    node = np.repeat(np.arange(n_nodes), 40)
    near_node = (node + np.tile(np.arange(-20, 20), n_nodes)) % n_nodes
    pairs = sparse.csr_array((np.ones(len(node)), (node, near_node)), shape=(n_nodes, n_nodes))
    small = made(rng, n_nodes, T)
    weights, n = sparse.csr_array(sparse.kron(pairs, np.eye(2))), 2 * n_nodes
    evidence = replace(small, back=np.eye(2) + 0.01 * rng.standard_normal((T, n_nodes, 2, 2)), parts=tuple(
        replace(part, weights=weights, border=rng.standard_normal((n + 1, 6)), inner=np.eye(6) / n, inner_q=np.ones(6))
        for part in small.parts))
    columns = Columns(tuple(map(str, range(K))), rng.standard_normal((T, n, P)), rng.standard_normal((T, 1, K)))
    columns = replace(columns, courses=replace(columns.timed, motion=rng.integers(0, P, K),
                                               amplitude=rng.standard_normal((T, K))))
    null = null_model(evidence, columns.pick([0, 1]).expanded())
    score(evidence, null, columns.pick([2, 3]))  # compiles
    timed_scores, timed_s = cpu(score, evidence, null, columns)
    plain_columns, expansion_s = cpu(columns.expanded)
    plain_scores, plain_s = cpu(score, evidence, null, plain_columns)
    measured("scores of 400 columns of 130 motions", f"{timed_s:.1f} CPU s",
             f"as 400 motions {(plain_s + expansion_s) / timed_s:.1f} times as long")
    np.testing.assert_allclose(timed_scores.U, plain_scores.U, rtol=1e-9, atol=1e-9 * np.abs(plain_scores.U).max())
    assert timed_s < plain_s


def write_large(folder, monkeypatch):
    """640 x 407 px, 30 frames, 1408 elements of second order: an elastic plate with a hole and a soft spot."""
    import side_twins

    t = np.linspace(0.0, 1.0, 30)  # up, hold, down to a tenth
    course = np.interp(t, [0.0, 0.6, 0.75, 1.0], [0.0, 1.0, 1.0, 0.1])
    for name, value in {"PIXEL": 0.0165, "SHAPE": (407, 640), "ORIGIN": (319.5, 203.0), "TIMES": np.arange(30.0),
                        "GRIP": 0.12 * course}.items():
        monkeypatch.setattr(side_twins, name, value)
    toml = side_twins.TOML.replace("pixel_size_mm = 0.06", "pixel_size_mm = 0.0165").replace("[91.7, 57.4]",
                                                                                            "[319.5, 203.0]")
    spot = side_twins.Side(modulus=lambda at: 1.0 - 0.4 * np.exp(-((at - [2.5, 1.0]) ** 2).sum(axis=1) / 0.64))
    side_twins.write_folder(folder, spot, 1, toml)
    write_inp(strip_with_hole(10.0, 6.0, 1.0, "quad8", 11, 12, 8, name="BODY"), folder / "mesh.inp", "large")


def test_what_a_diagnosis_of_640_pixels_costs(measured, tmp_path, monkeypatch):
    """The goal is one identification for --quick, three for the whole and 2 CPU min (issue 23); the first two are
    missed by far: the bounds keep what has been reached. The identification is that in memory, without a report.

    The whole diagnosis runs last, so that every law is compiled.
    """
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tests" / "diagnose")
    write_large(tmp_path / "test", monkeypatch)
    idic.identify(tmp_path / "test", tmp_path / "run")  # compiles, and leaves the RUN
    diagnose_run(tmp_path / "run", quick=True)
    experiment = load_experiment(tmp_path / "test")
    first = cpu(identify, experiment)[1]
    content, quick = cpu(diagnose_run, tmp_path / "run", quick=True)
    whole_content, diagnosis_s, screening = timed_by_stage(tmp_path / "run")
    identify_s = 0.5 * (first + cpu(identify, experiment)[1])  # before and after: a shared processor changes its speed
    measured("identification in memory, 640 x 407 px, 30 frames, 1408 elements", f"{identify_s:.1f} CPU s", "1")
    measured("diagnosis of it, --quick", f"{quick:.1f} CPU s", f"{quick / identify_s:.1f} identifications")
    measured("diagnosis of it, whole", f"{diagnosis_s:.1f} CPU s", f"{diagnosis_s / identify_s:.1f} identifications")
    measured("one screening of it", f"{screening:.1f} CPU s", f"{screening / identify_s:.1f} identifications")
    assert content["named"] == whole_content["named"] == ["heterogeneity"]
    # measured 26, 44 and 11 beside other work: an eighth above. They were 16, 24 and 6.5 of an identification that took
    # 6.5 s instead of 2.7: its solver and filter became faster, the diagnosis only from 154 to 130 CPU s
    assert quick < 29.0 * identify_s
    assert diagnosis_s < 50.0 * identify_s
    assert screening < 12.5 * identify_s


def cpu_of_command(checkout, folder, *words):
    """CPU seconds of a command of idic, of the version in a checkout."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", RUN_CHECKOUT, str(checkout), *words, "--workers", "0", "--no-prefect"],
                   cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    return now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime


def write_demo(checkout, folder, monkeypatch):
    """The demo and its run, made by the version in a checkout."""
    cpu_of_command(checkout, folder, "demo", "--out", "demo")
    return "demo/experiment", "demo/run"


def write_plate(checkout, folder, monkeypatch):
    """The plate of 640 x 407 px and its run."""
    write_large(folder / "test", monkeypatch)
    cpu_of_command(checkout, folder, "identify", "test", "--out", "run", "--no-report")
    return "test", "run"


@pytest.mark.parametrize("write", [write_demo, write_plate], ids=["demo", "plate"])
def test_diagnosis_beside_another_version(measured, tmp_path, monkeypatch, write):
    """Two diagnoses by each version in turns, the second one counts: the first compiles.

    IDIC_OTHER names a checkout of the other version: git worktree add FOLDER 3c8fed03.
    """
    other = os.environ.get("IDIC_OTHER", "")
    if not (Path(other) / "idic" / "__init__.py").exists():
        pytest.skip("IDIC_OTHER names no checkout of another version")
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tests" / "diagnose")
    versions = {"this version": Path(__file__).parents[2], "the other one": Path(other).resolve()}
    for name, checkout in versions.items():
        (tmp_path / name).mkdir()
        experiment, run = write(checkout, tmp_path / name, monkeypatch)
    for _ in range(2):
        diagnosis_s = {name: cpu_of_command(checkout, tmp_path / name, "diagnose", run)
                       for name, checkout in versions.items()}
    identify_s = cpu_of_command(versions["this version"], tmp_path / "this version", "identify", experiment, "--out",
                                "again", "--no-report")
    ratio = diagnosis_s["the other one"] / diagnosis_s["this version"]
    subject = write.__name__.removeprefix("write_")
    measured(f"diagnosis of the {subject}", f"{diagnosis_s['this version']:.1f} CPU s",
             f"{diagnosis_s['this version'] / identify_s:.1f} identifications; the other version takes {ratio:.2f} "
             "times as long")
    assert ratio > 1.0
