"""Compression in blocks: what JPEG leaves in the grey values of an image, whatever file holds them since.

JPEG divides an image into blocks of 8 x 8 px, takes the cosine transform of each and rounds it; of the finest
components most become zero (ITU-T T.81, 1992). The transform of other blocks, which lie across these, has no such
zeros. So the finest components of one position of the blocks are far smaller than those of all others.
"""

from __future__ import annotations

import numpy as np
import scipy

BLOCK_PX = 8
FINEST = 9  # sum of the two indices of a component, from which on it counts
MIN_RATIO = 1.1  # of the second smallest of the 64 positions over the smallest; recordings without: up to 1.002
MAX_SIDE_PX = 256  # of the part that is looked at, in the middle of the image


def compressed_at(image: np.ndarray) -> tuple[int, int] | None:
    """Row and column (0 to 7 px) at which the blocks of a compressed image begin; None where there are none.

    image : (ny, nx); an image of fewer than 16 px, of heights, or with gaps has none
    """
    image = np.asarray(image)
    if image.ndim != 2 or min(image.shape) < 2 * BLOCK_PX or not np.isfinite(image).all():
        return None
    begin = [max(0, (size - MAX_SIDE_PX) // 2) for size in image.shape]
    part = image[begin[0]:begin[0] + MAX_SIDE_PX, begin[1]:begin[1] + MAX_SIDE_PX].astype(np.float32)
    sizes = np.array([[_finest(part[row:, column:]) for column in range(BLOCK_PX)] for row in range(BLOCK_PX)])
    least, second = np.sort(sizes, axis=None)[:2]
    if not second > MIN_RATIO * least:
        return None
    row, column = np.unravel_index(int(sizes.argmin()), sizes.shape)
    return int(begin[0] + row) % BLOCK_PX, int(begin[1] + column) % BLOCK_PX


def _finest(image: np.ndarray) -> float:
    """Mean size of the finest components in the blocks from the first pixel on."""
    rows, columns = (size // BLOCK_PX for size in image.shape)
    blocks = image[:rows * BLOCK_PX, :columns * BLOCK_PX].reshape(rows, BLOCK_PX, columns, BLOCK_PX)
    transform = scipy.fft.dctn(blocks, axes=(1, 3), norm="ortho")
    index = np.arange(BLOCK_PX)
    fine = index[:, None] + index >= FINEST
    return float(np.abs(transform.transpose(0, 2, 1, 3)[..., fine]).mean())
