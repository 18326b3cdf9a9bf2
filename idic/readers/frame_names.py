"""Frames by name or number, for `reference`, `exclude_frames` and `still_frames`."""

from __future__ import annotations

import re

from idic.errors import InputError


def frame_numbers(labels: tuple[str, ...]) -> tuple[int, ...] | None:
    """The number in each file name that differs from file to file; None if it is not unique.

    ``zoom-0050_1.tif, zoom-0053_1.tif`` -> 50, 53.
    """
    groups = [re.findall(r"\d+", label.rpartition(".")[0] if "[" not in label else label) for label in labels]
    if len(labels) < 2 or len({len(group) for group in groups}) != 1:
        return None
    varying = [tuple(int(g[k]) for g in groups) for k in range(len(groups[0])) if len({int(g[k]) for g in groups}) > 1]
    return varying[0] if len(varying) == 1 and len(set(varying[0])) == len(labels) else None


def frame_indices(wanted: list[str | int], labels: tuple[str, ...], *, file, key) -> tuple[tuple[int, ...], str | None]:
    """Indices of the given frames, and a note on the meaning of the numbers.

    Names are file names. Numbers are those in the file names if all of them occur there, else indices into the stack,
    counted from 0.

    Raises
    ------
    InputError
        A name or number matches no frame, or only some of the numbers are in the file names.
    """
    numbers = frame_numbers(labels)
    integers = [item for item in wanted if isinstance(item, int)]
    in_names = [item for item in integers if numbers is not None and item in numbers]
    if integers and in_names and len(in_names) < len(integers):
        other = next(item for item in integers if item not in in_names)
        raise InputError("the frame numbers are ambiguous", file=file, key=key,
                         expected=f"numbers in the file names, {numbers[0]} … {numbers[-1]}",
                         found=f"{other} is not among them, {in_names[0]} is",
                         remedy="give file names in place of numbers")
    found, note = [], None
    for item in wanted:
        if isinstance(item, str):
            if item not in labels:
                raise InputError("no such frame", file=file, key=key,
                                 expected=f"a file name, {labels[0]} … {labels[-1]}", found=repr(item),
                                 remedy="correct the name")
            found.append(labels.index(item))
        elif in_names:
            found.append(numbers.index(item))
            if found[-1] != item:
                note = f"{key}: numbers are read as those in the file names ({item} is {labels[found[-1]]})"
        elif 0 <= item < len(labels):
            found.append(item)
            if numbers is not None and numbers != tuple(range(len(labels))):
                note = f"{key}: numbers are read as indices from 0 ({item} is {labels[item]})"
        else:
            span = "the numbers in the file names, or " if numbers is not None else ""
            raise InputError("no such frame", file=file, key=key, expected=f"{span}indices 0 … {len(labels) - 1}",
                             found=str(item), remedy="correct the number")
    return tuple(dict.fromkeys(found)), note
