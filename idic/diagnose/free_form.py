"""The free-form law: the last candidate, offered where no named physics fits a mismatch of the specimen.

The law of the class that the user's model has, with a curve in the place of a form: a free hardening curve for elastic
and plastic models, a free energy for rubber, a free relaxation spectrum for viscoelastic models. It is refitted to one
copy of the recording and judged on the other, as every candidate, and joins no model: a curve has no name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from idic.diagnose.locate.mismatch import Mismatch
from idic.diagnose.physics.candidate import Situation
from idic.diagnose.physics.enrich import elastic_pair, enriched, has_times, locked, new, plastic_strain, stress_levels
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import RefitJob
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.selection.free_model import FreeModel
from idic.diagnose.selection.rival import Round, winners
from idic.diagnose.selection.state import State
from idic.diagnose.selection.verdict import Verdict
from idic.laws import knots, rubber_level_names, weight_names
from idic.model import Model

BULK = "bulk"
N_KNOTS, N_SECOND_KNOTS = 8, 5  # of a hardening curve or dW/dI1, of dW/dI2
N_TIMES = 8  # of a spectrum
START_SLOPE_SHARE = 0.05  # of Young's modulus, the slope at which a hardening curve starts
START_SHARE = 0.1  # of the shear modulus relaxes at the start
STRENGTH = 3.0  # of the smoothness prior, the weakest that the evidence tries: the data shape the curve
ROOM = 1.1  # of the range over what the model reaches
YIELDING = ("j2_linear", "j2_voce", "j2_power", "j2_power_reference")
RUBBERS = ("neo_hookean", "mooney_rivlin")
RELAXING = ("maxwell",)
NEXT_TEST = {
    "hardening": "pull a plain strip of the same material and predict its force from the free curve: a force that "
                 "differs says that the cause is not the hardening",
    "rubber": "stretch a plain strip and a wide sheet of the same rubber and predict their forces from the free "
              "curve: forces that differ say that the cause is not the energy",
    "relaxation": "hold the motion of a second test and predict its force from the free spectrum: a force that differs "
                  "says that the cause is not the relaxation"}


@dataclass(frozen=True)
class FreeLaw:
    """A law with a free curve for one material.

    kind : key of `NEXT_TEST`; title : in standard words; edits : of experiment.toml; names : values at the knots, of
    unit `unit`; at : (n,) their abscissa; axes : titles of abscissa and ordinate
    """

    material: str
    kind: str
    title: str
    edits: Mapping[str, Any]
    names: tuple[str, ...]
    at: np.ndarray
    axes: tuple[str, str]
    unit: str = "MPa"

    @property
    def law(self) -> str:
        """Its name in experiment.toml."""
        return self.edits[f"material.{self.material}"]["law"]


@dataclass(frozen=True, eq=False)
class FreeForm(FreeModel):
    """A free law after its refit."""

    law: FreeLaw

    @property
    def unknowns(self) -> Sequence[str]:
        """Heights of its curve."""
        return self.law.names

    @property
    def next_test(self) -> str:
        """A test that says whether the cause is what the curve takes it for."""
        return NEXT_TEST[self.law.kind]

    def content(self) -> dict[str, Any]:
        """The entry of diagnosis.json."""
        law = self.law
        return {"law": law.law, "title": law.title, "material": law.material, "describes": self.describes,
                "share": self.share, "heldout_chi2_drop": self.heldout, "left_px": self.excess.motion_px,
                "axes": list(law.axes), "unit": law.unit, "at": law.at.tolist(),
                "value": [self.refitted.values[name] for name in law.names],
                "std": [self.refitted.stds.get(name) for name in law.names]}


def is_offered(verdict: Verdict, mismatch: Mismatch | None, rounds: Sequence[Round], model: Model) -> bool:
    """Whether a free law is offered.

    No named cause fits, a material has a free law of its class, and the nested tests or a selected candidate assign the
    mismatch to the specimen.
    """
    classes = ("elastic", *YIELDING, *RUBBERS, *RELAXING)
    if verdict.word != "outside_library" or mismatch is None or not any(
            material.law in classes for material in model.materials):
        return False
    return BULK in (mismatch.side, *(winner.ranked.candidate.side for winner in winners(rounds)))


def has_other_sides(rounds: Sequence[Round]) -> bool:
    """Whether a selected cause is not of the specimen: a free law does not replace it."""
    return any(winner.ranked.candidate.side != BULK for winner in winners(rounds))


def free_form(state: State, bases: Sequence[FittedModel]) -> FreeForm | None:
    """The free law that explains most of held-out data; None where no class of the model has one, or no answer.

    Parameters
    ----------
    bases : the identified model, and the last one where it holds causes that are not of the specimen, fitted to the
        copy for choosing
    """
    setting, null = state.setting, state.first.fit
    offered = [(base, law) for base in bases for law in free_laws(base.situation())]
    if not offered:
        return None
    jobs = [RefitJob(f"free_form_{k}", base.source, (law.title,), (law.edits,), (_without(base.fit.values, law),),
                     base.fit.local, setting.grid, np.inf, setting.seed, unlimited=True, whole_std=True)
            for k, (base, law) in enumerate(offered)]
    setting.stage(f"fit of a free law, as no named cause fits: {', '.join(law.title for _, law in offered)}")
    forms = [FreeForm(refit, ExcessLeft(null.judgement, refit.judgement,
                                        state.power_of_copy, margin_px=setting.margin.px,
                                        camera_px=setting.margin.camera_px), law)
             for (_, law), refit in zip(offered, setting.refits(jobs), strict=True) if refit.judgement is not None]
    return max(forms, key=lambda form: form.heldout, default=None)


def _without(values: Mapping[str, float], law: FreeLaw) -> dict[str, float]:
    """Values to begin at; a curve begins where its law has it: g_1 of a Maxwell body has another relaxation time."""
    return {name: value for name, value in values.items() if name not in law.names}


def free_laws(situation: Situation) -> Iterator[FreeLaw]:
    """Of every material the free laws of its class."""
    for material in situation.experiment.model.materials:
        name, law = material.element_set, material.law
        if law == "elastic" or law in YIELDING:
            yield _hardening(situation, name)
        if law in RUBBERS:
            yield _rubber(situation, name)
        if law in RELAXING and has_times(situation):
            yield _relaxation(situation, name)


def _hardening(situation: Situation, name: str) -> FreeLaw:
    values, E = situation.values, elastic_pair(situation, name)[0]
    start = values.get(f"{name}.yield_stress", next(iter(stress_levels(situation, name, (0,))), 1e-3 * E))
    end_strain = ROOM * plastic_strain(situation, name)
    slope = max(values.get(f"{name}.hardening_modulus", 0.0), START_SLOPE_SHARE * E)
    at = knots(end_strain, N_KNOTS)
    levels = {f"hardening_1_s{k + 1}": new(start + slope * p, "MPa") for k, p in enumerate(at) if k}
    edits = enriched(situation, name, f"elastoplastic(free{N_KNOTS})", hardening_1_range=locked(end_strain), **levels)
    table = edits[f"material.{name}"]
    table["yield_stress"] = new(start, "MPa")  # free, also where the file locks it: the first value of the curve
    table["smoothness"] = {"hardening_1": {"strength": STRENGTH}}
    return FreeLaw(name, "hardening", "free hardening curve", edits,
                   tuple(f"{name}.{key}" for key in ("yield_stress", *levels)), at,
                   ("plastic strain [-]", "flow stress [MPa]"))


def _rubber(situation: Situation, name: str) -> FreeLaw:
    stretch = np.sqrt(1.0 + 2.0 * ROOM * situation.strain[name])  # in tension
    first, second = stretch**2 + 2.0 / stretch - 3.0, 2.0 * stretch + stretch**-2 - 3.0
    names = rubber_level_names("I1", N_KNOTS), rubber_level_names("I2", N_SECOND_KNOTS)
    C10, C01 = situation.values[f"{name}.C10"], situation.values.get(f"{name}.C01", 0.0)
    levels = dict.fromkeys(names[0], new(C10, "MPa")) | dict.fromkeys(names[1], new(C01, "MPa"))
    edits = enriched(situation, name, f"free_rubber({N_KNOTS}+{N_SECOND_KNOTS})", I1_range=locked(float(first)),
                     I2_range=locked(float(second)), **levels)
    edits[f"material.{name}"]["smoothness"] = {key: {"strength": STRENGTH} for key in ("I1", "I2")}
    return FreeLaw(name, "rubber", "free rubber energy", edits, tuple(f"{name}.{key}" for key in names[0]),
                   knots(float(first), N_KNOTS), ("I1 - 3 [-]", "dW/dI1 [MPa]"))


def _relaxation(situation: Situation, name: str) -> FreeLaw:
    shortest = float(np.median(np.diff(situation.experiment.model.times))) / 3.0
    names = weight_names(N_TIMES)
    edits = enriched(situation, name, f"free_relaxation({N_TIMES})", shortest=locked(shortest, "s"),
                     longest=locked(situation.duration, "s"),
                     **dict.fromkeys(names, new(START_SHARE / N_TIMES)))
    edits[f"material.{name}"]["smoothness"] = {"spectrum": {"strength": STRENGTH}}
    return FreeLaw(name, "relaxation", "free relaxation spectrum", edits, tuple(f"{name}.{key}" for key in names),
                   np.geomspace(shortest, situation.duration, N_TIMES), ("relaxation time [s]", "weight [-]"), "-")
