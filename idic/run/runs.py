"""The stages of an identification in a RUN folder, of one experiment or of several together.

    planned → check, claim → [recover] → ingest → prepare → open_points → run_loop → postprocess

``RUN/state.json`` is the state that counts. Of several experiments each has a folder of its own with its view of the
state; all together choose the steps.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from idic.errors import InputError
from idic.identification import Joint, resolve_stages, start
from idic.run.part import RunPart
from idic.run.points import PartPoints, RunPoints
from idic.run.prepared.session import Timing, open_session
from idic.run.recovery.recover import restored, result_of_state, start_over
from idic.run.store.run_folders import RunFolders
from idic.run.store.run_store import RunStore
from idic.run.store.state_file import STATE_FILE
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.runner import TaskRunner

Folders = str | os.PathLike | Sequence[str | os.PathLike]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Run:
    """A RUN folder and the experiments that are identified in it: one, or several with shared materials."""

    folders: RunFolders
    parts: Mapping[str, RunPart]
    joint: Joint

    @classmethod
    def planned(cls, experiments: Folders, out: str | os.PathLike, overrides: Mapping[str, Any],
                say: Callable[[str], None] = lambda text: None) -> Run:
        """The run of these experiments; everything is read, nothing written.

        experiments : folder or experiment.toml, or a list of them; overrides : dotted keys as of ``--set``
        say : called with the progress of what comes first: the choice of knots of free curves

        Raises
        ------
        InputError
            If anything in the input is not what was expected.
        """
        listed = [experiments] if isinstance(experiments, (str, os.PathLike)) else list(experiments)
        paths, out = [os.path.abspath(path) for path in listed], os.path.abspath(out)  # workers have folders of theirs
        if not paths:
            raise InputError("no experiment", expected="an experiment folder, or several", found="none",
                             remedy="name the folder that holds experiment.toml")
        folders = RunFolders.planned(out, paths)
        parts = {name: RunPart(RunStore(folder), path, dict(overrides))
                 for (name, folder), path in zip(folders.parts.items(), paths, strict=True)}
        if any(part.experiment.model.curves_by_evidence for part in parts.values()):
            from idic.run.knots import with_chosen_knots  # here: most runs begin sooner without

            parts = with_chosen_knots(parts, say)
        return cls(folders, parts, Joint.of({name: part.experiment for name, part in parts.items()}))

    @property
    def store(self) -> RunStore:
        return RunStore(self.folders.run)

    def check(self, sensitivity: str) -> None:
        """Everything that can be wrong before something is written (`InputError`)."""
        for part in self.parts.values():
            part.check(sensitivity)
        start(self.joint.whole)

    def refuse_hopeless(self) -> None:
        """`InputError` where this machine cannot hold a simulation."""
        for part in self.parts.values():
            part.cost.refuse_hopeless(part.path)

    def check_pause(self, pause_after: int | None) -> None:
        """Refuse a pause after a stage that does not exist or is the last one (`InputError`)."""
        n = len(resolve_stages(self.joint.whole))
        if pause_after is None or 1 <= pause_after < n:
            return
        raise InputError("no stage to pause after", key="--pause-after", found=str(pause_after),
                         expected="a schedule of several stages ([[stage]])" if n == 1 else
                         f"a stage from 1 to {n - 1}: the schedule has {n}",
                         remedy="choose another number, or leave it out")

    @contextmanager
    def claim(self, resume: bool) -> Iterator[None]:
        """Lock the folders; an existing run is resumed with --resume only."""
        if not resume and self.folders.begun:
            raise InputError("this RUN exists already", file=self.folders.run,
                             expected="a new folder, or --resume", found="an earlier run",
                             remedy="add --resume to continue it, or choose another --out")
        with ExitStack() as stack:
            stack.enter_context(self.store.claim(self.joint.identity, title=self.joint.whole.title))
            for name in self.folders.below:
                stack.enter_context(self.parts[name].claim())
            self.folders.write()
            yield

    def recover(self, runner: TaskRunner) -> list[str]:
        """See `recovery.recover`; where one experiment has to start over, all do."""
        lines = restored(self.store, (STATE_FILE,)) if self.folders.below else []
        for name, part in self.parts.items():
            lines += [f"{name}: {line}" if self.folders.below else line for line in part.recover(runner)]
        begun = (self.folders.run / STATE_FILE).exists()
        if begun and not all((folder / STATE_FILE).exists() for folder in self.folders.below.values()):
            for store in (self.store, *(part.store for part in self.parts.values())):
                start_over(store)
        return lines

    @property
    def worth_scanning_by_workers(self) -> bool:
        """Whether it stores so much that workers read it before it is resumed."""
        return any(part.worth_scanning_by_workers for part in self.parts.values())

    def finished_result(self) -> dict | None:
        """The result of a run that has ended and whose files are whole; None where something is still to be done."""
        result = result_of_state(self.store)
        return result if result is not None and all(part.finished for part in self.parts.values()) else None

    def ingest(self, runner: TaskRunner, progress: Callable[[int, int], None] | None = None) -> None:
        """Copy the images of all experiments into their folders; progress : called as progress(count, total)."""
        for part in self.parts.values():
            part.ingest(runner, progress)

    @property
    def prepared(self) -> bool:
        """Whether `prepare` is behind it."""
        return all(part.prepared for part in self.parts.values())

    @property
    def measures(self) -> bool:
        """Whether it begins with a free FE-DIC."""
        return any(part.measures for part in self.parts.values())

    @property
    def worth_workers(self) -> bool:
        """Whether worker processes save more time than their start takes."""
        return any(part.worth_workers for part in self.parts.values())

    @property
    def first_job(self) -> tuple[str, str, dict]:
        """(folder, experiment, overrides) for the compilation of the image kernels."""
        part = next(iter(self.parts.values()))
        return str(part.store.run), part.path, part.overrides

    @property
    def to_see(self) -> tuple[ExperimentToSee, ...]:
        """The experiments that every worker must find."""
        return tuple(part.to_see for part in self.parts.values())

    def prepare(self, runner: TaskRunner) -> None:
        """Prepare every experiment that is not prepared yet."""
        for part in self.parts.values():
            part.prepare(runner)

    def open_points(self, runner: TaskRunner, sensitivity: str, timing: Timing, tasks: Progress | None = None,
                    say: Callable[[str], None] | None = None) -> RunPoints:
        """The points of the prepared run, new or resumed."""
        parts = {name: PartPoints(open_session(folder, runner, sensitivity, tasks, say), timing)
                 for name, folder in self.folders.parts.items()}
        return RunPoints(self.folders, parts, Joint.of({name: part.experiment for name, part in parts.items()}), timing)
