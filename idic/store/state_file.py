"""``RUN/state.json``: the state of the identification loop, with exact floats."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from idic.identify.step.state import (GENERALISED_REJECTED, ORDINARY, AcceptedPoint, Activation, Ending,
                                      EstimatorChoice, IncrementChoice, LoopState, ParallelTrial, SchedulePosition,
                                      Trial, TrustRegion)
from idic.store.checkpoint import from_hex, load_checkpoint, save_checkpoint, to_hex

STATE_FILE = "state.json"
STATE_SCHEMA, FLAT_SCHEMA = "idic.state/2", "idic.state/1"


def save_state(run: str | Path, state: LoopState) -> None:
    """Replace the state of a RUN atomically."""
    record = asdict(state)
    _convert_numbers(record, to_hex)
    save_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA, record)


def load_state(run: str | Path) -> LoopState | None:
    """The state in a RUN folder, or None; states of earlier versions are converted.

    Raises
    ------
    InputError
        The file is damaged.
    """
    path = Path(run) / STATE_FILE
    if _schema(path) == FLAT_SCHEMA:
        record = _nested(load_checkpoint(path, FLAT_SCHEMA))
    else:
        record = load_checkpoint(path, STATE_SCHEMA)
    if record is None:
        return None
    record.setdefault("increments", asdict(IncrementChoice()))  # states of earlier versions
    record.setdefault("end", None)
    _convert_numbers(record, from_hex)
    trial, accepted, activation, end = (record[name] for name in ("trial", "accepted", "activation", "end"))
    trial["parallel"] = tuple(ParallelTrial(**other) for other in trial["parallel"])
    activation |= {name: tuple(activation[name]) for name in ("active", "reactivated")}
    return LoopState(**record | {
        "trial": Trial(**trial), "accepted": accepted and AcceptedPoint(**accepted),
        "trust": TrustRegion(**record["trust"]), "schedule": SchedulePosition(**record["schedule"]),
        "activation": Activation(**activation), "estimator": EstimatorChoice(**record["estimator"]),
        "increments": IncrementChoice(**record["increments"]), "history": tuple(record["history"]),
        "end": end and Ending(**end)})


def _convert_numbers(record: dict, convert: Callable) -> None:
    """Convert the floats of a nested state in place, from or to their exact text."""
    trial, accepted, estimator = record["trial"], record["accepted"], record["estimator"]
    known = [accepted] if accepted else []
    for owner in (trial, *trial["parallel"], *record["history"], *known):
        owner["values"] = {name: convert(value) for name, value in owner["values"].items()}
    for owner, key in ((estimator, "ordinary_solution"), (record["increments"], "coarser"),
                       (record["increments"], "change")):
        if owner[key] is not None:
            owner[key] = {name: convert(value) for name, value in owner[key].items()}
    numbers = [(record["trust"], "radius"), (record["trust"], "damping"), *((own, "phi") for own in known),
               *((other, "damping") for other in trial["parallel"])]
    for owner, name in numbers:
        owner[name] = None if owner[name] is None else convert(owner[name])


def _schema(path: Path) -> str | None:
    """The schema of a checkpoint; None if the file is unreadable."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return document.get("schema") if isinstance(document, dict) else None


def _nested(flat: Mapping) -> dict:
    """Convert a state of the flat schema to the present groups; older files lack some keys."""
    kind, accepted = flat.get("estimator", ORDINARY), None
    if flat["accepted"] is not None:
        accepted = {"values": flat["accepted"], "number": flat["accepted_evaluation"], "phi": flat["phi"]}
    parallel = [{"values": other["values"], "damping": other["damping"], "halvings": other["rung"]}
                for other in flat.get("beside", ())]
    return {
        "trial": {"values": flat["trial"], "parallel": parallel, "re_evaluation": flat.get("fresh", False),
                  "tries_activation": flat.get("sought", False)},
        "accepted": accepted,
        "trust": {"radius": flat.get("reach", to_hex(1.0)), "damping": flat["damping"], "rejections": flat["rejected"]},
        "schedule": {"stage": flat["stage"], "iterations": flat["stage_iterations"]},
        "activation": {"active": flat.get("felt", ()), "reactivated": flat.get("again", ()),
                       "rejections": flat.get("refused", 0)},
        "estimator": {"kind": GENERALISED_REJECTED if kind == "settled" else kind,
                      "ordinary_solution": flat.get("arrived")},
        "parallel_evaluations": flat.get("extra", 0),
        **{name: flat[name] for name in ("evaluations", "iteration", "status", "history")}}
