"""A stored simulation as the warm start of the next one: predicted to first order, or taken over unchanged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from idic.store.arrays import Damaged, FrameArrays, read_array
from idic.store.run_store import RunStore

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
    for first, last in u.chunks():
        block = u.read(first, last)
        if du is not None:
            block = block + du.read(first, last) @ changes
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
    there = store.finished(source)
    if there is None or any(store.ident(there).get(key) != ident[key] for key in SAME_POINT_KEYS):
        return None
    try:
        locals_ = [read_array(store.group(start), "local") for start in starts]
        if not np.array_equal(*locals_) or tuple(read_array(there, "steps")) != steps:
            return None
        return store.repeat(name, ident, there)
    except Damaged:
        return None  # simulated again
