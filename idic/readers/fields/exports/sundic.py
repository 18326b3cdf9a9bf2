"""Stages of sun-dic: its container `.sdic`, msgpack objects; displacements from the first image, in px.

Version, date and settings, then of every pair of images its number, the shape, and the array: rows of points with
column, row, …, u at place 5 and v at place 11 (or 6, of displacements alone), perhaps compressed by zlib. Arrays are
those of msgpack_numpy: nothing in the file is executed. Rows and v count downwards, a stage has them upwards.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.readers.fields.stages.failed_points import sound_points
from idic.readers.fields.stages.stage import KEY, Stage

SUFFIXES = (".sdic",)
_V_AT = {7: 6, 17: 11}  # number of values per point: place of v
_U_AT = 5
_UPWARDS = np.array([1.0, -1.0])
_MAX_BYTES = 1 << 31  # of one array


def read_sundic(path: Path) -> dict[float | None, Stage]:
    """The reference, number 0, and a stage per pair of images, from 1 on.

    Raises
    ------
    InputError
        The file is cut off, holds no pair, or is none of sun-dic.
    """
    try:
        stages = {float(k): _stage(values) for k, values in enumerate(_pairs(path.read_bytes()), 1)}
    except Exception as problem:  # noqa: BLE001  (msgpack and zlib raise many kinds)
        raise _refused(path, f"{type(problem).__name__}: {problem}") from None
    if not stages:
        raise _refused(path, "no pair of images")
    first = stages[1.0]
    assert first.displacement is not None
    return {0.0: Stage(first.points, np.zeros_like(first.points), "px"), **stages}


def _pairs(data: bytes) -> Iterator[np.ndarray]:
    """The arrays of the pairs  # (n_points, 7 | 17)"""
    import msgpack

    unpacker = msgpack.Unpacker(raw=False, strict_map_key=False, max_buffer_size=len(data))
    unpacker.feed(data)
    for _ in range(3):
        unpacker.unpack()  # version, date, settings
    while unpacker.tell() < len(data):
        _, shape, payload = (unpacker.unpack() for _ in range(3))
        if isinstance(payload, bytes):
            expanded = zlib.decompressobj().decompress(payload, _MAX_BYTES)
            payload = msgpack.unpackb(expanded, raw=False, strict_map_key=False)
        yield _array(payload).reshape(-1, shape[-1])


def _array(entry: Mapping[Any, Any]) -> np.ndarray:
    """An array of msgpack_numpy with numbers."""
    fields = {key.decode() if isinstance(key, bytes) else key: value for key, value in entry.items()}
    dtype = np.dtype(fields["type"])
    if dtype.kind not in "fiu":
        raise ValueError(f"an array of {dtype}")
    return np.frombuffer(fields["data"], dtype).astype(float)


def _stage(values: np.ndarray) -> Stage:
    if values.shape[1] not in _V_AT:
        raise ValueError(f"{values.shape[1]} values per point")
    displacement = values[:, [_U_AT, _V_AT[values.shape[1]]]] * _UPWARDS
    sound = sound_points(values[:, :2] * _UPWARDS, displacement, None, "sun-dic", {})
    return Stage(sound.points, sound.displacement, "px", failed=sound.failed, placeless=sound.placeless)


def _refused(path: Path, finding: str) -> InputError:
    return InputError("not a readable file of sun-dic", file=path, key=KEY,
                      expected="the .sdic of an analysis with its pairs of images", found=finding,
                      remedy="run the analysis again, or export the displacements as CSV")
