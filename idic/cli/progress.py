"""Progress in the terminal: stage k of n, a bar per fan-out, expected time left; plain lines in a pipe or a file."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from math import ceil, log
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from idic.inside import open_inside

RUN_MARKS, LOG_FILE = ("run.zarr", "study.zarr", "batch.json"), "log.txt"  # each makes a folder a RUN, study or batch
LABELS = {"ingest": "reading images", "simulate": "simulating", "correlate": "correlating frames",
          "search": "searching start values", "identify": "identifications", "comparisons": "identifications compared"}
LINE_EVERY_S = 15.0  # in a pipe or a file, of a fan-out that lasts longer
SETTLED_GAIN = 1e-3  # of the objective in units of chi^2: a step of 3 % of a standard deviation gains that
SLOWEST_RATIO, FASTEST_RATIO = 0.3, 0.01  # of the gains of two steps in a row; outside, two steps say little: with 0.7,
#                                           51 identifications were promised 1.5 times what was left, 1 in 20 14 times
MIN_DONE_SHARE = 0.02  # of a fan-out before its pace means something


class ProgressView:
    """What `idic.run.Console` calls; the methods have the signatures it expects.

    stages : what the command does, in its order and in the words of its calls of `stage`; a call whose text begins with
    one of them is numbered; spent_s : by earlier stages
    """

    def __init__(self, console: Console, progress: Progress, run: Path, stages: Sequence[str] = (),
                 spent_s: float = 0.0):
        self._console, self._progress, self._run, self._stages = console, progress, run, tuple(stages)
        self._unwritten: list[str] = []
        self._stage = progress.add_task("starting", total=None)
        self._bars: dict[str, int] = {}
        self._paces: dict[str, Pace] = {}
        self._shown, self._began = 0, time.monotonic() - spent_s
        self._heading, self._number, self._evaluating = "", 0, self._began

    def stage(self, text: str) -> None:
        """Begin a stage; a text that is none of the list is a step of the present one, a stage that comes again has
        no number."""
        self._hide_bars()
        numbers = [k for k, name in enumerate(self._stages, start=1) if text.startswith(name)]
        if numbers:
            comes_again, self._number = numbers[0] < self._number, max(numbers[0], self._number)
            self._heading = "" if comes_again else f"stage {numbers[0]} of {len(self._stages)}: "
        description = f"{self._heading}{text}"
        self._progress.update(self._stage, description=description)
        self._evaluating = time.monotonic()
        self._say(description, quiet=self._console.is_terminal)

    def tasks(self, kind: str, count: int, total: int) -> None:
        label = LABELS.get(kind, kind)
        if kind not in self._bars:
            self._bars[kind] = self._progress.add_task(f"  {label}", total=total)
            self._paces[kind] = Pace(time.monotonic(), count)
        remaining_s = self._paces[kind].left(time.monotonic(), count, total)
        text = f"  {label}" + (f", {duration(remaining_s)} left" if remaining_s else "")
        self._progress.update(self._bars[kind], completed=count, total=total, visible=count < total, description=text)
        if self._paces[kind].due(time.monotonic(), LINE_EVERY_S) and count < total and remaining_s is not None:
            self._say(f"{label}: {count} of {total}, {duration(remaining_s)} left", quiet=self._console.is_terminal)

    def iteration(self, state) -> None:
        """Print the evaluations since the last call; `state` is an `idic.identification.loop.LoopState`."""
        from idic.identification import describe_evaluation  # here: `idic --help` does not load it

        clock_s, n_new = time.monotonic(), len(state.history) - self._shown
        n_left = evaluations_left(state.history) if state.running and n_new else None
        expected = "" if n_left is None else f"about {duration(n_left * (clock_s - self._evaluating) / n_new)} left"
        for k, entry in enumerate(state.history[self._shown :], start=1):
            suffix = f"  {expected}" if expected and k == n_new else ""
            self._say(describe_evaluation(entry) + suffix)
        self._shown, self._evaluating = len(state.history), clock_s
        self._hide_bars()
        description = f"iteration {state.iteration + 1}, evaluation {state.evaluations}"
        if expected:
            description += f", {expected}"
        self._progress.update(self._stage, description=f"{self._heading}{description}")

    def said(self, line: str) -> None:
        """A line for the screen and the log."""
        self._say(line)

    def dashboards(self, prefect: str | None, dask: str | None, password: str | None) -> None:
        """password : of the Prefect pages; others may read the log, so that it is on the screen only."""
        for name, url, secret in (("Prefect", prefect, password), ("Dask", dask, None)):
            if url:
                self._say(f"{name} dashboard while this runs: {url}",
                          on_screen=f"  (password {secret})" if secret else "")

    def _say(self, text: str, quiet: bool = False, on_screen: str = "") -> None:
        """A line with the time since the start, on the screen and, once the RUN exists, in ``RUN/log.txt``."""
        line = f"{time.monotonic() - self._began:6.1f} s  {text}"
        if not quiet:
            self._console.print(line + on_screen, highlight=False, markup=False, emoji=False, soft_wrap=True)
        self._unwritten.append(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {line}\n")
        if any((self._run / mark).exists() for mark in RUN_MARKS):
            with open_inside(self._run, LOG_FILE, "a") as log:
                log.writelines(self._unwritten)
            self._unwritten = []

    def _hide_bars(self) -> None:
        for bar in self._bars.values():
            self._progress.remove_task(bar)
        self._bars = {}


@contextmanager
def progress_view(console: Console, run: Path, stages: Sequence[str] = (),
                  spent_s: float = 0.0) -> Iterator[ProgressView]:
    """Bars for the length of a ``with`` block; their lines go to ``RUN/log.txt`` too. See `ProgressView`."""
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(bar_width=30),
               MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield ProgressView(console, progress, run, stages, spent_s)


# expected time left ----------------------------------------------------------------------
class Pace:
    """How fast the tasks of a fan-out come back; began : `time.monotonic` when `done` of them were there."""

    def __init__(self, began: float, count: int):
        self._began, self._done, self._told = began, count, began

    def left(self, clock_s: float, count: int, total: int) -> float | None:
        """Seconds for the remaining tasks; None before enough of them are finished, and at the end."""
        n_new = count - self._done
        if n_new < max(1, MIN_DONE_SHARE * total) or count >= total or clock_s <= self._began:
            return None
        return (clock_s - self._began) / n_new * (total - count)

    def due(self, clock_s: float, every_s: float) -> bool:
        """Whether a line is due; asks begin a new interval."""
        if clock_s - self._told < every_s:
            return False
        self._told = clock_s
        return True


def evaluations_left(history: Sequence[Mapping]) -> int | None:
    """Expected number of further evaluations, from the gains of the last two accepted steps; None where they tell
    nothing: a gain that has grown, where a bend is passed or increments change, says only that the end is not near.

    The gains of Gauss-Newton steps fall by a constant ratio at least. A last evaluation confirms the end.

    Parameters
    ----------
    history : entries of `idic.identification.step.state.LoopState`
    """
    values = [entry["phi"] for entry in history if entry["accepted"] and entry["phi"] is not None]
    gains = [earlier - later for earlier, later in pairwise(values)]
    if len(gains) < 2 or gains[-2] <= 0.0:
        return None
    if gains[-1] <= SETTLED_GAIN:
        return 1
    if gains[-1] >= gains[-2]:
        return None
    ratio = min(max(gains[-1] / gains[-2], FASTEST_RATIO), SLOWEST_RATIO)
    return 1 + ceil(log(SETTLED_GAIN / gains[-1]) / log(ratio))


def duration(seconds: float) -> str:
    """A rounded time: ``8 s``, ``3 min``, ``2.5 h``."""
    if seconds < 90.0:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
