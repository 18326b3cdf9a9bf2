"""How often a command computes: calls of the functions that cost the time, counted in this process.

Where a function moves, its new place is written before the old one in `COUNTED`: a record of either version is then
made by the same bench.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

COUNTED: dict[str, tuple[str, ...]] = {  # what is counted -> its places, "module:function" or "module:Class.method"
    "forward_runs": ("idic.fe.time_march:march", "idic.fe.march:march"),
    "external_runs": ("idic.fe.external.solver:ExternalSolver.run",),
    "frame_equations": ("idic.correlation.equations_of_frame:frame_equations",
                        "idic.correlation.frame_equations:frame_equations"),
    "image_passes": ("idic.correlation.image_equations.frame:nodal_equations",),
    "residual_passes": ("idic.correlation.image_equations.residual:pixel_residual",
                        "idic.correlation.image_equations.frame:pixel_residual"),
    "height_passes": ("idic.correlation.height.surface:height_equations",),
    "section_passes": ("idic.correlation.height.cross_section:SectionReference.equations",
                       "idic.correlation.height.cross_section:section_equations"),
    "field_passes": ("idic.correlation.field.reference:FieldReference.equations",),
}


class MissingPlace(LookupError):
    """None of the places of a counted function exists."""


class Counter:
    """Calls of every function of a table, from any thread.

    Parameters
    ----------
    table : mapping
        As `COUNTED`.

    Raises
    ------
    MissingPlace
        None of the places of a function exists.
    """

    def __init__(self, table: Mapping[str, tuple[str, ...]] = COUNTED) -> None:
        self._lock = threading.Lock()
        self._end: tuple[str, int] | None = None
        self._numbers = dict.fromkeys(table, 0)
        for name, places in table.items():
            self._wrap(name, places)

    @property
    def numbers(self) -> dict[str, int]:
        """Calls so far."""
        return dict(self._numbers)

    def kill_at(self, name: str, number: int) -> None:
        """Kill this process at a further call of a function; number : 1 is the next call."""
        self._end = name, self._numbers[name] + number

    def _wrap(self, name: str, places: tuple[str, ...]) -> None:
        owner, attribute, function = existing(name, places)
        counted = self._counted(name, function)
        setattr(owner, attribute, counted)
        for module in list(sys.modules.values()):  # those that have imported the function by its name
            names = [key for key, value in vars(module).items() if value is function] if module is not None else []
            for key in names:
                setattr(module, key, counted)

    def _counted(self, name: str, function: Callable) -> Callable:
        @functools.wraps(function)
        def counted(*arguments, **keywords):
            with self._lock:
                self._numbers[name] += 1
                if self._end == (name, self._numbers[name]):
                    os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **keywords)

        return counted


def existing(name: str, places: tuple[str, ...]) -> tuple[Any, str, Callable]:
    """The first place that exists: its owner (module or class), the attribute there, the function."""
    for place in places:
        module, _, path = place.partition(":")
        try:
            owner: Any = import_module(module)
        except ModuleNotFoundError:
            continue
        *classes, attribute = path.split(".")
        for cls in classes:
            owner = getattr(owner, cls, None)
        if attribute in vars(owner or object):
            return owner, attribute, vars(owner)[attribute]
    raise MissingPlace(f"{name}: none of {', '.join(places)} exists; write its new place into COUNTED of "
                       "idic_studies.equality.counting")
