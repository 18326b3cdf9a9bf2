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
from idic.path_names import path_inside
from idic.readers.frames.name_orders import (
    CLOCK, DECIMALS, LISTED, NAMES, SIGNED, UncertainOrder, WRAPPED, natural_key, order_by_names,
)


_DECIMAL = re.compile(r"(?<![\d.])\d+\.\d+(?![\d.])")  # not 2024.05.01
_IN_WORDS = {SIGNED: "numbers with a minus are below zero", WRAPPED: "the counter began again after its largest number",
             DECIMALS: "numbers with and without a point are decimals", CLOCK: "by the dates and times in the names"}
_REFERENCE = re.compile(r"(?<![a-z])(ref|reference|undeformed)(?![a-z])", re.IGNORECASE)


def called_the_reference(stem: str) -> bool:
    """Whether a file name calls the file the reference."""
    return _REFERENCE.search(stem) is not None


def recorded_order(paths: Iterable[Path], folder: Path, order: str | None = None) -> list[Path]:
    """Order of the names in a folder; the one file whose name calls it the reference comes first.

    order : as `order_by_names` takes it; None: the natural order, or another one that the names show

    Raises
    ------
    InputError
        The names have two readings: a decimal number whose digits put the files into another order than its value, a
        minus or a dash before every number, a day and a month that can be exchanged.
    """
    return read_order(paths, folder, order)[0]


def read_order(paths: Iterable[Path], folder: Path, order: str | None = None) -> tuple[list[Path], str]:
    """`recorded_order`, and by which reading of the names."""
    ordered = sorted(paths, key=lambda path: natural_key(path.relative_to(folder).as_posix()))
    named = [path for path in ordered if called_the_reference(path.stem)]
    first = named if len(named) == 1 else []
    counted = [path for path in ordered if path not in first]
    if order is None:
        _check_decimals(counted, folder)
    try:
        places, reading = order_by_names([_stem_in(path, folder) for path in counted], order)
    except UncertainOrder as error:
        raise InputError("the order of the files is not certain", file=folder, key="experiment.order",
                         expected=error.expected, found=error.found,
                         remedy=f"look at the images, then write {_choice(error.orders)} under [experiment]") from None
    return [*first, *(counted[k] for k in places)], reading


def reading_of_names(paths: Sequence[Path], folder: Path) -> str:
    """How names are read that are not in the order of their digits from left to right, in words; "" elsewhere."""
    names = [natural_key(path.name) for path in paths]
    reading = read_order(dict.fromkeys(paths), folder)[1] if names != sorted(names) else ""
    return _IN_WORDS.get(reading, "")


def _choice(orders: Sequence[str]) -> str:
    return " or ".join(f'order = "{name}"' + (" with images = [\"first.tif\", …]" if name == LISTED else "")
                       for name in orders)


def _stem_in(path: Path, folder: Path) -> str:
    return path.relative_to(folder).with_suffix("").as_posix()


def _check_decimals(paths: list[Path], folder: Path) -> None:
    """InputError for t_1.0s, t_1.5s, t_1.25s: 25 comes after 5, and 1.25 before 1.5."""
    stems = [_stem_in(path, folder) for path in paths]
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
                         remedy="rename the files, with as many digits behind the point in every name; or look at the "
                                f"images, then write {_choice((DECIMALS, NAMES))} under [experiment]")


def existing_file(folder: Path, name: str, *, file, key) -> Path:
    """The path `name` inside the experiment folder; InputError if the file does not exist."""
    path = path_inside(folder, name, file=file, key=key)
    if not path.is_file():
        siblings = sorted(p.name for p in path.parent.iterdir() if p.is_file())[:10] if path.parent.is_dir() else []
        raise InputError("no such file", file=file, key=key, expected=str(path),
                         found=f"the folder holds {', '.join(siblings)}" if siblings else "nothing",
                         remedy="correct the name, relative to experiment.toml")
    return path


def matching_files(folder: Path, patterns: list[str], *, file, key, order: str | None = None) -> list[Path]:
    """All files that match the patterns, in `recorded_order`, or pattern by pattern as they are listed."""
    files: dict[Path, None] = {}
    for pattern in patterns:
        path_inside(folder, pattern, file=file, key=key)
        matches = _matches(folder, pattern, file=file, key=key)
        if not matches:
            parent = folder.joinpath(*PurePosixPath(pattern).parts[:-1])
            names = sorted((p.name for p in parent.iterdir()), key=natural_key)[:5] if parent.is_dir() else []
            raise InputError("no images match the pattern", file=file, key=key,
                             expected=f"files that match {pattern!r} in {folder}",
                             found=f"{parent.name}/ holds {', '.join(names)} …" if names else "none",
                             remedy='correct the pattern, e.g. images = "images/*.tif"')
        files |= dict.fromkeys(recorded_order(matches, folder) if order == LISTED else matches)
    return list(files) if order == LISTED else recorded_order(files, folder, order)


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
