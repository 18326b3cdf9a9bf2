"""One image stack written in many ways, whole and spoilt."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tifffile
from hypothesis import strategies as st
from PIL import Image

SHAPE = (50, 60)  # rows, columns


def pixels(k: int, dtype: str) -> np.ndarray:
    """Frame k as it was taken."""
    values = np.random.default_rng(100 + k).integers(0, 256, SHAPE)
    return (values * {"uint8": 1, "uint16": 257, "float32": 1.0}[dtype]).astype(dtype)


def _tiff(dtype: str, **options) -> Callable[[int], bytes]:
    def write(k: int) -> bytes:
        stream = io.BytesIO()
        tifffile.imwrite(stream, pixels(k, dtype), **options)
        return stream.getvalue()

    return write


def _pillow(dtype: str, kind: str) -> Callable[[int], bytes]:
    def write(k: int) -> bytes:
        stream = io.BytesIO()
        Image.fromarray(pixels(k, dtype)).save(stream, kind)
        return stream.getvalue()

    return write


def xyz_text(heights: np.ndarray, pitch: float = 0.5, units: str = "um um um") -> str:
    """A height map as rows x y z; the height at a gap is "No Data"."""
    rows = [f"{pitch * column:g}\t{pitch * row:g}\t" + ("No Data" if np.isnan(z) else f"{z:.9g}")
            for (row, column), z in np.ndenumerate(heights)]
    return "\n".join([f"# units: {units}", *rows, ""])


WAYS: dict[str, tuple[str, str, Callable[[int], bytes]]] = {  # name -> (suffix, depth, content of frame k)
    "tiff": (".tif", "uint8", _tiff("uint8")),
    "tiff 16": (".tiff", "uint16", _tiff("uint16")),
    "tiff float": (".tif", "float32", _tiff("float32")),
    "tiff lzw": (".tif", "uint8", _tiff("uint8", compression="lzw")),
    "tiff deflate": (".tif", "uint16", _tiff("uint16", compression="zlib", predictor=True)),
    "tiff packbits": (".tif", "uint8", _tiff("uint8", compression="packbits")),
    "tiff big-endian": (".tif", "uint16", _tiff("uint16", byteorder=">")),
    "bigtiff": (".tif", "uint8", _tiff("uint8", bigtiff=True)),
    "tiff tiles": (".tif", "uint8", _tiff("uint8", tile=(16, 16))),
    "tiff strips": (".tif", "uint8", _tiff("uint8", rowsperstrip=7)),
    "png": (".png", "uint8", _pillow("uint8", "PNG")),
    "png 16": (".png", "uint16", _pillow("uint16", "PNG")),
    "bmp": (".bmp", "uint8", _pillow("uint8", "BMP")),
    "xyz": (".xyz", "float32", lambda k: xyz_text(pixels(k, "float32")).encode()),
}
CHECKED = ("png", "png 16")  # formats with checksums: a flipped bit cannot pass


def _tiff_of(array: np.ndarray, **options) -> bytes:
    stream = io.BytesIO()
    tifffile.imwrite(stream, array, **options)
    return stream.getvalue()


def _png_of(array: np.ndarray, mode: str | None = None) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(array, mode).save(stream, "PNG")
    return stream.getvalue()


RGB = np.random.default_rng(5).integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
NAN = np.full(SHAPE, np.nan, np.float32)
ONE_NAN = np.where(np.arange(SHAPE[1]) == 7, np.float32(np.nan), np.float32(3.0)) + np.zeros(SHAPE, np.float32)
STRANGERS: dict[str, bytes] = {  # content that is no frame of any of these stacks
    "empty": b"",
    "text": b"hello\n",
    "zeros": b"\x00" * 4000,
    "html": b"<html>404</html>",
    "only a header": b"II*\x00\x08\x00\x00\x00",
    "header to itself": b"II*\x00\x08\x00\x00\x00" + b"\x00\x00\x08\x00\x00\x00",
    "colour": _tiff_of(RGB, photometric="rgb"),
    "smaller": _tiff_of(pixels(0, "uint8")[:-1]),
    "one pixel": _tiff_of(np.zeros((1, 1), np.uint8)),
    "int32": _tiff_of(np.zeros(SHAPE, np.int32)),
    "float64": _tiff_of(np.zeros(SHAPE, np.float64)),
    "complex": _tiff_of(np.zeros(SHAPE, np.complex64)),
    "bool": _tiff_of(np.zeros(SHAPE, bool)),
    "nan": _tiff_of(NAN),
    "one nan": _tiff_of(ONE_NAN),
    "volume": _tiff_of(np.zeros((3, *SHAPE), np.uint8), photometric="minisblack"),
    "colour png": _png_of(RGB),
    "smaller png": _png_of(pixels(0, "uint8")[:-1]),
    "gif": b"GIF89a\x3c\x00\x32\x00\x00\x00\x00;",
    "eps": b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 60 50\n",
    "smaller xyz": xyz_text(pixels(0, "float32")[:-1]).encode(),
    "coarser xyz": xyz_text(pixels(0, "float32"), pitch=1.0).encode(),
    "xyz in mm": xyz_text(pixels(0, "float32"), units="mm mm mm").encode(),
    "xyz without heights": xyz_text(NAN).encode(),
    "xyz by columns": xyz_text(pixels(0, "float32").T, pitch=0.5).encode(),
    "numbers": b"1.0 2.0\n3.0 4.0\n",
}


@dataclass(frozen=True)
class Flip:
    """One bit of a file turned over."""

    where: float
    bit: int

    def __call__(self, data: bytes) -> bytes:
        content = bytearray(data)
        content[min(int(self.where * len(content)), len(content) - 1)] ^= 1 << self.bit
        return bytes(content)


@dataclass(frozen=True)
class LinesOfXyz:
    """Rows of an XYZ grid lost, doubled, exchanged with the next, without their last number, or with another place."""

    where: float
    damage: str

    def __call__(self, data: bytes) -> bytes:
        lines = data.decode().splitlines(keepends=True)
        k = 1 + min(int(self.where * (len(lines) - 2)), len(lines) - 3)  # of two rows, below the units
        row, following = lines[k:k + 2]
        lines[k:k + 2] = {"lost": [following], "doubled": [row, row, following], "exchanged": [following, row],
                          "short": [row.rsplit("\t", 1)[0] + "\n", following],
                          "without a place": ["***" + row[row.index("\t"):], following],
                          "elsewhere": ["7e3" + row[row.index("\t"):], following]}[self.damage]
        return "".join(lines).encode()


lines_of_xyz = st.builds(LinesOfXyz, st.floats(0, 1), st.sampled_from(
    ["lost", "doubled", "exchanged", "short", "without a place", "elsewhere"]))
flips = st.builds(Flip, st.floats(0, 1), st.integers(0, 7)) | st.builds(Flip, st.floats(0, 0.05), st.integers(0, 7))
