"""A candidate physics: how it is written into an experiment, where it is absent, and what tells it from its rivals.

A variant is a set of edits of experiment.toml: every enriched model is an ordinary experiment that `idic identify`
runs. One file per candidate in `idic.diagnose.candidates`; registering it puts it into the screening, the
documentation (`idic physics`) and the blind trial.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from idic.model.experiment import Experiment

FAMILIES = ("plasticity", "rate", "damage", "elastic_form", "heterogeneity", "environment", "boundary", "force",
            "camera")
SIDES = {"plasticity": "bulk", "rate": "bulk", "damage": "bulk", "elastic_form": "bulk", "heterogeneity": "bulk",
         "environment": "bulk", "boundary": "boundary", "force": "force", "camera": "camera"}


@dataclass(frozen=True)
class Situation:
    """What a candidate may look at to place its variants.

    Attributes
    ----------
    document : tables of experiment.toml as they are (the identified model's), to be edited
    experiment : the same as a record
    values : identified parameters, in the units of the file's internal system (mm, s, MPa, N)
    stress : {element set: (n_levels,)} quantiles 50 … 98 % over the points of the largest von Mises stress that each
        point reaches (MPa)
    strain : {element set: float} largest equivalent strain
    u : (n_frames, n_nodes, dim) mm; forces : (n_frames, n_channels)
    """

    document: Mapping[str, Any]
    experiment: Experiment
    values: Mapping[str, float]
    stress: Mapping[str, np.ndarray]
    strain: Mapping[str, float]
    u: np.ndarray
    forces: np.ndarray

    @property
    def duration(self) -> float:
        """Seconds from the reference frame to the last."""
        return float(self.experiment.times[-1] - self.experiment.times[self.experiment.reference])

    def law(self, element_set: str) -> str:
        return self.experiment.material_of(element_set).law


@dataclass(frozen=True)
class Variant:
    """One way in which a candidate may show.

    Attributes
    ----------
    label : what is on the grid here, e.g. "yield stress 41 MPa"
    edits : overrides of experiment.toml (dotted keys, `load_experiment(path, overrides)`), `new` among its free
        parameters
    new : names of the degrees of freedom it adds
    null : their values where the physics is absent (may be infinite); of one that has no meaning then, its probe, so
        that a start beyond the probe keeps it
    probe : their values for the finite probe; amplitude 1 of the column is the way from null to probe
    sign : +1 where only positive amplitudes are admissible, 0 where both are
    form, place : of the heterogeneity family
    direct : columns are the derivatives at the null values, one per name in `new`, per unit of the degree of freedom
    exact : the null embedding is the identified model itself, not only the same physics: nothing to subtract
    pixels : (kind, course (n_frames,)): columns of grey values instead of motion, one per hat (`idic.diagnose.residual.grey_value_effects`)
    refit : further edits for the refit only (starting values)
    """

    label: str
    edits: Mapping[str, Any]
    new: tuple[str, ...]
    null: Mapping[str, float]
    probe: Mapping[str, float] = field(default_factory=dict)
    sign: int = 0
    form: str | None = None
    place: tuple[float, float] | None = None
    direct: bool = False
    exact: bool = False
    pixels: tuple[str, np.ndarray] | None = None
    refit: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Candidate:
    """A missing physics.

    Attributes
    ----------
    name, family : fixed names, keys of `diagnosis.json`
    title : in a reader's words
    null : where it is absent, in words
    rivals : names that show alike, and why, in words
    separates : what experiment tells it from its rivals, cheapest first
    contains : candidates that are limits of this one: it is named beside them only where it explains more
    begins : there is a moment before which nothing of it shows (yield, damage, slip); others are there from the start
    turns : it shows where the load turns, not where points begin to yield
    variants : makes the variants for a situation; none where it cannot apply (already in the model, no times …)
    """

    name: str
    family: str
    title: str
    null: str
    rivals: Mapping[str, str]
    separates: tuple[str, ...]
    variants: Callable[[Situation], tuple[Variant, ...]]
    contains: tuple[str, ...] = ()
    begins: bool = False
    turns: bool = False

    @property
    def side(self) -> str:
        return SIDES[self.family]


_REGISTRY: dict[str, Candidate] = {}


def register(candidate: Candidate) -> Candidate:
    """Add a candidate to the library."""
    if candidate.family not in FAMILIES:
        raise ValueError(f"unknown family {candidate.family}")
    if candidate.name in _REGISTRY:
        raise ValueError(f"{candidate.name} is registered already")
    _REGISTRY[candidate.name] = candidate
    return candidate


def candidates() -> tuple[Candidate, ...]:
    """The whole library, in the order of the families."""
    import idic.diagnose.candidates  # noqa: F401  registers every file of the package

    return tuple(sorted(_REGISTRY.values(), key=lambda c: (FAMILIES.index(c.family), c.name)))
