"""What the noise of scans does to a search: rejected trials, and the objective against its two parts.

python studies/evidence/volumes/noisy_search.py OUT [SEEDS]

The bar of scale.py: 64 voxels, four scans, noise of a quarter of the contrast, 5 cubed hex8; four starts. Prints per
search evaluations and rejected trials, and how the objective changed over the accepted steps that began within three
standard deviations of the root (D below 9), in parentheses what b makes of it; one increment per frame.

Measured, three seeds, 12 searches: no rejected trial in 106 evaluations; 27 in 126 where a trial of higher objective
was accepted only when D halves. Between E, nu = 1493 MPa, 0.349 and 1500 MPa, 0.351 at seed 0 the objective changes by
-46.3, the expected noise that the spline passes by -45.6 (`ResidualMap.noise_gain`), 2 by the slopes.
At 256 voxels and eight scans (`scale.write(OUT, 256, 8, 10)`, noise of an eighth of the contrast, in memory) the third
to fifth step change an objective of 8.2e7 by +7322, +631, +40, where b predicts -2880, -8.9, -0.04.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import scale

from idic.experiment_file import load_experiment
from idic.identification import Evaluation, evaluate_at, identify, scaled_system
from idic.model import Experiment

SIDE, SCANS, ELEMENTS, NOISE_GV, NEAR = 64, 4, 5, 8.0, 9.0
STARTS = ((1350.0, 0.32, 33.0, 70.0), (1650.0, 0.38, 27.0, 95.0), (1400.0, 0.37, 32.0, 60.0),
          (1600.0, 0.33, 28.0, 90.0))


def written(folder: Path, seed: int) -> Experiment:
    """The bar in scans of one seed, its noise stated."""
    scale.NOISE_GV = NOISE_GV
    scale.write(folder, SIDE, SCANS, ELEMENTS, seed)
    file = folder / "experiment.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("[scanner]\n", f"[scanner]\nnoise_std_gv = {NOISE_GV}\n"), encoding="utf-8")
    return load_experiment(folder)


def last_steps(experiment: Experiment, history: list[dict], noise: float) -> list[tuple[float, float]]:
    """Change of the objective and of the function of which b is the slope, over steps near the root."""
    local = np.zeros((experiment.model.n_frames, 0))

    def at(values: dict[str, float]) -> tuple[Evaluation, np.ndarray, np.ndarray, np.ndarray]:
        point, parameters = evaluate_at(experiment, values, local)[0], experiment.model.parameters.with_values(values)
        scaled = scaled_system(point.system, parameters, point.reference_gram, noise)
        return point, parameters.pack(), scaled.b, scaled.M

    changes = []
    accepted = [entry["values"] for entry in history if entry["accepted"]]
    for here, there in pairwise(accepted):
        (first, x, b, M), (second, y, slope, _) = at(here), at(there)
        if b @ np.linalg.solve(M, b) < NEAR and not np.array_equal(x, y):
            changes.append((second.system.phi - first.system.phi, -float((y - x) @ (b + slope))))
    return changes


def main() -> None:
    out, seeds = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 3
    evaluations = rejected = 0
    for seed in range(seeds):
        experiment = written(out / str(seed), seed)
        parameters = experiment.model.parameters
        for start in STARTS:
            values = {name: value * parameters[name].factor for name, value in zip(parameters.free, start, strict=True)}
            model = replace(experiment.model, parameters=parameters.with_starts(values))
            end = identify(replace(experiment, model=model))
            refused = sum(not entry["accepted"] and not entry["passed_over"] for entry in end.state.history)
            evaluations, rejected = evaluations + end.state.evaluations, rejected + refused
            steps = " ".join(f"{phi:+.1f} ({slope:+.1f})"
                             for phi, slope in last_steps(experiment, list(end.state.history), end.weights.image_noise))
            print(f"seed {seed}, start {start}: {end.state.status}, {end.state.evaluations} evaluations, {refused} "
                  f"rejected; objective (by b): {steps}", flush=True)
    print(f"{rejected} of {evaluations} trials rejected")


if __name__ == "__main__":
    main()
