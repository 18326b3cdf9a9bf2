"""Where the tasks of a command run, as its options say: checked before the first write, opened for their length."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from idic.run.workers.dask_executor import (
    check_scheduler, checked_memory_limit, checked_workers, default_workers, open_cluster,
)
from idic.run.workers.mirrored_runner import checked_store, without_common_disk
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.runner import TaskRunner


@dataclass(frozen=True)
class Workplace:
    """The options of the workers.

    workers : processes of this machine; None: one per core, 0: everything in this process
    scheduler : address of an existing Dask scheduler, used instead
    memory_limit : of one worker process, "2GB"
    store : through which workers without a common disk get and send files: a URL of fsspec, or "driver"
    threads : of a simulation in this process
    runner : workers that another command has opened; everything else is then ignored
    """

    workers: int | None = None
    scheduler: str | None = None
    memory_limit: str | None = None
    store: str | None = None
    threads: int = 1
    runner: TaskRunner | None = None

    @property
    def is_here(self) -> bool:
        """Whether this machine does the work, for all that is known."""
        return self.scheduler is None and self.runner is None

    def worthwhile(self, worth_workers: bool) -> Workplace:
        """This place; without a word of the user this process for a small run, as the start of workers takes longer
        than they save, with a second thread where there is a second core."""
        options = (self.workers, self.scheduler, self.memory_limit, self.runner)
        if worth_workers or options != (None, None, None, None):
            return self
        return replace(self, workers=0, threads=min(2, default_workers()))

    def check(self, out: Path | str, to_see: Sequence[ExperimentToSee] = (),
              say: Callable[[str], None] = lambda text: None) -> None:
        """Check the options, an existing scheduler and each of its workers; nothing is written.

        Raises
        ------
        InputError
            As of `checked_workers`, `checked_memory_limit`, `checked_store` and `check_scheduler`.
        """
        checked_workers(self.workers)
        checked_memory_limit(self.memory_limit, self.workers, self.scheduler)
        check_scheduler(self.scheduler, out, to_see, say, checked_store(self.store, self.scheduler))

    @contextmanager
    def opened(self, out: Path | str, to_see: Sequence[ExperimentToSee], preload: Sequence[str],
               say: Callable[[str], None] = lambda text: None) -> Iterator[TaskRunner]:
        """The runner for the length of a ``with`` block.

        out, to_see : the RUN folder and the experiments that tasks read and write; preload : modules that workers
        import at once; say : takes a line for the user
        """
        if self.runner is not None:
            yield self.runner
            return
        limit = checked_memory_limit(self.memory_limit, self.workers, self.scheduler)
        with (open_cluster(self.workers, self.scheduler, limit, preload, self.threads, say) as cluster,
              without_common_disk(cluster, self.store, out, to_see) as runner):
            yield runner


IN_PROCESS = Workplace(0)

__all__ = ["IN_PROCESS", "Workplace"]
