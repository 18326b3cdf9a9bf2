"""The accepted simulation without its time error, as a further evaluation: motion and channels are other, derivatives
are kept (`idic.fe.half_rate`)."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from idic.errors import NotConverged
from idic.fe.half_rate import Motion
from idic.parameters import ParameterSet
from idic.run.context import RunContext
from idic.store.arrays import FrameArrays, read_array


def write_without_time_error(context: RunContext, source: Path | None, parameters: ParameterSet, local: np.ndarray,
                             folder: Path) -> np.ndarray:
    """Write the frames into `folder`; returns the increments (s) of the simulation in `source`, which is of this point.

    Raises
    ------
    NotConverged
        Without the source, or where no equilibrium is found in steps of two frames.
    """
    if source is None:
        raise NotConverged("the simulation of the accepted point is not there")
    arrays = {name: FrameArrays.open(source, name) for name in ("u", "channels")}

    def known() -> Iterator[Motion]:
        for first, last in arrays["u"].chunks():
            yield from zip(*(array.read(first, last) for array in arrays.values()), strict=True)

    copies = {name: _like(folder, name, array) for name, array in arrays.items()}
    with copies["u"].writer() as moved, copies["channels"].writer() as read:
        for u, channels in context.forward.without_time_error(parameters, local, known):
            moved.append(u)
            read.append(channels)
    for entry in source.iterdir():
        if entry.is_dir() and not (folder / entry.name).exists():
            shutil.copytree(entry, folder / entry.name)
    return read_array(source, "steps")


def _like(folder: Path, name: str, array: FrameArrays) -> FrameArrays:
    return FrameArrays.create(folder, name, array.n_frames, array.shape, array.frames_per_chunk)
