"""`idic design` in the terminal: a table per plan, a table of all plans, and the sentences to them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from idic.report.design.page import assumed, parameter_rows, said, short
from idic.report.design.words import best_plan, in_words, largest_motion, motion_unit, seen_area
from idic.report.terminal.text_table import Line, TextTable


def plan_table(plan: Mapping) -> TextTable:
    """Expected standard deviations of one plan."""
    rows, has_channels = parameter_rows(plan), bool(plan["channels"])
    has_test = any(entry["std_test_known"] is not None for entry in plan["parameters"].values())
    columns = [("parameter", "full"), ("assumed", "value"), ("± std", "std"), ("unit", "unit"),
               ("relative", "relative"),
               *([(in_words(plan, "images only"), "image")] if has_channels else []),
               *([("test known", "known")] if has_test else []),
               (f"motion {motion_unit(plan)[1]}", "motion"), ("", "verdict")]
    words = frozenset(title for title, key in columns if key in ("full", "unit", "verdict"))
    return TextTable(tuple(title for title, _ in columns), words,
                     rows=[[row[key] for _, key in columns] for row in rows])


def comparison_table(comparison: Mapping) -> TextTable:
    """Standard deviations per plan, the best one marked, and of all plans together."""
    table = TextTable(("± std of", *comparison["plans"], "all together", "unit"), frozenset(("± std of", "unit")))
    for name, entry in comparison["parameters"].items():
        cells = [(short(entry["std"][plan]) if plan in entry["std"] else "") + "*" * (plan == entry["best"])
                 for plan in comparison["plans"]]
        table.add_row(name, *cells, short(entry["joint"]), entry["unit"])
    return table


def separation_table(separation: Mapping) -> TextTable:
    """The plans by how well they tell the candidates of a diagnosed run apart, the best first."""
    table = TextTable(("plan", "log-odds", "99:1 after frames", "at load", "hardest pair"),
                      frozenset(("plan", "hardest pair")))
    for plan in separation["plans"]:
        if plan["log_odds"] is None:
            table.add_row(plan["name"], "–", "–", "–", plan["problem"])
            continue
        pair = min(plan["pairs"], key=lambda entry: entry["log_odds"])
        table.add_row(plan["name"], f"{plan['log_odds']:.3g}", "–" if plan["frames"] is None else str(plan["frames"]),
                      "–" if plan["load"] is None else f"{100 * plan['load']:.0f} %",
                      " / ".join(name.replace("_", " ") for name in pair["members"]))
    return table


def separation_lines(separation: Mapping) -> Iterator[Line | TextTable]:
    """The ranking of the plans, and the programme of the best course."""
    yield Line("candidates of " + separation["run"] + ": "
               + ", ".join(name.replace("_", " ") for name in separation["members"]), "bold")
    yield separation_table(separation)
    yield from map(Line, separation["sentences"])
    if separation["course"]:
        yield Line("[design.program]")
        for column, points in separation["course"]["program"].items():
            listed = ", ".join(f"[{time:g}, {value:g}]" for time, value in points)
            yield Line(f'"{column}" = [{listed}]')


def design_lines(content: Mapping) -> Iterator[Line | TextTable]:
    """Tables and sentences of all plans of design.json."""
    for plan in content["plans"]:
        yield Line(f"{plan['name']}: {plan['frames']} frames, {seen_area(plan).replace('×', 'x')}, "
                   f"largest motion {largest_motion(plan)}", "bold")
        yield plan_table(plan)
        yield from map(Line, said(plan))
        yield from (Line(f"assumed: {text}", "dim") for text in assumed(plan))
    if len(content["plans"]) > 1:
        yield Line("comparison (* best of the plans)", "bold")
        yield comparison_table(content["comparison"])
        yield Line(best_plan(content["comparison"]))
        yield from (Line(f"note: {text}") for text in content["joint"]["notes"])
    if "separation" in content:
        yield from separation_lines(content["separation"])
