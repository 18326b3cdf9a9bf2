"""A stack of images: a number of frames, a shape, one frame at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from idic.errors import InputError


@runtime_checkable
class Stack(Protocol):
    """Images of equal size, read one by one; `frame` may be called from several threads at once."""

    @property
    def n_frames(self) -> int: ...

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx): rows, columns."""
        ...

    def frame(self, k: int) -> np.ndarray:
        """Frame `k` in grey values (or height units): uint8, uint16 or float32  # (ny, nx)"""
        ...


class ArrayStack:
    """A stack in memory.

    Parameters
    ----------
    images : array (n_frames, ny, nx) or sequence of arrays (ny, nx)
        Grey values; no copy is made.

    Raises
    ------
    InputError
        Where the images differ in size or are not two-dimensional.
    """

    def __init__(self, images: np.ndarray | Sequence[np.ndarray]):
        if len(images) == 0:
            raise InputError("the image stack is empty", expected="one image or more", found="none",
                             remedy="check the pattern of experiment.images")
        shapes = {np.shape(image) for image in images}
        if len(shapes) > 1 or len(next(iter(shapes))) != 2:
            raise InputError(
                "the images of a stack must be grey images of one size",
                expected="(ny, nx) for every image",
                found=", ".join(str(shape) for shape in sorted(shapes, key=str)),
                remedy="leave out the images of another size, or crop all of them alike",
            )
        self._images = images
        rows, columns = next(iter(shapes))
        self._shape = int(rows), int(columns)

    @property
    def n_frames(self) -> int:
        return len(self._images)

    @property
    def shape(self) -> tuple[int, int]:
        return self._shape

    def frame(self, k: int) -> np.ndarray:
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} of a stack of {self.n_frames}")
        return np.asarray(self._images[k])

    def __len__(self) -> int:
        return self.n_frames
