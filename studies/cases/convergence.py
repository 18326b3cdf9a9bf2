"""The convergence study: random starts at growing distance, five schedules, three virtual tests.

Open-hole strip of metal that yields (4 parameters), bulge test of a metal strip on rubber (5), necking strip of
polycarbonate (10). A start at distance d has every parameter multiplied by d^u, u between -1 and 1, one of them at
an end of that range; all schedules have the same starts. Figures: `idic_studies.pages.convergence_page`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.virtual_tests import DemoSize
from idic_studies.cases.bulge import bulge_study
from idic_studies.cases.coverage import coverage_study
from idic_studies.cases.polycarbonate import polycarbonate_study
from idic_studies.cases.study import Case, Rendering, Study
from idic_studies.examples.bulge import RMS_UM
from idic_studies.examples.bulge_model import TRUTH as BULGE_TRUTH
from idic_studies.examples.open_hole_strip import NOISE_GV
from idic_studies.examples.polycarbonate_model import TRUTH as POLYCARBONATE_TRUTH
from idic_studies.pages.convergence_page import draw_convergence

SEED = 1944
TRIAL_STEPS = 4  # the ordinary step and steps of twice, half and four times its length
DRAWS = {"full": 20, "reduced": 6, "sketch": 1}
DISTANCE_EXPONENT = {"sheet.nu": 0.3, "strip.n": 0.5}  # of parameters with an upper bound
LARGEST_START = {"sheet.nu": 0.48, "strip.n": 0.98, "sheet.E": 396e3}  # below the upper bound


@dataclass(frozen=True)
class VirtualTest:
    """A virtual test: images, truth, noise of an image, distances of the starts, duration (s), share of the draws."""

    rendering: Rendering
    truth: Mapping[str, float]
    noise: float
    distances: tuple[float, ...]
    duration: float
    part: float = 1.0


def convergence_study(size: str) -> Study:
    """The study; "full": 20 starts per distance and schedule, "reduced": 6 (half as many of the costly strip)."""
    tests = virtual_tests()
    cases = [case for name, test in tests.items()
             for case in _cases(name, test, max(1, round(test.part * DRAWS[size])))]
    renderings = tuple(replace(test.rendering, name=name) for name, test in tests.items())
    return Study("convergence", "Success of an identification over the distance of its start", size, renderings,
                 tuple(cases), draw_convergence)


def virtual_tests() -> dict[str, VirtualTest]:
    """The three tests, in their smallest size."""
    distances = (1.5, 3.0, 6.0)
    return {
        "metal": VirtualTest(coverage_study("sketch").rendering("metal"), DemoSize.TRUTH, NOISE_GV, distances, 9.0),
        "bulge": VirtualTest(bulge_study("sketch").rendering("main"), BULGE_TRUTH, 0.003 * RMS_UM, distances, 1.0),
        "polycarbonate": VirtualTest(polycarbonate_study("sketch").rendering("main"), POLYCARBONATE_TRUTH, 0.0,
                                     (1.1, 1.3, 2.0), 200.0, 0.5),
    }


def schedules(duration: float) -> dict[str, dict[str, Any]]:
    """Options of the schedules, as ``--set`` takes them; the names are keys of stored records."""
    return {"all": {}, "spectrum": {"options.schedule": "spectrum"},
            "coarse": {"stage": [{"lowpass_px": 4.0}, {"lowpass_px": 2.0}, {"free": "all"}]},
            "beside": {"options.trial_steps": TRIAL_STEPS},
            "windows": {"stage": [{"until_s": duration / 3}, {"until_s": 2 * duration / 3}, {"free": "all"}]}}


def starts(test: VirtualTest, distance: float, draws: int) -> Iterable[dict[str, float]]:
    """Start values in the user's units, the same for every schedule."""
    rng = np.random.default_rng([SEED, round(1000 * distance)])
    for _ in range(draws):
        u = rng.uniform(-1.0, 1.0, len(test.truth))
        u /= np.abs(u).max()
        factors = [distance ** (DISTANCE_EXPONENT.get(name, 1.0) * float(u[i])) for i, name in enumerate(test.truth)]
        yield {name: float(f"{min(value * factor, LARGEST_START.get(name, np.inf)):.6g}")
               for (name, value), factor in zip(test.truth.items(), factors, strict=True)}


def _cases(name: str, test: VirtualTest, draws: int) -> Iterable[Case]:
    for distance in test.distances:
        for k, start in enumerate(starts(test, distance, draws)):
            for schedule, overrides in schedules(test.duration).items():
                yield Case(f"{name}-{schedule}/{round(100 * distance):03d}-{k:02d}", name, {**start, **overrides},
                           noise=test.noise, seed=SEED + k)
