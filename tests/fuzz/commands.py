"""`idic` commands run in this process, and what must be true of them whatever they are given.

A command ends well, or it says once what is wrong and what to do; then nothing has been written. It never shows a
traceback, never hangs, and is never killed for memory.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
import typer
from hypothesis import HealthCheck, Phase, given, settings
from scratch import scratch
from typer.main import get_command
from typer.testing import CliRunner

from idic.cli.app import app
from idic.cli.outcomes import BAD_INPUT, DONE, outcome

SECONDS = int(os.environ.get("IDIC_FUZZ_SECONDS", "60"))  # a case takes 0.02 to 2 s on a quiet machine
LONGEST_MESSAGE = 2500  # characters
CASES = int(os.environ.get("IDIC_FUZZ_CASES", "1000"))  # of every property, on demand
AS_FOUND = "IDIC_FUZZ_AS_FOUND" in os.environ  # a campaign against the clock: failing cases are not made small


def campaign(number: int, prop: Callable, share: float = 1.0, **strategies) -> tuple[Callable, Callable]:
    """Two tests of a property: `number` cases, always the same ones, for every day; and on demand (``-m slow``) a share
    of IDIC_FUZZ_CASES, each time others, with the failing case made small."""
    often = dict(deadline=None, database=None, suppress_health_check=list(HealthCheck))
    daily = settings(max_examples=number, derandomize=True, phases=(Phase.explicit, Phase.generate), **often)
    phases = [phase for phase in Phase if not (AS_FOUND and phase is Phase.shrink)]
    at_length = settings(max_examples=max(1, int(CASES * share)), print_blob=True, phases=phases, **often)
    return daily(given(**strategies)(prop)), pytest.mark.slow(at_length(given(**strategies)(prop)))


@dataclass(frozen=True)
class Answer:
    """How a command ended: exit code, standard error, standard output, warnings that a user would have seen."""

    code: int
    said: str
    shown: str
    warned: tuple[str, ...]


def idic(*arguments) -> Answer:
    """A command line in this process, stopped (exit code 4) where it takes too long."""
    return _answer(_all_commands(), [str(word) for word in arguments])


def within_outcome(work: Callable[[], int]) -> Answer:
    """The same for what a command does between its terminal and its servers; `work` gives the exit code."""
    part = typer.Typer()

    @part.command()
    def command() -> None:
        with outcome():
            raise typer.Exit(work())

    return _answer(get_command(part), [])


@cache
def _all_commands():
    """The commands as every process builds them once; building them takes as long as `idic check` of a small folder."""
    return get_command(app)


def _answer(program, arguments: list[str]) -> Answer:
    with _time_limit(), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for kind in (DeprecationWarning, ResourceWarning, PendingDeprecationWarning):  # Python does not show these
            warnings.simplefilter("ignore", kind)
        warnings.filterwarnings("ignore", message="Numcodecs codecs are not in")  # as idic.run.store.arrays, for users
        code, shown, said = _invoked(program, arguments)
    return Answer(code, said, shown, tuple(f"{w.category.__name__}: {w.message}" for w in caught))


def _invoked(program, arguments: list[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error; an exception that comes through ends like Python: 1, traceback."""
    with CliRunner().isolation() as (shown, said, _):
        try:
            code = program.main(args=arguments, prog_name="idic") or DONE
        except SystemExit as end:
            code = end.code or DONE
        except Exception:  # noqa: BLE001 - whatever comes through is what is looked for
            code = 1
            said.write(traceback.format_exc().encode())
        sys.stdout.flush()
        sys.stderr.flush()
        return code, *(stream.getvalue().decode("utf-8", "replace") for stream in (shown, said))


@contextmanager
def _time_limit() -> Iterator[None]:
    def stop(*_):
        raise KeyboardInterrupt(f"not over after {SECONDS} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def copy_of(folder: Path) -> Iterator[Path]:
    """A copy to spoil, gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="idic-fuzz-", dir=scratch()) as parent:
        copy = Path(parent) / "experiment"
        folders, files = _whole(folder)
        for name in folders:
            os.mkdir(os.path.join(copy, name))
        for name, content in files:
            with open(os.path.join(copy, name), "wb") as file:
                file.write(content)
        yield copy


@cache
def _whole(folder: Path) -> tuple[list[str], list[tuple[str, bytes]]]:
    """Folders (outermost first) and files of a base folder, read once for thousands of copies."""
    paths = sorted(folder.rglob("*"))
    assert not any(path.is_symlink() for path in paths)
    name = lambda path: str(path.relative_to(folder))  # noqa: E731
    return (["", *(name(path) for path in paths if path.is_dir())],
            [(name(path), path.read_bytes()) for path in paths if path.is_file()])


def contents(folder: Path) -> Mapping[str, tuple]:
    """Every path below a folder with what tells whether it was written."""
    found = {}
    for base, folders, files in os.walk(folder):
        for name in (*folders, *files):
            status = os.lstat(os.path.join(base, name))
            found[os.path.join(base, name)] = (status.st_mode, status.st_size, status.st_mtime_ns)
    return found


def check(folder: Path, picture: bool = False) -> Answer:
    """`idic check`, and all that must be true of it; the caller judges what it accepted. Drawing takes 0.3 s."""
    before = contents(folder)
    answer = idic("check", folder, *([] if picture else ["--no-picture"]))
    assert_fair(answer, (DONE, BAD_INPUT))
    if answer.code == BAD_INPUT or not picture:
        assert contents(folder) == before, "something was written"
    return answer


def assert_fair(answer: Answer, codes: tuple[int, ...]) -> None:
    """One of the exit codes; where the input was bad, one message that says what to do, and nothing else."""
    assert answer.code in codes, f"exit code {answer.code}\n{answer.said}\n{answer.shown}\n{_report(answer)}"
    assert "Traceback" not in answer.said + answer.shown
    if answer.code == BAD_INPUT:
        assert answer.said.startswith("idic: ") and len(re.findall(r"^idic: ", answer.said, re.MULTILINE)) == 1, (
            answer.said
        )
        assert answer.said.count("what to do: ") == 1, answer.said
        assert len(answer.said) < LONGEST_MESSAGE, answer.said
        assert "\x00" not in answer.said and "\x1b" not in answer.said, "control characters reach the terminal"
        assert not answer.warned, f"more than one message: {answer.warned}\n{answer.said}"


def _report(answer: Answer) -> str:
    """The traceback of an internal error, from the file that the message names."""
    named = re.search(r"^ +(/.*idic-error-.*\.txt)$", answer.said, re.MULTILINE)
    return Path(named.group(1)).read_text(encoding="utf-8") if named else ""
