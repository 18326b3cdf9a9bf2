"""Names that users give (sets, materials, channels, boundaries) where they become parts of paths.

A mesh may come from a stranger: a set named ``../../elsewhere`` must not lead out of the RUN folder, and ``Force/N`` is
one name, not a folder and a file.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from idic.errors import InputError

_ENCODED = re.compile(r'[/\\:*?"<>|%\x00-\x1f\x7f]|^\.|[. ]$')  # separators, and what a file system refuses
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)  # of Windows
MAX_BYTES = 160  # of a part of a path; file systems take 255, with endings and temporary names
_DIGITS = 16


def path_name(label: str) -> str:
    """The label as one part of a path: the same label gives the same name, different ones different names.

    Labels of letters, digits, dots, dashes and spaces stay as they are.
    """
    name = _ENCODED.sub(lambda match: "".join(f"%{byte:02X}" for byte in match.group().encode()), label)
    if _DEVICES.fullmatch(name) or not name:
        name = f"%{name}"
    if len(name.encode()) <= MAX_BYTES:
        return name
    digest = hashlib.sha256(label.encode()).hexdigest()[:_DIGITS]
    return f"{quote(name, safe='%')[:MAX_BYTES - _DIGITS - 1]}-{digest}"


def refuse_names_that_are_one(labels: Iterable[str], folder: Path) -> None:
    """Refuse two labels that the file system of a folder treats as one name: ``Sheet`` and ``sheet`` on most macOS and
    Windows disks.

    Raises
    ------
    InputError
        There are two such labels, and the file system ignores case.
    """
    labels_by_name: dict[str, str] = {}
    for label in labels:
        earlier = labels_by_name.setdefault(unicodedata.normalize("NFC", path_name(label)).casefold(), label)
        if earlier != label and ignores_case(folder):
            raise InputError("two names that are the same for the file system of the results", file=folder,
                             expected="names that differ in more than upper and lower case",
                             found=f"{earlier}, {label}",
                             remedy="rename one of them in the mesh, the log or experiment.toml")


def ignores_case(folder: Path) -> bool:
    """Whether the disk of a folder, which need not exist yet, takes ``a`` and ``A`` for one name; writes nothing."""
    for part in (folder.absolute(), *folder.absolute().parents):
        swapped = part.with_name(part.name.swapcase()) if part.name else part
        if part.exists() and swapped.name != part.name:
            return swapped.exists() and swapped.samefile(part)
    return False


def path_inside(folder: Path, name: str, *, file, key) -> Path:
    """The path `name` inside the experiment folder.

    Raises
    ------
    InputError
        The path is absolute or contains `..`; an experiment folder can be moved and passed on.
    """
    parts = PurePosixPath(name.replace("\\", "/")).parts
    if not name or ".." in parts or Path(name).is_absolute() or (
            parts and (parts[0].startswith("/") or re.match(r"[A-Za-z]:", parts[0]))):
        raise InputError("the path leaves the experiment folder", file=file, key=key, found=repr(name),
                         expected="a path relative to experiment.toml, without ..",
                         remedy="copy the data into the experiment folder, or put a symbolic link there")
    return folder.joinpath(*parts)
