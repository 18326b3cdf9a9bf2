"""Films of Photron cameras: frames in a .mraw file, their size, depth and rate in a .cihx or .cih file beside it.

pymraw reads the header. Its frames are not used: 12-bit ones come as the whole film in memory, by a parallel kernel
that several threads must not call at once, and values on the upper side of 16 bits stay there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.formats.format import IMAGES, Format
from idic.readers.instruments.film import Film
from idic.remote_files import fetch

FORMAT = Format(IMAGES, "Photron cameras", (".mraw",), "pymraw", "frame times, saved step, depth",
                ".cihx or .cih beside it",
                "made by layout and pymraw, 8 to 16 bits; real", is_film=True, is_extra=True)
_HEADERS = (".cihx", ".cih", ".CIHX", ".CIH")
_DEPTHS = {8: "uint8", 12: "uint16", 16: "uint16"}
_EXPECTED = "grey frames of 8, 12 or 16 bits, as many as the header says"


def photron_film(path: Path) -> Film:
    """What the header says of a film.

    Raises
    ------
    InputError
        pymraw or the header is missing, the film is in colour or of another depth, or the file is too short.
    """
    header = next((file for suffix in _HEADERS if (file := path.with_suffix(suffix)).is_file()), None)
    if header is None:
        raise InputError("the header of the film is missing", file=path, key="images",
                         expected=f"{path.stem}.cihx or {path.stem}.cih beside it", found="none of them",
                         remedy="copy it from the camera's folder: it holds size, depth and rate of the frames")
    fetch(header)
    return _film(path, header, path.stat().st_mtime_ns, header.stat().st_mtime_ns)


def read_photron(path: Path, number: int) -> np.ndarray:
    """One frame with the recorded grey values  # (ny, nx) uint8 or uint16"""
    film = photron_film(path)
    n, bits = film.shape[0] * film.shape[1], film.bits
    first, shift = divmod(number * n * bits, 8)
    with path.open("rb") as stream:
        stream.seek(first)
        data = stream.read((shift + n * bits + 7) // 8)
    if bits == 12:
        import imagecodecs

        skipped = shift // 4  # a frame may begin in the middle of a byte
        values = imagecodecs.packints_decode(_aligned(data, skipped), np.uint16, 12)[:n]
    else:
        values = np.frombuffer(data, "<u2" if bits == 16 else "u1", n) >> film.shift
    return np.ascontiguousarray(values.reshape(film.shape), dtype=film.dtype)


def _aligned(data: bytes, half_bytes: int) -> bytes:
    """The bytes from the half byte on at which the first value begins."""
    if not half_bytes:
        return data
    halves = np.frombuffer(data, np.uint8)
    return ((halves[:-1] << 4) | (halves[1:] >> 4)).tobytes() + bytes([(int(halves[-1]) << 4) & 0xFF])


@lru_cache(maxsize=16)
def _film(path: Path, header: Path, _changed: int, _header_changed: int) -> Film:
    with FORMAT.decoded(path):
        import pyMRAW

        entries: Mapping[str, Any] = pyMRAW.get_cih(str(header))
        n_frames, ny, nx, bits, effective_bits = (int(entries[name]) for name in (
            "Total Frame", "Image Height", "Image Width", "Color Bit", "EffectiveBit Depth"))
        rate, side = float(entries["Record Rate(fps)"]), str(entries["EffectiveBit Side"]).lower()
        kind, step = _colour_and_step(header, entries)
        if str(entries["File Format"]).lower() != "mraw":
            raise _refused(path, f"the file format {entries['File Format']} in {header.name}")
        if bits not in _DEPTHS or kind.lower() not in ("mono", "raw"):
            raise _refused(path, f"{bits} bits per pixel, {kind}")
    if min(n_frames, ny, nx) < 1 or not 0.0 < rate < np.inf or step < 1:
        raise _refused(path, f"{n_frames} frames of {nx} x {ny} px, {rate:g} per second")
    n_bytes, size = (n_frames * ny * nx * bits + 7) // 8, path.stat().st_size
    if size < n_bytes or size >= n_bytes + ny * nx * bits // 8:
        raise _refused(path, f"{size} bytes; {n_bytes} by {header.name}: {n_frames} frames of {nx} x {ny} px, {bits} "
                       "bits")
    shift = 16 - effective_bits if bits == 16 and side == "higher" else 0
    saved = f", of which every {step}th was saved" if step > 1 else ""
    mosaic = "; its colours are called Raw: of a colour camera that is a mosaic, not a grey image"
    note = (f"{rate:g} frames per second by {header.name}{saved}: times count from the first frame, which "
            f"first_frame_s shifts{mosaic if kind.lower() == 'raw' else ''}")
    return Film(n_frames, (ny, nx), _DEPTHS[bits], step / rate * np.arange(n_frames), note, bits, max(shift, 0))


def _colour_and_step(header: Path, entries: Mapping[str, Any]) -> tuple[str, int]:
    """Kind of colour, and of how many recorded frames one was saved; pymraw gives them of .cih files only."""
    if header.suffix.lower() == ".cih":
        return str(entries.get("Color Type", "Mono")), int(entries.get("Save Step", 1))
    text = header.read_text(encoding="utf-8", errors="ignore")
    colour = re.search(r"<colorInfo>\s*<type>\s*(\w+)", text)
    step = re.search(r"<frameInfo>.*?<skipFrame>\s*(\d+).*?</frameInfo>", text, re.DOTALL)
    return colour[1] if colour else "Mono", max(int(step[1]), 1) if step else 1


def _refused(path: Path, finding: str) -> InputError:
    return InputError("the film cannot be read", file=path, key="images", expected=_EXPECTED, found=finding,
                      remedy="copy .mraw and header again, or export the frames as grey 16-bit TIFF")
