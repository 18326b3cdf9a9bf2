"""The coverage study: error bars against the scatter of hundreds of draws, each with its own noise on every record.

An open-hole strip of metal that yields, four parameters, driven by the logged grip; the same strip of a polymer, two
parameters, driven by the log, by measured edges or by virtual boundaries. Noise: images with the reference, logged
grip, force, gain and offset of every frame. Estimators: ordinary and generalised least squares. The truth is computed
on the user's mesh, so noise is the only error; groups `foreign`: on a finer one. Images are not quantised. Figures:
`idic_studies.pages.coverage_page`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from idic.images import ArrayStack
from idic.virtual_tests import DemoSize, VirtualTest
from idic_studies.cases.realisation import Disturbance
from idic_studies.cases.study import Case, Rendering, Study
from idic_studies.examples.open_hole_strip import NOISE_GV, POLYMER_TABLE, metal, polymer, write_clean
from idic_studies.pages.coverage_page import draw_coverage

SAME = DemoSize(0.2, (100, 152), (3, 3, 4), (2, 3, 1), (2, 3, 1), 1)
FOREIGN = replace(SAME, true=(5, 7, 3))
DISTURBANCE = Disturbance(records=True, gain=0.02, offset_gv=1.0)
SEED = 20260
DRAWS = {"full": 1000, "reduced": 200, "sketch": 3}
DRAWS_OF_A_WORLD = {"full": 300, "reduced": 40, "sketch": 2}
ESTIMATORS = ("ordinary", "generalised")
EDGES = ("LEFT", "RIGHT")
ON_POLYMER = {"material": {"sheet": POLYMER_TABLE}}
ROUTES = {  # starts at the truth: the result of a draw does not depend on it
    "grips": dict(DemoSize.TRUTH),
    "polymer": ON_POLYMER,
    "measured": ON_POLYMER | {"boundary": [{"nodes": edge, "ux": "measured", "uy": "measured"} for edge in EDGES]},
    "virtual": ON_POLYMER | {"boundary": [{"nodes": edge, "u": {"virtual": "bspline", "modes": 3, "time_modes": 2}}
                                          for edge in EDGES]},
}
IMAGES = {"grips": "metal", "polymer": "polymer", "measured": "polymer", "virtual": "polymer"}
WORLDS: dict[str, dict[str, Any]] = {  # noise that the identification is not told of: what is added to `DISTURBANCE`;
    # fields: what a subset DIC has measured in the images
    "blurred": {"sensor": "blurred"}, "jpeg": {"sensor": "jpeg"}, "bayer": {"sensor": "bayer"},
    "grey_level": {"sensor": "grey_level"}, "understated": {"stated": 0.8},
    "drifting_force": {"channel_correlation": 0.9},
    "fields": {"subsets": (8, 8)}}
FOREIGN_GROUPS = {"foreign": ("foreign", "grips"), "foreign_measured": ("polymer_foreign", "measured"),
                  "foreign_virtual": ("polymer_foreign", "virtual")}


@dataclass(frozen=True)
class _Group:
    name: str
    images: str
    route: str
    estimator: str
    disturbance: Disturbance = DISTURBANCE


def coverage_study(size: str) -> Study:
    """The study; "full": 1000 draws of every combination and 300 of every world, "reduced": 200 and 40."""
    groups = [_Group(f"{route}-{estimator}", IMAGES[route], route, estimator) for route in ROUTES
              for estimator in ESTIMATORS]
    groups += [_Group(f"{name}-{estimator}", images, route, estimator)
               for name, (images, route) in FOREIGN_GROUPS.items() for estimator in ESTIMATORS]
    worlds = [_Group(f"{world}_{route}-ordinary", IMAGES[route], route, "ordinary", replace(DISTURBANCE, **more))
              for world, more in WORLDS.items() for route in ("grips", "polymer")]
    cases = [*_bounds(), *(case for group in groups for case in _draws(group, DRAWS[size])),
             *(case for group in worlds for case in _draws(group, DRAWS_OF_A_WORLD[size]))]
    renderings = (_rendering("metal", metal, SAME), _rendering("polymer", polymer, SAME),
                  _rendering("foreign", metal, FOREIGN), _rendering("polymer_foreign", polymer, FOREIGN))
    return Study("coverage", "Coverage of the 95 % intervals, scatter against the Cramér-Rao bound", size, renderings,
                 tuple(cases), draw_coverage)


def _bounds() -> Iterable[Case]:
    """The Cramér-Rao bounds: standard deviations of the generalised system on records without noise."""
    for route in ROUTES:
        overrides = _overrides(route, "generalised") | {"camera.noise_std_gv": NOISE_GV}
        yield Case(f"bound/{route}", IMAGES[route], overrides, measure_start=True)


def _draws(group: _Group, number: int) -> Iterable[Case]:
    for k in range(number):
        yield Case(f"{group.name}/{k:04d}", group.images, _overrides(group.route, group.estimator), noise=NOISE_GV,
                   seed=SEED + k, disturbance=group.disturbance, measure_start=True)


def _overrides(route: str, estimator: str) -> dict[str, Any]:
    return {**ROUTES[route], "options.estimator": estimator}  # type: ignore[dict-item]


def _rendering(name: str, make: Callable[[DemoSize], VirtualTest], size: DemoSize) -> Rendering:
    def write(folder: Path) -> ArrayStack:
        return write_clean(folder, make(size))

    return Rendering(name, write, f"open-hole strip {name} {size}, without noise")
