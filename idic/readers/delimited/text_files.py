"""Text of files as laboratories write them: UTF-8 and UTF-16 with or without a byte order mark, Windows-1252."""

from __future__ import annotations

import codecs
from pathlib import Path

from idic.errors import InputError

_MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
WINDOWS = "cp1252"  # Excel and testing machines in western Europe: µ, °, ä in one byte
_SHOWN = {"utf-16-le": "UTF-16", "utf-16-be": "UTF-16", WINDOWS: "Windows-1252"}
_LOOKED_AT = 4096  # bytes in which UTF-16 without a mark shows by its zero bytes
_MIN_ZERO_SHARE = 0.4  # of every second byte: letters, digits and separators have one zero byte each


def text_of(data: bytes, file: Path, key: str | None, *, windows: bool = True) -> tuple[str, str | None]:
    """The text of a file, and a note if it is not in UTF-8.

    Parameters
    ----------
    windows : bool
        Text that is not UTF-8 may be Windows-1252.

    Raises
    ------
    InputError
        The bytes are no text in these encodings.
    """
    encoding, start = _encoding(data)
    try:
        text = data[start:].decode(encoding)
    except UnicodeDecodeError as problem:
        if encoding != "utf-8" or start or not windows:
            raise _no_text(file, key, problem, windows) from None
        try:
            text, encoding = data.decode(WINDOWS), WINDOWS
        except UnicodeDecodeError:  # five bytes have no character there
            raise _no_text(file, key, problem, windows) from None
    note = f"{file.name}: read as {_SHOWN[encoding]}, not UTF-8" if encoding in _SHOWN else None
    return text, note


def _encoding(data: bytes) -> tuple[str, int]:
    """The encoding by byte order mark or zero bytes, and the length of the mark."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return encoding, len(mark)
    first, second = data[0:_LOOKED_AT:2], data[1:_LOOKED_AT:2]
    for zeros, letters, encoding in ((second, first, "utf-16-le"), (first, second, "utf-16-be")):
        if zeros and zeros.count(0) >= _MIN_ZERO_SHARE * len(zeros) and letters.count(0) == 0:
            return encoding, 0
    return "utf-8", 0


def _no_text(file: Path, key: str | None, problem: UnicodeDecodeError, windows: bool) -> InputError:
    kinds = "UTF-8, UTF-16 or Windows-1252" if windows else "UTF-8 or UTF-16"
    return InputError("not a text file", file=file, key=key, expected=f"text in {kinds}", found=str(problem),
                      remedy="export or save it again as text in UTF-8")
