"""Large solids: cubes of hex8, elastoplastic, four exact sensitivities; SuperLU in the same run; CalculiX on the same
mesh."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_jobs import brick, stretched

from idic.fe.march import march

pytestmark = [pytest.mark.bench, pytest.mark.slow]

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}


def evaluate(solver: str, n: int, n_frames: int, n_threads: int = 1) -> tuple[int, float, float, float, float]:
    """Equations, CPU seconds, peak memory (MB), force (N) and seconds of one evaluation in a process of its own."""
    done = subprocess.run([sys.executable, "solid_job.py", solver, *map(str, (n, n_frames, n_threads))],
                          cwd=Path(__file__).parent, env=os.environ | ONE_THREAD, capture_output=True, text=True,
                          check=True)
    equations, *others = done.stdout.split()
    return int(equations), *map(float, others)


@pytest.mark.parametrize("n, gain", [(14, 1.5), (20, 3.0)])
def test_fronts_are_faster_than_superlu_and_take_less_memory(n, gain, measured):
    equations, seconds, memory, force, _ = evaluate("fronts", n, 4)
    _, before, memory_before, force_before, _ = evaluate("superlu", n, 4)
    measured(f"{equations} equations, hex8, elastoplastic, 3 frames, 4 sensitivities",
             f"{seconds:.1f} CPU s, {memory:.0f} MB",
             f"SuperLU, minimum degree {before:.1f} CPU s, {memory_before:.0f} MB: {before / seconds:.1f} x")
    assert force == pytest.approx(force_before, rel=1e-8)  # Newton's tolerance is 1e-9
    assert before > gain * seconds and memory < memory_before


def test_a_hundred_thousand_equations_take_thirty_frames_within_six_gigabytes(measured):
    """About ten minutes; alone:  pytest tests/bench -m bench -s -k hundred."""
    equations, seconds, memory, _, wall = evaluate("fronts", 32, 31, n_threads=2)
    measured(f"{equations} equations, hex8, elastoplastic, 30 frames, 4 sensitivities, two threads",
             f"{wall / 60:.1f} min, {seconds / 60:.1f} CPU min, {memory:.0f} MB", "goal 10 min, 6 GB on 2 cores")
    assert equations > 100_000 and memory < 6000.0


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


def test_calculix_agrees_on_the_same_mesh_and_is_slower(tmp_path, measured):
    """At a yield stress of 10 MPa: idic's is a Kirchhoff stress, CalculiX's a Cauchy stress; they differ by elastic
    dilatation."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (Debian: apt install calculix-ccx)")
    n, yield_stress = 16, 10.0
    mesh = brick(n, n, n)
    model, values, times = stretched(mesh, "solid", float(n), 4)
    histories = 0.05 * model.constraints.histories
    model = replace(model, locking="none", constraints=replace(model.constraints, histories=histories))
    values = {name: np.where(v == 200.0, yield_stress, v) for name, v in values.items()}
    list(march(*stretched(brick(2, 2, 2), "solid", 2.0, 3)))  # compiled
    began = os.times()
    own = list(march(model, values, times))[-1]
    between = os.times()
    (tmp_path / "job.inp").write_text(deck(mesh, histories[1:, 0], yield_stress))
    subprocess.run(["ccx", "-i", "job"], cwd=tmp_path, env=os.environ | ONE_THREAD, check=True, capture_output=True)
    end = os.times()
    seconds, theirs = between.user - began.user, end.children_user - between.children_user
    text = (tmp_path / "job.dat").read_text().split("total force")[-1].splitlines()
    force = float(text[2].split()[0])
    u = np.array([line.split()[1:] for line in text[3:] if len(line.split()) == 4], dtype=float)
    difference = np.abs(own.u - u).max() / np.abs(u).max()
    measured(f"{model.n_dof} dofs, hex8, elastoplastic, 3 frames", f"{seconds:.1f} CPU s",
             f"CalculiX 2.20 {theirs:.1f} CPU s: {theirs / seconds:.1f} x; force differs by "
             f"{own.channels[0] / force - 1:.1e}, motion by {difference:.1e} of the largest")
    assert own.channels[0] == pytest.approx(force, rel=1e-4) and difference < 1e-4
    assert theirs > 2.0 * seconds
