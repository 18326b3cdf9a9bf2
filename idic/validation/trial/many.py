"""Many trials without a server: ``python -m idic.validation.trial.many OUT --processes 16 [--only GROUP] [--until SECONDS]``.

The same trials as `idic trial`, spread over processes of this machine; one line of JSON per finished trial. Whatever is
answered already stays; a later call goes on.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path

from idic.errors import InputError
from idic.validation.trial.plan import Campaign
from idic.validation.trial.seal import Folder, seal
from idic.validation.trial.tool import tool
from idic.validation.trial.trial import TrialJob, check_solvers, run_trial
from idic.workers.dask_settings import use_one_thread

LOOK_S = 0.5
RECYCLED = 20  # trials per process: memory that fragments is given back


def missing(folder: Folder, numbers: Sequence[str]) -> list[str]:
    """The trials that have no answer yet."""
    return [number for number in numbers if not folder.answer(number).exists()]


def run_many(folder: Folder, numbers: Sequence[str], processes: int, until: float = float("inf")) -> Iterator[str]:
    """Run trials side by side; yields their IDs as they finish, and stops asking for more after `until` (s)."""
    began = time.monotonic()
    jobs = (TrialJob(str(folder.out), number) for number in numbers if time.monotonic() - began < until)
    if processes <= 1:
        yield from map(run_trial, jobs)
        return
    with multiprocessing.get_context("spawn").Pool(processes, maxtasksperchild=RECYCLED) as pool:
        waiting, running = deque(jobs), []
        while running or (waiting and time.monotonic() - began <= until):
            while waiting and len(running) < processes and time.monotonic() - began <= until:
                running.append(pool.apply_async(run_trial, (waiting.popleft(),)))
            running[0].wait(LOOK_S)
            for done in [trial for trial in running if trial.ready()]:
                running.remove(done)
                yield done.get()


def main(arguments: Sequence[str] | None = None) -> None:
    """Seal, run what is missing, print one line per trial."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--size", default="full")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--until", type=float, default=float("inf"), help="seconds after which no trial is begun")
    given = parser.parse_args(arguments)
    use_one_thread()
    campaign, folder = Campaign(given.size, given.seed), Folder(given.out)
    try:
        numbers = seal(folder, campaign, campaign.select(given.only), tool())
        check_solvers(folder, missing(folder, list(numbers.values())))
    except InputError as problem:
        sys.stderr.write(f"{problem}\n")
        sys.exit(2)
    for number in run_many(folder, missing(folder, list(numbers.values())), given.processes, given.until):
        answer = json.loads(folder.answer(number).read_text(encoding="utf-8"))
        line = {"id": number, "verdict": answer["verdict"], "cpu_s": answer.get("cost", {}).get("cpu_s")}
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
