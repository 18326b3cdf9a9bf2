"""The integrity of what a RUN stores: every chunk read against its checksum, by the workers where it is much."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from idic.run.store.arrays import Damaged, FrameArrays, read_array
from idic.run.store.run_store import RunStore
from idic.run.store.stack import ZarrStack
from idic.run.workers.runner import TaskRunner

BYTES_OF_A_JOB = 64_000_000
BYTES_FOR_WORKERS = 500_000_000  # a second or two of one process; less is not worth the wait for the workers


@dataclass(frozen=True)
class ScanJob:
    """Some records of an array, or with `images` some frames of a stack.

    group : its folder; first, stop : records, `stop` excluded
    """

    name: str
    group: str
    array: str
    first: int
    stop: int
    images: bool = False


def is_whole(job: ScanJob) -> bool:
    """Whether all records fit their checksums (a task)."""
    try:
        if job.images:
            stack = ZarrStack(job.group)
            for k in range(job.first, job.stop):
                stack.frame(k)
            return True
        stored = FrameArrays.open(job.group, job.array)
        if not stored.shape or not stored.n_frames:
            read_array(job.group, job.array)
            return True
        for first, stop in stored.chunks():
            if job.first <= first < job.stop:
                stored.read(first, stop)
    except Damaged:
        return False
    return True


def damaged_groups(store: RunStore, names: Iterable[str], images: Iterable[str], runner: TaskRunner) -> set[str]:
    """Those of these groups that are missing, unfinished or altered; images : groups of frames."""
    names, images = list(names), list(images)
    jobs, spoilt = [], set()
    for name in dict.fromkeys([*images, *names]):
        try:
            jobs += _jobs(store, name, name in images)
        except Damaged:
            spoilt.add(name)
    spread = runner.sees_files and runner.workers > 1 and stored_bytes(store) > BYTES_FOR_WORKERS
    verdicts = runner.stream(is_whole, jobs,
                             [f"scan-{job.name}-{job.array}-{job.first}" for job in jobs]) if spread else map(
        is_whole, jobs)
    return spoilt | {job.name for job, intact in zip(jobs, verdicts, strict=True) if not intact}


def stored_bytes(store: RunStore) -> int:
    """Bytes of all files of the store."""
    return sum(os.stat(os.path.join(base, name)).st_size for base, _, names in os.walk(store.path) for name in names)


def _jobs(store: RunStore, name: str, images: bool) -> list[ScanJob]:
    folder = store.group(name)
    if images:
        stack = ZarrStack(folder)
        record = max(1, int(stack.frame_bytes))
        return [ScanJob(name, str(folder), "frames", first, stop, True)
                for first, stop in _spans(stack.n_frames, stack.frames_per_chunk, record)]
    jobs = []
    for array in sorted(file.parent.name for file in folder.glob("*/zarr.json")):
        stored = FrameArrays.open(folder, array)
        record = stored.record_bytes if stored.shape and stored.n_frames else 0
        spans = _spans(stored.n_frames, stored.frames_per_chunk, record) if record else [(0, 1)]
        jobs += [ScanJob(name, str(folder), array, first, stop) for first, stop in spans]
    return jobs


def _spans(n: int, step: int, record_bytes: int) -> Sequence[tuple[int, int]]:
    """Whole chunks of about `BYTES_OF_A_JOB`."""
    size = step * max(1, BYTES_OF_A_JOB // (step * record_bytes))
    return [(first, min(first + size, n)) for first in range(0, n, size)]

