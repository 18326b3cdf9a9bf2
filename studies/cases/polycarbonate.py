"""The polycarbonate study: the published virtual test of a necking strip, with known truth.

Rounding to 8, 12 and 16 bits, start values of ten and of eight parameters, a staged schedule, noise, random starts,
truth with other increments and on another mesh. Figures: `idic_studies.pages.polycarbonate_page`. Neggers et al.
(2015), section 3.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from idic_studies.pages.polycarbonate_page import draw_polycarbonate
from idic_studies.cases.realisation import Disturbance
from idic_studies.cases.study import Case, Rendering, Study
from idic_studies.examples.polycarbonate import (FOREIGN_INCREMENTS_PER_STEP, FOREIGN_MESH_REFINEMENT, FULL, REDUCED,
                                              Size, necking_strip)
from idic_studies.examples.polycarbonate_model import TRUTH, Divisions
from idic.virtual_tests import write_virtual_model

SKETCH = Size(0.3724, (49, 105), 10, 5, Divisions(20, 2), 2.2)
POINT_SAMPLED = {  # the tables of docs/evidence/polycarbonate.md: computed pictures, whose pixels have no area
    "options.lowpass_px": 0.0, "options.border_px": 6, "options.edge_margin_px": 6,
}
SPLINE_FLOOR = 0.033  # GV: interpolation residual of these dots without noise and rounding, over the square root of 2
PATTERN_RMS = 122.0  # GV: unit of the published noise levels
BITS = 8
FROM_TRUTH = {"options.search": "never", "options.tolerance": 0.1}  # standard deviations
SEED = 2015
REJUVENATION = ("strip.Sa", "strip.r0", "strip.r1", "strip.r2")
KNOWN = ("strip.mu", "strip.eta0")  # locked at their true values where eight parameters are identified
GUESSES = (0.5, 0.65, 0.8, 0.9, 1.1, 1.2, 1.3, 1.5, 2.0)
NOISES = (0.0, 0.001, 0.003, 0.01, 0.03, 0.1)
STARTS, SPREAD = 10, 0.5
DRAW_NOISES = NOISES[1:]
FIXED_ROUNDING_NOISES = NOISES[1:3]  # 0.12 and 0.37 grey values: the rounding of the pattern is the same in every draw
EXPOSURE_GREY_VALUES = 0.5  # grey values: half a step of rounding
MAIN_NOISE = 0.01  # of the draws of all ten, and of those at full size
TIME_STEP_REFINEMENT = 10  # increments of the truth over those of the model, in `time`
AREA_SAMPLES = 5  # samples per pixel and direction, where pixels integrate light over their area


@dataclass(frozen=True)
class Plan:
    """Sizes of a study: images of the single cases, of the many cases, draws per noise level and at full size."""

    main: Size
    many: Size
    draws: int
    main_draws: int


PLANS = {
    "full": Plan(FULL, REDUCED, 40, 8),
    "reduced": Plan(REDUCED, REDUCED, 40, 0),
    "sketch": Plan(SKETCH, SKETCH, 2, 0),
}


def polycarbonate_study(size: str) -> Study:
    """The study; "full": single cases at the published size, many cases on 50 frames and a reduced mesh."""
    plan = PLANS[size]
    many = "main" if plan.main is plan.many else "many"
    renderings = [
        _rendering("main", plan.main),
        _rendering("steps", plan.main, steps=TIME_STEP_REFINEMENT),
        _rendering("foreign", plan.main, FOREIGN_MESH_REFINEMENT, FOREIGN_INCREMENTS_PER_STEP),
        _rendering("area", plan.many, supersampling=AREA_SAMPLES),
        *([_rendering("many", plan.many)] if many == "many" else []),
    ]
    cases = [
        Case("reference/simulation", "main", POINT_SAMPLED, identify=False, keep=("displacements", "sensitivities")),
        Case("from110/08", "main", scaled(1.1), bits=8, keep=("displacements", "residuals", "levels")),
        *(Case(f"from110/{bits:02d}", "main", scaled(1.1), bits=bits) for bits in (12, 16)),
        *(Case(f"starts/{k:02d}", many, scaled(factors), bits=BITS) for k, factors in enumerate(random_factors())),
        *_schedules(many),
        *(
            Case(f"noise/{_per_mille(part)}", many, _eight(1.1), noise=part * PATTERN_RMS, seed=SEED, bits=BITS)
            for part in NOISES
        ),
        *(Case(f"guess8/{round(100 * g):03d}", many, _eight(g), bits=BITS) for g in GUESSES),
        *(Case(f"guess10/{round(100 * g):03d}", many, scaled(g), bits=BITS) for g in GUESSES),
        Case("camera/area", "area", scaled(1.1), bits=BITS),
        Case("time/steps", "steps", scaled(1.0), bits=BITS),
        Case("twin/foreign", "foreign", scaled(1.0), bits=BITS),
        *_bounds(many),
        *(case for level in DRAW_NOISES for case in _draws("draws", level, plan.draws, many, _eight(1.0))),
        *(case for level in FIXED_ROUNDING_NOISES
          for case in _draws("draws-exposed", level, plan.draws, many, _eight(1.0), EXPOSURE_GREY_VALUES)),
        *_draws("draws-ten", MAIN_NOISE, plan.draws, many, scaled(1.0)),
        *_draws("draws-full", MAIN_NOISE, plan.main_draws, "main", scaled(1.0)),
    ]
    size_text = f"{plan.main.shape[1]} × {plan.main.shape[0]} px, {plan.main.frames} frames"
    return Study(
        "polycarbonate",
        f"Necking polycarbonate strip, ten parameters ({size_text})",
        size,
        tuple(renderings),
        tuple(cases),
        draw_polycarbonate,
    )


def scaled(factors: float | Iterable[float]) -> dict[str, Any]:
    """Start values at `factors` times the truth (one, or one per parameter), as ``--set`` takes them, and the
    options."""
    factors = np.broadcast_to(np.asarray(factors, float), len(TRUTH))
    return POINT_SAMPLED | {name: float(f"{factor * value:.6g}")
                            for factor, (name, value) in zip(factors, TRUTH.items(), strict=True)}


def random_factors() -> np.ndarray:
    """Start values over truth, uniform within 1 ± SPREAD, seed 2015  # (STARTS, 10)"""
    return np.random.default_rng(SEED).uniform(1.0 - SPREAD, 1.0 + SPREAD, (STARTS, len(TRUTH)))


