"""`idic check` says beforehand what an identification takes, and warns of what does not fit."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from fe.test_factorisation_cost import brick
from typer.testing import CliRunner

from experiment_file.small_experiment import TOML, change, load_experiment, write_experiment
from idic.cli.app import app
from idic.report.evidence.cost import Cost, memory_here, simulation_cost
from idic.report import expected_cost

BENCH = Path(__file__).parents[2] / "studies" / "bench" / "jobs"
ELASTOPLASTIC = """law = "j2_linear"
E = { value = 70, unit = "GPa", identify = true }
nu = 0.3
yield_stress = { value = 200, unit = "MPa", identify = true }
hardening_modulus = 1000"""
ELASTIC = TOML[TOML.index('law = "elastic"'):TOML.index("nu = 0.3") + len("nu = 0.3")]


@pytest.fixture
def folder(tmp_path):
    return write_experiment(tmp_path / "test")


def brick_text(n: int) -> str:
    """n x n x n hexahedra of a cube of 4 mm, held at BOTTOM, pulled at TOP, seen on FRONT."""
    size, per_row = 4.0 / n, n + 1
    at = lambda i, j, k: 1 + i + per_row * j + per_row**2 * k  # noqa: E731
    lines = ["*NODE"]
    lines += [f"{at(i, j, k)}, {i * size}, {j * size}, {k * size}" for k in range(n + 1) for j in range(n + 1)
              for i in range(n + 1)]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=SPECIMEN")
    corners = [(a, b, c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for e in range(n**3):
        i, j, k = e % n, e // n % n, e // n**2
        lines.append(", ".join(map(str, (e + 1, *(at(i + a, j + b, k + c) for a, b, c in corners)))))
    for name, j in (("BOTTOM", 0), ("TOP", n)):
        lines += [f"*NSET, NSET={name}", *(str(at(i, j, k)) for k in range(n + 1) for i in range(n + 1))]
    lines += ["*ELSET, ELSET=LAST, GENERATE", f"{n**3 - n**2 + 1}, {n**3}, 1", "*SURFACE, NAME=FRONT", "LAST, S2"]
    return "\n".join(lines) + "\n"


def as_solid(folder, n: int):
    (folder / "mesh.inp").write_text(brick_text(n))
    change(folder, "experiment.toml", '"plane_stress"\nthickness_mm = 2.0', '"solid"\nsurface = "FRONT"')
    change(folder, "experiment.toml", "uy = 0.0", "uy = 0.0\nuz = 0.0")
    return folder


def test_check_prints_memory_time_and_disk_and_does_not_warn_of_a_small_test(folder):
    answer = CliRunner().invoke(app, ["check", str(folder), "--no-picture"])
    (line,) = (line for line in answer.stdout.splitlines() if line.startswith("cost "))
    assert all(word in line for word in ("of memory", "on one core", "of disk", "within a factor of 2"))
    assert "memory than" not in answer.stdout


def test_a_model_that_does_not_fit_is_announced_with_its_remedy(folder):
    cost = replace(expected_cost(load_experiment(as_solid(folder, 16))), available=0.4e9)
    (warning,) = cost.warnings()
    assert "needs more memory than this machine has" in warning or "may need more memory" in warning
    assert f"{3 * 17**3} equations" in warning and "larger elements" in warning
    assert not replace(cost, available=64e9).warnings() and not replace(cost, available=None).warnings()


def test_a_run_longer_than_a_day_is_announced():
    cost = Cost(1e9, 1e8, 1e9, 3 * 86400.0, 1000, 16e9)
    (warning,) = cost.warnings()
    assert "about 3 days on one core" in warning and "--workers" in warning
    assert "this machine has 16 GB" in cost.line()
    assert "this machine has 25.8 GB" in replace(cost, available=24 * 2**30).line()  # not 30: it is no estimate


def test_cost_follows_what_drives_it(folder):
    """Frames, law, unknowns of measured edges: each makes the time or the memory grow."""
    elastic = expected_cost(load_experiment(folder))
    change(folder, "experiment.toml", ELASTIC, ELASTOPLASTIC)
    plastic_experiment = load_experiment(folder)
    plastic = expected_cost(plastic_experiment)
    assert plastic.time_s > elastic.time_s
    options = replace(plastic_experiment.options, substeps=50, estimator="generalised")
    dear = expected_cost(replace(plastic_experiment, options=options))
    assert dear.time_s > plastic.time_s and dear.memory > plastic.memory
    assert 1e8 < memory_here() < 1e15


@pytest.mark.slow  # a file of 20 MB: half a minute of reading
def test_check_of_a_mesh_with_a_quarter_of_a_million_nodes_warns(folder):
    """680 000 equations in space: 80 GB for the factors."""
    answer = CliRunner().invoke(app, ["check", str(as_solid(folder, 60)), "--no-picture"])
    assert answer.exit_code == 0, answer.output
    if memory_here() < 160e9:
        assert "more memory than this machine has" in answer.stdout


@pytest.mark.slow  # one identification of 22 000 equations: half a minute of processor time
def test_an_identification_takes_what_was_expected(folder, tmp_path):
    """A factor of two is what the estimate claims; another one for a machine that is busy or of another make."""
    change(folder, "experiment.toml", ELASTIC, ELASTOPLASTIC)
    change(folder, "experiment.toml", 'mesh = "mesh.inp"\nmesh_unit = "mm"',
           "mesh = { roi_px = [8, 8, 48, 40], element_px = 0.6 }")
    (folder / "experiment.toml").write_text((folder / "experiment.toml").read_text()
                                            + "[options]\nmax_iterations = 2\n")
    expected = expected_cost(load_experiment(folder, {"options.element_order": "auto"}))
    subprocess.run([sys.executable, "-c", "import sys; from idic import identify; "
                    "identify(*sys.argv[1:])", str(folder), str(tmp_path / "run")], check=True)
    spent = json.loads((tmp_path / "run" / "result.json").read_text())["cost"]
    assert 0.25 < expected.memory / (1e6 * spent["peak_rss_mb"]) < 4.0
    assert 0.25 < expected.time_s / spent["cpu_s"] < 4.0


@pytest.mark.slow  # two simulations: half a minute of processor time
def test_simulations_of_large_solids_take_what_was_expected():
    """Memory within a factor of 1.5. Time: so does its growth from 9 000 to 33 000 equations; the level is that of the
    machine."""
    ratios = []
    for n in (14, 22):
        done = subprocess.run([sys.executable, "solid_job.py", "fronts", str(n), "4"], cwd=BENCH, capture_output=True,
                              text=True, check=True)
        _, seconds, memory, _, _ = map(float, done.stdout.split())
        expected = simulation_cost(brick(n, n, n), 3, 3, 4)
        assert 1 / 1.5 < (0.35e9 + expected.factor + expected.kept_bytes) / (1e6 * memory) < 1.5
        ratios.append(expected.time_s / seconds)
    assert 1 / 1.5 < ratios[1] / ratios[0] < 1.5
    assert 0.25 < min(ratios) and max(ratios) < 4.0
