"""A study: many identifications of virtual tests whose truth is known, and the figures drawn from them.

Plain records. A case says what to do and nothing of where; `idic.validation.studies.case` does it, in any process; the flow
`idic_flows.study` spreads the cases over workers and keeps what is finished.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.images.stack import Stack
from idic.validation.pages.case_record import CaseRecord
from idic.validation.pages.study_page import StudyPage
from idic.validation.studies.realisation import Disturbance


@dataclass(frozen=True)
class Rendering:
    """A virtual test that several cases look at.

    write : makes the experiment folder (without images) at the path given and returns its noise-free images
    source : what the images depend on, in words; others are rendered where it has changed
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
        The `Rendering` that it looks at.
    overrides : mapping
        Over what experiment.toml says, as ``--set`` on the command line: start values, a material with another law.
    truth : mapping
        True values of parameters that the rendering's truth.json does not know (another form of the same law).
    n_frames : int, optional
        Only the first so many frames, the reference included.
    noise : float
        Standard deviation added to every image, the reference included, in the unit of the pixel values; `seed` is its
        and that of `disturbance`, what else varies from draw to draw.
    measure_start : bool
        Start values of measured and virtual boundaries from a free FE-DIC, as in a run.
    bits : int
        Images of 256 grey values are rounded as a sensor of so many bits rounds them (8: to whole ones); 0: not at all.
    identify : bool
        False: a simulation at the start values.
    keep : tuple of str
        What to store beside the result, see `idic.validation.studies.fields`: "displacements", "sensitivities", "residuals",
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
        """What the record of this case depends on (JSON values)."""
        asked = asdict(self)
        if not self.bits:
            del asked["bits"]  # records from before there was any rounding are as good
        if self.disturbance == Disturbance() and not self.measure_start:
            del asked["disturbance"], asked["measure_start"]
        return {"case": asked, "images": rendering.source}


@dataclass(frozen=True)
class Study:
    """A named list of cases, and how to draw what came out of them.

    draw : from the records of all finished cases, in the order of `cases`
    size : "full" or "reduced"
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
        """The cases whose group or key fits one of the patterns (``starts``, ``noise/10*``); all without any.

        Raises
        ------
        InputError
            If a pattern fits nothing.
        """
        if not patterns:
            return self.cases
        for pattern in patterns:
            if not any(_fits(case, pattern) for case in self.cases):
                raise InputError(f"study {self.name} has no such case", key="--only", found=pattern,
                                 expected=f"{', '.join(self.groups)}, or a case of theirs such as {self.cases[0].key}")
        return tuple(case for case in self.cases if any(_fits(case, pattern) for pattern in patterns))


def _fits(case: Case, pattern: str) -> bool:
    return fnmatch.fnmatchcase(case.group, pattern) or fnmatch.fnmatchcase(case.key, pattern)
