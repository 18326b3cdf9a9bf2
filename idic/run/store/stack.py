"""Images in the RUN folder: copied once, frame by frame, and verified at every read."""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.images import Stack
from idic.run.store.arrays import Damaged, create_array, open_array, read_block
from idic.run.store.schemas.groups import IngestedImages
from idic.run.store.schemas.types import refuse_other_types
from idic.run.store.image_files import FILES, describe, files_of

GROUP = "images"
ARRAY = "frames"
# bytes of a frame; smaller frames share chunks of up to 16, as a read takes at least 0.3 ms
_MIN_OWN_CHUNK_BYTES = 500_000
_FRAMES_PER_SMALL_CHUNK = 16


class ZarrStack:
    """A stack in Zarr. It follows the `Stack` protocol; another process receives its path.

    Parameters
    ----------
    group : Path
        The finished folder ``run.zarr/images``.
    """

    def __init__(self, group: Path | str):
        self.group = Path(group)
        self._array = open_array(self.group, ARRAY)
        attributes = self._array.attrs
        if attributes.get("finished"):
            refuse_other_types(dict(attributes), IngestedImages, self.group / ARRAY)
        self._checksums = attributes.get("frame_crc32", [])
        self.files = tuple(attributes.get(FILES, ()))  # what was ingested (`idic.run.store.image_files`)
        if not attributes.get("finished") or len(self._checksums) != self._array.shape[0]:
            raise _incomplete(self.group, f"{len(self._checksums)} of {self._array.shape[0]} frames")
        self._cached: tuple[int, np.ndarray] | None = None

    def __reduce__(self):
        return ZarrStack, (str(self.group),)

    @property
    def n_frames(self) -> int:
        return self._array.shape[0]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows, columns."""
        return tuple(self._array.shape[1:])

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return int(self._array.nbytes // max(self.n_frames, 1))

    @property
    def frames_per_chunk(self) -> int:
        return self._array.chunks[0]

    def frame(self, k: int) -> np.ndarray:
        """Grey values of frame `k`, as they were ingested  # (ny, nx)"""
        k = range(self.n_frames)[k]
        chunk = k // self.frames_per_chunk
        cached = self._cached  # one reference, as another thread may replace it
        if cached is None or cached[0] != chunk:
            cached = self._cached = (chunk, self._read_chunk(chunk))
        return cached[1][k - chunk * self.frames_per_chunk]

    def _read_chunk(self, chunk: int) -> np.ndarray:
        first = chunk * self.frames_per_chunk
        stop = min(first + self.frames_per_chunk, self.n_frames)
        frames = read_block(self._array, self.group / ARRAY, first, stop)
        for k, image in enumerate(frames, start=first):
            if zlib.crc32(image) != self._checksums[k]:
                raise _incomplete(self.group, f"frame {k} differs from the ingested one")
        frames.flags.writeable = False
        return frames

    @classmethod
    def of(cls, store, stack: Stack, progress: Callable[[int, int], None] | None = None, source: str = "",
           name: str = GROUP, spread: Spread = map) -> ZarrStack:
        """Copy a stack into ``run.zarr/images`` (or the group `name`) unless it holds a complete copy of the same
        source.

        Parameters
        ----------
        store : RunStore
            A claimed store.
        stack : Stack
            Read one frame at a time, in order; no more than one chunk is in memory.
        progress : callable, optional
            Called as ``progress(count, total)`` after every chunk.
        source : str
            Identity of the stack (a hash of names, sizes and settings); a copy of another source is replaced.
        spread : callable
            Calls a function with every job; the workers, where they copy the chunks.

        Raises
        ------
        InputError
            The disk is too full, or a frame differs from the first one in size or type.
        """
        first = np.asarray(stack.frame(0))
        ident = {"source": source, "shape": [stack.n_frames, *first.shape], "dtype": first.dtype.str}
        existing = store.finished(name, ident)
        if existing is not None:
            return cls(existing)
        _require_space(store.run, stack.n_frames * first.nbytes)
        step = 1 if first.nbytes >= _MIN_OWN_CHUNK_BYTES else -(-stack.n_frames //
                                                                -(-stack.n_frames // _FRAMES_PER_SMALL_CHUNK))
        with store.building(name, ident) as group:
            array = create_array(group, ARRAY, (stack.n_frames, *first.shape), (step, *first.shape), first.dtype,
                                 compressed=True)
            checksums: list[int] = []
            files: list[dict] = []
            jobs = _ingest_jobs(str(group), stack, step)
            for job, (checksums_of_job, described) in zip(jobs, spread(ingest_frames, jobs), strict=True):
                checksums += checksums_of_job
                files += described
                if progress is not None:
                    progress(job.stop, stack.n_frames)
            array.attrs.update({"finished": True, "frame_crc32": checksums, FILES: files})
        return cls(store.group(name))


@dataclass(frozen=True)
class IngestJob:
    """The frames [first, stop) of a recording, to be copied into the array of a group.

    stack : from frame `begins` of the recording on; files : those that no job before has
    """

    group: str
    stack: Stack
    first: int
    stop: int
    files: tuple[Path, ...]
    begins: int = 0

    @property
    def name(self) -> str:
        return f"ingest-frames{self.first}-{self.stop - 1}"


Ingested = tuple[list[int], list[dict]]  # checksums of frames, descriptions of files
Spread = Callable[[Callable[[IngestJob], Ingested], Sequence[IngestJob]], Iterable[Ingested]]  # as `map` does, in order


def _ingest_jobs(group: str, stack: Stack, step: int) -> list[IngestJob]:
    """A job per chunk of `step` frames; a file of many frames belongs to the first of its jobs."""
    jobs, known_paths = [], set()
    for first in range(0, stack.n_frames, step):
        stop = min(first + step, stack.n_frames)
        new_paths = tuple(path for path in files_of(stack, range(first, stop)) if path not in known_paths)
        known_paths.update(new_paths)
        jobs.append(IngestJob(group, stack, first, stop, new_paths))
    return jobs


def ingest_frames(job: IngestJob) -> Ingested:
    """Copy some frames (a task); returns the checksums of the frames, and the descriptions of the job's files."""
    array = open_array(job.group, ARRAY, "r+")
    described = [describe(path) for path in job.files]
    frames = np.stack([_checked(job, k, array.shape[1:], array.dtype) for k in range(job.first, job.stop)])
    array[job.first : job.stop] = frames
    return [zlib.crc32(image) for image in frames], described


def _checked(job: IngestJob, k: int, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    image = np.asarray(job.stack.frame(k - job.begins))
    if image.shape != shape or image.dtype != dtype:
        raise InputError(
            f"frame {k} differs from frame 0 in size or depth",
            expected=f"{shape[0]} x {shape[1]} {dtype}",
            found=f"{' x '.join(map(str, image.shape))} {image.dtype}",
            remedy="remove or convert this image",
        )
    return np.ascontiguousarray(image)


def _require_space(folder: Path, needed: int) -> None:
    free_bytes = shutil.disk_usage(folder).free
    if needed * 1.02 > free_bytes:  # 2 %: checksums, folders and the file system's own records
        raise InputError(
            "not enough space for the images in the RUN folder",
            file=folder,
            expected=f"{needed / 1e9:.2f} GB free",
            found=f"{free_bytes / 1e9:.2f} GB",
            remedy="free some space, or choose an --out on another disk",
        )


def _incomplete(group: Path, found: str) -> Damaged:
    return Damaged(
        "the ingested images are incomplete or altered",
        file=group,
        expected="every frame with its checksum",
        found=found,
        remedy="run the command again with --resume: the images are ingested again",
    )
