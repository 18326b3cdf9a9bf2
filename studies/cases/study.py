"""The records of a study: virtual tests, cases, and the function that draws the page.

A case is plain data. `idic_studies.cases.case` runs it in any process; the flow `idic_studies.flows.study` distributes
the cases over workers.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.images import Stack
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import StudyPage
from idic_studies.cases.realisation import Disturbance


@dataclass(frozen=True)
class Rendering:
    """A virtual test that several cases share.

    write : makes the experiment folder (without images) at the path given and returns its noise-free images
    source : identifies the images: they are rendered again where it has changed
    """

    name: str
    write: Callable[[Path], Stack]
    source: str


@dataclass(frozen=True)
class Case:
    """One identification (or one simulation) of a study.

    Attributes
    ----------
    key : str
        ``GROUP/NAME``: where the record lies.
    images : str
        Name of the `Rendering`.
    overrides : mapping
        Of experiment.toml, as ``--set`` on the command line: start values, a material with another law.
    truth : mapping
        True values of parameters that are not in truth.json of the rendering (another form of the same law).
    n_frames : int, optional
        Number of leading frames in use, the reference included; all without it.
    noise : float
        Standard deviation added to every image, the reference included, in the unit of the pixel values; `seed` is that
        of the noise and of `disturbance`.
    measure_start : bool
        Start values of measured and virtual boundaries from a free FE-DIC, as in a run.
    bits : int
        Bits of the sensor: images of 256 grey values are rounded accordingly (8: to integers); 0: no rounding.
    identify : bool
        False: a simulation at the start values.
    keep : tuple of str
        Further fields to store, see `idic_studies.cases.fields`: "displacements", "sensitivities", "residuals",
        "levels".
    """

    key: str
    images: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    truth: Mapping[str, float] = field(default_factory=dict)
    n_frames: int | None = None
    noise: float = 0.0
    seed: int = 0
    bits: int = 0
    identify: bool = True
    keep: tuple[str, ...] = ()
    disturbance: Disturbance = field(default_factory=Disturbance)
    measure_start: bool = False

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]

    def ident(self, rendering: Rendering) -> dict:
        """JSON values that identify the record: a case with another ident is run again."""
        content = asdict(self)
        if not self.bits:
            del content["bits"]  # records without this key stay valid
        if self.disturbance == Disturbance() and not self.measure_start:
            del content["disturbance"], content["measure_start"]
        return {"case": content, "images": rendering.source}


@dataclass(frozen=True)
class Study:
    """A named list of cases and the function that draws their page.

    draw : records of the finished cases, in the order of `cases`, to the page
    size : "full", "reduced" or "sketch"
    """

    name: str
    title: str
    size: str
    renderings: tuple[Rendering, ...]
    cases: tuple[Case, ...]
    draw: Callable[[Mapping[str, CaseRecord]], StudyPage]

    def rendering(self, name: str) -> Rendering:
        return next(rendering for rendering in self.renderings if rendering.name == name)

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of cases, in order."""
        return tuple(dict.fromkeys(case.group for case in self.cases))

    def select(self, patterns: Sequence[str] | None) -> tuple[Case, ...]:
        """The cases whose group or key fits one of the patterns (``starts``, ``noise/10*``, the world ``jpeg``); all
        without any.

        Raises
        ------
        InputError
            If a pattern selects no case.
        """
        if not patterns:
            return self.cases
        for pattern in patterns:
            if not any(_fits(case, pattern) for case in self.cases):
                raise InputError(f"study {self.name} has no such case", key="--only", found=pattern,
                                 expected=f"{', '.join(self.groups)}, or a case such as {self.cases[0].key}",
                                 remedy="correct the name, or leave --only out to run all cases")
        return tuple(case for case in self.cases if any(_fits(case, pattern) for pattern in patterns))


def _fits(case: Case, pattern: str) -> bool:
    return any(fnmatch.fnmatchcase(name, glob) for name, glob in
               ((case.group, pattern), (case.key, pattern), (case.group, f"{pattern}_*")))
