"""Arrays on disk with one record per frame: chunks with checksums; a reader refuses incomplete ones.

Images, residual maps, small records and what a finished run keeps are compressed without loss, at 200 MB/s and read at
500 MB/s or more: nodal values to two thirds, and further where their last digits are not needed (`rounded`). What every
step of a run writes and reads is not.

Zarr returns the fill value for a missing chunk and reports nothing; every reader here checks for the chunks first.
Damage inside a chunk is found by the crc32c codec.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path, PurePath

import numpy as np
import zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec
from zarr.core import sync

from idic.errors import InputError
from idic.inside import is_regular
from idic.remote_files import fetch

_CODECS, _KINDS = (BytesCodec, BloscCodec, Crc32cCodec), "biuf"
_DIFFERENCES = "numcodecs.delta"  # every value less the one before, by numcodecs: any Zarr for Python reads it
_DIGITS = "binary_digits"  # attribute of an array whose further digits were cut off
warnings.filterwarnings("ignore", message="Numcodecs codecs are not in the Zarr version 3 specification")
MIN_COMPRESSED_BYTES = 16_384  # of an array: less is a block of the disk or a few
MAX_CHUNKS = 1_000_000  # of an array, a file each: an array of idic has one per frame at most


class Damaged(InputError):
    """Stored data are missing or altered; the caller may compute them again."""

    def __reduce__(self):
        return _rebuild_damaged, (self.what, self.file, self.key, self.expected, self.found, self.remedy)


def _rebuild_damaged(what, file, key, expected, found, remedy):
    return Damaged(what, file=file, key=key, expected=expected, found=found, remedy=remedy)


def leave_stuck_io() -> None:
    """Let the next reads and writes begin with a new thread of Zarr's.

    An interruption may leave a lock behind that the old thread waits for; every later read would wait for that thread.
    """
    sync.loop[0] = sync.iothread[0] = None


def create_array(group: Path | str, name: str, shape, chunks, dtype, attributes=None,
                 compressed: bool = False) -> zarr.Array:
    """A new array in the folder `group`, with crc32c per chunk; floats that are not written read as NaN.

    compressed : for grey values and maps of them: camera noise leaves a half to two thirds
    """
    dtype = np.dtype(dtype)
    of_neighbours = compressed and dtype == np.uint8
    if PurePath(name).name != name:
        raise ValueError(f"an array of that name would lie outside its group: {name!r}")
    return zarr.create_array(
        store=str(Path(group) / name),
        shape=tuple(shape),
        chunks=tuple(chunks),
        dtype=dtype,
        fill_value=np.nan if dtype.kind == "f" else 0,
        filters=[{"name": _DIFFERENCES, "configuration": {"dtype": dtype.str}}] if of_neighbours else None,
        compressors=[*([_smaller(dtype)] if compressed else []), Crc32cCodec()],
        attributes=attributes or {},
        config={"write_empty_chunks": True},  # otherwise frames of zeros look like missing ones
    )


def _smaller(dtype: np.dtype) -> BloscCodec:
    shuffle = {"|u1": "noshuffle", "<f2": "shuffle"}.get(dtype.str, "bitshuffle")  # <f2: maps of a few digits
    return BloscCodec(cname="zstd", clevel=1, shuffle=shuffle, typesize=dtype.itemsize)


def rounded(values: np.ndarray, digits: int | None) -> np.ndarray:
    """Values with this many binary digits, in the same type: what is cut off compresses to nothing; None: all."""
    if digits is None:
        return values
    scale, exponent = np.frexp(values)
    return np.ldexp(np.round(np.ldexp(scale, digits)), exponent - digits).astype(values.dtype)


def open_array(group: Path | str, name: str, mode: str = "r") -> zarr.Array:
    """The array `name` of the folder `group`; `Damaged` if it is missing or its description is unreadable.

    Zarr takes a millisecond to read a description, and every step of a run reads a hundred of them: an array that was
    opened before is taken as it is while its description is the same file of the same age and size.
    """
    path = os.path.join(os.path.abspath(group), name)
    try:
        status = os.lstat(os.path.join(path, "zarr.json"))
    except OSError as problem:
        raise _damage(Path(path), found=f"{type(problem).__name__}: {problem}") from problem
    return _opened(path, mode, (status.st_dev, status.st_ino, status.st_mtime_ns, status.st_size))


@lru_cache(maxsize=1024)
def _opened(folder: str, mode: str, description: tuple) -> zarr.Array:
    """The array as Zarr reads it; `description` tells its zarr.json from an older one of the same name."""
    path = Path(folder)
    try:
        array = zarr.open_array(store=folder, mode=mode, zarr_format=3)
    except (FileNotFoundError, ValueError, KeyError, TypeError, OverflowError) as problem:
        raise _damage(path, found=f"{type(problem).__name__}: {problem}") from problem
    _refuse_foreign(array, path)
    if min(array.chunks, default=1) < 1:
        raise _damage(path, found=f"a description of chunks of {array.chunks} values")
    if array.nchunks > MAX_CHUNKS:  # each is a file whose presence is asked for
        raise _damage(path, found=f"a description of {array.nchunks} chunks")
    return array.with_config({"write_empty_chunks": True})  # as of `create_array`; open_array leaves it out


def _refuse_foreign(array: zarr.Array, path: Path) -> None:
    """Refuse data types and codecs that idic does not write: a RUN may come from a foreign source, and a codec such as
    pickle executes code of its author."""
    foreign = [type(codec).__name__ for codec in array.metadata.codecs
               if not isinstance(codec, _CODECS) and codec.to_dict()["name"] != _DIFFERENCES]
    if array.dtype.kind not in _KINDS or foreign:
        raise InputError("the stored data were not written by idic", file=path,
                         expected="an array of numbers with checksums",
                         found=", ".join(foreign) or f"values of type {array.dtype}",
                         remedy="do not use this folder; repeat the run with another --out")


def missing_chunks(array: zarr.Array, path: Path, first: int = 0, stop: int | None = None) -> list[str]:
    """Names of the absent chunk files among those that hold the records [first, stop); chunked along time only."""
    if not array.ndim:
        keys = [array.metadata.encode_chunk_key(())]
    else:
        step, zeros = array.chunks[0], (0,) * (array.ndim - 1)
        stop = array.shape[0] if stop is None else stop
        keys = [array.metadata.encode_chunk_key((i, *zeros)) for i in range(first // step, -(-stop // step))]
    files = {key: os.path.join(path, key) for key in keys}
    return [key for key, file in files.items() if not (is_regular(file) or _came(file))]


def _came(file: str) -> bool:
    fetch(file)
    return is_regular(file)


def read_block(array: zarr.Array, path: Path, first: int, stop: int) -> np.ndarray:
    """Records [first, stop) of an array; `Damaged` if one of them is missing or altered."""
    missing = missing_chunks(array, path, first, stop)
    if missing:
        raise _damage(path, found=f"{len(missing)} missing chunk(s), the first is {missing[0]}")
    try:
        return array[first:stop]
    except Exception as problem:  # the codec's checksum, a truncated file, an unreadable disk
        raise _damage(path, found=f"records {first} to {stop - 1}: {problem}") from problem


def write_array(group: Path | str, name: str, values: np.ndarray) -> None:
    """Store a whole array as one chunk (small records: M, b, the history of the parameters)."""
    values = np.asarray(values)
    array = create_array(group, name, values.shape, [max(n, 1) for n in values.shape], values.dtype,
                         compressed=values.nbytes >= MIN_COMPRESSED_BYTES)
    array[...] = values


def read_array(group: Path | str, name: str) -> np.ndarray:
    """The whole array `name`, checked for missing and altered chunks."""
    array, path = open_array(group, name), Path(group) / name
    if array.size == 0:
        return array[...]
    if array.ndim:
        return read_block(array, path, 0, array.shape[0])
    if missing_chunks(array, path):
        raise _damage(path, found="its chunk is missing")
    return array[...]


def gets_smaller(group: Path | str, name: str, digits: int | None = None) -> bool:
    """Whether an array is large enough to be compressed, and is not, or has more than these binary digits."""
    array = open_array(group, name)
    is_long = digits is not None and array.attrs.get(_DIGITS) is None
    return array.nbytes >= MIN_COMPRESSED_BYTES and (is_long or not any(isinstance(codec, BloscCodec)
                                                                        for codec in array.metadata.codecs))


def write_compressed(source: Path | str, group: Path | str, name: str, digits: int | None = None) -> None:
    """The same array, chunk by chunk, in another group; `Damaged` if it is incomplete or altered.

    digits : binary ones that are kept; None: the same bits
    """
    original = FrameArrays.open(source, name)
    copy = FrameArrays.create(group, name, original.n_frames, original.shape, original.frames_per_chunk, original.dtype,
                              compressed=True, attributes=None if digits is None else {_DIGITS: digits})
    for first, stop in original.chunks():
        copy.write(first, rounded(original.read(first, stop), digits))


class FrameArrays:
    """An array of one record per frame, ``(n_frames, *shape)``, in chunks along time.

    Several processes may write different chunks at the same time; a block therefore consists of whole chunks. `writer`
    takes frames one by one and holds at most one chunk in memory.
    """

    def __init__(self, array: zarr.Array, path: Path):
        self._array, self._path = array, path

    @classmethod
    def create(cls, group, name: str, n_frames: int, shape, frames_per_chunk: int = 1, dtype="f8",
               compressed: bool = False, attributes=None) -> FrameArrays:
        """A new empty array `name` in the folder `group`, shape ``(n_frames, *shape)``."""
        chunks = (max(1, min(frames_per_chunk, n_frames)), *(max(n, 1) for n in shape))
        return cls(create_array(group, name, (n_frames, *shape), chunks, dtype, attributes, compressed),
                   Path(group) / name)

    @classmethod
    def open(cls, group, name: str, mode: str = "r") -> FrameArrays:
        """The existing array `name` of the folder `group`; mode "r+" to write into it (a worker's chunks)."""
        return cls(open_array(group, name, mode), Path(group) / name)

    @property
    def n_frames(self) -> int:
        return self._array.shape[0]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the record of one frame."""
        return tuple(self._array.shape[1:])

    @property
    def record_bytes(self) -> int:
        """Bytes of the record of one frame."""
        return int(np.prod(self.shape, dtype=np.int64)) * self._array.dtype.itemsize

    @property
    def dtype(self) -> np.dtype:
        return self._array.dtype

    @property
    def frames_per_chunk(self) -> int:
        return self._array.chunks[0]

    def chunks(self) -> list[tuple[int, int]]:
        """The blocks ``(first, last)``, last excluded, in which the array is stored; one task handles one block."""
        step = self.frames_per_chunk
        return [(first, min(first + step, self.n_frames)) for first in range(0, self.n_frames, step)]

    def write(self, first: int, block: np.ndarray) -> None:
        """Store ``block`` (n, *shape) as the records of the frames from `first` on; whole chunks only."""
        stop, step = first + len(block), self.frames_per_chunk
        if block.shape[1:] != self.shape:
            raise ValueError(f"{self._path}: expected records of shape {self.shape}, got {block.shape[1:]}")
        if first % step or (stop % step and stop != self.n_frames) or stop > self.n_frames:
            raise ValueError(f"{self._path}: frames {first} to {stop - 1} are not whole chunks of {step}")
        if block.size:
            self._array[first:stop] = block

    def read(self, first: int = 0, stop: int | None = None) -> np.ndarray:
        """The records of the frames [first, stop), checked  # (stop - first, *shape)"""
        stop = self.n_frames if stop is None else stop
        if not 0 <= first <= stop <= self.n_frames:
            raise IndexError(f"{self._path}: frames {first} to {stop - 1} of {self.n_frames}")
        if self._array.size == 0 or first == stop:
            return np.empty((stop - first, *self.shape), self._array.dtype)
        return read_block(self._array, self._path, first, stop)

    def shorten(self, n_frames: int) -> None:
        """Keep the first records only."""
        self._array.resize((n_frames, *self.shape))

    def missing(self) -> list[str]:
        """Names of the missing chunks."""
        return [] if self._array.size == 0 else missing_chunks(self._array, self._path)

    @contextmanager
    def writer(self, first: int = 0) -> Iterator[FrameWriter]:
        """Append records one by one from frame `first` on (the start of a chunk); the end writes the last chunk."""
        writer = FrameWriter(self, first)
        yield writer
        writer.flush()


class FrameWriter:
    """Collects records until a chunk is full."""

    def __init__(self, target: FrameArrays, first: int):
        self._target, self._next = target, first
        self._buffer: list[np.ndarray] = []

    def append(self, record: np.ndarray) -> None:
        """The record of the next frame; it is copied."""
        self._buffer.append(np.array(record))
        if len(self._buffer) == self._target.frames_per_chunk:
            self.flush()

    def flush(self) -> None:
        if self._buffer:
            self._target.write(self._next, np.stack(self._buffer))
            self._next += len(self._buffer)
            self._buffer = []


def _damage(path: Path, found: str) -> Damaged:
    return Damaged(
        "stored data are missing or damaged",
        file=path,
        expected="every chunk with its checksum",
        found=found,
        remedy="run the command again with --resume: the damaged part is computed again",
    )
