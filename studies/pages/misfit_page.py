"""The page of the misfit study: coverage with and without the discrepancy of the model, and every interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.report import Colour, Picture, look, new_figure, to_picture
from idic_studies.examples.misfit_worlds import RIGHT, WRONG, draw, flow_stress
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import Goal, StudyPage, StudySection, Table

Z95 = 1.96
MIN_COVERAGE = 0.90  # target where the model is wrong
MAX_WIDTH_RATIO = 1.15  # target where it is right: mean width over that of noise alone
MIN_DRAWS_OF_A_TARGET = 20
LINE = ("sheet.yield_stress", "sheet.hardening_modulus")
WITHOUT_COUNTERPART = {"hardening": LINE}  # of a model in its truth
PLASTIC_STRAIN = 0.02  # at which the flow stress stands for them, well inside the test
FLOW_STRESS = f"σ at {100 * PLASTIC_STRAIN:.0f} % plastic strain"
PLAIN = {"sheet.E": "E", "sheet.nu": "ν", "sheet.yield_stress": "σy", "sheet.hardening_modulus": "H", "sheet.E1": "E1",
         "sheet.E2": "E2", "sheet.nu12": "ν12", "sheet.G12": "G12"}
IN_WORDS = {"metal": "right model, metal", "polymer": "right model, polymer", "solid": "three-dimensional truth",
            "coarse": "coarse linear mesh", "hardening": "wrong hardening form", "orthotropy": "orthotropy to 5 %",
            "rotation": "rotated grip", "lens": "lens distortion",
            "off_axis": "off-axis composite, other rim of the hole", "spot": "soft or stiff spot"}
MAX_SHOWN_ERROR = 8.0  # standard deviations


@dataclass(frozen=True)
class Outcome:
    """The converged draws of a world.

    names : of n parameters as they are shown
    noise, both : (draws, n) error over the standard deviation by noise, and over that of noise and model; NaN: not
    known
    significant : share of draws with a significant discrepancy
    """

    world: str
    asked: int
    names: tuple[str, ...]
    noise: np.ndarray
    both: np.ndarray
    significant: float

    @property
    def coverage(self) -> float:
        """Share of all 95 % intervals that hold the truth."""
        return float((np.abs(self.both) < Z95).mean())

    @property
    def noise_coverage(self) -> float:
        """The same of noise alone."""
        is_finite = np.isfinite(self.noise)
        return float((np.abs(self.noise[is_finite]) < Z95).mean())

    @property
    def width_ratio(self) -> np.ndarray:
        """Mean width over that of noise alone  # (n,)"""
        return np.mean(self.noise / self.both, axis=0)


def outcome_of(world: str, records: Sequence[CaseRecord]) -> Outcome:
    """The outcome of a world; a parameter without a counterpart in its truth does not count."""
    converged = [record for record in records if record.converged]
    names = tuple(name for name in PLAIN if name in converged[0].names
                  and name not in WITHOUT_COUNTERPART.get(world, ()))
    pick = [converged[0].names.index(name) for name in names]
    value, std, noise, truth = (np.array([r.arrays[key][pick] for r in converged])
                                for key in ("value", "std", "std_noise", "truth"))
    significances = [bool((record.facts["discrepancy"] or {}).get("significant")) for record in converged]
    z_noise, z_both, labels = (value - truth) / noise, (value - truth) / std, tuple(PLAIN[name] for name in names)
    if world == "hardening":
        z_noise = np.column_stack([z_noise,
                                   np.full(len(converged), np.nan)])  # their correlation by noise is not recorded
        z_both, labels = np.column_stack([z_both,
                                         [_flow_stress_error(record) for record in converged]]), (*labels, FLOW_STRESS)
    return Outcome(world, len(records), labels, z_noise, z_both, float(np.mean(significances)))


def _flow_stress_error(record: CaseRecord) -> float:
    """Error of the identified flow stress over its standard deviation; the number of the truth begins the record's
    name."""
    i, weights = [record.names.index(name) for name in LINE], np.array([1.0, PLASTIC_STRAIN])
    table = record.facts["correlation"]
    pair = [table["names"].index(name) for name in LINE]
    steps = weights * record.arrays["std"][i]
    std = np.sqrt(steps @ np.array(table["matrix"])[np.ix_(pair, pair)] @ steps)
    true = flow_stress(draw("hardening", int(record.name.partition("-")[0])), PLASTIC_STRAIN)
    return float((weights @ record.arrays["value"][i] - true) / std)


