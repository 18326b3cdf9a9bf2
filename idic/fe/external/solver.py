"""Any finite-element program as a black box: a deck filled in, a command run, its output read.

    solver = ExternalSolver(setup, expected, program)
    solution = solver.run({"SPECIMEN.E": 70e3, ...}, tables, folder)

Every run has its own folder. A successful run deletes it; after a failure it stays, with ``reason.txt`` and
``log.txt``, and the run is `NotConverged`: the identification rejects that step. The deck is in mm, s, MPa, N.
"""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from idic.errors import InputError, NotConverged
from idic.fe.external.deck import Deck
from idic.fe.external.process import LOG_FILE, find_program, require_permission, run_program
from idic.fe.external.solver_output import FRD_READER, Solution, ExpectedOutput, gathered, local_output

EXTERNAL = "external"  # the law of a material that only the external program knows
REASON_FILE = "reason.txt"
RUNNING_PREFIX = "."  # first letter of the folder of a run under way
MAX_KEPT_FOLDERS = 5  # folders of failed runs that stay, the latest ones
MAX_SHOWN_LINES, MAX_LINE_LENGTH = 3, 160  # of the solver's output, in the message


@dataclass(frozen=True)
class ExternalSetup:
    """The table ``[solver]``.

    Attributes
    ----------
    experiment_file : named in messages
    deck : the template, written as `deck_file`
    files : copied into the same folder under their own names
    command : decks of one argument each, with the places {job}, {deck}
    reader : a name in `idic.fe.external.solver_output.READERS`
    clock : "seconds" or "frames": what the deck counts its time in, from the reference frame on
    mesh_file : the mesh of the experiment is written under this name in the same folder
    element_types : cell -> its name
    """

    experiment_file: Path
    deck: Deck
    deck_file: str
    command: tuple[Deck, ...]
    reader: str
    files: tuple[Path, ...] = ()
    timeout_s: float = 3600.0
    retries: int = 1
    environment: Mapping[str, str] = field(default_factory=dict)
    clock: str = "seconds"
    mesh_file: str | None = None
    element_types: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """InputError where the deck asks for an output whose axes the file does not tell."""
        literal = "".join(part for part in self.deck.parts if isinstance(part, str))
        texts = [literal, *(path.read_text(encoding="utf-8", errors="replace") for path in self.files
                            if path.suffix.lower() == ".inp")]
        line = local_output("\n".join(texts)) if self.reader == FRD_READER else None
        if line is not None:
            raise InputError("the output would be in local axes without a mark", file=self.deck.file,
                             key="solver.reader", expected="displacements in the axes of the mesh",
                             found=f"*TRANSFORM, and {line}", remedy="write *NODE FILE without GLOBAL=NO")

    @property
    def job(self) -> str:
        """Name of the deck without its ending."""
        return Path(self.deck_file).stem

    @property
    def arguments(self) -> tuple[str, ...]:
        """The command as it is run."""
        return tuple(word.render({"job": self.job, "deck": self.deck_file}) for word in self.command)

    def require_ready(self) -> None:
        """The command may be run, and its program is there (InputError otherwise)."""
        require_permission(self.arguments, self.experiment_file)
        find_program(self.arguments[0], self.experiment_file)


@dataclass(frozen=True)
class ExternalSolver:
    """A setup, and what one simulation has to deliver."""

    setup: ExternalSetup
    expected: ExpectedOutput

    def run(self, values: Mapping[str, float], texts: Mapping[str, str], scratch: Path, name: str) -> Solution:
        """One simulation in ``scratch/name``, tried again as often as the setup says.

        Parameters
        ----------
        values : every name that the deck may ask for
        texts : tables that the deck may ask for, and files to write: the entry `setup.mesh_file`

        Raises
        ------
        NotConverged
            The program crashed, took too long, or its output is not what is expected: with its last lines, and where
            the folder was kept.
        InputError
            The command may not be run, or its program is not there.
        """
        self.setup.require_ready()
        for attempt in range(self.setup.retries + 1):
            folder = scratch / f"{RUNNING_PREFIX}{name}.{uuid.uuid4().hex[:8]}"
            folder.mkdir(parents=True)
            try:
                self._write(folder, values, texts)
                solution = self._attempt(folder)
            except NotConverged as problem:
                kept_folder = _keep(folder, scratch / name, str(problem), self.setup.arguments, values, attempt + 1)
                if attempt == self.setup.retries:
                    raise NotConverged(f"{problem} (kept in {kept_folder})") from None
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
            else:
                shutil.rmtree(folder, ignore_errors=True)
                shutil.rmtree(scratch / name, ignore_errors=True)  # of a first attempt that failed
                return solution
        raise AssertionError("not reached: retries >= 0")

    def _write(self, folder: Path, values: Mapping[str, float], texts: Mapping[str, str]) -> None:
        for source in self.setup.files:
            shutil.copyfile(source, folder / source.name)
        if self.setup.mesh_file is not None:
            (folder / self.setup.mesh_file).write_text(texts[self.setup.mesh_file], encoding="utf-8")
        (folder / self.setup.deck_file).write_text(self.setup.deck.render({**values, **texts}), encoding="utf-8")

    def _attempt(self, folder: Path) -> Solution:
        setup = self.setup
        program = find_program(setup.arguments[0], setup.experiment_file)
        ending = run_program((program, *setup.arguments[1:]), folder, setup.environment, setup.timeout_s)
        wrong = ending.in_words(setup.arguments[0], setup.timeout_s)
        if not wrong:
            try:
                return gathered(setup.reader, folder, setup.job, self.expected)
            except NotConverged as problem:
                wrong = f"{setup.arguments[0]}: {problem}"
        raise NotConverged(wrong + _last_words(folder / LOG_FILE))


def sweep(scratch: Path) -> None:
    """Remove the folders of runs whose process was killed."""
    for folder in scratch.glob(f"{RUNNING_PREFIX}*/"):
        shutil.rmtree(folder, ignore_errors=True)


def _last_words(log: Path) -> str:
    """The last lines that the program printed."""
    try:
        with log.open("rb") as file:
            file.seek(max(log.stat().st_size - 4096, 0))
            lines = file.read().decode("utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    lines = [line.strip()[:MAX_LINE_LENGTH] for line in lines if any(letter.isalnum() for letter in line)]
    return f"; its last lines: {' | '.join(lines[-MAX_SHOWN_LINES:])}" if lines else ""


def _keep(folder: Path, target: Path, reason: str, command, values: Mapping[str, float], attempt: int) -> Path:
    """Leave a failed run to be looked at, of many the latest ones; returns its folder.

    Others clean up here at the same time, and the disk may be full: whatever fails is left as it is.
    """
    lines = [reason, f"attempt {attempt}", f"command: {' '.join(command)}", "",
             *(f"{name} = {value!r}" for name, value in sorted(values.items()))]
    with suppress(OSError):
        (folder / REASON_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
    shutil.rmtree(target, ignore_errors=True)
    try:
        folder.rename(target)
    except OSError:
        target = folder
    for path in _failed_runs(target.parent)[:-MAX_KEPT_FOLDERS]:
        shutil.rmtree(path, ignore_errors=True)
    return target


def _failed_runs(scratch: Path) -> list[Path]:
    """Folders of failed runs, oldest first."""
    dated_folders = []
    with suppress(OSError):
        for path in scratch.iterdir():
            with suppress(OSError):  # it was deleted meanwhile
                if not path.name.startswith(RUNNING_PREFIX):
                    dated_folders.append(((path / REASON_FILE).stat().st_mtime, path))
    return [path for _, path in sorted(dated_folders)]
