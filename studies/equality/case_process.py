"""Cases, each in a process of its own that is forked from one with everything imported: no case depends on another.

    python -m idic_studies.equality.case_process OUT CASE... [--arrays]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic_studies.equality.cases import CASES, Case
from idic_studies.equality.contents import array_record, input_sums, output_content, stored_arrays
from idic_studies.equality.counting import Counter
from idic_studies.equality.fingerprint import fingerprint
from idic_studies.equality.normal_text import normal
from idic_studies.equality.strips import Strip, write_recorded
from idic_studies.equality.workshop import Workshop

SCHEMA = "idic-studies.equality/1"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
SETTINGS = {"COLUMNS": "140", "NO_COLOR": "1", "TERM": "dumb", "TZ": "UTC", "LC_ALL": "C.UTF-8", "PYTHONHASHSEED": "0",
            "MPLBACKEND": "agg"}
OF_THE_USER = ("IDIC_STORE", "IDIC_LAWS", "IDIC_ALLOW_EXTERNAL")  # settings that would change a case
REHEARSAL = Strip("rehearsal", n_frames=3, mesh=(3, 2))


def record_cases(names: Sequence[str], out: Path, arrays: bool = False,
                 say: Callable[[str], None] = lambda text: None) -> bool:
    """Record cases into OUT/CASE.json, one after the other, in a new process; False: one of them failed.

    arrays : also keep the decoded arrays, OUT/CASE.npz; say : called with a line for every case
    """
    out.mkdir(parents=True, exist_ok=True)
    words = [sys.executable, "-m", __name__, str(out.resolve()), *names, *(["--arrays"] if arrays else [])]
    with subprocess.Popen(words, env=_environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True) as process:
        for line in process.stdout or ():
            say(line.rstrip("\n"))
    return process.returncode == 0


def _environment() -> dict[str, str]:
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    inherited = {key: value for key, value in os.environ.items() if key not in OF_THE_USER}
    return inherited | dict.fromkeys(THREADS, "1") | SETTINGS | {"PATH": programs}


def run_case(case: Case, counter: Counter, folder: Path, arrays_file: Path | None = None) -> dict[str, Any]:
    """The record of a case that works in an empty folder."""
    workshop = Workshop(folder, counter)
    case.run(workshop)
    documents, texts, names, arrays = {}, {}, [], {}
    for output in workshop.outputs:
        parts = output_content(workshop.path(output), folder)
        documents |= parts[0]
        texts |= parts[1]
        names += parts[2]
        arrays |= dict(stored_arrays(workshop.path(output), folder))
    if arrays_file is not None:
        np.savez_compressed(arrays_file, **arrays)
    return {
        "schema": SCHEMA, "case": case.name, "subject": case.subject, "fingerprint": fingerprint(),
        "commands": [{"words": [normal(word, folder) for word in answer.words], "exit_code": answer.exit_code,
                      "counts": {name: number for name, number in answer.counts.items() if number},
                      "output": normal(answer.output, folder).splitlines()} for answer in workshop.answers],
        "inputs": {name: total for part in workshop.inputs for name, total in
                   input_sums(workshop.path(part), folder).items()},
        "documents": documents, "texts": texts, "files": names,
        "arrays": {name: array_record(array) for name, array in arrays.items()},
    }


def main() -> int:
    """The process that the cases are forked from."""
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("cases", nargs="+", choices=CASES, metavar="CASE")
    parser.add_argument("--arrays", action="store_true")
    arguments = parser.parse_args()
    os.fsync = _no_wait_for_the_disk  # type: ignore[assignment]  # most of the time of a small run
    counter = Counter()
    if len(arguments.cases) > 1:
        _rehearse(counter)
    failed = [name for name in arguments.cases if not _forked(CASES[name], counter, arguments.out, arguments.arrays)]
    return len(failed)


def _no_wait_for_the_disk(descriptor: int) -> None:
    """In the place of `os.fsync`."""


def _rehearse(counter: Counter) -> None:
    """The smallest identification: the cases that are forked find the modules imported and the kernels loaded."""
    with tempfile.TemporaryDirectory(prefix="idic-equality-") as folder:
        workshop = Workshop(Path(folder), counter)
        write_recorded(workshop, "test", REHEARSAL)
        workshop.idic("identify", "test", "--out", "run", "--no-prefect", "--workers", "0", "--no-report")


def _forked(case: Case, counter: Counter, out: Path, arrays: bool) -> bool:
    """Run a case in a forked process and tell how it went; False: it failed."""
    start, usage = time.monotonic(), _cpu_s()
    process = multiprocessing.get_context("fork").Process(target=_record, args=(case, counter, out, arrays))
    process.start()
    process.join()
    end = "recorded" if process.exitcode == 0 else "FAILED"
    _say(f"{case.name:24} {_cpu_s() - usage:6.1f} s CPU {time.monotonic() - start:6.1f} s  {end}")
    return process.exitcode == 0


def _record(case: Case, counter: Counter, out: Path, arrays: bool) -> None:
    folder = Path(tempfile.mkdtemp(prefix="idic-equality-"))
    workplace, scratch = folder / "case", folder / "scratch"
    workplace.mkdir()
    scratch.mkdir()
    tempfile.tempdir = os.environ["TMPDIR"] = str(scratch)
    try:
        record = run_case(case, counter, workplace, out / f"{case.name}.npz" if arrays else None)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = json.dumps(record, indent=1, ensure_ascii=False)
    (out / f"{case.name}.json").write_text(f"{text}\n", encoding="utf-8")


def _cpu_s() -> float:
    """CPU time of the processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":  # worker processes load this module under another name
    sys.exit(main())
