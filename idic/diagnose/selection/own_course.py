"""A course that the data give, where the course of a selected cause leaves something.

Candidates are screened with a few courses: in proportion to the motion or to time, ramps and jumps from some moments on.
The cause that is selected keeps its pattern. Where its refit leaves more than noise, its course becomes linear between knots
(`idic.model.free_course`) and the model is refitted; the copy without a part in the fit decides whether that course stays.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from idic.diagnose.courses import TIMED, course_of
from idic.diagnose.refit import Refit
from idic.diagnose.refit_job import ExperimentSource, RefitJob, Refits
from idic.diagnose.residual.heldout import Fit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.candidate import Variant
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival
from idic.diagnose.selection.rivals import edits_of
from idic.errors import InputError
from idic.model.free_course import KNOTS, without_knot

MIN_LEFT_Z = 3.0  # standard deviations of what a refit leaves in motions or channels


def with_own_course(source: ExperimentSource, null: Refit, winner: Rival, screening: Screening, refits: Refits, grid: Grid,
                    seed: int) -> Rival | None:
    """The winner of a round with a course that the data give; None where it has no course, or needs no other one."""
    if winner.copies > 1 or winner.refitted.choice is None or not leaves_something(winner.refitted.choice):
        return None
    edits = free_edits(source.document(), edits_of(winner, screening), winner.ranked.variant)
    if edits is None:
        return None
    try:
        before, after = source.load(edits_of(winner, screening)), source.load(edits)
    except InputError:  # a camera with a lens has no such course
        return None
    new = tuple(name for name in after.parameters.free if name not in before.parameters)
    (old,) = winner.ranked.variant.new
    course = course_of(before, old)
    if course is None or len(new) < 2:
        return None
    size = winner.refitted.values[old]
    start = {}
    for name in new:
        hat = course_of(after, name)
        top = int(np.argmax(np.abs(hat)))
        start[name] = size * float(course[top] / hat[top])
    variant = Variant(f"{winner.ranked.variant.label}, with a course of its own", edits, new, dict.fromkeys(new, 0.0), start)
    (answer,) = refits([RefitJob(winner.name, source, (variant.label,), (edits,), ({**winner.refitted.values, **start},),
                                 winner.refitted.local, grid, np.inf, seed)])
    if not answer.usable:
        return None
    freed = replace(winner, ranked=replace(winner.ranked, variant=variant, label=variant.label), refitted=answer,
                    achieved=null.choice.chi2 - answer.choice.chi2,
                    heldout=null.judgement.chi2 - answer.judgement.chi2)
    return freed if freed.heldout - winner.heldout > MIN_HELDOUT_DROP + len(new) - 1 else None


def has_own_course(rival: Rival) -> bool:
    """Whether its course is given by the data."""
    return any(without_knot(name) != name for name in rival.ranked.variant.new)


def leaves_something(one: Fit) -> bool:
    """Whether a fit leaves more than noise in motions or channels."""
    channels = float((one.channels**2).sum() - one.channels.size) / np.sqrt(2.0 * max(one.channels.size, 1))
    return max(one.excess_z, channels) > MIN_LEFT_Z


def free_edits(document: Mapping[str, Any], edits: Mapping[str, Any], variant: Variant) -> dict[str, Any] | None:
    """Edits of a variant with knots in the place of its course; None where it has none to free.

    document : tables of the model without the candidate
    """
    if len(variant.new) != 1:
        return None
    (name,), made = variant.new, dict(edits)
    stem, _, last = name.rpartition(".")
    if name.startswith("boundary.") and last in TIMED:
        tables = copy.deepcopy(list(made["boundary"]))
        for table in tables:
            for component in "xyz":
                if stem == f"boundary.{table.get('nodes')}.{component}" and isinstance(table.get(f"u{component}"), Mapping):
                    _free(table[f"u{component}"]["corrections"], last)
        return made | {"boundary": tables}
    if name.startswith("channel.") and last == "drift":
        tables = copy.deepcopy(list(made.get("channel", document["channel"])))
        for table in tables:
            if stem == f"channel.{table['column']}":
                table.pop("drift_from_s", None)
                table["drift_knots"] = KNOTS
        return _without(made, name) | {"channel": tables}
    if last in ("magnification_drift", "magnification_load"):
        key = "camera.0" if isinstance(document.get("camera"), list) else "camera"
        made.pop(f"{key}.magnification_column", None)
        return _without(made, name) | {f"{key}.magnification_knots": KNOTS}
    return None


def _free(corrections: list[dict], kind: str) -> None:
    """Knots in the place of the course of the last correction of a kind."""
    number = max(i for i, entry in enumerate(corrections) if entry["kind"] == kind)
    corrections[number] = {key: value for key, value in corrections[number].items() if key in ("kind", "towards")} | {
        "course": "free", "knots": KNOTS}


def _without(edits: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Edits whose [[dof]] lack a name."""
    return {**edits, "dof": [entry for entry in edits["dof"] if entry["name"] != name]}
