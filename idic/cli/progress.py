"""Progress in the terminal: a line per evaluated point, a bar per fan-out; plain lines in a pipe or a file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

RUN_MARKS, LOG_FILE = ("run.zarr", "study.zarr", "batch.json"), "log.txt"  # each makes a folder a RUN, study or batch
LABELS = {"ingest": "reading images", "simulate": "simulating", "correlate": "correlating frames",
          "search": "searching start values"}


class ProgressView:
    """What `idic_flows.identify.Console` calls; the methods have the signatures it expects."""

    def __init__(self, console: Console, progress: Progress, run: Path):
        self._console, self._progress, self._run = console, progress, run
        self._unwritten: list[str] = []
        self._stage = progress.add_task("starting", total=None)
        self._bars: dict[str, int] = {}
        self._shown, self._began = 0, time.monotonic()

    def stage(self, text: str) -> None:
        self._hide_bars()
        self._progress.update(self._stage, description=text)
        self._say(text, quiet=self._console.is_terminal)

    def tasks(self, what: str, done: int, total: int) -> None:
        if what not in self._bars:
            self._bars[what] = self._progress.add_task(f"  {LABELS.get(what, what)}", total=total)
        self._progress.update(self._bars[what], completed=done, total=total, visible=done < total)

    def iteration(self, state) -> None:
        """Print the evaluations since the last call; `state` is an `idic.identify.loop.LoopState`."""
        from idic.identify.driver import describe_evaluation  # here: `idic --help` does not load it

        for entry in state.history[self._shown :]:
            self._say(describe_evaluation(entry))
        self._shown = len(state.history)
        self._hide_bars()
        now = f"iteration {state.iteration + 1}, evaluation {state.evaluations}"
        self._progress.update(self._stage, description=now)

    def said(self, line: str) -> None:
        """A line for the screen and the log."""
        self._say(line)

    def dashboards(self, prefect: str | None, dask: str | None, password: str | None) -> None:
        """password : of the Prefect pages; others may read the log, so that it is on the screen only."""
        for name, url, secret in (("Prefect", prefect, password), ("Dask", dask, None)):
            if url:
                self._say(f"{name} dashboard while this runs: {url}", on_screen=f"  (password {secret})" if secret else "")

    def _say(self, text: str, quiet: bool = False, on_screen: str = "") -> None:
        """A line with the time since the start, on the screen and, once the RUN exists, in ``RUN/log.txt``."""
        line = f"{time.monotonic() - self._began:6.1f} s  {text}"
        if not quiet:
            self._console.print(line + on_screen, highlight=False, soft_wrap=True)
        self._unwritten.append(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {line}\n")
        if any((self._run / mark).exists() for mark in RUN_MARKS):
            with open(self._run / LOG_FILE, "a", encoding="utf-8") as log:
                log.writelines(self._unwritten)
            self._unwritten = []

    def _hide_bars(self) -> None:
        for bar in self._bars.values():
            self._progress.remove_task(bar)
        self._bars = {}


@contextmanager
def progress_view(console: Console, run: Path) -> Iterator[ProgressView]:
    """Bars for the length of a ``with`` block; their lines go to ``RUN/log.txt`` too."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=30), MofNCompleteColumn(),
               TimeElapsedColumn())  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield ProgressView(console, progress, run)
