"""How cameras record: with white noise, smoothed, by grey level, through JPEG compression or a colour filter.

Every sensor adds independent noise to what it sees; what it does with the values after that correlates the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from idic.images import NoisyStack, Stack, StackView

SMOOTHING_PX = 0.6  # of the noise of "blurred"
JPEG_QUALITY = 80
MEAN_GV = 128.0  # grey value at which "grey_level" has the stated noise
TOP_GV = 255.0


@dataclass(frozen=True, eq=False)
class RecordedStack(StackView):
    """A stack as a sensor records it; the noise of frame k depends on seed and k alone.

    std : of the noise that the sensor adds, in the unit of the pixel values; sensor : a key of `SENSORS`
    """

    std: float
    seed: int
    sensor: str

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        k = range(self.n_frames)[k]
        white = np.random.default_rng((self.seed, k)).standard_normal(self.shape)
        return SENSORS[self.sensor](np.asarray(self.stack.frame(k), dtype=float), white, self.std).astype(np.float32)


def recorded_by(sensor: str, stack: Stack, std: float, seed: int) -> Stack:
    """The stack with noise of this standard deviation as the sensor makes it ("white": independent)."""
    return NoisyStack(stack, std, seed) if sensor == "white" else RecordedStack(stack, std, seed, sensor)


def _blurred(image: np.ndarray, white: np.ndarray, std: float) -> np.ndarray:
    smooth = gaussian_filter(white, SMOOTHING_PX, mode="wrap")
    axis = np.zeros(33)
    axis[16] = 1.0
    passed = gaussian_filter(axis, SMOOTHING_PX)
    return image + std * smooth / (passed**2).sum()


def _grey_level(image: np.ndarray, white: np.ndarray, std: float) -> np.ndarray:
    return image + std * np.sqrt(np.maximum(image, 0.0) / MEAN_GV) * white


def _jpeg(image: np.ndarray, white: np.ndarray, std: float) -> np.ndarray:
    _, content = cv2.imencode(".jpg", _eight_bits(image + std * white), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return cv2.imdecode(content, cv2.IMREAD_GRAYSCALE)


def _bayer(image: np.ndarray, white: np.ndarray, std: float) -> np.ndarray:
    colours = cv2.demosaicing(_eight_bits(image + std * white), cv2.COLOR_BayerBG2BGR)
    return cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)


def _eight_bits(image: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(image), 0.0, TOP_GV).astype(np.uint8)


SENSORS: Mapping[str, Callable[[np.ndarray, np.ndarray, float], np.ndarray]] = {
    "blurred": _blurred, "grey_level": _grey_level, "jpeg": _jpeg, "bayer": _bayer}
