"""Reads videos as stacks of 8-bit grey frames with OpenCV; decoding counts the frames.

A seek in a compressed video may reach another frame; frames are therefore decoded in order, and an earlier frame is
read from the start of the video. A run copies the frames once, in order, into its store.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from idic.errors import InputError

if TYPE_CHECKING:
    import cv2  # loaded where there is a video

SUFFIXES = (".avi", ".mp4", ".mov", ".mkv")
LOSSLESS = {"FFV1", "HFYU", "FFVH", "DIB ", "RAW ", "I420", "IYUV", "Y800", "GREY", "MPNG", "PNG1"}
DEEP_BITS = (9, 10, 12, 14, 16)  # that FFmpeg has
MAX_CHANNEL_DIFFERENCE_GV = 2  # grey values between the channels of a grey pixel: rounding through YUV
_EXPECTED = "an AVI, MP4, MOV or Matroska file that OpenCV decodes"


def video_headers(path: Path) -> tuple[int, tuple[int, int]]:
    """Number of frames and (rows, columns) of a video.

    Raises
    ------
    InputError
        The file is not a video, or cannot be decoded.
    """
    return _decoded(path, path.stat().st_mtime_ns)[:2]


def video_notes(path: Path) -> list[str]:
    """Notes on a video: loss by compression, of grey values, colour."""
    _, _, codec, colour, bits = _decoded(path, path.stat().st_mtime_ns)
    notes = []
    if codec not in LOSSLESS:
        notes.append(f"{path.name}: the codec {codec.strip() or '?'} compresses with loss and correlates the noise of "
                     "neighbouring pixels: standard deviations are too small. Record without loss if possible")
    if bits > 8:
        notes.append(f"{path.name}: of its {bits} bits per pixel the upper 8 are read; the rounding adds noise. Export "
                     f"the frames with all, e.g.  ffmpeg -i {path.name} -pix_fmt gray16be images/frame_%05d.png")
    if colour:
        notes.append(f"{path.name}: a colour video; its luminance is used")
    return notes


def read_video_frame(path: Path, number: int) -> np.ndarray:
    """One frame  # (ny, nx) uint8"""
    with _lock:
        reader = _readers.get(path)
        if reader is None or reader.following > number:
            _readers.clear()  # one open video at a time
            reader = _readers[path] = _Reader(path)
        return reader.frame(number)


class _Reader:
    """The decoder of an open video. following : number of the next frame."""

    def __init__(self, path: Path):
        self._path, self._capture, self.following = path, _open(path), 0

    def frame(self, number: int) -> np.ndarray:
        while self.following < number:
            self._forward(self._capture.grab())
        good, image = self._capture.read()
        self._forward(good)
        return luminance(image)

    def _forward(self, good: bool) -> None:
        if not good:
            raise _unreadable(self._path, f"decoding stops at frame {self.following}")
        self.following += 1


def luminance(image: np.ndarray) -> np.ndarray:
    """The grey image of a decoded frame (ny, nx, 3); a grey video keeps its values  # (ny, nx) uint8"""
    if image.ndim == 2:
        return image
    if not _coloured(image):
        return np.ascontiguousarray(image[:, :, 1])
    import cv2

    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _coloured(image: np.ndarray) -> bool:
    return bool(np.abs(np.diff(image.astype(np.int16), axis=2)).max(initial=0) > MAX_CHANNEL_DIFFERENCE_GV)


@lru_cache(maxsize=16)
def _decoded(path: Path, _changed: int) -> tuple[int, tuple[int, int], str, bool, int]:
    """Frames, shape, codec, whether its first frame is in colour, bits per pixel."""
    import cv2

    capture = _open(path)
    good, image = capture.read()
    if not good:
        raise _unreadable(path, "no frame")
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    codec = "".join(chr((code >> 8 * k) & 0xFF) for k in range(4)).upper()
    bits = _bits(int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
    count = 1
    while capture.grab():
        count += 1
    capture.release()
    return count, image.shape[:2], codec, image.ndim == 3 and _coloured(image), bits


def _bits(pixel_format: int) -> int:
    """Bits of a grey value by FFmpeg's four characters: Y, planes, layout, bits (or in reverse); 8 where they are
    others."""
    code = (pixel_format & 0xFFFFFFFF).to_bytes(4, "little")
    for letters in (code, code[::-1]):
        if letters[:1] == b"Y" and letters[3] in DEEP_BITS:
            return letters[3]
    return 8


def _open(path: Path) -> cv2.VideoCapture:
    with path.open("rb") as stream:
        head = stream.read(12)
    kinds: dict[str, Callable[[bytes], bool]] = {
        "AVI": lambda h: h[:4] == b"RIFF" and h[8:12] == b"AVI ",
        "MP4": lambda h: h[4:8] in (b"ftyp", b"moov", b"wide"),
        "Matroska": lambda h: h[:4] == b"\x1a\x45\xdf\xa3"}
    if not any(fits(head) for fits in kinds.values()):  # a playlist with this name would make the decoder fetch files
        raise _unreadable(path, "a file with the first bytes of another format")
    import cv2

    capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise _unreadable(path, "a codec that OpenCV does not know, or a damaged file")
    return capture


def _unreadable(path: Path, finding: str) -> InputError:
    return InputError("the video cannot be read", file=path, key="images", expected=_EXPECTED, found=finding,
                      remedy=f"export the frames without loss, e.g.  ffmpeg -i {path.name} images/frame_%05d.png")


_lock = threading.Lock()
_readers: dict[Path, _Reader] = {}
