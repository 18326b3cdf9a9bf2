"""A diagnosis in the terminal."""

from __future__ import annotations

from collections.abc import Mapping

from idic.diagnose import candidate_library
from idic.identification import p_text, z_text
from idic.report.diagnosis.page import STANDINGS
from idic.report.diagnosis.words import heldout_drop, standing_of, strongest
from idic.report.terminal.text_table import TextTable

CANDIDATES_SHOWN = 8


def candidates_table(content: Mapping) -> TextTable:
    """The strongest candidates of a diagnosis.json, and those that it names."""
    titles = {candidate.name: candidate.title for candidate in candidate_library()}
    table = TextTable(("candidate", "score", "p", "effect px", "visible", "predicted", "achieved", "held out", ""),
                      frozenset(("candidate", "")))
    for entry in strongest(content, CANDIDATES_SHOWN):
        drops = [_number(entry[key]) for key in ("predicted_chi2_drop", "achieved_chi2_drop")]
        standing = standing_of(content, entry, STANDINGS[entry["standing"]])
        title = titles.get(entry["name"], entry["name"].replace("_", " "))
        table.add_row(title, z_text(entry["score"]), p_text(entry["p_familywise"]), f"{entry['effect_px_rms']:.2g}",
                      f"{entry['visibility']:.2f}", *drops, heldout_drop(entry), standing)
    return table


def diagnosis_lines(content: Mapping) -> list[str]:
    """What a diagnosis says, line by line: headline, residual excess, effects not excluded, next test, cautions."""
    lines = [content["headline"], *([content["left_over"]] if content["left_over"] else ())]
    if content["not_excluded"]:
        lines += ["Not excluded:", *(f"· {entry['title']}: {entry['why']}" for entry in content["not_excluded"])]
    if content["next_experiment"]:
        lines.append(f"Next: {content['next_experiment']}.")
    if content.get("separate"):
        lines.append(f"To tell them apart: {content['separate']}.")
    return lines + list(content["cautions"])


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
