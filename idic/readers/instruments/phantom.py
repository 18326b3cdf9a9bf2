"""Films of Phantom cameras (.cine), by cinereader, frame by frame.

cinereader takes the depth of a stored value from the depth of the sensor, a rate that older cameras do not write, and
of the time of a frame the seconds of its minute: depth, rate and minute are put right here.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.readers.formats.format import IMAGES, Format
from idic.readers.instruments.film import Film

FORMAT = Format(IMAGES, "Phantom cameras", (".cine",), "cinereader", "frame times, depth", "",
                "made by layout, 8 to 16 bits, packed", is_film=True,
                is_extra=True)
_STORED_BITS = {8: 8, 16: 12}  # stored -> a depth whose values cinereader takes so
_DTYPES = {8: "uint8", 16: "uint16"}
_PACKED = {256: 10, 1024: 12}  # code of the packing: bits
_RATE_AT = 768  # bytes into the setup: frames per second, a whole number in all versions
_EXACT_RATE_END = 10_408  # bytes of the setup with which it holds the rate as a fraction, too
_MINUTE = 60.0
_MAX_RATE_DIFFERENCE = 0.5  # of the interval: the stamps count other frames than the rate


def phantom_film(path: Path) -> Film:
    """What the header says of a film.

    Raises
    ------
    InputError
        cinereader is missing, the film is in colour or compressed, or the file is damaged.
    """
    return _opened(path, path.stat().st_mtime_ns)[0]


def read_phantom(path: Path, number: int) -> np.ndarray:
    """One frame with the recorded grey values  # (ny, nx) uint8 or uint16"""
    film, header = _opened(path, path.stat().st_mtime_ns)
    with FORMAT.decoded(path):
        from cinereader import cinereader

        return np.ascontiguousarray(cinereader.read_image(header, str(path), header.FirstImageNo + number),
                                    dtype=film.dtype)


@lru_cache(maxsize=16)
def _opened(path: Path, _changed: int) -> tuple[Film, Any]:
    with FORMAT.decoded(path):
        from cinereader import cinereader

        header = cinereader.read_metadata(str(path))
        packed = _PACKED.get(header.biCompression)
        n_bits, n = packed or header.biBitCount, header.biWidth * header.biHeight
        if (header.Type, header.Mark) != ("CI", "ST"):
            raise _refused(path, "the first bytes of another format")
        if header.CFA != "Mono" or n_bits not in (8, 10, 12, 16):
            raise _refused(path, f"{header.biBitCount} bits per pixel, colours {header.CFA}")
        if header.biCompression not in (0, *_PACKED) or header.ImageCount < 1 or min(header.biWidth,
                                                                                     header.biHeight) < 1:
            raise _refused(path, f"{header.ImageCount} frames of {header.biWidth} x {header.biHeight} px, packing "
                           f"{header.biCompression}")
        if header.biSizeImage * 8 != n * n_bits:
            raise _refused(path, f"{header.biSizeImage} bytes per frame of {header.biWidth} x {header.biHeight} px, "
                           f"{n_bits} bits per pixel")
        header.RealBPP = packed or _STORED_BITS[header.biBitCount]
        _check_size(path, header)
        times, source = _times(path, header, cinereader)
    note = (f"frame times by {source}, from the first frame on, which first_frame_s shifts"
            + ("; its 10-bit values are made linear by the table of the camera" if packed == 10 else ""))
    return Film(header.ImageCount, (header.biHeight, header.biWidth), _DTYPES[8 if n_bits == 8 else 16], times,
                note), header


def _check_size(path: Path, header: Any) -> None:
    """InputError where a frame lies beyond the end of the file."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(header.OffImageOffsets)
        places = np.frombuffer(stream.read(8 * header.ImageCount), "<i8")
    end = int(places.max(initial=0)) + header.biSizeImage
    if len(places) < header.ImageCount or places.min() <= 0 or end > size:
        raise InputError("the film is truncated", file=path, key="images",
                         expected=f"{header.ImageCount} frames in {end} bytes or more", found=f"{size} bytes",
                         remedy="copy the file again from the camera, or save fewer frames")


def _times(path: Path, header: Any, cinereader: Any) -> tuple[np.ndarray, str]:
    """Times of the frames from the first on, and where they are from  # (n_frames,) s"""
    with path.open("rb") as stream:
        stream.seek(header.OffSetup + _RATE_AT)
        rate = struct.unpack("<I", stream.read(4))[0]
    if header.Length >= _EXACT_RATE_END and 0.0 < header.FrameRate < np.inf:
        rate = header.FrameRate
    try:
        stamps = np.unwrap(cinereader.read_timestamps(header, str(path)), period=_MINUTE)
    except (UnboundLocalError, ValueError, struct.error):
        stamps = np.empty(0)  # no block of times
    counted = np.arange(header.ImageCount) / rate if rate else None
    if len(stamps) == header.ImageCount and (np.diff(stamps) > 0).all():
        if counted is None or np.abs(stamps - stamps[0] - counted).max() < _MAX_RATE_DIFFERENCE / rate:
            return stamps - stamps[0], "their stamps"
        raise _refused(path, f"time stamps {np.median(np.diff(stamps)):.6g} s apart, at {rate:g} frames per second")
    if counted is None:
        raise _refused(path, "neither time stamps nor a frame rate")
    return counted, f"the rate of {rate:g} per second"


def _refused(path: Path, finding: str) -> InputError:
    return InputError("the film cannot be read", file=path, key="images",
                      expected="a .cine of a grey camera: 8 or 16 bits, or 10 or 12 bits packed", found=finding,
                      remedy="save it again in one of these, or export the frames as grey 16-bit TIFF")
