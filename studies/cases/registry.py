"""The studies by name; a new study adds its line to `STUDIES`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from idic.errors import InputError
from idic_studies.cases.bulge import bulge_study
from idic_studies.cases.convergence import convergence_study
from idic_studies.cases.coverage import coverage_study
from idic_studies.cases.misfit import misfit_study
from idic_studies.cases.polycarbonate import polycarbonate_study
from idic_studies.cases.study import Study
from idic_studies.cases.two_step import two_step_study

STUDIES: dict[str, Callable[[str], Study]] = {"bulge": bulge_study, "convergence": convergence_study,
                                              "coverage": coverage_study, "misfit": misfit_study,
                                              "polycarbonate": polycarbonate_study, "two-step": two_step_study}
SIZES = ("full", "reduced", "sketch")


@cache
def make_study(name: str, size: str) -> Study:
    """A study in one of its sizes: "full", "reduced" (minutes), "sketch" (seconds); the same in every process.

    Raises
    ------
    InputError
        Unknown name or size.
    """
    if name not in STUDIES:
        raise InputError(f"there is no study {name}", key="NAME", expected=f"one of {', '.join(STUDIES)}", found=name,
                         remedy="correct the name, e.g.  idic study coverage --out FOLDER")
    if size not in SIZES:
        raise InputError(f"study {name} has no size {size}", key="size", expected=f"one of {', '.join(SIZES)}",
                         found=size, remedy="choose one of these sizes")
    return STUDIES[name](size)
