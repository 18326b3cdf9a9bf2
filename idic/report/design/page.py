"""The page and the table of `idic design`: one self-contained HTML file from the content of design.json."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from functools import partial

from idic.parameters import digits_text
from idic.report.design import figures as design_figures, words as say
from idic.report.design.figures import PlanPictures
from idic.report.html import filled_in
from idic.report.page import Section
from idic.report.result.words import number_text, short_names, two_digits

MAX_LISTED_DIRECTIONS = 12  # best and worst ones that the page lists; design.json has all

__all__ = ["PlanPictures", "design_table", "draw_design", "render_design"]


def draw_design(content: Mapping, pictures: Sequence[PlanPictures]) -> tuple[Section, ...]:
    """The figures: one section for all plans, one for each."""
    plans = content["plans"]
    sections = [Section("expected", "Expected error bars", "", (design_figures.expected(content),))]
    for number, (plan, picture) in enumerate(zip(plans, pictures, strict=True)):
        title = "Sensitivities" if len(plans) == 1 else f"Plan {plan['name']}"
        sections.append(Section(f"plan{number}", title, "", tuple(design_figures.plan_pictures(plan, picture))))
    return tuple(sections)


def render_design(content: Mapping, sections: tuple[Section, ...]) -> str:
    """The HTML text."""
    plans, several = content["plans"], len(content["plans"]) > 1
    comparison = content["comparison"]
    first = say.best_plan(comparison) if several else say.headline(plans[0])
    return filled_in(
        "design.html.j2", title=" – ".join(dict.fromkeys(plan["title"] for plan in plans)), first=first,
        several=several, words=partial(say.in_words, plans[0]) if all(plan["points"] for plan in plans) else str,
        overview=sections[0],
        separation=_separation_rows(content.get("separation")), comparison=comparison and _comparison_rows(comparison),
        notes=[] if content["joint"] is None else content["joint"]["notes"],
        plans=[_plan(plan, section) for plan, section in zip(plans, sections[1:], strict=True)])


def _separation_rows(separation: Mapping | None) -> dict | None:
    """What the page says of candidates that the plans shall tell apart; None without them."""
    if separation is None:
        return None
    rows = []
    for plan in separation["plans"]:
        pair = min(plan["pairs"], key=lambda entry: entry["log_odds"], default=None)
        rows.append({"name": plan["name"], "problem": plan["problem"],
                     "log_odds": "–" if plan["log_odds"] is None else f"{plan['log_odds']:.3g}",
                     "frames": "–" if plan["frames"] is None else str(plan["frames"]),
                     "load": "–" if plan["load"] is None else f"{100 * plan['load']:.0f} %",
                     "pair": "" if pair is None else " / ".join(name.replace("_", " ") for name in pair["members"])})
    course = separation["course"]
    program = [] if course is None else [
        f'"{column}" = [' + ", ".join(f"[{time:g}, {value:g}]" for time, value in points) + "]"
        for column, points in course["program"].items()]
    return {"members": ", ".join(name.replace("_", " ") for name in separation["members"]), "rows": rows,
            "sentences": separation["sentences"], "program": program}


def _plan(plan: Mapping, section: Section) -> dict:
    return {"name": plan["name"], "section": section, "headline": say.headline(plan), "facts": _facts(plan),
            "sentences": said(plan),
            "rows": parameter_rows(plan), "directions": _direction_rows(plan),
            "motion_unit": say.motion_unit(plan)[1],
            "has_channels": bool(plan["channels"]), "has_test": _has_test(plan),
            "assumptions": _in_words(plan, (*plan["assumptions"], *plan["notes"])),
            "words": partial(say.in_words, plan)}


def said(plan: Mapping) -> list[str]:
    """Facts on a plan, shown below the table."""
    return _in_words(plan, (*say.open_parameters(plan), *say.confusions(plan), say.weakest(plan),
                            *say.mode_groups(plan["parameters"])))


def assumed(plan: Mapping) -> list[str]:
    """What was taken for granted, in sentences."""
    return _in_words(plan, plan["assumptions"])


def _in_words(plan: Mapping, texts: Iterable[str]) -> list[str]:
    return [say.in_words(plan, text) for text in texts]


def _facts(plan: Mapping) -> list[tuple[str, str]]:
    noise = f"{digits_text(plan['noise']['std_gv'])} {plan['noise']['unit']}"
    facts = [("frames", f"{plan['frames']} in {plan['duration_s']:g} s")]
    if plan["points"] is None:
        facts += [("image", f"{say.seen_area(plan)}, {plan['pixels']} on the specimen"),
                  ("pattern", plan["pattern"]), ("camera noise σ", noise)]
    else:
        facts += [(plan["pattern"], say.seen_area(plan)), ("noise of a component σ", noise)]
    facts.append(("largest motion", say.largest_motion(plan)))
    for name, channel in plan["channels"].items():
        facts.append((name, f"up to {channel['peak']:.4g} {channel['unit']}, σ {digits_text(channel['noise_std'])}"))
    if plan["condition"] is not None:
        facts.append(("condition of M", f"{plan['condition']:.2g}"))
    return facts


def _has_test(plan: Mapping) -> bool:
    return any(entry["std_test_known"] is not None for entry in plan["parameters"].values())


def parameter_rows(plan: Mapping) -> list[dict]:
    """The table of one plan as text: – where something is not determined, no row for the modes of boundaries."""
    parameters = say.named(plan["parameters"])
    short_name, rows, scale = short_names(parameters), [], say.motion_unit(plan)[0]
    for name, entry in parameters.items():
        std = entry["std"]
        rows.append({
            "full": name, "name": short_name[name], "unit": entry["unit"] or "–",
            "value": number_text(entry["value"]), "std": short(std),
            "relative": "–" if entry["relative_std"] is None else say.percent(entry["relative_std"]),
            "image": short(entry["std_images_only"]), "known": short(entry["std_test_known"]),
            "motion": "" if entry["motion_px"] is None else _px(entry["motion_px"], scale),
            "frame": "" if entry["motion_frame"] is None else str(entry["motion_frame"]),
            "grade": entry["grade"], "verdict": say.GRADES[entry["grade"]]})
    return rows


def _px(motion: float, scale: float) -> str:
    return f"{scale * motion:.3g}" if motion > 1e-6 else "0"


def short(std: float | None) -> str:
    """A standard deviation to two digits; – for None."""
    return "–" if std is None else two_digits(std)


def _direction_rows(plan: Mapping) -> list[dict]:
    n = len(plan["directions"])
    return [{"number": i + 1, "text": entry["text"], "std": short(entry["std"]), "determined": entry["determined"],
             "fixed": entry["fixed"] or "", "eigenvalue": f"{value:.3g}"}
            for i, (entry, value) in enumerate(zip(plan["directions"], plan["eigenvalues"], strict=True))
            if i < MAX_LISTED_DIRECTIONS or i >= n - MAX_LISTED_DIRECTIONS]


def _comparison_rows(comparison: Mapping) -> dict:
    short_name = short_names(comparison["parameters"])
    rows = [{"name": short_name[name], "full": name, "unit": entry["unit"] or "–",
             "cells": [{"text": short(entry["std"][plan]) if plan in entry["std"] else "",
                        "best": plan == entry["best"]} for plan in comparison["plans"]],
             "joint": short(entry["joint"])} for name, entry in comparison["parameters"].items()]
    condition = [comparison["condition"][plan] for plan in (*comparison["plans"], "joint")]
    return {"plans": comparison["plans"], "rows": rows,
            "condition": ["–" if value is None else f"{value:.2g}" for value in condition]}


def design_table(content: Mapping) -> str:
    """CSV: one row per plan and parameter, the joint identification under the name ``joint``."""
    keys = ("value", "unit", "std", "relative_std", "grade", "std_images_only", "std_test_known", "motion_px",
            "motion_frame")
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(("plan", "parameter", *keys))
    plans = [(plan["name"], plan["parameters"]) for plan in content["plans"]]
    if content["joint"] is not None:
        plans.append(("joint", content["joint"]["parameters"]))
    for plan, parameters in plans:
        for name, entry in parameters.items():
            cells = [entry.get(key) for key in keys]
            writer.writerow((plan, name, *("" if c is None else f"{c:.10g}" if isinstance(c, float) else c
                                           for c in cells)))
    return buffer.getvalue()
