"""The bulge study: the published virtual bulge test of a metal strip on rubber, with known truth.

Start values, noise, numbers of frames, wrong and equivalent laws, truth on another mesh. Figures:
`idic_studies.pages.bulge_page`. Neggers et al. (2015), section 4.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from idic_studies.pages.bulge_page import draw_bulge
from idic_studies.cases.study import Case, Rendering, Study
from idic_studies.examples.bulge import FULL_SIZE, REDUCED_SIZE, RMS_UM, Size, write_bulge_model
from idic_studies.examples.bulge_mesh import Columns
from idic_studies.examples.bulge_model import FIXED, REFERENCE_STRAIN, TRUTH

SKETCH_SIZE = Size(1.328, (60, 192), 8, Columns(12, 10, 20), 5.0, 1, 3e-4)
THICKNESS_UM = 2.0
SEED = 2014
GUESSES = (0.7, 0.8, 0.9, 1.1, 1.3, 1.5, 1.7, 2.0)
NOISES = (0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3)  # of the rms of the roughness
STARTS, START_RANGE = 20, (0.5, 3.0)
DRAW_NOISES = (0.01, 0.03, 0.1)
DRAW_START = 1.0  # start of the Monte Carlo draws over the truth: their result does not depend on it
FULL_SIZE_DRAWS = 10
N_WINDOWS = 8


@dataclass(frozen=True)
class Plan:
    """Sizes of a study: images of the single cases, images of the many cases, draws per noise level."""

    main: Size
    many: Size
    draws: int


PLANS = {"full": Plan(FULL_SIZE, REDUCED_SIZE, 100), "reduced": Plan(REDUCED_SIZE, REDUCED_SIZE, 100),
         "sketch": Plan(SKETCH_SIZE, SKETCH_SIZE, 4)}


def bulge_study(size: str) -> Study:
    """The study; "full": single cases with published images and mesh, many cases with reduced ones."""
    plan = PLANS[size]
    several = plan.main is not plan.many
    many = "many" if several else "main"
    renderings = [_rendering("main", plan.main, False), _rendering("foreign", plan.main, True)]
    if several:
        renderings.append(_rendering("many", plan.many, False))
    cases = [
        Case("reference/simulation", "main", identify=False, keep=("displacements", "sensitivities")),
        Case("from130/all", "main", scaled(1.3), keep=("displacements", "residuals", "levels")),
        Case("twin/foreign", "foreign", scaled(1.3), keep=("levels",)),
        *_windows(plan.main.frames),
        *_forms(many),
        *(Case(f"starts/{k:02d}", many, scaled(f)) for k, f in enumerate(random_factors())),
        *(Case(f"guess/{round(100 * g):03d}", "main", scaled(g)) for g in GUESSES),
        *(Case(f"noise/{1000 * r:03.0f}", "main", scaled(1.3), noise=r * RMS_UM, seed=SEED) for r in NOISES),
        *_draws("draws", DRAW_NOISES, plan.draws, many),
        *(_draws("draws-full", (0.03,), FULL_SIZE_DRAWS, "main") if several else ()),
    ]
    size_text = f"{plan.main.shape[1]} × {plan.main.shape[0]} px, {plan.main.frames} frames"
    return Study("bulge", f"Bulge test, five parameters of two materials ({size_text})", size, tuple(renderings),
                 tuple(cases), draw_bulge)


def scaled(factors: float | Iterable[float]) -> dict[str, float]:
    """Start values at `factors` times the truth (one, or one per parameter), as ``--set`` takes them."""
    factors = np.broadcast_to(np.asarray(factors, float), len(TRUTH))
    return {name: float(f"{factor * value:.6g}") for factor, (name, value) in zip(factors, TRUTH.items(), strict=True)}


def random_factors() -> np.ndarray:
    """Start values over truth, log-uniform over the range, seed 2014  # (STARTS, 5)"""
    low, high = np.log(START_RANGE)
    return np.exp(np.random.default_rng(SEED).uniform(low, high, (STARTS, len(TRUTH))))


def reference_form(factors: float = 1.3) -> tuple[dict[str, Any], dict[str, float]]:
    """Hardening law with a reference strain: overrides that start from the same K and n, and the true values."""
    start, ep0 = scaled(factors), REFERENCE_STRAIN[THICKNESS_UM]
    table = {"law": "j2_power_reference", "nu": FIXED["strip.nu"], "ep0": ep0,
             "K0": {"value": start["strip.K"] * ep0 ** start["strip.n"], "unit": "MPa", "identify": True}}
    for name, unit in (("E", "MPa"), ("yield_stress", "MPa"), ("n", "-")):
        table[name] = {"value": start[f"strip.{name}"], "unit": unit, "identify": True}
    overrides = {"material.strip": table, "elastomer.C10": start["elastomer.C10"]}
    return overrides, {"strip.K0": TRUTH["strip.K"] * ep0 ** TRUTH["strip.n"]}


def elastic_strip(factor: float = 1.3) -> dict[str, Any]:
    """Overrides of a strip that never yields: two unknowns."""
    start = scaled(factor)
    table: dict[str, Any] = {"law": "j2_power", "nu": FIXED["strip.nu"], "yield_stress": 1e9, "K": TRUTH["strip.K"],
                                "n": TRUTH["strip.n"],
                                "E": {"value": start["strip.E"], "unit": "MPa", "identify": True}}
    return {"material.strip": table, "elastomer.C10": start["elastomer.C10"]}


def _windows(n_frames: int) -> Iterable[Case]:
    """The elastic strip on the first 1/8, 2/8 ... of the frames."""
    for k in range(1, N_WINDOWS + 1):
        end = round(k * n_frames / N_WINDOWS)
        yield Case(f"window/{round(200 * k / N_WINDOWS):03d}", "main", elastic_strip(), n_frames=end + 1,
                   keep=("levels",))


def _forms(images: str) -> Iterable[Case]:
    """K and n, and K0 and n, from the same noisy images."""
    noise = 0.01 * RMS_UM
    yield Case("forms/K", images, scaled(1.3), noise=noise, seed=SEED)
    overrides, truth = reference_form()
    yield Case("forms/K0", images, overrides, truth, noise=noise, seed=SEED)


def _draws(group: str, noises: Iterable[float], number: int, images: str) -> Iterable[Case]:
    for noise in noises:
        for k in range(number):
            yield Case(f"{group}/{round(100 * noise):02d}-{k:03d}", images, scaled(DRAW_START), noise=noise * RMS_UM,
                       seed=SEED + 1 + k)


def _rendering(name: str, size: Size, foreign: bool) -> Rendering:
    def write(folder):
        return write_bulge_model(folder, size, foreign=foreign, thickness_um=THICKNESS_UM)

    return Rendering(name, write, f"bulge {size} foreign={foreign} thickness={THICKNESS_UM}")
