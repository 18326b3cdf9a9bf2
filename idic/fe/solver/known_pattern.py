"""The numbering of a mesh, made once for simulations that follow each other on it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from idic.fe.solver.linear import Pattern, make_pattern

MAX_KEPT_PATTERNS = 4  # given mesh and finer one, body held in two ways
# of their matrices, all together: a body, its finer mesh and its bricks; a larger one takes much memory, and little
# time beside its factors
MAX_KEPT_ENTRIES = 8_000_000

_kept: dict[bytes, Pattern] = {}


def known_pattern(coordinates: np.ndarray, element_dofs: Sequence[np.ndarray], prescribed: np.ndarray) -> Pattern:
    """`make_pattern`; that of a mesh of moderate size is kept for the next simulation of the same mesh, held alike.

    A diagnosis simulates one mesh some thirty times, and its numbering costs as much as several frames of it.
    """
    key = _digest(coordinates, prescribed, *element_dofs)
    pattern = _kept.pop(key, None)
    if pattern is None:
        pattern = make_pattern(coordinates, element_dofs, prescribed)
    if pattern.n_stored <= MAX_KEPT_ENTRIES:
        _kept[key] = pattern  # the last one used stands last
        newest_first = list(_kept.items())[::-1]
        n_entries = np.cumsum([former_pattern.n_stored for _, former_pattern in newest_first])
        for number, (stale_key, _) in enumerate(newest_first):
            if number >= MAX_KEPT_PATTERNS or n_entries[number] > MAX_KEPT_ENTRIES:
                _kept.pop(stale_key, None)
    return pattern


def _digest(*arrays: np.ndarray) -> bytes:
    content = hashlib.blake2b(digest_size=16)
    for array in arrays:
        content.update(repr((array.shape, array.dtype.str)).encode())
        content.update(np.ascontiguousarray(array).tobytes())
    return content.digest()
