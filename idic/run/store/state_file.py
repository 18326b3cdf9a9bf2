"""``RUN/state.json``: the state of the identification loop, with exact floats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from idic.identification import LoopState
from idic.run.store.checkpoint import from_hex, load_checkpoint, save_checkpoint, to_hex

STATE_FILE = "state.json"
STATE_SCHEMA = "idic.state/2"


def save_state(run: str | Path, state: LoopState) -> None:
    """Replace the state of a RUN atomically."""
    record = asdict(state)
    _convert_numbers(record, to_hex)
    save_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA, record)


def load_state(run: str | Path) -> LoopState | None:
    """The state in a RUN folder, or None.

    Raises
    ------
    InputError
        The file is damaged.
    """
    record = load_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA)
    if record is None:
        return None
    _convert_numbers(record, from_hex)
    return LoopState.of_content(record)


def _convert_numbers(record: dict, convert: Callable) -> None:
    """Convert the floats of a nested state in place, from or to their exact text."""
    trial, accepted, estimator = record["trial"], record["accepted"], record["estimator"]
    accepted_points = [accepted] if accepted else []
    for owner in (trial, *trial["parallel"], *record["history"], *accepted_points):
        owner["values"] = {name: convert(value) for name, value in owner["values"].items()}
    for owner, key in ((estimator, "ordinary_solution"), (record["increments"], "coarser"),
                       (record["increments"], "change")):
        if owner[key] is not None:
            owner[key] = {name: convert(value) for name, value in owner[key].items()}
    numbers = [(record["trust"], "radius"), (record["trust"], "damping"),
               *((point, "phi") for point in accepted_points), *((step, "damping") for step in trial["parallel"])]
    for owner, name in numbers:
        owner[name] = None if owner[name] is None else convert(owner[name])
