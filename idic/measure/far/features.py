"""Features of a speckled surface matched between two images, whatever the surface has turned and stretched between.

Scale-invariant features (Lowe 2004, doi 10.1023/B:VISI.0000029664.99615.94) have an orientation and a scale of their
own: a match states how the surface around it turned and stretched, and so where all other points would be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MAX_SIDE_PX = 1600  # of the images that are searched; larger ones are binned, the detector doubles its image first
MAX_FEATURES = 4000  # per image, the strongest: matching takes a second
MAX_RATIO = 0.8  # distance of the best match over that of the second best: Lowe's, keeps 95 % of the right ones
CONTRAST_PERCENTILES = (0.5, 99.5)  # of the grey values, stretched to 8 bit: a bright reflex does not flatten the rest
MIN_CONTRAST = 0.01  # of features, of the stretched range; the default 0.04 leaves few on weak speckle
MARGIN_PX = 8  # of the region that is searched around the points: a feature at the rim is seen from inside


@dataclass(frozen=True, eq=False)
class Matches:
    """Points of one image found again in another, the most distinct first.

    places, targets : (n, 2) px (column, row); turns : (n, 2, 2) scale times rotation around each
    """

    places: np.ndarray
    targets: np.ndarray
    turns: np.ndarray

    def __len__(self) -> int:
        return len(self.places)


def match_features(image_from: np.ndarray, image_to: np.ndarray, points_px: np.ndarray) -> Matches:
    """Features around points of one image, found again anywhere in the other.

    Parameters
    ----------
    image_from, image_to : (ny, nx), of any range of grey values
    points_px : (n, 2) column and row of points of the surface in `image_from`
    """
    import cv2  # loaded where a frame is sought

    n_threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # workers share the cores
    try:
        return _matched(image_from, image_to, points_px)
    finally:
        cv2.setNumThreads(n_threads)


def _matched(image_from: np.ndarray, image_to: np.ndarray, points_px: np.ndarray) -> Matches:
    import cv2

    factor = int(np.ceil(max(*image_from.shape, *image_to.shape) / MAX_SIDE_PX))
    detector = cv2.SIFT.create(MAX_FEATURES, contrastThreshold=MIN_CONTRAST)
    first, second = (_eight_bit(image, factor) for image in (image_from, image_to))
    region = _region(points_px / factor, first.shape)
    keys_from, words_from = detector.detectAndCompute(first, region)
    keys_to, words_to = detector.detectAndCompute(second, None)
    if words_from is None or words_to is None or len(words_to) < 2:
        return Matches(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words_from, words_to, k=2)
    ratios = np.array([best.distance / max(second_best.distance, 1e-9) for best, second_best in pairs])
    order = np.argsort(ratios, kind="stable")
    order = order[ratios[order] < MAX_RATIO]
    from_numbers, to_numbers = order, np.array([pairs[i][0].trainIdx for i in order], dtype=int)
    places, sizes, angles = _described(keys_from, from_numbers)
    targets, sizes_to, angles_to = _described(keys_to, to_numbers)
    turn, scale = np.radians(angles_to - angles), sizes_to / np.maximum(sizes, 1e-9)
    turns = scale[:, None, None] * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
                                            ).transpose(2, 0, 1)
    middle = (factor - 1) / 2  # of a binned pixel
    return Matches(factor * places + middle, factor * targets + middle, turns)


def _described(keys, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, 2), sizes and angles (n,) of some features"""
    chosen = [keys[i] for i in numbers]
    return (np.array([key.pt for key in chosen]).reshape(-1, 2), np.array([key.size for key in chosen]),
            np.array([key.angle for key in chosen]))


def _eight_bit(image: np.ndarray, factor: int) -> np.ndarray:
    """Binned and stretched to 0 … 255  # (ny, nx) -> (ny / factor, nx / factor) uint8"""
    ny, nx = (n // factor * factor for n in image.shape)
    values = np.nan_to_num(np.asarray(image[:ny, :nx], dtype=np.float32))
    values = values.reshape(ny // factor, factor, nx // factor, factor).mean(axis=(1, 3))
    low, high = np.percentile(values, CONTRAST_PERCENTILES)
    return np.clip(np.rint((values - low) * (255.0 / max(high - low, 1e-9))), 0, 255).astype(np.uint8)


def _region(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The rectangle around the points that are in the image, as a mask  # (ny, nx) uint8"""
    inside = points[((points >= 0) & (points <= np.array(shape[::-1]) - 1)).all(axis=1)]
    region = np.zeros(shape, dtype=np.uint8)
    if len(inside):
        low = np.maximum(np.floor(inside.min(axis=0)).astype(int) - MARGIN_PX, 0)
        high = np.ceil(inside.max(axis=0)).astype(int) + MARGIN_PX + 1
        region[low[1]:high[1], low[0]:high[0]] = 255
    return region
