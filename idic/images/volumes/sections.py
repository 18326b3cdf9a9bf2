"""Three sections of a volume as one picture: the slice, and beside and below it the sections along it.

     rows x columns   |  rows x slices
    ------------------+----------------
     slices x columns |
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

GAP_PX = 4  # between the sections


def picture_shape(shape: tuple[int, int, int]) -> tuple[int, int]:
    """Rows and columns of the picture of a volume (nz, ny, nx)."""
    nz, ny, nx = shape
    return ny + GAP_PX + nz, nx + GAP_PX + nz


def picture_places(voxels: np.ndarray, shape: tuple[int, int, int],
                   at: tuple[int, int, int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Where voxels lie in the picture: of each section which of them are in it, and their row and column there.

    voxels : (n, 3) column, row, slice; at : column, row and slice that the sections run through

    Returns
    -------
    three pairs: numbers (m,) of voxels, and places (m, 2) row and column
    """
    _, ny, nx = shape
    x, y, z = np.asarray(voxels).T
    pairs = []
    for inside, row, column in ((z == at[2], y, x), (x == at[0], y, nx + GAP_PX + z), (y == at[1], ny + GAP_PX + z, x)):
        numbers = np.flatnonzero(inside)
        pairs.append((numbers, np.column_stack([row[numbers], column[numbers]])))
    return pairs


def picture(read: Callable[[slice, slice, slice], np.ndarray], shape: tuple[int, int, int],
            at: tuple[int, int, int], fill: float = 0.0) -> np.ndarray:
    """The picture of a volume  # read : a block by its slices -> (rows, columns) float32"""
    nz, ny, nx = shape
    column, row, plane = at
    image = np.full(picture_shape(shape), fill, dtype=np.float32)
    everything = slice(None)
    image[:ny, :nx] = read(slice(plane, plane + 1), everything, everything)[0]
    image[:ny, nx + GAP_PX:] = read(everything, everything, slice(column, column + 1))[:, :, 0].T
    image[ny + GAP_PX:, :nx] = read(everything, slice(row, row + 1), everything)[:, 0]
    return image
