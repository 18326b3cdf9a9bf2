"""Names that users give (sets, materials, channels, boundaries) where they become parts of paths.

A mesh may come from a stranger: a set named ``../../elsewhere`` must not lead out of the RUN folder, and ``Force/N`` is
one name, not a folder and a file.
"""

from __future__ import annotations

import hashlib
import re
from urllib.parse import quote

_ENCODED = re.compile(r'[/\\:*?"<>|%\x00-\x1f\x7f]|^\.|[. ]$')  # separators, and what a file system refuses
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)  # of Windows
MAX_BYTES = 160  # of a part of a path; file systems take 255, with endings and temporary names
_DIGITS = 16


def path_name(label: str) -> str:
    """The label as one part of a path: the same label gives the same name, different ones different names.

    Labels of letters, digits, dots, dashes and spaces stay as they are.
    """
    name = _ENCODED.sub(lambda found: "".join(f"%{byte:02X}" for byte in found.group().encode()), label)
    if _DEVICES.fullmatch(name) or not name:
        name = f"%{name}"
    if len(name.encode()) <= MAX_BYTES:
        return name
    digest = hashlib.sha256(label.encode()).hexdigest()[:_DIGITS]
    return f"{quote(name, safe='%')[:MAX_BYTES - _DIGITS - 1]}-{digest}"
