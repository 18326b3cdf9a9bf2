"""Stages of µDIC as ``np.save("fields.npy", fields.coords())`` writes them: positions of the points in every image.

(n_elements, 2, n, m, n_images) in px; rows count downwards, a stage has them upwards.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.fields.stages.failed_points import MAX_LENGTH
from idic.readers.fields.stages.stage import KEY, Stage

SUFFIXES = (".npy",)


def read_mudic(path: Path) -> dict[float | None, Stage]:
    """All stages of a file by the number of the image.

    Raises
    ------
    InputError
        The file is damaged, or holds another array.
    """
    expected = "an array (elements, 2, n, m, images), as fields.coords() of µDIC gives it"
    try:
        coords = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as problem:  # noqa: BLE001  (damaged headers raise many types)
        raise InputError("not a readable NumPy file", file=path, key=KEY, expected=expected, found=str(problem),
                         remedy='save it again: np.save("fields.npy", fields.coords())') from None
    if coords.ndim != 5 or coords.shape[1] != 2 or coords.dtype.kind != "f" or coords.shape[4] < 2 or not coords.size:
        raise InputError("not the positions of points in images", file=path, key=KEY, expected=expected,
                         found=f"an array {coords.shape} of {coords.dtype}",
                         remedy='save them: np.save("fields.npy", fields.coords())')
    ids = np.arange(coords[:, 0, :, :, 0].size, dtype=np.int64)
    at = np.asarray(np.moveaxis(coords, 1, 3), dtype=float).reshape(len(ids), 2, -1) * np.array([[1.0], [-1.0]])
    at = np.where(np.abs(at) < MAX_LENGTH, at, np.nan)
    return {float(k): Stage(at[:, :, 0].copy(), at[:, :, k] - at[:, :, 0], "px", ids) for k in range(at.shape[2])}
