"""The folder of a batch: one RUN per name, and the summary that is replaced whole after every run.

::

    DIR/batch.json, batch.csv, batch.html     the summary
    DIR/NAME/                                 a RUN folder, as of `idic identify`
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from idic.errors import InputError
from idic.inside import is_inside, way_inside, write_inside
from idic.report import batch_table, render_batch, scatter
from idic.run.batch.entries import BatchRun
from idic.run.batch.runs import BatchJob, BatchOutcome
from idic.run.store.result_file import RESULT_FILE, read_json
from idic.run.store.run_lock import run_lock
from idic.run.store.schemas.batch import BatchRow
from idic.run.store.schemas.types import refuse_other_types

SCHEMA = "idic.batch/1"
JSON_FILE, CSV_FILE, PAGE_FILE = "batch.json", "batch.csv", "batch.html"
WAITING, INTERRUPTED = "waiting", "interrupted"
_REASONS = {  # of statuses that a result has without further words
    "stalled": "no step lowered the residual any further", "max_iterations": "the limit of iterations was reached",
    "at_bound": "a parameter ended at its bound", "forward_failed": "the simulation failed"}  # fmt: skip


class Batch:
    """The runs of a batch in DIR and their status.

    Parameters
    ----------
    out : DIR
    runs : in the order of the table
    sensitivity : of every run, "auto" being chosen as for one worker where whole runs are tasks
    """

    def __init__(self, out: str | Path, runs: Sequence[BatchRun], sensitivity: str = "auto"):
        self.folder, self.runs = Path(out).resolve(), tuple(runs)
        self._sensitivity = sensitivity
        self._outcomes: dict[str, BatchOutcome] = {}
        self._earlier: dict[str, dict] = {}  # rows of the batch that is continued
        self._began = time.monotonic()

    @contextmanager
    def claim(self, resume: bool) -> Iterator[Batch]:
        """Lock DIR for a ``with`` block.

        Raises
        ------
        InputError
            DIR holds an earlier batch (and no `resume`) or something else, or another process is using it.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError("the output must be a folder", file=self.folder, found="a file",
                             remedy="choose another --out")
        names = sorted(p.name for p in self.folder.iterdir()) if self.folder.is_dir() else []
        if JSON_FILE in names and not resume:
            raise InputError("this batch exists already", file=self.folder, expected="a new folder, or --resume",
                             found="an earlier batch", remedy="add --resume to continue it, or choose another --out")
        strangers = [name for name in names if not name.startswith(".") and name != "run.lock"]
        if strangers and JSON_FILE not in names:
            raise InputError("the output folder is in use for something else", file=self.folder,
                             expected="a new or empty folder, or an earlier batch", found=", ".join(strangers[:5]),
                             remedy="choose another --out")
        with run_lock(self.folder):
            self._earlier = self._rows_of_earlier_batch()
            yield self

    def job(self, run: BatchRun) -> BatchJob:
        """What a worker needs for a run."""
        out = way_inside(self.folder, run.name)
        return BatchJob(run.name, run.experiment, str(out), run.overrides, self._sensitivity)

    def record(self, outcome: BatchOutcome) -> None:
        """Note the outcome of a run."""
        self._outcomes[outcome.name] = outcome

    def write(self, status: str, page: bool = False) -> dict:
        """Replace batch.json and batch.csv (and, with `page`, batch.html); returns the content of batch.json.

        status : "running", "finished" or "interrupted"
        """
        content = self._content(status)
        write_inside(self.folder, JSON_FILE, json.dumps(content, indent=1, allow_nan=False))
        write_inside(self.folder, CSV_FILE, batch_table(content))
        if page:
            write_inside(self.folder, PAGE_FILE, render_batch(content))
        return content

    def _content(self, status: str) -> dict:
        rows = [self._row(run, status) for run in self.runs]
        return {"schema": SCHEMA, "status": status, "converged": sum(row["status"] == "converged" for row in rows),
                "wall_s": time.monotonic() - self._began, "runs": rows, "groups": scatter(rows)}

    def _rows_of_earlier_batch(self) -> dict[str, dict]:
        """Rows of the same runs whose RUN is still there: they are true until --resume has come to them."""
        try:
            content = read_json(self.folder / JSON_FILE)
            for row in content["runs"]:
                refuse_other_types(row, BatchRow, self.folder / JSON_FILE)
        except (OSError, ValueError, KeyError, TypeError, InputError):
            return {}
        rows = {row["run"]: row for row in content["runs"]}
        earlier_rows = {}
        for run in self.runs:
            row = rows.get(run.name, {})
            is_same = row.get("experiment") == run.experiment and row.get("set") == json.loads(
                json.dumps(dict(run.overrides)))
            if is_same and row.get("status") not in (WAITING, INTERRUPTED) and (
                    is_inside(self.folder, f"{run.name}/{RESULT_FILE}")):
                earlier_rows[run.name] = row
        return earlier_rows

    def _row(self, run: BatchRun, status: str) -> dict:
        row = {"name": run.name, "experiment": run.experiment, "set": dict(run.overrides), "run": run.name}
        outcome = self._outcomes.get(run.name)
        if outcome is None and run.name in self._earlier:
            return self._earlier[run.name]
        if outcome is None:
            return row | {"status": WAITING if status == "running" else INTERRUPTED,
                          "reason": "" if status == "running" else "not finished; --resume continues it",
                          "iterations": None, "image_chi2_dof": None, "wall_s": None, "parameters": {}}
        result = outcome.result or {}
        ended = (result.get("end") or {}).get("reason", "") if outcome.status in _REASONS else ""
        parameters = {name: {key: entry.get(key) for key in ("value", "std", "unit", "start")}
                      for name, entry in result.get("parameters", {}).items() if entry.get("free")}
        return row | {
            "status": outcome.status, "reason": outcome.reason or ended or _REASONS.get(outcome.status, ""),
            "iterations": result.get("iterations"), "image_chi2_dof": result.get("residual", {}).get("image_chi2_dof"),
            "wall_s": result.get("cost", {}).get("wall_s"), "parameters": parameters}  # fmt: skip
