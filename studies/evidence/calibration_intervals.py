"""How often intervals of 95 % of a calibration hold the truth, in six worlds.

python calibration_intervals.py [DRAWS] [WORLD]

Points of a dot target (12 x 9, 10 mm) before two cameras, 18 degrees apart, f 1800 px, 0.02 px of noise, 10 pairs.
Prints, per world, the share of all values within 1.96 standard deviations, its range over the values and its error.

Measured, first 35 draws of each: late trigger 96.3 +- 1.1 %; bent 67.3 +- 1.4 %, since every view has the bend of the
target in common, which the scatter between views does not show.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from idic.calibrate import calibrate
from idic.images import PinholeCamera, rotation_of
from idic.readers import TargetView

GRID, SPACING_MM, SIZE_PX, DISTANCE_MM = (12, 9), 10.0, (640, 480), 500.0
INDEX = np.array([(i, j) for j in range(GRID[1]) for i in range(GRID[0])])
POINTS = np.column_stack([INDEX * SPACING_MM, np.zeros(len(INDEX))])
MIDDLE = POINTS - POINTS.mean(axis=0)
TURN = rotation_of(np.array([0.0, -18.0, 0.0]))
SHIFT = np.array([0.0, 0.0, DISTANCE_MM]) - TURN @ np.array([0.0, 0.0, DISTANCE_MM])
F_PX, NOISE_PX = 1800.0, 0.02
WORLDS = ("clean", "focus", "bent", "late trigger", "few views", "blurred views")


def camera(number: int, scale: float = 1.0) -> PinholeCamera:
    place = {} if number == 0 else {"rotation": TURN, "translation_mm": SHIFT}
    return PinholeCamera(F_PX * scale, F_PX * scale, 322.0, 238.0, k1=-0.1, k2=0.0, **place)


def views(world: str, generator: np.random.Generator):
    """What both cameras see of the target in every pair."""
    rows = []
    bend_mm = 0.1 * (MIDDLE[:, 0] / MIDDLE[:, 0].max())**2 if world == "bent" else np.zeros(len(MIDDLE))
    shape = MIDDLE + np.column_stack([np.zeros((len(MIDDLE), 2)), bend_mm])
    for _ in range(4 if world == "few views" else 10):
        turn = rotation_of(generator.uniform(-1, 1, 3) * (25.0, 25.0, 8.0))
        place = np.array([*generator.uniform(-1, 1, 2) * (25.0, 18.0), DISTANCE_MM + generator.uniform(-40, 40)])
        scale = 1.0 + (0.003 * generator.uniform(-1, 1) if world in ("focus", "few views") else 0.0)
        noise = NOISE_PX * (10.0 if world == "blurred views" and generator.random() < 0.3 else 1.0)
        row = []
        for number in (0, 1):
            late = world == "late trigger" and number == 1
            moved = rotation_of(generator.normal(0, 0.02, 3)) @ turn if late else turn
            offset = generator.normal(0, 0.1, 3) if late else 0.0
            pixels = camera(number, scale).project(shape @ moved.T + place + offset)
            row.append(TargetView(INDEX, pixels + generator.normal(0, noise, pixels.shape), unique=True))
        rows.append(tuple(row))
    return tuple(rows)


def errors(result) -> np.ndarray:
    """Identified minus true values."""
    differences = []
    for name in result.rig.names:
        number, key = int(name[0]), name[2:]
        estimate, truth = result.rig.cameras[number], camera(number)
        if key.startswith("rotation"):
            turn = estimate.rotation @ truth.rotation.T
            vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
            differences.append(np.degrees(vector["xyz".index(key[-1])]))
        elif key.startswith("t_"):
            differences.append((estimate.translation_mm - truth.translation_mm)["xyz".index(key[-1])])
        else:
            differences.append(getattr(estimate, key) - getattr(truth, key))
    return np.array(differences)


def draw(world: str, seed: int):
    return calibrate(views(world, np.random.default_rng(1000 + seed)), (SIZE_PX, SIZE_PX), SPACING_MM)


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for world in sys.argv[2:] or WORLDS:
        start_s, misses, stds, n_scattered, n_shapes = time.process_time(), [], [], 0, 0
        for seed in range(draws):
            result = draw(world, seed)
            misses.append(errors(result))
            stds.append(np.sqrt(np.diag(result.rig.covariance)))
            n_scattered += result.between.all_views.is_significant
            n_shapes += result.shape.is_bent or result.shape.is_distorted
        inside = np.abs(np.array(misses)) < 1.96 * np.array(stds)
        by_value, by_draw = inside.mean(axis=0), inside.mean(axis=1)
        width = np.mean(stds, axis=0) / np.sqrt(np.mean(np.square(misses), axis=0))
        print(f"{world:14s} {inside.mean():6.1%} +- {by_draw.std(ddof=1) / np.sqrt(draws):.1%}  values "
              f"{by_value.min():.0%} to {by_value.max():.0%}  width {width.mean():.2f} ({width.min():.2f} to "
              f"{width.max():.2f})  scatter in {n_scattered}, shape in {n_shapes} of {draws}  "
              f"{(time.process_time() - start_s) / draws:.2f} s each", flush=True)


if __name__ == "__main__":
    main()
