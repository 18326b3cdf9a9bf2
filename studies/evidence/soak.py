"""Memory and file handles of a long batch: ``python -m idic_studies.evidence.soak 200``.

The demonstration in six small frames, identified again and again by one `idic batch` on two workers. Resident memory
and handles of driver, server and workers are read every `PAUSE_S`; shown are the medians over the fifths of the batch,
compared those of the second and the last.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import psutil

from idic_studies.evidence.hostile.bases import demonstration

PROGRAM = "if __name__ == '__main__':\n    from idic.cli import main\n    main()\n"
PAUSE_S = 2.0
MAX_GROWTH = 0.05  # of resident memory: allocators keep what they have once needed
ROLES = {"spawn_main": "worker", "uvicorn": "server", "idic_command": "driver"}
Samples = Mapping[tuple[str, int], Sequence[tuple[int, int]]]


def soaked(number: int, folder: Path) -> tuple[Samples, int, int]:
    """Samples (bytes, handles) of each (role, process), the finished runs, and the exit code."""
    (folder / "idic_command.py").write_text(PROGRAM)
    listed = folder / "list.csv"
    listed.write_text("experiment,name\n" + "".join(f"{demonstration().experiment},run-{k:03d}\n"
                                                    for k in range(number)))
    process = subprocess.Popen([sys.executable, str(folder / "idic_command.py"), "batch", str(listed), "--out",
                                str(folder / "out"), "--workers", "2"], stdout=subprocess.DEVNULL)
    samples: dict[tuple[str, int], list[tuple[int, int]]] = defaultdict(list)
    while process.poll() is None:
        time.sleep(PAUSE_S)
        for role, member in _members(process.pid):
            try:
                samples[role, member.pid].append((member.memory_info().rss, member.num_fds()))
            except psutil.Error:  # it has ended
                continue
    return samples, len(list((folder / "out").glob("**/result.json"))), process.returncode


def _members(pid: int) -> list[tuple[str, psutil.Process]]:
    try:
        driver = psutil.Process(pid)
        processes = [driver, *driver.children(recursive=True)]
        return [(role, member) for member in processes for mark, role in ROLES.items()
                if mark in " ".join(member.cmdline()) and (role == "driver") == (member.pid == pid)]
    except psutil.Error:
        return []


def main() -> int:
    """Exit code 1 where memory grew by more than `MAX_GROWTH`, or handles at all."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory(prefix="idic-soak-") as folder:
        began = time.monotonic()
        samples, finished, code = soaked(number, Path(folder))
        print(f"{finished} of {number} runs in {time.monotonic() - began:.0f} s, exit code {code}")
    is_flat = True
    for (role, pid), values in sorted(samples.items()):
        fifth = len(values) // 5
        if fifth < 2:  # a helper of some seconds
            continue
        parts = [values[k * fifth : (k + 1) * fifth] for k in range(5)]
        memory = [statistics.median(value for value, _ in part) for part in parts]
        handles = [statistics.median(value for _, value in part) for part in parts]
        growth = memory[-1] / memory[1] - 1.0
        is_flat &= growth <= MAX_GROWTH and handles[-1] <= handles[1]
        print(f"{role} {pid}: {', '.join(f'{value / 1e6:.0f}' for value in memory)} MB ({100 * growth:+.1f} %), "
              f"handles {', '.join(f'{value:.0f}' for value in handles)}; {len(values)} samples")
    return int(not is_flat)


if __name__ == "__main__":
    sys.exit(main())
