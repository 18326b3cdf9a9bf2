"""The misfit study: whether the error bars hold for a slightly wrong model, and stay narrow for a right one.

Every draw of a world has its own error, its own truth and its own noise (`idic_studies.examples.misfit_worlds`).
Figures: `idic_studies.pages.misfit_page`.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from idic.images import ArrayStack
from idic_studies.cases.realisation import Disturbance
from idic_studies.cases.study import Case, Rendering, Study
from idic_studies.examples.misfit_worlds import METAL_SIZE, POLYMER_SIZE, RIGHT, WRONG, Draw, draw, virtual_test
from idic_studies.examples.open_hole_strip import write_clean
from idic_studies.pages.misfit_page import draw_misfit

TRUTHS = {"full": 10, "reduced": 5, "sketch": 2}  # of every world: size and sign of its error
RECORDINGS = {"full": 4, "reduced": 3, "sketch": 1}  # of every truth: noise
DISTURBANCE = Disturbance(records=True, gain=0.02, offset_gv=1.0)
NOISE_GV = {True: 1.0, False: 2.0}  # of the polymer, of the metal: mesh and rendering stay below it
SEED = 70700


def misfit_study(size: str) -> Study:
    """The study; "full": 40 draws of every world, "reduced": 15."""
    truths = [draw(world, k) for world in (*RIGHT, *WRONG) for k in range(TRUTHS[size])]
    cases = (_case(drawn, k, SEED + k + TRUTHS[size] * recording)
             for recording in range(RECORDINGS[size]) for k, drawn in _numbered(truths, TRUTHS[size]))
    return Study("misfit", "Error bars where the model is a little wrong", size,
                 tuple(_rendering(drawn, k) for k, drawn in _numbered(truths, TRUTHS[size])), tuple(cases), draw_misfit)


def _numbered(truths: list[Draw], per_world: int) -> list[tuple[int, Draw]]:
    return [(number % per_world, drawn) for number, drawn in enumerate(truths)]


def _rendering(drawn: Draw, k: int) -> Rendering:
    size = POLYMER_SIZE if drawn.elastic else METAL_SIZE
    return Rendering(f"{drawn.world}-{k:02d}", partial(_write, drawn), f"{drawn} {size}, without noise")


def _write(drawn: Draw, folder: Path) -> ArrayStack:
    return write_clean(folder, virtual_test(drawn))


def _case(drawn: Draw, k: int, seed: int) -> Case:
    """Starts at the truth: the result of an identification does not depend on its start."""
    return Case(f"{drawn.world}/{k:02d}-{seed - SEED:02d}", f"{drawn.world}-{k:02d}", drawn.overrides,
                noise=NOISE_GV[drawn.elastic], seed=seed, disturbance=DISTURBANCE)
