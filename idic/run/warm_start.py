"""A stored simulation as a start for the next one: carried on by its sensitivities to other parameters, or taken as is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from idic.store.arrays import Damaged, FrameArrays, read_array
from idic.store.run_store import RunStore

SAME_POINT = ("label", "values", "names", "influence")  # of two simulations that are one


def first_order_prediction(simulation: Path, changes: np.ndarray) -> Iterator[np.ndarray]:
    """Displacements of every frame, to first order, after changes of the parameters.

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
    for first, last in u.chunks():
        block = u.read(first, last)
        if du is not None:
            block = block + du.read(first, last) @ changes
        yield from block


def repeated(store: RunStore, source: str, name: str, ident: Mapping, starts: Sequence[str],
             steps: Sequence[float] | None) -> Path | None:
    """A simulation under another name, where that would be one of the same values; None where it is another one.

    Parameters
    ----------
    source, name : groups of the finished and of the wanted simulation
    ident : what the wanted one depends on
    starts : groups with the frame-local unknowns of both
    steps : its increments
    """
    there = store.finished(source)
    if there is None or any(store.ident(there).get(key) != ident[key] for key in SAME_POINT):
        return None
    try:
        locals_ = [read_array(store.group(start), "local") for start in starts]
        if not np.array_equal(*locals_) or tuple(read_array(there, "steps")) != steps:
            return None
        return store.repeat(name, ident, there)
    except Damaged:
        return None  # simulated again
