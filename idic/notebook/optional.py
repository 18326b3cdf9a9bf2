"""Packages that a notebook may have: imported where they are used, with a clear message where they are missing."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from idic.errors import InputError


def optional(name: str) -> ModuleType:
    """The package of this name.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as missing:
        if missing.name != name:
            raise
        raise InputError(f"{name} is not installed", expected=f"the package {name}", found="none",
                         remedy=f"pip install {name}, or all packages for notebooks: pip install "
                                f"'idic[notebook]'") from None
