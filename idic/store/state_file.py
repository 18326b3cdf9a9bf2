"""``RUN/state.json``: the state of the loop of an identification, floats to the last bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from idic.identify.step.parallel_steps import ParallelTrial
from idic.identify.step.state import LoopState
from idic.store.checkpoint import from_hex, load_checkpoint, save_checkpoint, to_hex

STATE_FILE = "state.json"
STATE_SCHEMA = "idic.state/1"


def save_state(run: str | Path, state: LoopState) -> None:
    """Replace the state of a RUN whole."""
    record = asdict(state)
    record["trial"] = _hex(state.trial)
    for name in ("accepted", "arrived"):
        record[name] = record[name] and _hex(record[name])
    record["history"] = [entry | {"values": _hex(entry["values"])} for entry in state.history]
    record["beside"] = [{"values": _hex(other.values), "damping": to_hex(other.damping), "rung": other.rung}
                        for other in state.beside]
    for name in ("damping", "phi", "reach"):
        record[name] = None if record[name] is None else to_hex(record[name])
    save_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA, record)


def load_state(run: str | Path) -> LoopState | None:
    """The state in a RUN folder, None where there is none.

    Raises
    ------
    InputError
        The file is damaged.
    """
    record = load_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA)
    if record is None:
        return None
    record["trial"] = _values(record["trial"])
    for name in ("accepted", "arrived"):  # there was no way back in runs of earlier versions
        record[name] = record.get(name) and _values(record[name])
    record["history"] = tuple(entry | {"values": _values(entry["values"])} for entry in record["history"])
    record |= {name: tuple(record.get(name, ())) for name in ("felt", "again")}
    record.pop("predicted", None)  # runs of earlier versions
    record["beside"] = tuple(ParallelTrial(_values(other["values"]), from_hex(other["damping"]), other["rung"])
                             for other in record.get("beside", ()))
    for name in ("damping", "phi", "reach"):
        if record.get(name) is not None:  # there was no reach in runs of earlier versions
            record[name] = from_hex(record[name])
    return LoopState(**record)


def _hex(values: Mapping[str, float]) -> dict[str, str]:
    return {name: to_hex(value) for name, value in values.items()}


def _values(record: Mapping[str, str]) -> dict[str, float]:
    return {name: from_hex(value) for name, value in record.items()}
