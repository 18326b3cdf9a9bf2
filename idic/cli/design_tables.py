"""`idic design` in the terminal: a table per plan, a table of all plans, and the sentences to them."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table


def plan_table(plan: Mapping) -> Table:
    """Expected standard deviations of one plan."""
    from idic.report import in_words, motion_unit, parameter_rows

    rows, has_channels = parameter_rows(plan), bool(plan["channels"])
    has_test = any(entry["std_test_known"] is not None for entry in plan["parameters"].values())
    columns = [("parameter", "full"), ("assumed", "value"), ("± std", "std"), ("unit", "unit"),
               ("relative", "relative"),
               *([(in_words(plan, "images only"), "image")] if has_channels else []),
               *([("test known", "known")] if has_test else []),
               (f"motion {motion_unit(plan)[1]}", "motion"), ("", "verdict")]
    table = Table(box=None, header_style="bold")
    for title, key in columns:
        table.add_column(title, justify="left" if key in ("full", "unit", "verdict") else "right")
    for row in rows:
        table.add_row(*(row[key] for _, key in columns))
    return table


def comparison_table(comparison: Mapping) -> Table:
    """Standard deviations per plan, the best one marked, and of all plans together."""
    from idic.report import short

    table = Table(box=None, header_style="bold")
    table.add_column("± std of")
    for title in (*comparison["plans"], "all together"):
        table.add_column(title, justify="right")
    table.add_column("unit")
    for name, entry in comparison["parameters"].items():
        cells = [(short(entry["std"][plan]) if plan in entry["std"] else "") + "*" * (plan == entry["best"])
                 for plan in comparison["plans"]]
        table.add_row(name, *cells, short(entry["joint"]), entry["unit"])
    return table


def separation_table(separation: Mapping) -> Table:
    """The plans by how well they tell the candidates of a diagnosed run apart, the best first."""
    table = Table(box=None, header_style="bold")
    for title in ("plan", "log-odds", "99:1 after frames", "at load", "hardest pair"):
        table.add_column(title, justify="left" if title in ("plan", "hardest pair") else "right")
    for plan in separation["plans"]:
        if plan["log_odds"] is None:
            table.add_row(plan["name"], "–", "–", "–", plan["problem"])
            continue
        pair = min(plan["pairs"], key=lambda entry: entry["log_odds"])
        table.add_row(plan["name"], f"{plan['log_odds']:.3g}", "–" if plan["frames"] is None else str(plan["frames"]),
                      "–" if plan["load"] is None else f"{100 * plan['load']:.0f} %",
                      " / ".join(name.replace("_", " ") for name in pair["members"]))
    return table


def show_separation(console, separation: Mapping) -> None:
    """Print the ranking of the plans, and the programme of the best course."""
    console.print("candidates of " + separation["run"] + ": "
                  + ", ".join(name.replace("_", " ") for name in separation["members"]), style="bold", highlight=False)
    console.print(separation_table(separation))
    for text in separation["sentences"]:
        console.print(text, highlight=False)
    if separation["course"]:
        console.print("[design.program]", highlight=False, markup=False)
        for column, points in separation["course"]["program"].items():
            listed = ", ".join(f"[{time:g}, {value:g}]" for time, value in points)
            console.print(f'"{column}" = [{listed}]', highlight=False, markup=False)


def show_design(console, content: Mapping) -> None:
    """Print tables and sentences of all plans."""
    from idic.report import assumed, best_plan, largest_motion, said, seen_area

    several = len(content["plans"]) > 1
    for plan in content["plans"]:
        console.print(f"{plan['name']}: {plan['frames']} frames, {seen_area(plan).replace('×', 'x')}, "
                      f"largest motion {largest_motion(plan)}", style="bold", highlight=False)
        console.print(plan_table(plan))
        for text in said(plan):
            console.print(text, highlight=False)
        for text in assumed(plan):
            console.print(f"assumed: {text}", highlight=False, style="dim")
    if several:
        console.print("comparison (* best of the plans)", style="bold", highlight=False)
        console.print(comparison_table(content["comparison"]))
        console.print(best_plan(content["comparison"]), highlight=False)
        for text in content["joint"]["notes"]:
            console.print(f"note: {text}", highlight=False)
    if "separation" in content:
        show_separation(console, content["separation"])
