"""One evaluation of a large solid with its sensitivities, in a process of its own: ``python solid_job.py SOLVER N
FRAMES [THREADS]``.

SOLVER : "fronts", "multigrid", "superlu" for minimum degree with a new factorisation per Newton iteration, or "elastic"
for idic's choice, an elastic body and two sensitivities. Standard error: a line
per frame. Standard output: equations, CPU seconds, peak memory in MB, the last force in N, and seconds of the wall
clock.
"""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import replace

import numpy as np
from bench_jobs import PLASTIC, brick, directions, stretched
from scipy.sparse.linalg import splu

from idic.fe import Section, march, solver_threads
from idic.fe.solver import linear
from idic.laws import compile as compile_law
from idic.run import peak_memory_mb


def minimum_degree(pattern: linear.Pattern, values: np.ndarray) -> linear.Factor:
    """LU by SuperLU, numbered by minimum degree on A^T + A."""
    return linear.Factor(pattern, splu(pattern.matrix(values), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01,
                                       options={"SymmetricMode": True}))


def problem(solver: str, n: int, n_frames: int) -> tuple:
    """What `march` takes."""
    model, values, times = stretched(brick(n, n, n), "solid", float(n), n_frames)
    if solver != "elastic":
        return model, values, times, directions(4)
    section = Section("body", compile_law("elastic", "small"), model.mesh.element_sets["body"])
    model = replace(model, sections=(section,), locking="none")
    return model, {"body": np.array([PLASTIC["E"], PLASTIC["nu"]])}, times, directions(2)


def peak_mb() -> float:
    return peak_memory_mb(children=False)


def main(solver: str, n: int, n_frames: int, n_threads: int = 1) -> str:
    if solver == "superlu":
        linear._sparse_factor, linear.MIN_OPERATIONS_PER_ENTRY = minimum_degree, np.inf
    if solver in ("fronts", "multigrid"):
        linear.MAX_FACTOR_ENTRIES = np.inf if solver == "fronts" else 0.0
    list(march(*problem(solver, 12, 2)))  # compiled
    model, values, times, unknowns = problem(solver, n, n_frames)
    equations = model.n_dof - len(model.constraints.dofs)
    began, wall = time.process_time(), time.perf_counter()
    with solver_threads(n_threads):
        for state in march(model, values, times, unknowns):
            spent = resource.getrusage(resource.RUSAGE_SELF)
            sys.stderr.write(f"{equations} equations, frame {state.frame} of {n_frames - 1}: {state.n_newton} Newton "
                             f"iterations, {time.perf_counter() - wall:.1f} s, CPU {time.process_time() - began:.1f} s "
                             f"(process: user {spent.ru_utime:.0f}, system {spent.ru_stime:.0f} s), peak "
                             f"{peak_mb():.0f} MB, force {state.channels[0]:.9e} N\n")
            sys.stderr.flush()
    seconds, wall = time.process_time() - began, time.perf_counter() - wall
    return f"{equations} {seconds:.1f} {peak_mb():.0f} {state.channels[0]:.9e} {wall:.1f}"


if __name__ == "__main__":
    sys.stdout.write(main(sys.argv[1], *map(int, sys.argv[2:])))
