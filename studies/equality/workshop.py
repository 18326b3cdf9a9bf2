"""Where a case works: a folder of its own in which the commands of idic run, in this process."""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from idic_studies.equality.counting import Counter

LAST_WORDS = 3000  # characters of what a failed command said


class CommandFailed(RuntimeError):
    """A command ended otherwise than the case expects."""


@dataclass(frozen=True)
class Answer:
    """Words, exit code and output of a command, and how often it computed."""

    words: tuple[str, ...]
    exit_code: int
    output: str
    counts: dict[str, int]


@dataclass
class Workshop:
    """Folder of a case; the inputs and outputs that are kept, relative to it; the answers of its commands."""

    folder: Path
    counter: Counter
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)

    def path(self, name: str) -> Path:
        return self.folder / name

    def write(self, name: str, text: str) -> None:
        """A file of the case."""
        self.path(name).parent.mkdir(parents=True, exist_ok=True)
        self.path(name).write_text(text, encoding="utf-8")

    def idic(self, *words: str, exit_code: int = 0) -> None:
        """A command of idic, in this process.

        Raises
        ------
        CommandFailed
            It ended with another exit code.
        """
        output, errors, start = io.StringIO(), io.StringIO(), self.counter.numbers
        with _in_folder(self.folder), contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            code = _exit_code(words)
        if code != exit_code:
            raise CommandFailed(f"idic {' '.join(words)}: exit code {code}, expected {exit_code}\n"
                                f"{(output.getvalue() + errors.getvalue())[-LAST_WORDS:]}")
        counts = {name: number - start[name] for name, number in self.counter.numbers.items()}
        self.answers.append(Answer(words, code, output.getvalue(), counts))

    def killed_idic(self, name: str, number: int, *words: str) -> None:
        """A command in a process that is killed at a call of a counted function, as by a power cut.

        Raises
        ------
        CommandFailed
            It ended otherwise.
        """
        process = multiprocessing.get_context("fork").Process(target=self._run_until, args=(name, number, words))
        process.start()
        process.join()
        if process.exitcode != -signal.SIGKILL:
            raise CommandFailed(f"idic {' '.join(words)} was not killed at {name} {number}, "
                                f"exit code {process.exitcode}")

    def _run_until(self, name: str, number: int, words: tuple[str, ...]) -> None:
        self.counter.kill_at(name, number)
        self.idic(*words)


def _exit_code(words: tuple[str, ...]) -> int:
    from idic.cli import main

    sys.argv = ["idic", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


@contextlib.contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    origin = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(origin)
