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
