"""Bias and scatter of the routes to one answer: whole specimen with grip log, measured edge, virtual boundaries.

    python tests/twins/virtual_boundary_study.py 10 [strip] [plate]     # 10 draws of all noise; rows of the table in
    python studies/evidence/virtual_boundaries_picture.py               # docs/evidence/virtual-boundaries.md, and its
                                                                        # figure
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from reduced_domains import TRUTH, clean_images, redrawn, write_case

from idic.measure import BoundaryStart, dic_stack, with_boundary_start
from idic.experiment_file import load_experiment
from idic.identification import identify, measured_start
from idic.model import Measured, Parametrised

CASES = ("strip", "plate")
STUDIED = ("full", "full, log 1 % off", "measured", "bspline", "dic")


def begun(experiment):
    """The experiment where a run would start: virtual boundaries and measured edges from a free FE-DIC."""
    if not any(isinstance(p.drive, (Measured, Parametrised)) for p in experiment.model.prescribed):
        return experiment, None
    motion = dic_stack(experiment)
    experiment = with_boundary_start(experiment, BoundaryStart.of(experiment, motion.u_px))
    return experiment, measured_start(experiment, motion.u_px, ())


def one_draw(experiment, clean, seed: int, log_scale: float = 1.0) -> dict:
    """Values, standard deviations and iterations of one draw of all noise."""
    began = time.perf_counter()
    found = identify(*begun(redrawn(experiment, clean, seed, log_scale)))
    parameters = found.result["parameters"]
    return {"status": found.state.status, "iterations": found.state.iteration, "seconds": time.perf_counter() - began,
            "elements": experiment.model.mesh.n_elements, "free": len(experiment.model.parameters.free)} | {
        name: [parameters[f"SHEET.{name}"][key] for key in ("value", "std")] for name in TRUTH}


def study(case: str, draws: int) -> None:
    """Write a row per route of a case."""
    for route in STUDIED:
        with tempfile.TemporaryDirectory() as folder:
            clean = clean_images(case)
            experiment = load_experiment(write_case(Path(folder) / "test", case, route.partition(",")[0], clean))
            scale = 1.01 if "," in route else 1.0
            found = [one_draw(experiment, clean, seed, scale) for seed in range(draws)]
        sys.stdout.write(table_row(case, route, found))
        sys.stdout.flush()


def table_row(case: str, route: str, draws: list[dict]) -> str:
    """A Markdown row: mean error and scatter in percent, the stated standard deviation, iterations, seconds."""
    cells = [case, route, str(draws[0]["elements"]), str(draws[0]["free"])]
    for name, true in TRUTH.items():
        values, stds = 100.0 * np.array([draw[name] for draw in draws]).T / true
        error = values.mean() - 100.0
        cells.append(f"{error:+.2f} ± {values.std(ddof=1) / np.sqrt(len(draws)):.2f}")
        cells.append(f"{values.std(ddof=1):.2f} ({stds.mean():.2f})")
    cells.append(f"{np.mean([draw['iterations'] for draw in draws]):.1f}")
    cells.append(f"{np.median([draw['seconds'] for draw in draws]):.1f}")
    return "| " + " | ".join(cells) + " |\n"


if __name__ == "__main__":
    for chosen in sys.argv[2:] or CASES:
        study(chosen, int(sys.argv[1]))
