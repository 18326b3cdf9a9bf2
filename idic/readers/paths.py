"""Paths of an experiment: inside its folder, in natural order; patterns that match given files."""

from __future__ import annotations

import glob
import os
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import Path, PurePosixPath

from idic.errors import InputError


def natural_key(text: str) -> list[tuple[int, int, str]]:
    """Sort key in which ``frame_2`` comes before ``frame_10``."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part.lower()) for part in re.split(r"(\d+)", text)
            if part]


_DECIMAL = re.compile(r"(?<![\d.])\d+\.\d+(?![\d.])")  # not 2024.05.01
_REFERENCE = re.compile(r"(?<![a-z])(ref|reference|undeformed)(?![a-z])", re.IGNORECASE)


def called_the_reference(stem: str) -> bool:
    """Whether a file name calls the file the reference."""
    return _REFERENCE.search(stem) is not None


def recorded_order(paths: Iterable[Path], folder: Path) -> list[Path]:
    """Natural order of the names in a folder; the one file whose name calls it the reference comes first.

    Raises
    ------
    InputError
        The names differ in a decimal number whose digits put the files into another order than its value.
    """
    ordered = sorted(paths, key=lambda path: natural_key(path.relative_to(folder).as_posix()))
    named = [path for path in ordered if called_the_reference(path.stem)]
    if len(named) == 1:
        ordered.insert(0, ordered.pop(ordered.index(named[0])))
    _check_decimals(ordered[len(named) == 1:], folder)
    return ordered


def _check_decimals(paths: list[Path], folder: Path) -> None:
    """InputError for t_1.0s, t_1.5s, t_1.25s: 25 comes after 5, and 1.25 before 1.5."""
    stems = [path.relative_to(folder).with_suffix("").as_posix() for path in paths]
    numbers = [_DECIMAL.findall(stem) for stem in stems]
    if any(len(matches) != 1 for matches in numbers) or len({_DECIMAL.sub("#", stem) for stem in stems}) != 1:
        return
    values = [float(matches[0]) for matches in numbers]
    integers, fractions = ([matches[0].split(".")[place] for matches in numbers] for place in (0, 1))
    if len(set(integers)) == 1 and [int(digits)
                                    for digits in fractions] == list(range(int(fractions[0]), int(fractions[0])
                                                                                       + len(fractions))):
        return  # specimen_1.9, specimen_1.10: a counter behind a point
    k = next((k for k in range(1, len(values)) if values[k] < values[k - 1]), None)
    if k is not None:
        raise InputError("the order of the files is not certain", file=folder,
                         expected="decimal numbers with equally many digits, such as 1.00, 1.25, 1.50",
                         found=f"{paths[k - 1].name} and {paths[k].name}",
                         remedy="rename the files, with as many digits behind the point in every name")


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
        siblings = sorted(p.name for p in path.parent.iterdir() if p.is_file())[:10] if path.parent.is_dir() else []
        raise InputError("no such file", file=file, key=key, expected=str(path),
                         found=f"the folder holds {', '.join(siblings)}" if siblings else "nothing",
                         remedy="correct the name, relative to experiment.toml")
    return path


def matching_files(folder: Path, patterns: list[str], *, file, key) -> list[Path]:
    """All files that match the patterns, in `recorded_order`."""
    files: dict[Path, None] = {}
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
        files |= dict.fromkeys(matches)
    return recorded_order(files, folder)


def patterns_of(folder: Path, paths: Sequence[Path]) -> list[str]:
    """Patterns relative to `folder` that match these files of one folder and no other: one where one is enough."""
    parent = paths[0].parent
    place = glob.escape(parent.relative_to(folder).as_posix())

    def fitting(files: Sequence[Path]) -> list[str]:
        names = [path.name for path in files]
        start = glob.escape(_shared_start(names).rstrip("0123456789"))
        end = glob.escape(_shared_start([name[::-1] for name in names])[::-1].lstrip("0123456789"))
        shapes = (f"*{glob.escape(files[0].suffix)}", f"{start}*{end}", f"{start}[0-9]*{end}")
        pattern = next((shape for shape in shapes if set(_visible(parent, shape)) == set(files)), None)
        return [] if pattern is None else [pattern]

    shapes = fitting(paths)
    if not shapes:
        alike = defaultdict(list)
        for path in paths:
            alike[re.sub(r"\d+", "#", path.name)].append(path)
        shapes = [shape for group in alike.values()
                  for shape in fitting(group) or [glob.escape(path.name) for path in group]]
    return [(PurePosixPath(place) / shape).as_posix() for shape in shapes]


def _visible(folder: Path, pattern: str) -> list[Path]:
    """The files that match; hidden ones, such as ``._a.tif`` of a Mac, only where the pattern begins with a dot."""
    hidden = pattern.rpartition("/")[2].startswith(".")
    return [path for path in folder.glob(pattern) if path.is_file() and (hidden or not path.name.startswith("."))]


def _shared_start(names: Sequence[str]) -> str:
    """The letters that all names begin with."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in alike)


def existing_start(base: Path, parts: Sequence[str]) -> tuple[Path, str]:
    """The folder that the first parts of a pattern name as they stand, as ``images [1]`` does, and the rest as a
    pattern; the last part, too, where it is the name of a file."""
    remaining = list(parts)
    while len(remaining) > 1 and os.path.isdir(base / remaining[0]):
        base /= remaining.pop(0)
    if len(remaining) == 1 and os.path.isfile(base / remaining[0]):
        remaining = [glob.escape(remaining[0])]
    return base, "/".join(remaining)


def _matches(folder: Path, pattern: str, *, file, key) -> list[Path]:
    parts = PurePosixPath(pattern.replace("\\", "/")).parts  # "." and "./" have none: no name to match
    try:
        if not parts:
            return []
        start, tail = existing_start(folder, parts)
        return _visible(start, tail)
    except (ValueError, NotImplementedError) as problem:  # Python's glob does not know the pattern
        raise InputError("not a usable pattern", file=file, key=key, expected='a pattern such as "images/*.tif"',
                         found=f"{pattern!r}: {problem}",
                         remedy='correct the pattern: ** stands alone, as in "**/*.tif"') from None
