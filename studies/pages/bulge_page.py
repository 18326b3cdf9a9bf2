"""The page of the bulge study: sections, tables and targets compared with the published figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic_studies.pages import bulge_figures as figures
from idic_studies.pages import study_charts as charts
from idic_studies.pages.bulge_figures import PAPER_SCALES, PLAIN, SYMBOLS
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import Goal, StudyPage, StudySection, Table

Records = Mapping[str, CaseRecord]
WITHIN_STDS, WITHIN = 3.0, 1e-3  # a start ended right: within 3 std, or (no noise) within 0.1 %
MIN_SUCCESSFUL_STARTS = 15
TRIAL_SCALES = {"elastomer.C10": 94.0, "strip.E": 0.14, "strip.yield_stress": 1.40, "strip.K": 0.65, "strip.n": 3.5}
TRIAL_WINDOWS = {25: (-0.2, 3e-4), 50: (-0.7, -5e-4), 75: (-3.2, -3e-3), 100: (-7.3, -4e-3), 125: (-20.0, -4e-3),
                 150: (-34.0, -2e-2), 175: (-45.0, -4e-2), 200: (-53.0, -7e-2)}  # E, C10: error in % of a prototype


def draw_bulge(records: Records) -> StudyPage:
    """The page of the finished cases."""
    drawn = [make(records) for make in (_reference, _from130, _guesses, _starts, _draws, _windows, _twin, _forms)]
    sections = tuple(section for section, _ in filter(None, drawn))
    goals = tuple(goal for _, section_goals in filter(None, drawn) for goal in section_goals)
    met = sum(goal.met for goal in goals)
    first = f"{met} of {len(goals)} targets are met. Paper: section 4 of the published method." if goals else ""
    return StudyPage("Bulge test of a metal strip on rubber: five parameters of two materials", first, goals, sections)


def _reference(records: Records):
    if "reference/simulation" not in records:
        return None
    record = records["reference/simulation"]
    constants = figures.scaling_constants(record)
    rows = tuple((PLAIN[name], f"{value:.2f}", f"{PAPER_SCALES[name]:.2f}", f"{TRIAL_SCALES[name]:g}",
                  f"{value / PAPER_SCALES[name]:.2f}") for name, value in constants.items())
    table = Table("Scaling constants: largest |λ ∂u/∂λ| in the field of view", ("parameter", "here [px]", "paper",
                  "prototype", "here / paper"), rows,
                  "u is proportional to C10^(-1/3): the constant of C10 is a third of the rise (90 µm = 271 px).")
    section = StudySection("reference", "The test and what its parameters do", "", (table,),
                           (figures.displacements(record), figures.sensitivities(record)))
    return section, []


def _from130(records: Records):
    if "from130/all" not in records:
        return None
    record = records["from130/all"]
    facts, error = record.facts, 1e6 * record.arrays["u_error"]
    rms, worst = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
    largest = float(np.abs(record.relative_error).max())
    rows = tuple((PLAIN[n], f"{v:.6g}", f"{t:g}", f"{100 * e:+.2g} %", f"{100 * s:.2g} %") for n, v, t, e, s in zip(
        record.names, record.arrays["value"], record.arrays["truth"], record.relative_error, record.relative_std,
        strict=True))
    tables = (Table("Identified without added noise, from 130 % of every parameter",
                    ("parameter", "value", "true value", "error", "reported std"), rows,
                    "Reported std: of a noise of "
                    f"{facts['noise']:.1g} µm, the interpolation residual of noise-free heights."),)
    level = charts.frame_levels(record.arrays["times"], [("identified", 1e3 * record.arrays["level_abs"], None)], "nm",
                                "fig15_level", "Residual per frame", "Mean |r| of every frame at the identified "
                                "parameters: the interpolation residual; the roughness has 1500 nm rms.")
    pictures = (figures.residual_maps(record),
                charts.convergence(record, SYMBOLS, "fig15_convergence",
                                   f"{facts['iterations']} iterations (paper: 16, fig. 15b)."),
                level, figures.displacement_errors(record))
    goals = [Goal("iterations from 130 %", "at most 7 (paper 16)", str(facts["iterations"]),
                  record.converged and facts["iterations"] <= 7),
             Goal("error of every parameter, no noise", "at most 0.05 %", f"largest {100 * largest:.2g} %",
                  largest <= 5e-4),
             Goal("error of the displacement, no noise", "at most 0.02 nm rms (paper 0.4 nm at worst)",
                  f"{rms:.2g} nm rms, {worst:.2g} nm at worst", rms <= 0.02),
             Goal("cost of that identification", "at most 60 s on two quiet cores, less than 1 GB",
                  f"{facts['wall_s']:.1f} s wall on one core ({facts['cpu_s']:.1f} s CPU), "
                  f"{facts['peak_rss_mb']:.0f} MB",
                  facts["wall_s"] <= 60.0 and facts["peak_rss_mb"] < 1000.0)]
    return StudySection("from130", "From 130 % of every parameter", "", tables, pictures), goals


def _guesses(records: Records):
    panels = []
    guesses, noises = ([r for key, r in records.items() if r.group == group] for group in ("guess", "noise"))
    if guesses:
        panels.append(("Initial guess (no noise)", "start value / true value [%]",
                       np.array([float(r.name) for r in guesses]), guesses))
    if noises:
        levels = [0.1 * max(float(r.name), 0.5) for r in noises]  # no noise: at the left end of a logarithmic axis
        panels.append(("Noise (from 130 %)", "noise / rms of the roughness [%]", np.array(levels), noises))
    if not panels:
        return None
    caption = ("Dotted: reported standard deviation. Paper: all starts up to 170 % converge to the same values, at the "
               "same accuracy up to 3 % of noise. Noise-free images stand at 0.05 %.")
    picture = charts.errors_over(panels, SYMBOLS, "fig17_guess_and_noise", "Initial guess and noise (paper: fig. 17)",
                                 caption, [heading.startswith("Noise") for heading, *_ in panels])
    return StudySection("guess", "Initial guess and noise", "", (_noise_table(noises),) if noises else (),
                        (picture,)), _guess_goals(guesses)


def _noise_table(noises: list[CaseRecord]) -> Table:
    names = noises[0].names
    rows = tuple((f"{0.1 * float(r.name):g} %", *(f"{100 * e:+.2g} ({100 * s:.2g})" for e, s in zip(
        r.relative_error, r.relative_std, strict=True)), str(r.facts["iterations"]),
        r.facts["status"].replace("_", " ")) for r in noises)
    return Table("Error (reported std) in %, from 130 %", ("noise", *(PLAIN[n] for n in names), "iterations", "status"),
                 rows)


def _guess_goals(guesses: list[CaseRecord]) -> list[Goal]:
    if not guesses:
        return []
    fine = [r.name for r in guesses if r.explained and ended_right(r)]
    return [Goal("equal starts of all parameters", "70 to 170 % (paper), here up to 200 %",
                 f"right from {', '.join(str(int(name)) for name in fine)} %", len(fine) == len(guesses))]


def ended_right(record: CaseRecord) -> bool:
    """Every parameter within 3 reported standard deviations of the truth, without noise within 0.1 %."""
    close = np.abs(record.normalised_error) <= WITHIN_STDS
    if record.facts["case"]["noise"] == 0.0:
        close |= np.abs(record.relative_error) <= WITHIN
    return bool(close.all())


def _starts(records: Records):
    cases = [r for r in records.values() if r.group == "starts"]
    if not cases:
        return None
    right = [r.explained and ended_right(r) for r in cases]
    false = [r.name for r in cases if r.explained and not ended_right(r)]
    rows = tuple((r.name, *(f"{s / t:.2f}" for s, t in zip(r.arrays["start"], r.arrays["truth"], strict=True)),
                  r.outcome, str(r.facts["iterations"]), str(r.facts["evaluations"]),
                  f"{100 * np.abs(r.relative_error).max():.2g} %") for r in cases)
    table = Table("", ("start", *(PLAIN[n] for n in cases[0].names), "status", "iterations", "evaluations",
                       "largest error"), rows, "Start values over true values, log-uniform from 0.5 to 3, seed 2014.")
    picture = charts.starts(cases, right, SYMBOLS, "starts", "Random starts",
                            "Shaded: not at the truth; right: the status of the identification.")
    goals = [Goal(f"random starts (50 to 300 % per parameter) that reach the truth, of {len(cases)}",
                  f"at least {MIN_SUCCESSFUL_STARTS}", str(sum(right)), sum(right) >= MIN_SUCCESSFUL_STARTS),
             Goal("random starts that converge elsewhere without a residual beyond the noise", "none",
                  ", ".join(false) if false else "none", not false)]
    return StudySection("starts", "Random starts", "", (table,), (picture,)), goals


def _draws(records: Records):
    groups, counted = [], []
    for group, size in (("draws", ""), ("draws-full", ", full size")):
        members = [r for r in records.values() if r.group == group]
        for noise in dict.fromkeys(r.name.partition("-")[0] for r in members):
            drawn = [r for r in members if r.name.partition("-")[0] == noise]
            errors = np.array([r.normalised_error for r in drawn if r.converged])
            if len(errors) > 1:
                groups.append((f"{int(noise)} % noise, {len(errors)} draws{size}", errors))
                counted.append((len(drawn), len(errors), np.mean([r.relative_std for r in drawn], axis=0)))
    if not groups:
        return None
    names = next(r.names for r in records.values() if r.group in ("draws", "draws-full"))
    rows = tuple((label, *(f"{s:.2f} ({100 * d:.2g} %)" for s, d in zip(errors.std(axis=0, ddof=1), stds, strict=True)),
                  "{:.2f} … {:.2f}".format(*charts.chance(len(errors))), f"{good} of {number}")
                 for (label, errors), (number, good, stds) in zip(groups, counted, strict=True))
    table = Table("Standard deviation of (error / reported std), mean reported std in brackets",
                  ("", *(PLAIN[n] for n in names), "99 % of chance", "converged"), rows)
    picture = charts.draws(groups, [SYMBOLS[n] for n in names], "monte_carlo", "Error bars over draws",
                           "Grey: 99 % of such figures if the reported standard deviations hold.")
    inside = [low <= s <= high for _, errors in groups for low, high in [charts.chance(len(errors))]
              for s in errors.std(axis=0, ddof=1)]
    goals = [Goal("std of (error / reported std), every parameter and noise", "consistent with 1 (99 % of chance)",
                  f"{sum(inside)} of {len(inside)} inside", bool(sum(inside) >= len(inside) - 1))]
    return StudySection("draws", "Monte Carlo: the error bars", "Every draw has its own noise on all images, the "
                        "reference included.", (table,), (picture,)), goals


def _windows(records: Records):
    cases = [r for r in records.values() if r.group == "window"]
    if not cases:
        return None
    ends = np.array([int(r.name) for r in cases])
    times = cases[0].arrays["times"]
    lines = [(f"frames 1 … {end}", 1e3 * r.arrays["level_abs"], times[-1] * end / 200) for end, r in
             zip(ends, cases, strict=True)]
    if "from130/all" in records:
        lines.append(("right law", 1e3 * records["from130/all"].arrays["level_abs"], None))
    rows = tuple(_window_row(r, int(end), times) for end, r in zip(ends, cases, strict=True))
    frame_numbers = (25, 50, 75, 100, 125, 150, 200)
    table = Table("Elastic strip: errors, and mean |r| [nm] of some frames (* used)",
                  ("frames used", "E", "E, prototype", "C10", "C10, prototype", *(f"frame {k}" for k in frame_numbers)),
                  rows)
    c10 = np.array([abs(r.relative_error[r.names.index("elastomer.C10")]) for r in cases])
    e = np.array([r.relative_error[r.names.index("strip.E")] for r in cases])
    goals = [Goal("model error: C10 of an elastic strip", "within 0.1 % in every window", f"{100 * c10.max():.2g} %",
                  bool(c10.max() <= 1e-3)),
             Goal("model error: E falls with plastic frames", "monotonously",
                  f"{100 * e[0]:+.1f} % … {100 * e[-1]:+.0f} %", bool((np.diff(e) < 0.0).all()))]
    pictures = (charts.frame_levels(times, lines, "nm", "fig18_model_error",
                                    "Residual of a wrong law, by the frames used (paper: fig. 18b)",
                                    "Elastic strip; bold: frames used, dashed: other frames. As in the paper the "
                                    "residual rises with the first plastic frames and has a dip at about 3/4 of the "
                                    "window, where it changes sign."), figures.model_error(cases, ends))
    return StudySection("model-error", "Model error: an elastic strip", "", (table,), pictures), goals


def _window_row(record: CaseRecord, end: int, times: np.ndarray) -> tuple[str, ...]:
    e, c10 = (100 * record.relative_error[record.names.index(name)] for name in ("strip.E", "elastomer.C10"))
    trial = TRIAL_WINDOWS[end]
    levels, last_frame = record.arrays["level_abs"], len(times) - 1
    cells = [f"{1e3 * levels[round(k / 200 * last_frame)]:.3g}{'*' if k <= end else ''}" for k in
             (25, 50, 75, 100, 125, 150, 200)]
    return (f"1 … {end}", f"{e:+.2g} %", f"{trial[0]:+.2g} %", f"{c10:+.1g} %", f"{trial[1]:+.1g} %", *cells)


def _twin(records: Records):
    if "twin/foreign" not in records:
        return None
    record = records["twin/foreign"]
    same_mesh = records.get("from130/all")
    rows = tuple((PLAIN[n], f"{v:.6g}", f"{t:g}", f"{100 * e:+.2g} %", f"{100 * s:.1g} %",
                  "–" if same_mesh is None else f"{100 * same_mesh.relative_error[i]:+.1g} %") for i, (n, v, t, e, s) in
                 enumerate(zip(record.names, record.arrays["value"], record.arrays["truth"], record.relative_error,
                               record.relative_std, strict=True)))
    level = float(1e3 * np.nanmean(record.arrays["level_abs"]))
    table = Table("", ("parameter", "value", "true value", "discretisation bias", "reported std", "same mesh"), rows,
                  f"No noise. Mean |r| {level:.2g} nm. The std counts noise only; the bias is that of the mesh and the "
                  "increments of the model.")
    return StudySection("twin", "Discretisation: the truth on another mesh, with five times finer steps",
                        "The other sections use images of the mesh of the model.", (table,)), []


def _forms(records: Records):
    if not {"forms/K", "forms/K0"} <= records.keys():
        return None
    rows = []
    for key, label, pair in (("forms/K", "σy + K ep^n", ("strip.K", "strip.n")),
                             ("forms/K0", "σy + K0 (ep/ep0)^n", ("strip.K0", "strip.n"))):
        record = records[key]
        names, matrix = record.facts["correlation"]["names"], np.array(record.facts["correlation"]["matrix"])
        correlation = matrix[names.index(pair[0]), names.index(pair[1])]
        M = record.arrays["M"]
        size = np.sqrt(np.diagonal(M))
        stds = dict(zip(record.names, record.relative_std, strict=True))
        derived = record.facts["derived"].get("strip.K")
        std_k = stds.get("strip.K", np.nan) if derived is None else derived["std"] / derived["value"]
        rows.append((label, f"{correlation:+.4f}", f"{np.linalg.cond(M):.1e}",
                     f"{np.linalg.cond(M / np.outer(size, size)):.1e}",
                     f"{100 * stds[pair[0]]:.2g} %", f"{100 * stds['strip.n']:.2g} %", f"{100 * std_k:.2g} %",
                     str(record.facts["iterations"])))
    table = Table("Two forms of the same law on the same images (1 % noise)",
                  ("hardening", "correlation of the pair", "condition of M", "scaled", "std of K or K0", "std of n",
                   "std of K", "iterations"), tuple(rows),
                  "Condition of M in ln(parameter); scaled: unit diagonal. K of the second form follows from K0, n and "
                  "their covariance. ep0 = 2e-3.")
    return StudySection("forms", "Correlation of K and n", "", (table,)), []
