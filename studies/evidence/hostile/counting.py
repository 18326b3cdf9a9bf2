"""A campaign: many cases in this process, each classified, limited in time and watched."""

from __future__ import annotations

import math
import os
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from idic.cli.app import app
from idic.errors import InputError, NotConverged
from idic_studies.evidence.hostile.watch import unwatched, watched

LIMIT_S = 300.0  # wall time of a case, after which it hangs: other programs share the cores
LONG_S = 10.0  # processor time of a case: more is a hang, too; a case with nothing spoilt takes 3 s at most
GOOD = ("done", "refused")
SHOWN = 12  # failures that are kept in full
TOLD_EVERY = 100  # cases


@dataclass
class Scene:
    """Folders of a case: `work` to write into, `secret` beside it, which nothing may touch."""

    work: Path
    secret: Path
    rng: np.random.Generator


@dataclass
class Tally:
    """Outcomes of a campaign; `failures`: (seed, outcome, words, traceback)."""

    name: str
    outcomes: Counter = field(default_factory=Counter)
    failures: list[tuple[int, str, str, str]] = field(default_factory=list)
    longest_s: float = 0.0
    seconds: float = 0.0

    @property
    def cases(self) -> int:
        return sum(self.outcomes.values())

    @property
    def bad(self) -> int:
        return sum(number for outcome, number in self.outcomes.items() if outcome not in GOOD)

    def line(self) -> str:
        """One line for the table of docs/evidence/safety.md."""
        parts = ", ".join(f"{outcome} {number}" for outcome, number in sorted(self.outcomes.items()))
        return (f"{self.name}: {self.cases} cases in {self.seconds:.0f} s; {parts}; longest {self.longest_s:.1f} s of "
                "processor time")


Case = Callable[[Scene], str]  # does something and says what; raises as idic does


def run_campaign(name: str, case: Case, number: int, seed: int = 0, say: Callable[[str], None] = print,
                 seconds: float = math.inf) -> Tally:
    """`number` cases, or as many as `seconds` allow, of the seeds `seed`, `seed` + 1 …; each in a folder of its own."""
    tally, began = Tally(name), time.monotonic()
    for k in range(seed, seed + number):
        if time.monotonic() - began > seconds:
            break
        outcome, words, trace, spent = _one(case, k)
        tally.outcomes[outcome] += 1
        tally.longest_s = max(tally.longest_s, spent)
        if outcome not in GOOD:
            tally.failures.append((k, outcome, words, trace))
            if len(tally.failures) <= SHOWN:
                say(f"seed {k}: {outcome}: {words}\n{trace}")
        if tally.cases % TOLD_EVERY == 0:
            say(f"{name}: {tally.cases} cases, {tally.bad} failed")
    tally.seconds = time.monotonic() - began
    say(tally.line())
    return tally


def _one(case: Case, seed: int) -> tuple[str, str, str, float]:
    """Outcome, words, traceback and processor time of a case."""
    with tempfile.TemporaryDirectory(prefix="idic-hostile-") as folder:
        scene = Scene(Path(folder) / "work", Path(folder) / "secret", np.random.default_rng(seed))
        scene.work.mkdir()
        _write_secret(scene.secret)
        began, words, trace = time.process_time(), "", ""
        os.chdir(scene.work)
        with watched([scene.work, Path.home() / ".cache", *_own_folders()], scene.secret) as watch:
            outcome, words, trace = _outcome(case, scene)
        spent = time.process_time() - began
        os.chdir(tempfile.gettempdir())
    if watch.events and outcome in GOOD:
        return watch.events[0][0], words, "\n".join(f"{kind}: {path}" for kind, path in watch.events[:5]), spent
    if spent > LONG_S and outcome in GOOD:
        return "over 10 s", words, "", spent
    return outcome, words, trace, spent


def _outcome(case: Case, scene: Scene) -> tuple[str, str, str]:
    try:
        with _time_limit():
            words = case(scene)
    except (InputError, NotConverged):
        return "refused", "", ""
    except Failure as failure:
        return failure.outcome, failure.words, failure.trace
    except KeyboardInterrupt:
        return "hang", "", traceback.format_exc()[-3000:]
    except Exception as problem:  # noqa: BLE001  (whatever comes through is what is looked for)
        return "failed", repr(problem)[:200], traceback.format_exc()[-3000:]
    return ("refused" if words == "refused" else "done"), words, ""


class Failure(Exception):
    """A command that ended neither well nor with one message."""

    def __init__(self, outcome: str, words: str, trace: str = ""):
        super().__init__(words)
        self.outcome, self.words, self.trace = outcome, words, trace


def command(*arguments: object) -> str:
    """A command line in this process: "done" or "refused".

    Raises
    ------
    Failure
        Exit code 1, a traceback, no message or several.
    """
    from typer.testing import CliRunner

    words = [str(word) for word in arguments]
    with CliRunner().isolation() as (shown, said, _):
        try:
            code = _program().main(args=words, prog_name="idic") or 0
        except SystemExit as end:
            code = end.code or 0
        sys.stdout.flush()
        sys.stderr.flush()
        text, error = (stream.getvalue().decode("utf-8", "replace") for stream in (shown, said))
    if code in (1, 4) or "Traceback" in text + error:
        kind = "hang" if code == 4 else "failed"
        raise Failure(kind, f"{words}: exit {code}: {error[-600:]}", _report(error))
    messages = len(re.findall("^idic: ", error, re.MULTILINE))
    if code == 2 and not (error.startswith(("idic: ", "Usage")) and messages <= 1):
        raise Failure("messages", f"{words}: {error[-600:]}")
    return "refused" if code == 2 else "done"


def _report(said: str) -> str:
    """The traceback of an internal error, from the file that the message names."""
    named = re.search(r"^ +(/.*\.txt)$", said, re.MULTILINE)
    try:
        return Path(named[1]).read_text(encoding="utf-8")[-3000:] if named else ""
    except OSError:
        return ""


@cache
def _program():
    from typer.main import get_command

    return get_command(app)


@contextmanager
def _time_limit() -> Iterator[None]:
    def stop(*_):
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


def _own_folders() -> list[Path]:
    """Where idic and its libraries keep compiled code and reports of errors."""
    import idic

    root = Path(idic.__file__).parents[1]
    libraries = Path(np.__file__).parents[1]
    reports = Path(tempfile.gettempdir())
    return [root / "idic", root / "flows", libraries, reports / "matplotlib", Path.home() / ".config" / "matplotlib",
            Path(os.environ.get("NUMBA_CACHE_DIR", root / "idic"))]


def _write_secret(folder: Path) -> None:
    (folder / "deep").mkdir(parents=True)
    for name in ("secret.txt", "result.json", "report.html", "secret.csv", "deep/secret.h5", "image.tif"):
        (folder / name).write_text("what lies outside")


def copied(source: Path, target: Path) -> Path:
    """A copy of a folder."""
    with unwatched():
        return Path(shutil.copytree(source, target, symlinks=True))
