"""Orientation tag of TIFF and EXIF: how the stored rows and columns are to be turned to show the scene upright.

Tag 274 of TIFF 6.0 (1992), p. 36, and of EXIF 2.32: the side of the scene that the first stored row and the first
stored column show.
"""

from __future__ import annotations

import numpy as np

TAG = 274
UPRIGHT = 1
_WORDS = {2: "mirrored left to right", 3: "turned by 180°", 4: "mirrored top to bottom",
          5: "mirrored along the diagonal", 6: "turned by 90° clockwise", 7: "mirrored along the other diagonal",
          8: "turned by 90° counter-clockwise"}


def orientation_of(value: object) -> int:
    """The orientation that a tag states; upright where it states none that exists."""
    return value if isinstance(value, int) and value in _WORDS else UPRIGHT


def upright_shape(shape: tuple[int, int], orientation: int) -> tuple[int, int]:
    """(rows, columns) of the upright image."""
    return (shape[1], shape[0]) if orientation >= 5 else shape


def upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """The image as it is to be seen  # (ny, nx)"""
    if orientation >= 5:
        image = image.T
    # row and column directions after the exchange of rows and columns
    rows = -1 if orientation in (3, 4, 7, 8) else 1
    columns = -1 if orientation in (2, 3, 6, 7) else 1
    return image[::rows, ::columns]


def orientation_note(labels_and_orientations: list[tuple[str, int]]) -> list[str]:
    """One note on images that are stored in another orientation than upright; mixed orientations are named."""
    turned = [(label, orientation) for label, orientation in labels_and_orientations if orientation != UPRIGHT]
    if not turned:
        return []
    kinds = {orientation for _, orientation in turned}
    every = len(turned) == len(labels_and_orientations) and len(kinds) == 1
    number = len(labels_and_orientations)
    subject = "the images" if every else f"{len(turned)} of {number} images (first {turned[0][0]})"
    return [f"{subject} are {_WORDS[turned[0][1]]} as their orientation tag ({TAG} = {turned[0][1]}) says; columns and "
            f"rows "
            "count in the turned image" + ("" if every else ": check that the camera was not turned during the test")]
