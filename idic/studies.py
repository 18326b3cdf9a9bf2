"""The door to the studies: what idic is measured by is a distribution of its own, not installed with idic."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from idic.errors import InputError

PACKAGE = "idic_studies"


def studies_module(name: str, command: str) -> ModuleType:
    """A module of the studies.

    Parameters
    ----------
    name : below their package, e.g. ``cases.gallery``
    command : what needs it, for the message

    Raises
    ------
    InputError
        The studies are not installed.
    """
    try:
        return import_module(f"{PACKAGE}.{name}")
    except ModuleNotFoundError as problem:
        if problem.name != PACKAGE:
            raise
        raise InputError("the studies are not installed", key=command,
                         expected="the package idic-studies, of the same checkout as idic", found="idic alone",
                         remedy="in a checkout of idic:  pip install ./studies") from None
