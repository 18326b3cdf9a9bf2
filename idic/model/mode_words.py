"""Modes of virtual boundaries in texts and tables: the many degrees of freedom of one motion under one name."""

from __future__ import annotations

import re
from collections.abc import Iterable

_MODE = re.compile(r"(boundary\..+)\.s\d+t\d+")


def motion_of(name: str) -> str | None:
    """``boundary.SET.COMPONENT`` of a mode ``boundary.SET.COMPONENT.sItJ``; None for any other degree of freedom."""
    match = _MODE.fullmatch(name)
    return match.group(1) if match else None


def is_mode(name: str) -> bool:
    """Whether a degree of freedom is an amplitude of a virtual boundary."""
    return motion_of(name) is not None


def motions(names: Iterable[str]) -> dict[str, list[str]]:
    """The modes among `names` by the motion they belong to, in order."""
    modes: dict[str, list[str]] = {}
    for name in names:
        if is_mode(name):
            modes.setdefault(motion_of(name), []).append(name)
    return modes


def in_words(names: Iterable[str], among: Iterable[str]) -> list[str]:
    """`names` with the modes of each motion as one entry, ``boundary.TOP.y: 7 of 24 modes``.

    among : every name there is, to count the modes of a motion.
    """
    names = list(names)
    every = {motion: len(modes) for motion, modes in motions(among).items()}
    return [name for name in names if not is_mode(name)] + [
        f"{motion}: {len(modes)} of {max(every.get(motion, 0), len(modes))} modes"
        for motion, modes in motions(names).items()]
