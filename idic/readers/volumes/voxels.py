"""How the voxels of a scan lie in files: planes at offsets, chunks that are decoded whole, axes in another order.

Every source is a record of paths and numbers, which crosses process boundaries, and opens its file for one block.
"""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Protocol

import numpy as np

from idic.errors import InputError
from idic.remote_files import fetch

MAX_CACHE_BYTES = 256 * 2**20  # of decoded chunks and pages, per process: 32 pages of 2048 x 2048 voxels of 16 bit
Region = tuple[slice, slice, slice]


class VoxelSource(Protocol):
    """What `VolumeEntry` reads from."""

    def read(self, region: Region) -> np.ndarray:
        """The voxels of a region with starts and stops inside the volume  # (n, m, l)"""


@dataclass(frozen=True)
class RawPlanes:
    """Planes one after the other in a file, without compression.

    offsets : of every plane, or of the first alone where they follow each other without a gap; dtype : with the byte
    order of the file
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype
    offsets: tuple[int, ...]

    def read(self, region: Region) -> np.ndarray:
        planes, rows, columns = region
        _, ny, nx = self.shape
        row_bytes = nx * self.dtype.itemsize
        voxels = np.empty([part.stop - part.start for part in region], self.dtype.newbyteorder("="))
        n_rows = rows.stop - rows.start
        fetch(self.path)
        with self.path.open("rb", buffering=0) as stream:
            for k in range(planes.start, planes.stop):
                start = self.offsets[k] if len(self.offsets) > 1 else self.offsets[0] + k * ny * row_bytes
                content = _whole_read(stream.fileno(), n_rows * row_bytes, start + rows.start * row_bytes, self.path)
                voxels[k - planes.start] = np.frombuffer(content, self.dtype).reshape(n_rows, nx)[:, columns]
        return voxels

    @property
    def end(self) -> int:
        """Bytes that the file has at least."""
        plane = self.shape[1] * self.shape[2] * self.dtype.itemsize
        return max(self.offsets) + plane * (1 if len(self.offsets) > 1 else self.shape[0])


@dataclass(frozen=True)
class Chunks:
    """Chunks in a regular lattice, each decoded as a whole and kept while there is room.

    chunk : shape of a chunk; those at the end may be smaller; decode : the chunk at a place of the lattice; identity :
    what tells the chunks of this scan from all others
    """

    shape: tuple[int, int, int]
    dtype: np.dtype
    chunk: tuple[int, int, int]
    decode: Callable[[tuple[int, int, int]], np.ndarray]
    identity: Hashable

    def read(self, region: Region) -> np.ndarray:
        voxels = np.empty([part.stop - part.start for part in region], self.dtype.newbyteorder("="))
        lattice = [range(part.start // n, -(-part.stop // n)) for part, n in zip(region, self.chunk, strict=True)]
        for place in product(*lattice):
            values = CACHE.values((self.identity, place), partial(self.decode, place))
            starts = [k * n for k, n in zip(place, self.chunk, strict=True)]
            lower = [max(part.start, start) for part, start in zip(region, starts, strict=True)]
            upper = [min(part.stop, start + n) for part, start, n in zip(region, starts, self.chunk, strict=True)]
            inner = tuple(slice(a - start, b - start) for a, b, start in zip(lower, upper, starts, strict=True))
            target = tuple(slice(a - part.start, b - part.start)
                         for a, b, part in zip(lower, upper, region, strict=True))
            voxels[target] = values[inner]
        return voxels


@dataclass(frozen=True)
class OtherOrder:
    """A source whose axes are in another order.

    order : for z, y and x, the axis of the source
    """

    source: VoxelSource
    order: tuple[int, int, int]

    def read(self, region: Region) -> np.ndarray:
        stored = [slice(0)] * 3
        for axis, part in zip(self.order, region, strict=True):
            stored[axis] = part
        return np.ascontiguousarray(self.source.read(tuple(stored)).transpose(self.order))


def in_order(source: VoxelSource, order: Sequence[int]) -> VoxelSource:
    """The source with axes z, y, x; `order` gives the axis of the source for each."""
    return source if tuple(order) == (0, 1, 2) else OtherOrder(source, tuple(order))


class _Cache:
    """Decoded chunks, those used last; shared by the threads of a process."""

    def __init__(self, max_bytes: int):
        self.max_bytes, self.n_bytes = max_bytes, 0
        self._values: OrderedDict[Hashable, np.ndarray] = OrderedDict()
        self._lock = threading.Lock()

    def values(self, key: Hashable, decode: Callable[[], np.ndarray]) -> np.ndarray:
        """The chunk of a key, decoded where it is not there; two threads may decode one chunk at a time."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        chunk = decode()
        with self._lock:
            if key not in self._values and chunk.nbytes <= self.max_bytes:
                self._values[key] = chunk
                self.n_bytes += chunk.nbytes
                while self.n_bytes > self.max_bytes:
                    self.n_bytes -= self._values.popitem(last=False)[1].nbytes
        return chunk


CACHE = _Cache(MAX_CACHE_BYTES)


def _whole_read(descriptor: int, n_bytes: int, offset: int, path: Path) -> bytearray:
    """Bytes at a place of a file; InputError where it ends before."""
    content, n_read = bytearray(n_bytes), 0
    view = memoryview(content)
    while n_read < n_bytes:
        n = os.preadv(descriptor, [view[n_read:]], offset + n_read)
        if n == 0:
            raise truncated(path, offset + n_bytes, offset + n_read)
        n_read += n
    return content


def truncated(path: Path, expectation: int, finding: int) -> InputError:
    """The refusal of a file that ends too early, by its sizes in bytes."""
    return InputError("the volume file is truncated", file=path, key="volumes", expected=f"{expectation} bytes",
                      found=f"{finding} bytes", remedy="copy the file again from its source, or leave it out")
