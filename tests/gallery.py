"""The gallery: finished RUN folders that tests only look at, each made once in a session for all its processes."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import idic
from idic.identification import LoopState
from idic.report import RunRecord
from idic.run import read_result
from idic.run.reporting.write import load_record
from idic.run.store.state_file import load_state

sys.path.append(str(Path(__file__).parent / "identify"))

WHOLE = "whole.json"  # beside a finished RUN: what its files were
LOCK = "run.lock"  # of a RUN: taken for reading, too


@dataclass(frozen=True)
class FinishedRun:
    """An experiment and its RUN; nothing may be written into either."""

    experiment: Path
    run: Path

    @cached_property
    def result(self) -> dict:
        return read_result(self.run)

    @cached_property
    def state(self) -> LoopState:
        return load_state(self.run)

    @cached_property
    def shown(self) -> Path:
        """A copy of the RUN for this process, in which reports and exports keep what they compute."""
        folder = self.run.with_name(f"shown-{os.getpid()}")
        if not folder.exists():
            shutil.copytree(self.run, folder)
        return folder

    @cached_property
    def record(self) -> RunRecord:
        return load_record(self.shown)

    def copied(self, folder: Path) -> FinishedRun:
        """Both in a folder of the test's own, to be changed. The RUN reads the experiment of the gallery."""
        return FinishedRun(Path(shutil.copytree(self.experiment, folder / "test")),
                           Path(shutil.copytree(self.run, folder / "run")))


# the kinds -----------------------------------------------------------------------------------------------------
def strip(folder: Path) -> None:
    """The demonstration in 11 small frames that start near the truth: plasticity, four parameters."""
    from virtual_tests.small_strip import write_small_strip

    write_small_strip(folder / "test")
    idic.identify(folder / "test", folder / "run")


def twin(folder: Path) -> None:
    """The standard twin: E and nu of an elastic plate, with a force, six frames."""
    from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder

    write_folder(folder / "test", Twin(), ELASTIC + GRIPS + FORCE)
    idic.identify(folder / "test", folder / "run")


def plate(folder: Path) -> None:
    """The same with other noise, and a camera in words for the report."""
    from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder

    write_folder(folder / "test", Twin(seed=1), ELASTIC + GRIPS + FORCE + '\n[setup]\ncamera = "a virtual camera"\n')
    idic.identify(folder / "test", folder / "run")


def step(folder: Path) -> None:
    """The small experiment, whose images show nothing, after one step."""
    from experiment_file.small_experiment import write_experiment

    write_experiment(folder / "test")
    idic.identify(folder / "test", folder / "run", overrides={"options.max_iterations": 1})


def section(folder: Path) -> None:
    """Height images of the bulge test in its smallest size, from the truth: a step or two."""
    from idic_studies.cases.bulge import SKETCH_SIZE
    from idic_studies.examples.bulge import write_bulge

    write_bulge(folder / "test", noise=0.01, seed=3, size=SKETCH_SIZE)
    idic.identify(folder / "test", folder / "run")


KINDS: dict[str, Callable[[Path], None]] = {make.__name__: make for make in (strip, twin, plate, step, section)}


# opening one ---------------------------------------------------------------------------------------------------
@contextmanager
def opened(base: Path, locked: Callable) -> Iterator[Callable[[str], FinishedRun]]:
    """A function that gives a kind of RUN below a folder, made where it is missing; at the end each must be as it was.

    locked : context of a folder that one process at a time enters
    """
    kinds: set[str] = set()

    def finished(kind: str) -> FinishedRun:
        kinds.add(kind)
        folder = base / kind
        with locked(folder):
            if not (folder / WHOLE).exists():
                KINDS[kind](folder)
                (folder / WHOLE).write_text(json.dumps(contents(folder)))
        return FinishedRun(folder / "test", folder / "run")

    yield finished
    for kind in kinds:
        before, after = json.loads((base / kind / WHOLE).read_text()), contents(base / kind)
        changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
        assert not changed, f"a test has changed the RUN {kind!r} of the gallery, in place of a copy: {changed}"


def contents(folder: Path) -> dict[str, list[int]]:
    """Size and time of the last change of every file of the experiment and its RUN."""
    return {path.relative_to(folder).as_posix(): [path.stat().st_size, path.stat().st_mtime_ns]
            for part in ("test", "run") for path in (folder / part).rglob("*") if path.is_file() and path.name != LOCK}
