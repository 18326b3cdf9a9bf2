"""``RUN/diagnosis.json``, ``RUN/diagnosis.html`` and its figures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from idic.diagnose import free_parameters
from idic.inside import folder_inside, is_inside, read_inside, write_inside
from idic.report import Picture
from idic.run.store.result_file import RESULT_FILE, read_result, write_json

DIAGNOSIS_FILE, PAGE_FILE = "diagnosis.json", "diagnosis.html"


def write_diagnosis(run: Path | str, verdict: Mapping, enriched: Path | None, wall_s: float,
                    notes: Sequence[str] = ()) -> dict:
    """Write ``RUN/diagnosis.json``; returns its content.

    verdict : what does not change any more (`diagnosis_content`)
    notes : parts beside the verdict that failed
    """
    run = Path(run)
    model = verdict["model"] | {"experiment": None if enriched is None else enriched.relative_to(run).as_posix()}
    content = dict(verdict) | {
        "model": model, "cost": verdict["cost"] | {"wall_s": wall_s}, "notes": list(notes),
        "cautions": [*verdict["cautions"], *notes]}
    write_json(run / DIAGNOSIS_FILE, content)
    return json.loads(read_inside(run, DIAGNOSIS_FILE))


def identified_parameters(run: Path | str) -> dict:
    """Value, std, unit of the free parameters of a RUN; {} without a result.json."""
    run = Path(run)
    return free_parameters(read_result(run) if is_inside(run, RESULT_FILE) else {})


def write_page(run: Path | str, page: str, pictures: Iterable[Picture]) -> Path:
    """Write the page and its figures; returns the page's path."""
    folder_inside(run, "figures")
    for picture in pictures:
        write_inside(run, f"figures/{picture.name}.png", picture.png)
    return write_inside(run, PAGE_FILE, page)
