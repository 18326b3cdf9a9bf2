"""The blind trial without a server, on processes of this machine.

    python -m idic_studies.trial.many OUT --processes 16 [--only GROUP] [--first N] [--until SECONDS]
    python -m idic_studies.trial.many OUT --size pictures --photographs FOLDER

The same trials as `idic trial`; one line of JSON per finished trial, then the table of scores and targets. Answered
trials stay; a later call does the others.
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
from idic.run import use_one_thread
from idic_studies.trial.plan import Campaign
from idic_studies.trial.pool import records_of, target_table
from idic_studies.trial.seal import Folder, seal, tool_state
from idic_studies.trial.trial import TrialJob, check_solvers, run_trial
from idic_studies.trial.trial_page import write_trial_page

POLL_INTERVAL_S = 0.5
TRIALS_PER_PROCESS = 20  # a new process returns fragmented memory to the system


def run_many(folder: Folder, numbers: Sequence[str], processes: int, until: float = float("inf")) -> Iterator[str]:
    """Run trials in parallel; yields the ID of each finished trial, and starts none after `until` (s)."""
    began = time.monotonic()
    jobs = (TrialJob(str(folder.out), number) for number in numbers if time.monotonic() - began < until)
    if processes <= 1:
        yield from map(run_trial, jobs)
        return
    with multiprocessing.get_context("spawn").Pool(processes, maxtasksperchild=TRIALS_PER_PROCESS) as pool:
        waiting, running = deque(jobs), []
        while running or (waiting and time.monotonic() - began <= until):
            while waiting and len(running) < processes and time.monotonic() - began <= until:
                running.append(pool.apply_async(run_trial, (waiting.popleft(),)))
            running[0].wait(POLL_INTERVAL_S)
            for finished in [trial for trial in running if trial.ready()]:
                running.remove(finished)
                yield finished.get()


def main(arguments: Sequence[str] | None = None) -> None:
    """Seal the truths, run the unanswered trials, print one line per trial."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--size", default="full")
    parser.add_argument("--photographs", default="", help="folder of real surfaces, with --size pictures")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, help="so many trials of the campaign, from its beginning")
    parser.add_argument("--until", type=float, default=float("inf"), help="seconds after which no trial starts")
    options = parser.parse_args(arguments)
    use_one_thread()
    folder = Folder(options.out)
    try:
        campaign = Campaign(options.size, options.seed, photographs=options.photographs)
        with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
            numbers = seal(folder, campaign, campaign.select(options.only)[:options.first], tool_state(), pool.imap)
        check_solvers(folder, folder.unanswered(numbers.values()))
    except InputError as problem:
        sys.stderr.write(f"{problem}\n")
        sys.exit(2)
    for number in run_many(folder, folder.unanswered(numbers.values()), options.processes, options.until):
        answer = json.loads(folder.answer(number).read_text(encoding="utf-8"))
        line = {"id": number, "verdict": answer["verdict"], "cpu_s": answer.get("cost", {}).get("cpu_s")}
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()
    write_trial_page(folder)
    sys.stdout.write(target_table(records_of([folder.out])))


if __name__ == "__main__":
    main()
