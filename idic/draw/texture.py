"""The texture of an image in blocks of pixels: products of gradients, and the noise floor of elements."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

MAX_BLOCKS = 400  # along the longer side
MIN_BLOCK_PX = 4


@dataclass(frozen=True)
class Texture:
    """Block means of the products of the grey-value gradient.

    Attributes
    ----------
    block : px, side of a block
    products : (ny, nx, 3) GV²/px²: fx², fy², fx fy
    shape : (ny, nx) px of the image
    """

    block: int
    products: np.ndarray
    shape: tuple[int, int]


def texture_of(image: np.ndarray) -> Texture:
    """Gradients by central differences, averaged over blocks; strips of rows keep the memory small."""
    ny, nx = image.shape
    block = max(MIN_BLOCK_PX, int(np.ceil(max(ny, nx) / MAX_BLOCKS)))
    rows, columns = ny // block, nx // block
    products = np.zeros((rows, columns, 3), dtype=np.float32)
    strip = max(1, 1_000_000 // (nx * block)) * block
    for first in range(0, rows * block, strip):
        end = min(first + strip, rows * block)
        part = np.nan_to_num(image[max(first - 1, 0) : end + 1].astype(np.float32))
        fy, fx = np.zeros_like(part), np.zeros_like(part)
        fy[1:-1] = 0.5 * (part[2:] - part[:-2])
        fx[:, 1:-1] = 0.5 * (part[:, 2:] - part[:, :-2])
        strip_rows = slice(first - max(first - 1, 0), first - max(first - 1, 0) + end - first)
        for k, product in enumerate((fx * fx, fy * fy, fx * fy)):
            cells = product[strip_rows, : columns * block].reshape(-1, block, columns, block)
            products[first // block : end // block, :, k] = cells.mean(axis=(1, 3))
    return Texture(block, products, (ny, nx))


# the noise floor -----------------------------------------------------------------------------------------
def noise_floor(texture: Texture, corners: list[np.ndarray], std_gv: float) -> np.ndarray:
    """Standard deviation of the displacement of each element as a whole, from the noise of two images, px  # (n,)

    sigma_u = sqrt(2) sigma / sqrt(lambda_min), lambda_min the smaller eigenvalue of the sum of grad f grad f^T over the
    element, less what the noise itself adds (half its variance per component with central differences).

    Parameters
    ----------
    corners : list of (n corners, 2), px
    std_gv : float
        Noise of one image.
    """
    areas = np.array([cv2.contourArea(cell.astype(np.float32)) for cell in corners])
    xx, yy, xy = _means(texture, corners).T
    xx, yy = (np.maximum(value - 0.5 * std_gv**2, 0.0) for value in (xx, yy))
    smallest = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)
    with np.errstate(divide="ignore"):
        return np.sqrt(2.0) * std_gv / np.sqrt(np.maximum(smallest, 0.0) * areas)


def _means(texture: Texture, corners: list[np.ndarray]) -> np.ndarray:
    """Mean of the products over the blocks in each element; elements smaller than a block have that of their centre  #
    (n, 3)"""
    rows, columns = texture.products.shape[:2]
    owner = np.full((rows, columns), -1, dtype=np.int32)
    for k, cell in enumerate(corners):
        # block centres, 8 bits below
        corners_8bit = np.round((cell + 0.5 - 0.5 * texture.block) / texture.block * 256).astype(np.int32)
        cv2.fillConvexPoly(owner, corners_8bit, k, shift=8)
    owned = owner >= 0
    counts = np.bincount(owner[owned], minlength=len(corners))
    sums = np.column_stack([np.bincount(owner[owned], texture.products[..., k][owned], len(corners)) for k in range(3)])
    centres = np.array([cell.mean(axis=0) for cell in corners])
    at = np.clip((centres / texture.block).astype(int), 0, [columns - 1, rows - 1])
    return np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], texture.products[at[:, 1], at[:, 0]])