def draw_misfit(records: Mapping[str, CaseRecord]) -> StudyPage:
    """The page of the finished cases."""
    outcomes = []
    for world in (*RIGHT, *WRONG):
        members = [record for record in records.values() if record.group == world]
        if any(record.converged for record in members):
            outcomes.append(outcome_of(world, members))
    goals = tuple(_goal(outcome) for outcome in outcomes if len(outcome.both) >= MIN_DRAWS_OF_A_TARGET)
    first = f"{sum(bool(goal.met) for goal in goals)} of {len(goals)} targets are met." if goals else ""
    text = ("Strips with a hole, 10 frames; size and sign of the error, and all noise, are drawn anew for every "
            "recording. std counts noise and the discrepancy of the model (docs/method.md, section 14).")
    sections = (StudySection("misfit", "Error bars where the model is a little wrong", text, (_table(outcomes),),
                             (_picture(outcomes),)),) if outcomes else ()
    return StudyPage("Error bars where the model is a little wrong", first, goals, sections)


def _goal(outcome: Outcome) -> Goal:
    if outcome.world in RIGHT:
        widest = float(outcome.width_ratio.max())
        return Goal(f"width over that of noise alone, {IN_WORDS[outcome.world]}", f"at most {MAX_WIDTH_RATIO}",
                    f"{widest:.2f}", widest <= MAX_WIDTH_RATIO)
    return Goal(f"coverage, {IN_WORDS[outcome.world]}", f"at least {100 * MIN_COVERAGE:.0f} %",
                f"{100 * outcome.coverage:.0f} % (noise alone: {100 * outcome.noise_coverage:.0f} %)",
                outcome.coverage >= MIN_COVERAGE)


def _table(outcomes: Sequence[Outcome]) -> Table:
    rows = []
    for outcome in outcomes:
        for i, name in enumerate(outcome.names):
            coverage, noise_coverage = ((np.abs(z[:, i]) < Z95).mean() for z in (outcome.both, outcome.noise))
            has_noise = bool(np.isfinite(outcome.noise[0, i]))
            rows.append((IN_WORDS[outcome.world], name, f"{100 * noise_coverage:.0f} %" if has_noise
                         else "–", f"{100 * coverage:.0f} %",
                         f"{np.sqrt(np.mean(outcome.noise[:, i]**2)):.1f}" if has_noise else "–",
                         f"{np.sqrt(np.mean(outcome.both[:, i]**2)):.2f}", f"{outcome.width_ratio[i]:.2f}" if has_noise
                         else "–", f"{100 * outcome.significant:.0f} %",
                         f"{len(outcome.both)} of {outcome.asked}"))
    return Table("Coverage of the 95 % intervals", (
        "world", "parameter", "noise alone", "noise and model", "rms error / std, noise alone",
        "rms error / std, noise and model", "mean width / noise alone", "discrepancy significant", "converged"),
        tuple(rows), "40 draws know a coverage of 90 % to ± 9 % (95 % of chance).")


def _picture(outcomes: Sequence[Outcome]) -> Picture:
    """Every error over both standard deviations: inside the band the interval holds the truth."""
    with look():
        figure = new_figure(9.0, 1.0 + 0.55 * sum(len(entry.names) for entry in outcomes) / 2)
        axis, labels, row = figure.subplots(), [], 0
        axis.axvspan(-Z95, Z95, color=Colour.FAINT, lw=0)
        for outcome in outcomes:
            for i, name in enumerate(outcome.names):
                for z, shift, colour, label in ((outcome.noise, 0.18, Colour.ORANGE, "noise alone"),
                                                (outcome.both, -0.18, Colour.BLUE, "noise and model")):
                    errors = np.clip(z[:, i], -MAX_SHOWN_ERROR, MAX_SHOWN_ERROR)
                    axis.plot(errors, np.full(len(errors), -row + shift), "|", color=colour, ms=6,
                              label=label if row == 0 else None)
                labels.append(f"{IN_WORDS[outcome.world]}, {name}")
                row += 1
            axis.axhline(-row + 0.5, color=Colour.GREY, lw=0.5)
        axis.set_yticks(-np.arange(len(labels)), labels)
        axis.set(xlabel=f"(value − truth) / std [–]; beyond ± {MAX_SHOWN_ERROR:.0f} at the edge",
                 ylim=(-row + 0.4, 0.6))
        figure.legend(loc="outside upper right", ncols=2)
        return to_picture(figure, "misfit", "Intervals against truth", "A stroke per recording. Grey: the 95 % "
                          "interval holds the truth.")
