"""The experiment and the RUN that the campaigns copy and spoil, made once for a process."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import idic
from idic.virtual_tests import EXAMPLES, DemoSize, strip, write_example

SIZE = DemoSize(0.2, (60, 110), (2, 2, 2), (2, 2, 1), (2, 2, 1), 1)  # a RUN with everything that a larger one has
LONGER = DemoSize(0.1, (200, 300), (4, 4, 4), (4, 6, 3), (4, 6, 3), 1)  # in which a worker can be lost twice
NAME = "hostile"


@dataclass(frozen=True)
class Base:
    """An experiment and its finished RUN; both are copied, never changed."""

    experiment: Path
    run: Path
    overrides: Mapping[str, object] = field(default_factory=dict)  # with which the RUN was made


def demonstration() -> Base:
    """The demonstration in six small frames, with two steps: what is damaged is computed again in a second."""
    return _finished(SIZE, 2)


def longer_demonstration() -> Base:
    """The demonstration in twelve frames, until it converges: a quarter of a minute of one core."""
    return _finished(LONGER, 30)


@cache
def _finished(size: DemoSize, iterations: int) -> Base:
    folder = Path(tempfile.mkdtemp(prefix="idic-base-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    EXAMPLES[NAME] = lambda reduced, foreign: strip(size)
    try:
        write_example(NAME, folder / "experiment")
    finally:
        del EXAMPLES[NAME]
    file = folder / "experiment" / "experiment.toml"
    file.write_text(file.read_text().replace("[options]\n", f"[options]\nmax_iterations = {iterations}\n"))
    idic.identify(folder / "experiment", folder / "run")
    return Base(folder / "experiment", folder / "run")
