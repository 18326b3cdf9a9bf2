"""Diagnoses of the sample: with everything, and without something.

::

    OUT/NAME/trace.json        what a complete diagnosis did (`trace.Ledger`), and how its answer is judged
    OUT/without/KEY/NAME.json  how the answer without one thing is judged, and what it did

The room of the diagnosis is imported by a function, after the trace has begun.
"""

from __future__ import annotations

import json
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from idic_studies.ablation.trace import Ledger, Omission, traced


def traced_sample(out: Path, chosen: Sequence[str] = ()) -> Iterator[str]:
    """Diagnose the worlds that have no trace yet; yields the name of each."""
    ledger = traced()
    from idic_studies.ablation.sample import names

    for name in chosen or names(out):
        path = out / name / "trace.json"
        if not path.exists():
            _write(path, _judged(out, name, ledger))
            yield name


def without(out: Path, key: str, omission: Omission, chosen: Sequence[str]) -> Iterator[str]:
    """Diagnose some worlds without something; yields the name of each."""
    ledger = traced(omission)
    for name in chosen:
        path = out / "without" / key / f"{name}.json"
        if not path.exists():
            _write(path, _judged(out, name, ledger))
            yield name


def _judged(out: Path, name: str, ledger: Ledger) -> dict[str, Any]:
    """The answer in short, its evaluation by the blind trial, the ledger of this world alone."""
    from idic_studies.ablation.sample import public, truth_of
    from idic_studies.trial.evaluation import evaluated
    from idic_studies.trial.seal import Folder
    from idic_studies.trial.tool_run import run_tool

    started = {attribute: getattr(ledger, attribute) for attribute in ("reads", "outcomes", "conditions", "calls")}
    for attribute in started:
        setattr(ledger, attribute, Counter())
    ledger.moves = {}
    began = time.process_time()
    try:
        answer = run_tool(public(out, name)).content
    except Exception:  # noqa: BLE001  without something a diagnosis may crash, and that is an outcome
        answer = {"verdict": "failed", "problem": traceback.format_exc(limit=-6)}
    content = ledger.content
    for attribute, at_import in started.items():
        setattr(ledger, attribute, at_import)
    record = evaluated(Folder(out), name, truth_of(out, name), answer).content
    return {"record": record, "answer": answer, "ledger": content, "cpu_s": time.process_time() - began}


def _write(path: Path, content: dict) -> None:
    from idic.plain_values import finite
    from idic.run import write_json

    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, finite(json.loads(json.dumps(content, default=_as_number))))


def _as_number(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else list(value)
