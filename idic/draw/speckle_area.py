"""The speckled part of an image: where the grey value changes from pixel to pixel; its outline and its holes."""

from __future__ import annotations

import cv2
import numpy as np

from idic.draw.round_edges import circle_of, lines_and_arcs
from idic.draw.texture import Texture
from idic.images import speckle_size

MIN_AREA_SHARE = 0.005  # of the image: a smaller part is no specimen
MIN_HOLE_SHARE = 0.002  # of the area: smaller gaps are filled
# of the gradient energy: uneven light and the pattern itself make less of a difference (0.1 to 0.4 decades in images
# that the pattern fills), a background more (1.7 to 2.7)
MIN_DECADES = 1.0
MIN_RECTANGLE_SHARE = 0.93  # of a rectangle around it that an area fills to be taken for one
MAX_DENT = 3.0  # blocks: of its edge; a notch is deeper
MIN_ROUNDNESS = 0.84  # 4 pi area / perimeter² of a round hole (a square has 0.79), with the steps of the blocks
TOLERANCE = 1.2  # blocks: of the corners of the outline
FINER = 4  # contours lie between the blocks
EDGE_SHARE = 0.5  # of the gradient energy inside: less is background
SMOOTHED = 3  # blocks: width of the means, unless the speckle is wider
SPECKLES = 1.3  # that half of their width holds, where the speckle is wider
SPECKLE_WINDOW_PX = 512
SEARCHED = 3  # blocks to both sides of a straight edge or a circle
INSET_PX = 1.0  # a central difference sees the edge one pixel before it
# of the image, along its border: a pattern that leaves the image would leave it further when it moves
BORDER_SHARE = 0.03


