"""A candidate physics: its entry in an experiment, its null value, the tests that separate it from its rivals.

A variant is a set of edits of experiment.toml: every enriched model is an ordinary experiment for `idic identify`.
One file per candidate in `idic.diagnose.candidates`; registering it puts it into the screening, the report and
`idic physics`. The recipe is docs/add-a-candidate.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from idic.model import Experiment
from idic.parameters import PlausibleSize



@dataclass(frozen=True)
class Family:
    """Candidates of one kind.

    side : "bulk", "boundary", "camera" or "force"
    active : laws of yielding, flow or damage: they act in the whole body, and the points of the enriched model say
    where
        and since when. They have no place among their unknowns.
    under_load : effects of the specimen that grow with the load
    placed : effects with a place on the specimen although they act from the start
    """

    side: str
    active: bool = False
    under_load: bool = False
    placed: bool = False


FAMILIES = {
    "plasticity": Family("bulk", active=True, under_load=True),
    "rate": Family("bulk", active=True, under_load=True),
    "damage": Family("bulk", active=True, under_load=True),
    "elastic_form": Family("bulk", under_load=True),
    "heterogeneity": Family("bulk", under_load=True, placed=True),
    "environment": Family("bulk"),
    "boundary": Family("boundary", placed=True),
    "force": Family("force"),
    "camera": Family("camera"),
}


MESH_TOO_COARSE = "the mesh is too coarse"  # begins the reason of a candidate that shows and asks for a finer mesh


def unknown_score() -> None:
    """No derivative by the stiffness of the elements."""


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
    stiffness_score : derivative of the misfit by the stiffness of every element (n_elements,), on demand; None where
        the model finds no answer along its path
    """

    document: Mapping[str, Any]
    experiment: Experiment
    values: Mapping[str, float]
    stress: Mapping[str, np.ndarray]
    strain: Mapping[str, float]
    u: np.ndarray
    forces: np.ndarray
    stiffness_score: Callable[[], np.ndarray | None] = unknown_score

    @property
    def duration(self) -> float:
        """Seconds from the reference frame to the last."""
        return float(self.experiment.model.times[-1] - self.experiment.model.times[self.experiment.model.reference])

    def law(self, element_set: str) -> str:
        return self.experiment.model.material_of(element_set).law


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
    idle : names that have no meaning at the null values: all variants with the same unknowns are one model there
    probe : their values for the finite probe; amplitude 1 of the column is the way from null to probe
    sign : +1 where only positive amplitudes are admissible, 0 where both are
    form, place : of the heterogeneity family
    direct : columns are the derivatives at the null values, one per name in `new`, per unit of the degree of freedom
    exact : the null embedding is the identified model itself, not only the same physics: nothing to subtract
    pixels : (kind, courses (n, n_frames)): columns of grey values instead of motion, one per hat and course
        (`idic.diagnose.residual.grey_value_effects`); each counts alone, and all together
    refit : further edits for the refit only (starting values)
    free_course : `new` are the knots of a course that the data give: their columns count together
    least : amplitude up to which the recording shows it without a cause in the test, whatever its significance
    unresolved : why a refit would say nothing although it shows: the mesh is too coarse for it
    searched : number of variants that a search looked at before it proposed this one: each counts as a test
    """

    label: str
    edits: Mapping[str, Any]
    new: tuple[str, ...]
    null: Mapping[str, float]
    probe: Mapping[str, float] = field(default_factory=dict)
    sign: int = 0
    form: str | None = None
    place: tuple[float, ...] | None = None
    direct: bool = False
    exact: bool = False
    pixels: tuple[str, np.ndarray] | None = None
    refit: Mapping[str, Any] = field(default_factory=dict)
    free_course: bool = False
    least: float = 0.0
    idle: tuple[str, ...] = ()
    unresolved: str = ""
    searched: int = 1

    @property
    def counts_together(self) -> bool:
        """Whether the best sum of its columns is a test of its own."""
        return self.free_course or self.pixels is not None


@dataclass(frozen=True)
class Candidate:
    """A missing physics.

    Attributes
    ----------
    name : key of diagnosis.json, and of its file in `idic.diagnose.candidates`
    family : key of `FAMILIES`
    title : its name in standard words; paraphrase : the same in plain words
    null : where it is absent, in words
    rivals : names of candidates that show alike, and why
    separating_tests : experiments that separate it from its rivals, cheapest first
    variants : makes the variants for a situation; () where it does not apply (already in the model, no times …)
    limits : names of candidates that are limits of this one; it is selected only where it explains more, by this share
        of its evidence (`share_over_limit`) and beyond noise
    has_onset : there is a moment before which it does not act (yield, damage, slip); others act from the start
    shows_at_reversal : it shows where the load turns, not where points begin to yield
    slow : its simulations take long, so that it is refitted after candidates that promise nearly as much
    hidden_by_yield_law : an identified law of yielding imitates it to first order; where no candidate is significant it
    is
        refitted whatever its score
    untestable : why a record cannot tell it from its rivals, "" where it can; it is not screened then, and not excluded
    everywhere : it acts all over the body, although other causes of its family have a place
    refitted_form : form of a variant after its refit, from the values of the parameters; None: the variant's own
    rescaled : a variant with the scale that it holds times a factor; None: it holds none
    cuts_mesh : its variants need a mesh that is cut where the residual asks for it (`idic.diagnose.cut_mesh`); every
        model of the diagnosis then has that mesh
    size : how large it plausibly is, in probes; None: any size is (laws of materials)
    """

    name: str
    family: str
    title: str
    null: str
    rivals: Mapping[str, str]
    separating_tests: tuple[str, ...]
    variants: Callable[[Situation], tuple[Variant, ...]]
    limits: tuple[str, ...] = ()
    share_over_limit: float = 0.0
    has_onset: bool = False
    shows_at_reversal: bool = False
    paraphrase: str = ""
    slow: bool = False
    hidden_by_yield_law: bool = False
    everywhere: bool = False
    refitted_form: Callable[[Variant, Mapping[str, float]], str | None] | None = None
    untestable: Callable[[Situation], str] | None = None
    rescaled: Callable[[Variant, float], Variant] | None = None
    cuts_mesh: bool = False
    size: PlausibleSize | None = None

    @property
    def kind(self) -> Family:
        """Its family."""
        return FAMILIES[self.family]

    @property
    def changes_law(self) -> bool:
        """Whether it is another law of a material, not a place with another stiffness or a constant that was locked."""
        return self.side == "bulk" and not self.kind.placed and self.kind.under_load

    @property
    def is_nonlinear(self) -> bool:
        """Whether its effect is far from a straight line in its amplitude: yield, flow, damage, slip, a void."""
        return self.kind.active or self.has_onset or self.refitted_form is not None

    @property
    def side(self) -> str:
        """Side on which it acts."""
        return self.kind.side

    def reason_against(self, situation: Situation) -> str:
        """Why this record cannot tell it from its rivals, "" where it can."""
        return "" if self.untestable is None else self.untestable(situation)

    def form_after(self, variant: Variant, values: Mapping[str, float]) -> str | None:
        """Form of a refitted variant; values : parameters after the refit."""
        return variant.form if self.refitted_form is None else self.refitted_form(variant, values)


_REGISTRY: dict[str, Candidate] = {}


def register(candidate: Candidate) -> Candidate:
    """Add a candidate to the library."""
    if candidate.family not in FAMILIES:
        raise ValueError(f"unknown family {candidate.family}")
    if candidate.name in _REGISTRY:
        raise ValueError(f"{candidate.name} is registered already")
    _REGISTRY[candidate.name] = candidate
    return candidate


def registered() -> tuple[Candidate, ...]:
    """The registered candidates, in the order of the families."""
    return tuple(sorted(_REGISTRY.values(), key=lambda c: (list(FAMILIES).index(c.family), c.name)))
