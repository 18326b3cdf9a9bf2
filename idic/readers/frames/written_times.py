"""When an image was taken, as its file or a file beside it says: TIFF and EXIF tags, text of the camera.

Tags 306 of TIFF 6.0, 36867, 36868 and 37520 … 37522 of EXIF 2.32.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

EXIF = 34665
_STAMPS = ((36867, 37521), (36868, 37522), (306, 37520))  # original, digitised, last change; each with its parts of a s
_STAMP = re.compile(r"(\d{4})[-:/.](\d\d)[-:/.](\d\d)[T _-]+(\d\d):(\d\d):(\d\d)(?:[.,](\d+))?")
_SECONDS = re.compile(r"time(?:[ _-]?stamp)?(?:[ _\[(]*(s|ms|us|µs|ns)\b)?[^\d\n]{1,12}?(\d+(?:\.\d+)?)", re.IGNORECASE)
_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_SIDECARS = (".txt", ".xml", ".json", ".xmp", ".hdr")
_MAX_SIDECAR_BYTES = 100_000
_EPOCH = datetime(1970, 1, 1)


def tiff_time(page: Any) -> float | None:
    """Seconds by the tags of a page of a TIFF file; None where it has none."""
    exif = page.tags.valueof(EXIF)
    tags = exif if isinstance(exif, Mapping) else {}
    by_name = {36867: "DateTimeOriginal", 36868: "DateTimeDigitized", 37520: "SubsecTime",
               37521: "SubsecTimeOriginal", 37522: "SubsecTimeDigitized"}
    return _tagged(lambda number: tags.get(by_name.get(number)) or page.tags.valueof(number))


def exif_time(exif: Any) -> float | None:
    """Seconds by the EXIF of an image that Pillow has opened; None where it has none."""
    if not exif:
        return None
    tags = exif.get_ifd(EXIF)
    return _tagged(lambda number: tags.get(number) or exif.get(number))


def time_beside(path: Path) -> float | None:
    """Seconds by a text file with the name of the image; None without one, or where it holds no time."""
    for suffix in _SIDECARS:
        for sidecar in (path.with_suffix(suffix), path.with_name(path.name + suffix)):
            if sidecar.is_file() and sidecar.stat().st_size < _MAX_SIDECAR_BYTES:
                return _time_in(sidecar.read_text(encoding="utf-8", errors="replace"))
    return None


def _time_in(text: str) -> float | None:
    if (stamp := _seconds(text)) is not None:
        return stamp
    match = _SECONDS.search(text)
    return None if match is None else float(match[2]) * _UNITS[(match[1] or "s").lower()]


def _tagged(tag: Callable[[int], Any]) -> float | None:
    for stamp, part in _STAMPS:
        seconds = _seconds(str(tag(stamp) or ""))
        if seconds is not None:
            digits = re.sub(r"\D", "", str(tag(part) or ""))
            return seconds + (float(f"0.{digits}") if digits else 0.0)
    return None


def _seconds(text: str) -> float | None:
    match = _STAMP.search(text)
    try:
        return None if match is None else (datetime(*(int(part) for part in match.groups()[:6]))
                                           - _EPOCH).total_seconds() + float(f"0.{match[7] or 0}")
    except ValueError:
        return None