def speckled_area(image: np.ndarray, texture: Texture) -> tuple[list, list]:
    """Outline and holes of the largest connected part of the image with a pattern, in px.

    The logarithm of the gradient energy of the blocks falls into two classes (Otsu 1979, doi
    10.1109/TSMC.1979.4310076); where these differ little, the pattern fills the image. Rectangles, discs and round
    holes are placed to the pixel, other outlines, with arcs where they are round, to the block.

    Returns
    -------
    outline, holes : as in `idic.fe.mesh.polygon.mesh_polygon`; ([], []) where the image has no pattern
    """
    wide, mask = _smoothed_pattern(image, texture)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count < 2:
        return [], []
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    if stats[largest, cv2.CC_STAT_AREA] < MIN_AREA_SHARE * mask.size:
        return [], []
    area = (labels == largest).astype(np.uint8)
    fine = cv2.resize(area * 255, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_LINEAR)
    loops, tree = cv2.findContours((fine > 127).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outer = max((k for k in range(len(loops)) if tree[0][k][3] < 0), key=lambda k: cv2.contourArea(loops[k]))
    least = MIN_HOLE_SHARE * cv2.contourArea(loops[outer])
    coarse = wide / SMOOTHED
    holes = [_hole(loop, image, texture, coarse) for k, loop in enumerate(loops)
             if tree[0][k][3] == outer and cv2.contourArea(loop) > least]
    return _outline(loops[outer], image, texture, coarse), holes


def _smoothed_pattern(image: np.ndarray, texture: Texture) -> tuple[int, np.ndarray]:
    """Blocks of the means, as many as the speckle asks for, and the blocks with a pattern."""
    wide = SMOOTHED
    while True:
        mask = _pattern(texture, wide)
        needed_blocks = 2 * int(SPECKLES * _speckle(image, mask, texture) / texture.block) + 1
        if needed_blocks <= wide:
            return wide, mask
        wide = needed_blocks


def _speckle(image: np.ndarray, mask: np.ndarray, texture: Texture) -> float:
    """Size of the speckle in the middle of the pattern, px; 0 where it has none."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return 0.0
    centre = ((np.array([np.median(rows), np.median(columns)]) + 0.5) * texture.block).astype(int)
    low = np.maximum(centre - SPECKLE_WINDOW_PX // 2, 0)
    part = image[low[0] : low[0] + SPECKLE_WINDOW_PX, low[1] : low[1] + SPECKLE_WINDOW_PX]
    block_of = [np.minimum(np.arange(first, first + n) // texture.block, blocks - 1)
             for first, n, blocks in zip(low, part.shape, mask.shape, strict=True)]
    return speckle_size(part, mask[np.ix_(*block_of)] > 0) or 0.0


def _pattern(texture: Texture, wide: int) -> np.ndarray:
    """Blocks with a pattern, in means over `wide` x `wide` blocks; gaps of that size are closed  # (rows, columns)
    uint8"""
    energy = texture.products[..., 0] + texture.products[..., 1]
    top = float(np.percentile(energy, 99.5))
    if top <= 0:
        return np.zeros(energy.shape, dtype=np.uint8)
    log = np.log10(np.clip(cv2.blur(energy, (wide, wide)) / top, 1e-3, 1.0))
    grey = np.round((log + 3.0) * 85.0).astype(np.uint8)
    _, mask = cv2.threshold(grey, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    patterned = mask > 0
    if not patterned.all() and log[patterned].mean() - log[~patterned].mean() < MIN_DECADES:
        mask[:] = 1  # the pattern fills the image
    rows, columns = (int(np.ceil(BORDER_SHARE * n)) for n in mask.shape)
    mask[:rows] = mask[-rows:] = mask[:, :columns] = mask[:, -columns:] = 0
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
    around = cv2.copyMakeBorder(mask, *(wide,) * 4, cv2.BORDER_CONSTANT, value=0)  # else gaps to the border close, too
    mask = cv2.morphologyEx(around, cv2.MORPH_CLOSE, disc)[wide:-wide, wide:-wide]
    mask = cv2.erode(mask, np.ones((wide, wide), dtype=np.uint8))  # means reach out by half their width
    return cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc)


def _to_px(points: np.ndarray, texture: Texture) -> np.ndarray:
    """Contour points of the finer mask in px of the image, not outside of it  # (n, 2) float32"""
    ny, nx = texture.shape
    px = (points.reshape(-1, 2).astype(float) + 0.5) / FINER * texture.block - 0.5
    return np.clip(px, 0, [nx - 1, ny - 1]).astype(np.float32)


def _outline(loop: np.ndarray, image: np.ndarray, texture: Texture, coarse: float) -> list:
    """coarse : how much wider than usual the means are"""
    px = _to_px(loop, texture)
    low, high = np.percentile(px, 2, axis=0), np.percentile(px, 98, axis=0)
    inside = np.minimum(px - low, high - px).min(axis=1)
    fills = cv2.contourArea(px) > MIN_RECTANGLE_SHARE * float(np.prod(np.ptp(px, axis=0)))
    if fills and np.percentile(inside, 98) < MAX_DENT * coarse * texture.block:
        (x0, y0), (x1, y1) = low.tolist(), high.tolist()
        x0, x1 = _side(image.T, x0, y0, y1, texture, -1), _side(image.T, x1, y0, y1, texture, 1)
        y0, y1 = _side(image, y0, x0, x1, texture, -1), _side(image, y1, x0, x1, texture, 1)
        return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    if disc := circle_of(px, TOLERANCE * coarse * texture.block):
        x, y, radius = disc
        return [round(x, 1), round(y, 1), round(_radius(image, x, y, radius, texture.block, outwards=True), 1)]
    return lines_and_arcs(px, TOLERANCE * coarse * texture.block, image)


def _side(image: np.ndarray, row: float, first_column: float, last_column: float, texture: Texture,
          outwards: int) -> float:
    """The row near `row` where the pattern ends, seen between two columns; `outwards`: 1 where it ends at the larger
    rows."""
    reach = SEARCHED * texture.block
    margin = 0.1 * (last_column - first_column)
    low, high = max(int(row) - 2 * reach, 0), min(int(row) + 2 * reach + 1, image.shape[0])
    part = image[low:high, int(first_column + margin) : int(last_column - margin) + 1].astype(np.float32)
    profile = _energy(part).mean(axis=1)[::outwards]  # from inside to outside
    rows = np.arange(low, high)[::outwards]
    level = EDGE_SHARE * float(np.median(profile[: max(reach, 1)]))
    above = np.flatnonzero(profile >= level)
    end = float(rows[above[-1]] if len(above) else row) - outwards * INSET_PX
    border = np.ceil(BORDER_SHARE * image.shape[0])
    return float(np.clip(end, border, image.shape[0] - 1 - border))


def _energy(part: np.ndarray) -> np.ndarray:
    fy, fx = np.gradient(np.nan_to_num(part))
    return fx * fx + fy * fy


def _hole(loop: np.ndarray, image: np.ndarray, texture: Texture, coarse: float) -> list:
    """A round hole, else lines and arcs: a short slot or an ellipse is rounder than a square, but not a circle."""
    px, tolerance = _to_px(loop, texture), TOLERANCE * coarse * texture.block
    area, length = cv2.contourArea(px), cv2.arcLength(cv2.approxPolyDP(px, 0.5 * texture.block, True), True)
    if 4 * np.pi * area < MIN_ROUNDNESS * length**2 or circle_of(px, tolerance) is None:
        return lines_and_arcs(px, tolerance, image, outwards=-1.0)
    x, y = px.mean(axis=0).tolist()
    return [round(x, 1), round(y, 1), round(_radius(image, x, y, float(np.sqrt(area / np.pi)), texture.block), 1)]


def _radius(image: np.ndarray, x: float, y: float, radius: float, block: int, outwards: bool = False) -> float:
    """The radius around (x, y) where the pattern begins, or, `outwards`, where it ends."""
    reach = SEARCHED * block
    low = [max(int(v - radius - 3 * reach), 0) for v in (x, y)]
    part = image[low[1] : int(y + radius + 3 * reach) + 1, low[0] : int(x + radius + 3 * reach) + 1].astype(np.float32)
    columns, rows = np.meshgrid(np.arange(part.shape[1]) + low[0], np.arange(part.shape[0]) + low[1])
    ring = np.hypot(columns - x, rows - y).astype(int)
    counts = np.maximum(np.bincount(ring.ravel()), 1)
    profile = np.bincount(ring.ravel(), _energy(part).ravel()) / counts
    radii = np.arange(max(int(radius) - reach, 0), min(int(radius) + reach, len(profile)))
    inside = slice(max(int(radius) - 3 * reach, 0), max(int(radius) - block, 1)) if outwards \
        else slice(int(radius) + block, int(radius) + 3 * reach)
    textured = radii[profile[radii] >= EDGE_SHARE * float(np.median(profile[inside]))]
    if not len(textured):
        return radius
    return float(textured[-1]) + 1.0 - INSET_PX if outwards else float(textured[0]) + INSET_PX
