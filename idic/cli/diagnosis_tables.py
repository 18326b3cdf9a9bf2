"""Tables of a diagnosis in the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.table import Table

CANDIDATES_SHOWN = 8


def candidates_table(content: Mapping) -> Table:
    """The strongest candidates of a diagnosis.json, and those that it names."""
    from idic.identification import p_text, z_text
    from idic.diagnose import candidate_library
    from idic.report import STANDINGS, heldout_drop, standing_of, strongest

    titles = {candidate.name: candidate.title for candidate in candidate_library()}
    table = Table(box=None, header_style="bold")
    for column in ("candidate", "score", "p", "effect px", "visible", "predicted", "achieved", "held out", ""):
        table.add_column(column, justify="left" if column in ("candidate", "") else "right")
    for entry in strongest(content, CANDIDATES_SHOWN):
        drops = [_number(entry[key]) for key in ("predicted_chi2_drop", "achieved_chi2_drop")]
        standing = standing_of(content, entry, STANDINGS[entry["standing"]])
        title = titles.get(entry["name"], entry["name"].replace("_", " "))
        table.add_row(title, z_text(entry["score"]), p_text(entry["p_familywise"]), f"{entry['effect_px_rms']:.2g}",
                      f"{entry['visibility']:.2f}", *drops, heldout_drop(entry), standing)
    return table


def told(content: Mapping) -> list[str]:
    """What a diagnosis says, line by line: headline, residual excess, effects not excluded, next test, cautions."""
    lines = [content["headline"], *([content["left_over"]] if content["left_over"] else ())]
    if content["not_excluded"]:
        lines += ["Not excluded:", *(f"· {entry['title']}: {entry['why']}" for entry in content["not_excluded"])]
    if content["next_experiment"]:
        lines.append(f"Next: {content['next_experiment']}.")
    if content.get("separate"):
        lines.append(f"To tell them apart: {content['separate']}.")
    return lines + list(content["cautions"])


def physics_table(candidates: Sequence) -> Table:
    """The library: name, family, physics, null value, rivals, tests that separate it from them."""
    table = Table(header_style="bold", show_lines=True)
    names = (name for candidate in candidates for name in (candidate.name, *candidate.rivals))
    longest = max(len(name) + 1 for name in names)  # a name is not broken
    for column in ("name", "family and side", "physics", "absent at", "rivals", "separating tests"):
        table.add_column(column, overflow="fold", no_wrap=column == "name",
                         min_width=longest if column == "rivals" else None)
    for candidate in candidates:
        rivals = "\n".join(f"{name}: {reason}" for name, reason in candidate.rivals.items())
        table.add_row(candidate.name, f"{candidate.family}\n({candidate.side})", described(candidate), candidate.null,
                      rivals, "\n".join(f"· {test}" for test in candidate.separating_tests))
    return table


def described(candidate) -> str:
    """Name of a candidate in standard words, its paraphrase in brackets."""
    return candidate.title + (f" ({candidate.paraphrase})" if candidate.paraphrase else "")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
