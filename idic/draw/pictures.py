"""Images for a browser: any part of a frame at the width of the screen, as JPEG in eight bits."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field

import cv2
import numpy as np

from idic.errors import InputError
from idic.readers import FileStack

KEPT_FRAMES = 2  # in memory: the reference and the one last looked at
MAX_WIDTH = 4096  # px of a picture for the browser
DARK, BRIGHT = 0.3, 99.7  # per cent of the pixels, shown black and white
SAMPLES = 400  # rows and columns that the contrast is taken from
JPEG_QUALITY = 88


@dataclass
class Pictures:
    """The frames of a stack; the last ones stay in memory."""

    stack: FileStack
    _frames: OrderedDict[int, np.ndarray] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def frame(self, k: int) -> np.ndarray:
        """A frame as it is read  # (ny, nx)"""
        if not 0 <= k < self.stack.n_frames:
            raise InputError("no such frame", expected=f"0 to {self.stack.n_frames - 1}", found=str(k),
                             remedy="choose another")
        with self._lock:
            if k not in self._frames:
                self._frames[k] = np.asarray(self.stack.frame(k))
                while len(self._frames) > KEPT_FRAMES:
                    self._frames.popitem(last=False)
            self._frames.move_to_end(k)
            return self._frames[k]

    def part(self, k: int, box: tuple[float, float, float, float], width: int) -> bytes:
        """The part (x0, y0, x1, y1), px, of frame `k` as a JPEG that is `width` px wide, or less where that has all
        detail."""
        image = self.frame(k)
        ny, nx = image.shape
        x0, y0 = (int(np.clip(np.floor(v), 0, n - 1)) for v, n in zip(box[:2], (nx, ny), strict=True))
        x1, y1 = (int(np.clip(np.ceil(v), low + 1, n)) for v, n, low in zip(box[2:], (nx, ny), (x0, y0), strict=True))
        cut = image[y0:y1, x0:x1]
        scale = min(1.0, np.clip(width, 1, MAX_WIDTH) / cut.shape[1])
        if scale < 1.0:
            size = (max(round(cut.shape[1] * scale), 1), max(round(cut.shape[0] * scale), 1))
            cut = cv2.resize(cut, size, interpolation=cv2.INTER_AREA)
        return jpeg(as_bytes(cut, *contrast(image)))


def contrast(image: np.ndarray) -> tuple[float, float]:
    """The grey values to show black and white."""
    ny, nx = image.shape
    sample = image[:: max(ny // SAMPLES, 1), :: max(nx // SAMPLES, 1)]
    low, high = np.nanpercentile(sample, [DARK, BRIGHT])
    return float(low), float(max(high, low + 1e-9))


def as_bytes(image: np.ndarray, low: float, high: float) -> np.ndarray:
    """Grey values from `low` to `high` as 0 to 255; NaN: 0."""
    scaled = (np.nan_to_num(image.astype(np.float32), nan=low) - low) * np.float32(255.0 / (high - low))
    return np.clip(scaled, 0, 255).astype(np.uint8)


def jpeg(image: np.ndarray) -> bytes:
    """(ny, nx) or (ny, nx, 3 blue, green, red) uint8."""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
