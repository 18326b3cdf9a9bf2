"""Large solids: cubes of hex8, elastoplastic, four exact sensitivities; SuperLU in the same run; CalculiX on the same
mesh."""

import importlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from jobs.bench_jobs import PLASTIC, brick, stretched

from idic.fe import Section, march
from idic.laws import compile as compile_law

pytestmark = [pytest.mark.bench, pytest.mark.slow]

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}


def evaluate(solver: str, n: int, n_frames: int, n_threads: int = 1) -> tuple[int, float, float, float, float]:
    """Equations, CPU seconds, peak memory (MB), force (N) and seconds of one evaluation in a process of its own."""
    process = subprocess.run([sys.executable, "solid_job.py", solver, *map(str, (n, n_frames, n_threads))],
                             cwd=Path(__file__).with_name("jobs"), env=os.environ | ONE_THREAD, capture_output=True,
                             text=True, check=True)
    equations, *figures = process.stdout.split()
    return int(equations), *map(float, figures)


@pytest.mark.parametrize("n, gain", [(14, 1.5), (20, 3.0)])
def test_fronts_are_faster_than_superlu_and_take_less_memory(n, gain, measured):
    equations, seconds, memory, force, _ = evaluate("fronts", n, 4)
    _, superlu_s, superlu_mb, superlu_force, _ = evaluate("superlu", n, 4)
    measured(f"{equations} equations, hex8, elastoplastic, 3 frames, 4 sensitivities",
             f"{seconds:.1f} CPU s, {memory:.0f} MB",
             f"SuperLU, minimum degree {superlu_s:.1f} CPU s, {superlu_mb:.0f} MB: {superlu_s / seconds:.1f} x")
    assert force == pytest.approx(superlu_force, rel=1e-8)  # Newton's tolerance is 1e-9
    assert superlu_s > gain * seconds and memory < superlu_mb


def test_a_hundred_thousand_equations_take_thirty_frames_within_six_gigabytes(measured):
    """About ten minutes; alone:  pytest studies/bench -m bench -s -k hundred."""
    equations, seconds, memory, _, wall = evaluate("fronts", 32, 31, n_threads=2)
    measured(f"{equations} equations, hex8, elastoplastic, 30 frames, 4 sensitivities, two threads",
             f"{wall / 60:.1f} min, {seconds / 60:.1f} CPU min, {memory:.0f} MB", "goal 10 min, 6 GB on 2 cores")
    assert equations > 100_000 and memory < 6000.0


def test_a_million_equations_are_solved_within_fourteen_gigabytes(measured):
    """One elastic load step with the derivatives to E and nu, by multigrid; a factor would take some 40 GB. About four
    minutes; alone:  pytest studies/bench -m bench -s -k million."""
    equations, seconds, memory, _, wall = evaluate("elastic", 69, 2)
    measured(f"{equations} equations, hex8, elastic, one load step, 2 sensitivities, one thread",
             f"{wall / 60:.1f} min, {seconds / 60:.1f} CPU min, {memory:.0f} MB", "goal 6 min, 14 GB")
    assert equations > 990_000 and memory < 14_000.0


@pytest.mark.parametrize("n", [20, 32])
def test_multigrid_beside_factors(n, measured):
    """The same elastoplastic body by both; which one runs without being asked is decided by the size of the factor."""
    equations, seconds, memory, force, _ = evaluate("multigrid", n, 4)
    _, direct_s, direct_mb, direct_force, _ = evaluate("fronts", n, 4)
    measured(f"{equations} equations, hex8, elastoplastic, 3 frames, 4 sensitivities, multigrid",
             f"{seconds:.1f} CPU s, {memory:.0f} MB", f"factors {direct_s:.1f} CPU s, {direct_mb:.0f} MB")
    assert force == pytest.approx(direct_force, rel=1e-8) and memory < direct_mb


def deck(mesh, grip: np.ndarray, yield_stress: float) -> str:
    """The test as input of CalculiX: C3D8 are fully integrated."""
    lines = ["*NODE, NSET=ALL", *(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1)),
             "*ELEMENT, TYPE=C3D8, ELSET=BODY",
             *(", ".join(map(str, [e, *cell])) for e, cell in enumerate((mesh.blocks[0].connectivity + 1).tolist(), 1))]
    for name in ("LEFT", "RIGHT"):
        lines += [f"*NSET, NSET={name}", *(str(i + 1) for i in mesh.node_sets[name])]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", "70000, 0.3", "*PLASTIC", f"{yield_stress}, 0",
              f"{yield_stress + 1500}, 1",
              "*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY", "LEFT, 1, 3", "RIGHT, 2, 3"]
    for value in grip.tolist():
        lines += ["*STEP, NLGEOM, INC=100", "*STATIC, DIRECT", "1., 1.", "*BOUNDARY", f"RIGHT, 1, 1, {value:.15g}",
                  "*NODE PRINT, NSET=RIGHT, TOTALS=ONLY", "RF", "*NODE PRINT, NSET=ALL", "U", "*END STEP"]
    return "\n".join(lines) + "\n"


def last_state(mesh, law: str, n: int):
    """The last frame of three of a body without F-bar, its model and the CPU seconds."""
    model, _, times = stretched(mesh, "solid", float(n), 4)
    section = Section("body", compile_law(law, "finite"), mesh.element_sets["body"])
    model = replace(model, locking="none", sections=(section,))
    values = {"body": np.array([PLASTIC[name] for name in section.law.spec.parameter_names])}
    list(islice(march(model, values, times), 2))  # compiled: large meshes take other kernels
    began = os.times().user
    return list(march(model, values, times))[-1], model, os.times().user - began


@pytest.mark.parametrize("n", [12, 20])
def test_calculix_agrees_on_the_same_mesh_and_is_slower(n, tmp_path, monkeypatch, measured):
    """At 200 MPa and 1.2 %: `j2_linear` is timed; the law of CalculiX (tests/twins/cauchy_yield.py) must agree."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (Debian: apt install calculix-ccx)")
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tests" / "twins")
    importlib.import_module("cauchy_yield")
    mesh = brick(n, n, n)
    state, model, seconds = last_state(mesh, "j2_linear", n)
    state_by_its_law, _, _ = last_state(mesh, "j2_calculix", n)
    (tmp_path / "job.inp").write_text(deck(mesh, model.constraints.histories[1:, 0], PLASTIC["yield_stress"]))
    between = os.times().children_user
    subprocess.run(["ccx", "-i", "job"], cwd=tmp_path, env=os.environ | ONE_THREAD, check=True, capture_output=True)
    calculix_s = os.times().children_user - between
    text = (tmp_path / "job.dat").read_text().split("total force")[-1].splitlines()
    force = float(text[2].split()[0])
    u = np.array([line.split()[1:] for line in text[3:] if len(line.split()) == 4], dtype=float)
    off, difference = (state_by_its_law.channels[0] / force
                       - 1.0, np.abs(state_by_its_law.u - u).max() / np.abs(u).max())
    measured(f"{model.n_dof} dofs, hex8, elastoplastic, 3 frames", f"{seconds:.1f} CPU s",
             f"CalculiX {calculix_s:.1f} CPU s: {calculix_s / seconds:.1f} x; with its law the force differs by "
             f"{off:.1e}, motion by {difference:.1e} of the largest; j2_linear: {state.channels[0] / force - 1.0:.1e}, "
             f"{np.abs(state.u - u).max() / np.abs(u).max():.1e}")
    assert abs(off) < 1e-4 and difference < 1e-4
    assert calculix_s > 2.0 * seconds
