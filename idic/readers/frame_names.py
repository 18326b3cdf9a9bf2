"""Frames by name or number, for `reference`, `exclude_frames` and `still_frames`; missing numbers of images."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NoReturn

from idic.errors import InputError
from idic.readers.frames.name_orders import signed_keys
from idic.readers.paths import called_the_reference

MIN_EVEN_SHARE = 0.6  # of the steps between numbers: with fewer equal ones they are no count of images


class FrameNames:
    """The names of the frames and the numbers in them.

    groups : of each label; of_frames : the one number of each that differs, None for a label that is not counted (a
    reference with a name of its own); None where there is not one such number, or it is not unique
    """

    def __init__(self, labels: tuple[str, ...]):
        self.labels = labels
        self.groups = [[int(part) for part in re.findall(r"\d+", _stem(label))] for label in labels]
        counted = [k for k, group in enumerate(self.groups) if group]
        named = [k for k in counted if called_the_reference(_stem(labels[k]))]
        unsigned = [k for k in counted if k not in named[:len(named) == 1]]
        signed = signed_keys([_stem(labels[k]) for k in unsigned])
        for k, numbers in zip(unsigned, signed or (), strict=False):
            self.groups[k] = list(numbers)
        unnamed = [k for k in counted if k not in named]
        if len(named) == 1 and len({len(self.groups[k]) for k in unnamed}) == 1 \
                and len(self.groups[named[0]]) != len(self.groups[unnamed[0]]):
            counted = unnamed
        self._counted = counted
        alike = len({len(self.groups[k]) for k in counted}) == 1
        columns = list(zip(*(self.groups[k] for k in counted), strict=True)) if alike else []
        self._varying = [j for j, column in enumerate(columns) if len(set(column)) > 1] if alike else None
        self.of_frames: tuple[int | None, ...] | None = None
        if self._varying is not None and len(self._varying) == 1:
            numbers = columns[self._varying[0]]
            if len(set(numbers)) == len(counted):
                of = dict(zip(counted, numbers, strict=True))
                self.of_frames = tuple(of.get(k) for k in range(len(labels)))

    @property
    def numbers(self) -> tuple[int, ...] | None:
        """The number in each file name that differs from file to file; None if it is not unique.

        ``zoom-0050_1.tif, zoom-0053_1.tif`` -> 50, 53; ``shot_-0001.tif, shot_00000.tif`` -> -1, 0.
        """
        return None if self.of_frames is None or None in self.of_frames else self.of_frames

    def indices(self, frames: list[str | int], *, file, key) -> tuple[tuple[int, ...], str | None]:
        """Indices of the given frames, and a note on the meaning of the numbers.

        Names are file names. Numbers are those in the file names if all of them occur there, else indices into the
        stack, counted from 0.

        Raises
        ------
        InputError
            A name or number matches no frame, only some of the numbers are in the file names, or a number may be one in
            the names or an index.
        """
        numbers, labels = self.of_frames, self.labels
        integers = [item for item in frames if isinstance(item, int)]
        in_names = [item for item in integers if numbers is not None and item in numbers]
        if integers and in_names and len(in_names) < len(integers):
            stray = next(item for item in integers if item not in in_names)
            known_numbers = [number for number in numbers if number is not None]
            raise InputError("the frame numbers are ambiguous", file=file, key=key,
                             expected=f"numbers in the file names, {known_numbers[0]} … {known_numbers[-1]}",
                             found=f"{stray} is not among them, {in_names[0]} is",
                             remedy="give file names in place of numbers")
        indices, note = [], None
        for item in frames:
            if isinstance(item, str):
                if item not in labels:
                    raise InputError("no such frame", file=file, key=key,
                                     expected=f"a file name, {labels[0]} … {labels[-1]}", found=repr(item),
                                     remedy="correct the name")
                indices.append(labels.index(item))
            elif in_names:
                indices.append(numbers.index(item))
                if indices[-1] != item:
                    note = f"{key}: numbers are read as those in the file names ({item} is {labels[indices[-1]]})"
            elif 0 <= item < len(labels):
                bearing = self.bearing(item) if numbers is None else []
                if bearing and bearing != [item]:
                    _refuse_two_meanings(item, labels, bearing, file, key)
                indices.append(item)
                if any(self.groups) and numbers != tuple(range(len(labels))):
                    note = f"{key}: numbers are read as indices from 0 ({item} is {labels[item]})"
            else:
                span = "the numbers in the file names, or " if numbers is not None else ""
                raise InputError("no such frame", file=file, key=key, expected=f"{span}indices 0 … {len(labels) - 1}",
                                 found=str(item),
                                 remedy="give a file name" if numbers is None else "correct the number")
        return tuple(dict.fromkeys(indices)), note

    def check_complete(self, *, file, key) -> None:
        """InputError where a number is missing in evenly numbered file names: times by an interval count the files.

        Numbers count images where most of their steps are equal and the others are multiples. What follows an image at
        rest may begin anywhere. Equal steps are a series that was thinned; times of the day (HHMMSS), load steps, pages
        of a file and names without numbers are not judged.
        """
        numbers, labels = self.of_frames, self.labels
        if numbers is None or any("[" in label for label in labels):
            return
        counted = [(number, label) for number, label in zip(numbers, labels, strict=True) if number is not None]
        if len(counted) > 2 and counted[0][0] > counted[1][0]:  # the reference, which comes first
            del counted[0]
        values = [number for number, _ in counted]
        if len(values) > 3 and values[1] - values[0] > values[2] - values[1] > 0:  # an image at rest, long before
            del counted[0], values[0]
        steps = _steps(values)
        if len(steps) < 2 or min(steps) <= 0 or any(step % min(steps) for step in steps):
            return
        if max(steps) == min(steps) or steps.count(min(steps)) < MIN_EVEN_SHARE * len(steps):
            return
        of_day = _steps([_seconds(value) for value in values])
        if values[0] >= 10_000 and max(of_day) - min(of_day) <= 1:  # whole seconds of an even series
            return
        k = next(k for k, wide in enumerate(steps) if wide > min(steps))
        n_missing = sum(step // min(steps) - 1 for step in steps)
        raise InputError("an image is missing" if n_missing == 1 else f"{n_missing} images are missing", file=file,
                         key=key,
                         expected=f"numbers in steps of {min(steps)}: the times count the files",
                         found=f"{counted[k + 1][1]} after {counted[k][1]}: all times from there on would be too early",
                         remedy="put the image back (exclude_frames leaves a bad one out), or give the time of every "
                                "image with image_times in place of frame_interval_s")

    def bearing(self, number: int) -> list[int]:
        """The frames whose names hold this number where names differ."""
        if self._varying is None:  # names of different kinds
            return [k for k in self._counted if number in self.groups[k]]
        return [k for k in self._counted if any(self.groups[k][j] == number for j in self._varying)]


def _refuse_two_meanings(item: int, labels: tuple[str, ...], bearing: Sequence[int], file, key) -> NoReturn:
    named = " or ".join(labels[k] for k in bearing[:2])
    raise InputError("the frame numbers are ambiguous", file=file, key=key,
                     expected="file names, where these hold several numbers that differ, or none that is unique",
                     found=f"{item}, which is {named} by the number in the name and {labels[item]} by its place from 0",
                     remedy=f"write the file name, e.g. {labels[bearing[0]]!r}")


def _steps(values: Sequence[int]) -> list[int]:
    return [later - value for value, later in pairwise(values)]


def _seconds(clock: int) -> int:
    """Of a time of the day, HHMMSS."""
    return 3600 * (clock // 10_000) + 60 * (clock // 100 % 100) + clock % 100


def _stem(label: str) -> str:
    return label.rpartition(".")[0] if "[" not in label else label
