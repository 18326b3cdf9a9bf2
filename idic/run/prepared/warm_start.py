"""A stored simulation as the warm start of the next one: predicted to first order, taken over unchanged, or without its
time error."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from idic.errors import NotConverged
from idic.fe import Motion
from idic.model import ForwardModel
from idic.parameters import ParameterSet
from idic.run.store.arrays import Damaged, FrameArrays, read_array
from idic.run.store.run_store import RunStore

SAME_POINT_KEYS = ("label", "values", "names", "influence")  # equal in two simulations of one point


def first_order_prediction(simulation: Path, changes: np.ndarray) -> Iterator[np.ndarray]:
    """First-order prediction of the displacements of every frame after changes of the parameters.

    Parameters
    ----------
    simulation : folder with `u` and, where it was differentiated, `du`
    changes : (n_parameters,) of the parameters of `du`, in their units

    Yields
    ------
    (n_nodes, dim) mm
    """
    u, du = FrameArrays.open(simulation, "u"), None
    if changes.any() and (simulation / "du").exists():
        du = FrameArrays.open(simulation, "du")
    for first, stop in u.chunks():
        block = u.read(first, stop)
        if du is not None:
            block = block + du.read(first, stop) @ changes
        yield from block


def repeated(store: RunStore, source: str, name: str, ident: Mapping, starts: Sequence[str],
             steps: Sequence[float] | None) -> Path | None:
    """A finished simulation under another name; None where the wanted one differs from it.

    Parameters
    ----------
    source, name : groups of the finished and of the wanted simulation
    ident : what the wanted one depends on
    starts : groups with the frame-local unknowns of both
    steps : its increments
    """
    folder = store.finished(source)
    if folder is None or any(store.ident(folder).get(key) != ident[key] for key in SAME_POINT_KEYS):
        return None
    try:
        locals_ = [read_array(store.group(start), "local") for start in starts]
        if not np.array_equal(*locals_) or tuple(read_array(folder, "steps")) != steps:
            return None
        return store.repeat(name, ident, folder)
    except Damaged:
        return None  # simulated again


def write_without_time_error(forward: ForwardModel, source: Path | None, parameters: ParameterSet, local: np.ndarray,
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
        for first, stop in arrays["u"].chunks():
            yield from zip(*(array.read(first, stop) for array in arrays.values()), strict=True)

    copies = {name: _like(folder, name, array) for name, array in arrays.items()}
    with copies["u"].writer() as moved, copies["channels"].writer() as read:
        for u, channels in forward.without_time_error(parameters, local, known):
            moved.append(u)
            read.append(channels)
    for entry in source.iterdir():
        if entry.is_dir() and not (folder / entry.name).exists():
            shutil.copytree(entry, folder / entry.name)
    return read_array(source, "steps")


def _like(folder: Path, name: str, array: FrameArrays) -> FrameArrays:
    return FrameArrays.create(folder, name, array.n_frames, array.shape, array.frames_per_chunk)
