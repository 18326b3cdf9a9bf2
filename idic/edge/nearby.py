"""A stored simulation, carried on by its sensitivities to other parameters, as a start for the next one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from idic.edge.zarr_arrays import FrameArrays


def carried_on(simulation: Path, changes: np.ndarray) -> Iterator[np.ndarray]:
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
