"""Images in memory as the readers give those of files: checked, labelled, one frame at a time."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.readers.images import FileStack, open_stack
from idic.readers.paths import existing_start, recorded_order

KEY = "images"
_DEPTHS = {"uint8": "uint8", "uint16": "uint16", "float16": "float32", "float32": "float32", "float64": "float32"}
_EXPECTED = "an array (n_frames, ny, nx), a list of arrays (ny, nx), or paths of image files"


class ArrayFrames:
    """Images in memory: uint8, uint16 or float, grey; floats become float32 as those of a file do.

    Parameters
    ----------
    images : array (n_frames, ny, nx), or a sequence of arrays (ny, nx)
        Indexed frame by frame: a Zarr or HDF5 array is read on demand. No copy is made.
    with_gaps : bool
        Height images: pixels without a value (NaN) are allowed.

    Raises
    ------
    InputError
        No image, images in colour, of different size, or of a depth that idic does not read.
    """

    def __init__(self, images: Sequence[np.ndarray] | np.ndarray, with_gaps: bool = False):
        self._images, self.with_gaps = images, with_gaps
        kinds = _kinds(images)
        if not hasattr(images, "__getitem__"):
            raise _refused("the images cannot be read one by one", type(images).__name__, "make a list of them")
        for k, (shape, dtype) in enumerate(kinds):
            if len(shape) != 2:
                colour = len(shape) == 3 and shape[-1] in (3, 4)
                raise _refused("a colour image" if colour else "not an image", f"frame {k} of shape {shape}",
                               "one channel, e.g. images[..., 0]" if colour else "give grey images of one size")
            if shape != kinds[0][0]:
                raise _refused("the images differ in size", f"frame {k} of shape {shape}, the first of {kinds[0][0]}",
                               "crop all images alike")
            if dtype not in _DEPTHS:
                raise InputError("an image depth that idic does not read", key=KEY, found=dtype,
                                 expected="uint8, uint16 or float32",
                                 remedy="convert them without loss, e.g. images.astype(np.uint16)")
            if dtype != kinds[0][1]:
                raise _refused("the images differ in depth", f"frame {k} in {dtype}, the first in {kinds[0][1]}",
                               "give all images in one depth")
        (rows, columns), self._dtype = kinds[0][0], _DEPTHS[kinds[0][1]]
        self._shape = rows, columns
        self.labels = tuple(f"frame_{k:03d}" for k in range(len(kinds)))

    @property
    def n_frames(self) -> int:
        return len(self.labels)

    @property
    def shape(self) -> tuple[int, int]:
        return self._shape

    def notes(self) -> list[str]:
        """Empty: an array does not state its origin."""
        return []

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`: uint8, uint16 or float32  # (ny, nx)"""
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} of a stack of {self.n_frames}")
        if np.ma.is_masked(self._images[k]):
            raise InputError("the image has masked pixels", key=f"{KEY}, frame {k}", expected="a value in every pixel",
                             found=f"{np.ma.count_masked(self._images[k])} pixels of a masked array",
                             remedy="height images: filled(np.nan); else give the plain array, and as mask= where "
                             "pixels may be correlated")
        image = np.ascontiguousarray(self._images[k], dtype=self._dtype)
        if image.dtype.kind == "f" and not (np.isfinite(image).any() if self.with_gaps else np.isfinite(image).all()):
            raise InputError("the image has pixels without a value", key=f"{KEY}, frame {k}",
                             expected="some finite values" if self.with_gaps else "finite values",
                             found=f"{int((~np.isfinite(image)).sum())} pixels are not finite",
                             remedy="exclude the frame (exclude_frames)" if self.with_gaps
                             else "replace them by the mean of their neighbours and exclude them with a mask")
        return np.where(np.isfinite(image), image, np.float32(np.nan)) if self.with_gaps else image


def frames_of(images: Any, with_gaps: bool = False) -> ArrayFrames | FileStack:
    """Images as a stack of frames.

    Parameters
    ----------
    images : array (n_frames, ny, nx), list of arrays, path of a file, folder or pattern, or list of such paths
        Files of a folder or pattern come in natural order, those of a list as listed.

    Raises
    ------
    InputError
        Nothing that is an image, or images that do not belong together.
    """
    if isinstance(images, (str, os.PathLike)):
        return open_stack(_files(images), file="idic.Experiment", key=KEY, with_gaps=with_gaps)
    if isinstance(images, Sequence) and images and all(isinstance(entry, (str, os.PathLike)) for entry in images):
        return open_stack([file for entry in images for file in _files(entry)], file="idic.Experiment", key=KEY,
                          with_gaps=with_gaps)
    return ArrayFrames(images, with_gaps)


def _files(path: str | os.PathLike) -> list[Path]:
    """The files that a path or pattern names, a folder all of its own."""
    named_path = Path(path)
    if named_path.is_file():
        return [named_path]
    start, tail = (named_path, "*") if named_path.is_dir() else existing_start(Path(named_path.anchor),
                                                                               named_path.relative_to(
        named_path.anchor).parts)
    pattern = os.path.join(glob.escape(str(start)), tail) if start.parts else tail
    files = [file for file in map(Path, glob.glob(pattern, recursive=True))
             if file.is_file() and not file.name.startswith(".")]
    files = recorded_order(files, Path(os.path.commonpath([file.parent for file in files])) if files else Path())
    if not files:
        raise InputError("no images match the pattern", key=KEY, expected=f"files that match {str(path)!r}",
                         found="none", remedy='correct the path, e.g. images="images/*.tif"')
    return files


def _kinds(images: Any) -> list[tuple[tuple[int, ...], str]]:
    """Shape and depth of every frame."""
    shape, dtype = getattr(images, "shape", None), getattr(images, "dtype", None)
    if shape is not None and dtype is not None:
        kinds = [(tuple(int(n) for n in shape[1:]), str(dtype))] * int(shape[0]) if len(shape) else []
    else:
        try:
            kinds = [(np.shape(image), str(np.asarray(image).dtype)) for image in images]
        except TypeError:
            kinds = []
    if not kinds:
        raise _refused("there are no images", type(images).__name__, "give the images of the test, the reference first")
    return kinds


def _refused(message: str, finding: str, remedy: str) -> InputError:
    return InputError(message, key=KEY, expected=_EXPECTED, found=finding, remedy=remedy)
