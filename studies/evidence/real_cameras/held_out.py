"""Held-out frames: residuals of a fit without them.

    python studies/evidence/real_cameras/held_out.py EXPERIMENT FRAME [FRAME ...] [--set key=value ...]

FRAME counts from 0. The table gives the residual (rms, grey values) of every frame: of the free FE-DIC, of the fit to
all frames, of the fit without the held-out ones. Edges are measured in every frame from its own image in all three.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from idic import load_experiment
from idic.measure import Regularisation, dic_stack
from idic.identification import Evaluation, evaluate_at, identify, measured_start
from idic.model import Experiment, Noise


def residuals(point: Evaluation, n_frames: int) -> np.ndarray:
    """Root mean square of every frame  # (n_frames,) GV, NaN where it took no part"""
    rms = np.full(n_frames, np.nan)
    for record in point.system.frames:
        rms[record.frame] = np.sqrt(record.rr / max(record.n_pixels, 1))
    return rms


def judged(experiment: Experiment, withheld: tuple[int, ...]) -> tuple[np.ndarray, list[dict]]:
    """Residuals (n_frames, 3) of free FE-DIC, fit to all, fit without `withheld`; and the two fits' results."""
    free_dic = dic_stack(experiment, Regularisation.smooth())
    excluded = [k for k, status in enumerate(free_dic.status) if status != "ok"]
    if experiment.recording.noise.std_gv is None:
        experiment = replace(experiment, recording=replace(experiment.recording,
                                                           noise=Noise(free_dic.noise_gv, "residual_of_free_dic")))
    local = measured_start(experiment, free_dic.u_px, excluded)
    experiment = replace(experiment, recording=replace(experiment.recording, excluded=tuple(excluded)))
    full_fit = identify(experiment, local)
    shorter = replace(experiment, recording=replace(experiment.recording, excluded=(*excluded, *withheld)))
    values = full_fit.state.accepted.values
    partial_fit = identify(shorter.with_parameters(experiment.model.parameters.with_values(values)), local)
    evaluated, _ = evaluate_at(experiment, partial_fit.state.accepted.values, full_fit.local)
    n = experiment.model.n_frames
    return (np.stack([free_dic.rms_gv, residuals(full_fit.point, n), residuals(evaluated, n)], axis=1),
            [full_fit.result, partial_fit.result])


def main() -> None:
    arguments, settings = sys.argv[1:], {}
    while "--set" in arguments:
        at = arguments.index("--set")
        key, _, value = arguments[at + 1].partition("=")
        settings[key] = value
        del arguments[at:at + 2]
    experiment, withheld = load_experiment(arguments[0], settings), tuple(int(k) for k in arguments[1:])
    residual_rows, results = judged(experiment, withheld)
    lines = ["| image | free FE-DIC | fit to all | fit without |", "| --- " * 4 + "|"]
    for k, row in enumerate(residual_rows):
        if np.isfinite(row[1]):
            star = " (held out)" if k in withheld else ""
            lines.append(f"| {experiment.recording.labels[k]}{star} | " + " | ".join(f"{value:.3f}"
                                                                                     for value in row) + " |")
    for title, result in zip(("all frames", "without"), results, strict=True):
        values = {name: (entry["value"], entry["std"]) for name, entry in result["parameters"].items()
                  if entry["free"] and entry["std"] is not None}
        values |= {name: (entry["value"], entry["std"]) for name, entry in result["derived"].items()}
        lines.append(f"{title}: " + ", ".join(f"{name} {v:.4g} ± {std:.2g}" for name, (v, std) in values.items()))
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
