"""The misfit study: do the error bars hold where the model is a little wrong, and stay narrow where it is right?

Every draw of a world has its own error, its own truth and its own noise (`idic.validation.misfit.worlds`). Figures:
`idic.validation.misfit.page`.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from idic.images.stack import ArrayStack
from idic.validation.misfit.page import draw_misfit
from idic.validation.misfit.worlds import RIGHT, WRONG, Draw, draw, virtual_test
from idic.validation.studies.open_hole_strip import write_clean
from idic.validation.studies.realisation import Disturbance
from idic.validation.studies.study import Case, Rendering, Study

DRAWS = {"full": 40, "reduced": 20, "sketch": 2}
DISTURBANCE = Disturbance(records=True, gain=0.02, offset_gv=1.0)
NOISE_GV = {True: 1.0, False: 2.0}  # of the polymer, of the metal: mesh and rendering stay below it
SEED = 70700


def misfit_study(size: str) -> Study:
    """The study; "full": 40 draws of every world, "reduced": 20."""
    draws = [(world, k) for world in (*RIGHT, *WRONG) for k in range(DRAWS[size])]
    return Study("misfit", "Error bars where the model is a little wrong", size,
                 tuple(_rendering(world, k) for world, k in draws), tuple(_case(world, k) for world, k in draws),
                 draw_misfit)


def _rendering(world: str, k: int) -> Rendering:
    drawn = draw(world, k)
    return Rendering(f"{world}-{k:02d}", partial(_write, drawn), f"{drawn}, without noise")


def _write(drawn: Draw, folder: Path) -> ArrayStack:
    return write_clean(folder, virtual_test(drawn))


def _case(world: str, k: int) -> Case:
    """Starts at the truth: where an identification ends does not depend on its start."""
    drawn = draw(world, k)
    return Case(f"{world}/{k:02d}", f"{world}-{k:02d}", drawn.overrides, noise=NOISE_GV[drawn.elastic], seed=SEED + k,
                disturbance=DISTURBANCE)
