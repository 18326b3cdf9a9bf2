"""Variants whose course in time the data give: the pattern of a cause times one amplitude per knot.

Ramps, jumps and motions in proportion follow few courses. A load cell that wanders off and back, or a grip that swings,
has none of them: its drift at a constant rate is zero. The free course of the same pattern (`records.free_course`)
holds all courses that are smooth over some frames, so that one test of its knots together stands for them.

Of the courses that explain as much, the one with the fewest knots is taken; it is zero at the others. A reading that
drifts in proportion to the load is another modulus: with all knots free both would be open.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

from idic.diagnose.physics.candidate import Candidate, Variant
from idic.diagnose.residual.score import Scores
from idic.diagnose.residual.thinning import drop_on_copy
from idic.diagnose.screen.courses import SUPPOSED_EXPANSION_PER_K
from idic.errors import InputError
from idic.images import CameraMotion
from idic.laws import EXPANSION
from idic.model import CorrectionTerm, Experiment, KNOTS, TEMPERATURE, channel_term, term_of_motion, without_knot

MIN_KNOT_CHI2 = 9.0  # drop of chi-square that a knot must bring
MAX_KNOTS_IN_SETS = 8  # 255 sets
KNOTTED = {"course": "free", "knots": KNOTS}
SEEN = {f"{kind}_{course}": kind for kind in ("magnification", *CameraMotion.shapes) for course in ("drift", "load")}


def with_free_courses(trials: Sequence[tuple[Candidate, Variant]], document: Mapping[str, Any],
                      free_names: Collection[str],
                      load: Callable[[Mapping[str, Any]], Experiment]) -> list[tuple[Candidate, Variant]]:
    """One variant with a free course for every degree of freedom of these trials that has a course.

    document : tables of the null; free_names : names of its free degrees of freedom; load : edits -> experiment
    """
    trials_by_stem: dict[str, tuple[Candidate, Variant]] = {}
    for candidate, variant in trials:
        stem = course_stem(variant)
        if stem in trials_by_stem or (edits := free_edits(document, variant.edits, variant)) is None:
            continue
        try:
            experiment = load(edits)
        except InputError:  # a camera with a lens has no such course
            continue
        knots = tuple(name for name in experiment.model.parameters.free if name not in free_names)
        if len(knots) > 1:
            label = f"{stem}, with an identified time course"
            trials_by_stem[stem] = candidate, Variant(label, edits, knots, dict.fromkeys(knots, 0.0),
                                                      dict.fromkeys(knots, 0.0),
                                                      direct=variant.direct, exact=variant.exact, free_course=True,
                                                      sign=variant.sign if variant.direct else 0)
    return list(trials_by_stem.values())


def fewest_knots(scores: Scores, members: Sequence[int]) -> list[int]:
    """Of the columns of a free course those that explain most of its drop of chi-square on a copy, less
    `MIN_KNOT_CHI2` each: of all sets, or, of many scans with a knot each, by leaving out one after the other."""
    def worth(knots: Sequence[int]) -> float:
        return drop_on_copy(scores.gain(knots), len(knots)) - MIN_KNOT_CHI2 * len(knots)

    if len(members) <= MAX_KNOTS_IN_SETS:
        return max((list(knots) for n in range(1, len(members) + 1) for knots in combinations(members, n)), key=worth)
    chosen = list(members)
    while len(chosen) > 1:
        fewer = max(([knot for knot in chosen if knot != candidate] for candidate in chosen), key=worth)
        if worth(fewer) < worth(chosen):
            break
        chosen = fewer
    return chosen


def with_knots(variant: Variant, names: Collection[str]) -> Variant:
    """A free course that is zero at all knots but these."""
    if len(names) == len(variant.new):
        return variant
    dropped = [name for name in variant.new if name not in names]
    entries = [entry for entry in variant.edits["dof"] if entry["name"] not in dropped]
    locked = [{"name": name, "value": 0.0, "identify": False} for name in dropped]
    knots = tuple(name for name in variant.new if name in names)
    return replace(variant, edits={**variant.edits, "dof": [*entries, *locked]}, new=knots,
                   null=dict.fromkeys(knots, 0.0), probe=dict.fromkeys(knots, 0.0))


def free_edits(document: Mapping[str, Any], edits: Mapping[str, Any], variant: Variant,
               course: Mapping[str, Any] = KNOTTED) -> dict[str, Any] | None:
    """Edits of a variant with knots in the place of its course; None where it has none to free.

    document : tables of the model without the candidate; course : of a correction
    """
    if len({without_knot(name) for name in variant.new}) != 1:
        return None
    name = without_knot(variant.new[0])
    tables_of_edits = {"dof": [dict(entry) for entry in document.get("dof", ())], **edits}
    stem, _, word = name.rpartition(".")
    if (correction := term_of_motion(name)) is not None and correction.is_timed:
        tables = copy.deepcopy(list(tables_of_edits["boundary"]))
        for table in tables:
            for component in "xyz":
                named = stem == f"boundary.{table.get('nodes')}.{component}"
                if named and isinstance(table.get(f"u{component}"), Mapping):
                    _free(table[f"u{component}"]["corrections"], correction, course)
        return tables_of_edits | {"boundary": tables}
    term = channel_term(word) if name.startswith("channel.") else None
    if term is not None and term.course is not None:
        tables = copy.deepcopy(list(tables_of_edits.get("channel", document["channel"])))
        for table in tables:
            if stem == f"channel.{table['column']}":
                table.pop(term.course.start, None)
                table[term.course.knots] = KNOTS
        return _without(tables_of_edits, name) | {"channel": tables}
    if word == EXPANSION.name and (tables_of_edits.get("boundary") or [{}])[-1].get("temperature", {}).get("course"):
        supposed = {"value": SUPPOSED_EXPANSION_PER_K, "unit": EXPANSION.unit}
        return tables_of_edits | {f"material.{name}": supposed,
                                  "boundary": [*tables_of_edits["boundary"][:-1], {"temperature": dict(KNOTTED)}]}
    key = "camera.0" if isinstance(document.get("camera"), list) else "camera"
    if SEEN.get(word) in CameraMotion.shapes:
        *shapes, newest = tables_of_edits[f"{key}.deflections"]
        return tables_of_edits | {f"{key}.deflections": [*shapes, {"shape": newest["shape"], "knots": KNOTS}]}
    if word in SEEN:
        tables_of_edits.pop(f"{key}.magnification_column", None)
        return _without(tables_of_edits, name) | {f"{key}.magnification_knots": KNOTS}
    return None


def course_stem(variant: Variant) -> str:
    """The degree of freedom of a variant without its course."""
    name = without_knot(variant.new[0]) if variant.new else ""
    stem, _, word = name.rpartition(".")
    if word == EXPANSION.name:
        return TEMPERATURE
    term = channel_term(word) if name.startswith("channel.") else None
    kind = SEEN.get(word, word) if term is None else term.names[0]
    return f"{stem}.{kind}" if stem else name


def _free(corrections: list[dict], term: CorrectionTerm, course: Mapping[str, Any]) -> None:
    """Knots or jumps in the place of the course of the last correction of a kind."""
    number = max(i for i, entry in enumerate(corrections) if entry["kind"] == term.kind)
    of_pattern = {"kind", *(key.name for key in term.keys)}
    entries = {key: value for key, value in corrections[number].items() if key in of_pattern}
    corrections[number] = entries | dict(course)


def _without(edits: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Edits whose [[dof]] lack a name."""
    return {**edits, "dof": [entry for entry in edits["dof"] if entry["name"] != name]}