def staged(rejuvenation: float, remaining: float) -> dict[str, Any]:
    """Start values and stages: the four parameters of rejuvenation, then all ten."""
    factors = [rejuvenation if name in REJUVENATION else remaining for name in TRUTH]
    return scaled(factors) | {"stage": [{"free": list(REJUVENATION)}, {"free": "all"}]}


def _schedules(images: str) -> Iterable[Case]:
    """From 130 % (published) and 200 % of the four, the others at 101 %; and from 200 % without a schedule."""
    for percent in (130, 200):
        yield Case(f"rejuvenation/{percent}-staged", images, staged(0.01 * percent, 1.01), bits=BITS)
    factors = [2.0 if name in REJUVENATION else 1.0 for name in TRUTH]
    yield Case("rejuvenation/200-at-once", images, scaled(factors), bits=BITS)


def _eight(factor: float) -> dict[str, Any]:
    locked = {name: TRUTH[name] for name in KNOWN}
    return scaled(factor) | locked | {f"material.{name}.identify": False for name in KNOWN}


def _bounds(images: str) -> Iterable[Case]:
    """Cramér-Rao bounds of eight parameters: generalised least squares on images without noise."""
    for level in DRAW_NOISES:
        total = float(np.hypot(level * PATTERN_RMS, 1.0 / np.sqrt(12.0)))
        noise_options = {"options.estimator": "generalised", "camera.noise_std_gv": total}
        yield Case(f"bound/{_per_mille(level)}", images, _eight(1.0) | FROM_TRUTH | noise_options)


def _draws(group: str, level: float, number: int, images: str, start: dict[str, Any],
           exposure: float = 0.0) -> Iterable[Case]:
    """Draws with noise of images and force, from the truth: their result does not depend on the start."""
    for k in range(number):
        yield Case(
            f"{group}/{_per_mille(level)}-{k:03d}",
            images,
            start | FROM_TRUTH,
            noise=level * PATTERN_RMS,
            seed=SEED + 1 + k,
            disturbance=Disturbance(records=True, exposure_gv=exposure),
            bits=BITS,
        )


def _per_mille(level: float) -> str:
    return f"{1000 * level:03.0f}"


def _rendering(name: str, size: Size, finer: float = 1.0, steps: int = 1, supersampling: int = 1) -> Rendering:
    def write(folder):
        return write_virtual_model(folder, necking_strip(size, finer, steps, supersampling), floor_gv=SPLINE_FLOOR)

    return Rendering(name, write, f"polycarbonate {size} finer={finer} steps={steps} supersampling={supersampling}")
