"""Paths of an experiment: inside its folder, in natural order."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from idic.errors import InputError


def natural_key(text: str) -> list[tuple[int, int, str]]:
    """Sort key in which ``frame_2`` comes before ``frame_10``."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part.lower()) for part in re.split(r"(\d+)", text)
            if part]


_REFERENCE = re.compile(r"(?<![a-z])(ref|reference|undeformed)(?![a-z])", re.IGNORECASE)


def called_the_reference(stem: str) -> bool:
    """Whether a file name calls the file the reference."""
    return _REFERENCE.search(stem) is not None


def recorded_order(paths: Iterable[Path], folder: Path) -> list[Path]:
    """Natural order of the names in a folder; the one file whose name calls it the reference comes first."""
    found = sorted(paths, key=lambda path: natural_key(path.relative_to(folder).as_posix()))
    named = [path for path in found if called_the_reference(path.stem)]
    if len(named) == 1:
        found.insert(0, found.pop(found.index(named[0])))
    return found


def inside(folder: Path, name: str, *, file, key) -> Path:
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


def existing_file(folder: Path, name: str, *, file, key) -> Path:
    """The path `name` inside the experiment folder; InputError if the file does not exist."""
    path = inside(folder, name, file=file, key=key)
    if not path.is_file():
        near = sorted(p.name for p in path.parent.iterdir() if p.is_file())[:10] if path.parent.is_dir() else []
        raise InputError("no such file", file=file, key=key, expected=str(path),
                         found=f"the folder holds {', '.join(near)}" if near else "nothing",
                         remedy="correct the name, relative to experiment.toml")
    return path


def matching_files(folder: Path, patterns: list[str], *, file, key) -> list[Path]:
    """All files that match the patterns, in `recorded_order`."""
    found: dict[Path, None] = {}
    for pattern in patterns:
        inside(folder, pattern, file=file, key=key)
        matches = _matches(folder, pattern, file=file, key=key)
        if not matches:
            parent = folder.joinpath(*PurePosixPath(pattern).parts[:-1])
            names = sorted((p.name for p in parent.iterdir()), key=natural_key)[:5] if parent.is_dir() else []
            raise InputError("no images match the pattern", file=file, key=key,
                             expected=f"files that match {pattern!r} in {folder}",
                             found=f"{parent.name}/ holds {', '.join(names)} …" if names else "none",
                             remedy='correct the pattern, e.g. images = "images/*.tif"')
        found |= dict.fromkeys(matches)
    return recorded_order(found, folder)


def _matches(folder: Path, pattern: str, *, file, key) -> list[Path]:
    parts = PurePosixPath(pattern.replace("\\", "/")).parts  # "." and "./" have none: no name to match
    try:
        return [path for path in folder.glob("/".join(parts)) if path.is_file()] if parts else []
    except (ValueError, NotImplementedError) as problem:  # Python's glob does not know the pattern
        raise InputError("not a usable pattern", file=file, key=key, expected='a pattern such as "images/*.tif"',
                         found=f"{pattern!r}: {problem}",
                         remedy='correct the pattern: ** stands alone, as in "**/*.tif"') from None
