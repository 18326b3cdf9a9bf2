"""The two-step study: scatter and bias of the integrated method and of DIC followed by FEMU, on the same images.

An open-hole strip of metal that yields (four parameters, logged grip, force) on a coarse and a fine mesh, with little
and much noise. The truth is computed on the user's mesh, so noise is the only error. Two steps: a free FE-DIC of all
frames, without or with mechanical regularisation, then FEMU, weighted by the matrix of the FE-DIC or unweighted.
Figures: `idic_studies.pages.two_step_page`.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path

from idic.images import ArrayStack
from idic.virtual_tests import DemoSize
from idic_studies.cases.coverage import DISTURBANCE
from idic_studies.cases.study import Case, Rendering, Study
from idic_studies.examples.open_hole_strip import metal, write_clean
from idic_studies.pages.two_step_page import METHODS, draw_two_step

SEED = 31000
DRAWS = {"full": 100, "reduced": 30, "sketch": 3}
NOISE_GV = {"low": 1.0, "high": 6.0}  # of 256; the speckle has a standard deviation of some 40
MESHES = {"coarse": (2, 2, 1), "fine": (4, 5, 3)}  # around, radial, beside the hole: elements of about 20 and 8 px
OVERRIDES = {
    "integrated": {"options.estimator": "auto"},
    "ordinary": {"options.estimator": "ordinary"},
    "two_step": {"options.method": "two_step"},
    "two_step_mechanical": {"options.method": "two_step", "options.dic_regularisation": "mechanical"},
    "unweighted": {"options.method": "two_step_unweighted"},
    "unweighted_mechanical": {"options.method": "two_step_unweighted", "options.dic_regularisation": "mechanical"},
}


def two_step_study(size: str) -> Study:
    """The study; "full": 100 draws of every combination, "reduced": 30."""
    return Study("two-step", "The integrated method and a free FE-DIC followed by model updating", size,
                 tuple(_rendering(name) for name in MESHES), tuple(_cases(DRAWS[size])), draw_two_step)


def _cases(draws: int) -> Iterable[Case]:
    for k in range(draws):  # draws outside: an interrupted study holds draws of every method
        for mesh in MESHES:
            for noise, level in NOISE_GV.items():
                for method in METHODS:
                    yield Case(f"{mesh}-{noise}-{method}/{k:03d}", mesh, {**DemoSize.TRUTH, **OVERRIDES[method]},
                               noise=level, seed=SEED + k, disturbance=DISTURBANCE)


def _rendering(name: str) -> Rendering:
    size = DemoSize(0.125, (140, 236), (2, 3, 4), MESHES[name], MESHES[name], 1)
    return Rendering(name, partial(_write, size), f"open-hole strip metal {size}, without noise")


def _write(size: DemoSize, folder: Path) -> ArrayStack:
    return write_clean(folder, metal(size))
