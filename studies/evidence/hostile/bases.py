"""The experiments and RUNs that the campaigns copy and spoil, made once for a process."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import idic
from idic.virtual_tests import write_example


@dataclass(frozen=True)
class Base:
    """An experiment and its finished RUN; both are copied, never changed."""

    experiment: Path
    run: Path


@cache
def demonstration() -> Base:
    """The demonstration in its small size."""
    folder = Path(tempfile.mkdtemp(prefix="idic-base-"))
    write_example("demo", folder / "experiment", reduced=True)
    idic.identify(folder / "experiment", folder / "run")
    return Base(folder / "experiment", folder / "run")
