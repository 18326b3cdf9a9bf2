"""Crack band: a softening law dissipates the same work per area with elements of any size.

A body that softens localises into one row of elements. The strain there is the opening of the row over its size h, so
that work per area falls with h unless the law knows it. A law with a length l (mm) is given l / h of every point and
stretches its softening by it: Bazant & Oh, Mater. Struct. 16 (1983) 155, doi:10.1007/BF02486267. With l = 0 it softens
alike in every element, and the response after the peak depends on the mesh.

The size of an element is the side of the square or cube of its area or volume (a triangle: half a square, a
tetrahedron: a sixth of a cube), half of it with mid-side nodes: Bazant & Oh take the row, quadratic elements open in
one row of points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

CELLS_OF_A_CUBE = {"tri3": 2.0, "tri6": 2.0, "tet4": 6.0, "tet10": 6.0}
QUADRATIC = ("tri6", "quad8", "tet10", "hex20")


@dataclass(frozen=True)
class CrackBand:
    """How a law depends on the size of the elements.

    Attributes
    ----------
    name : str
        The parameter that is the length, mm.
    largest : function, optional
        Values of the parameters by name -> the largest size of an element, over the length, that has a stress for
        every strain.
    """

    name: str
    largest: Callable[[Mapping[str, float]], float] | None = None

    def values(self, place: int, params: np.ndarray, size: np.ndarray) -> np.ndarray:
        """The parameters with the length over the size of each point  # ([n,] n_params), (n,) -> ([n,] n_params)"""
        if not params[..., place].any():
            return params
        scaled = np.tile(params, (len(size), 1)) if params.ndim == 1 else params.copy()
        scaled[:, place] /= size
        return scaled

    def changes(self, place: int, changes: np.ndarray | None, size: np.ndarray) -> np.ndarray | None:
        """Change of `values` with that of the parameters  # ([n,] nd, n_params) -> ([n,] nd, n_params)"""
        if changes is None or not changes[..., place].any():
            return changes
        scaled = np.array(np.broadcast_to(changes, (len(size), *changes.shape[-2:])))
        scaled[:, :, place] /= size[:, None]
        return scaled

    def trouble(self, values: Mapping[str, float], size: np.ndarray) -> str:
        """Empty, or why the law cannot be used with elements of these sizes."""
        length, largest = values[self.name], np.inf if self.largest is None else self.largest(values)
        if not length > 0.0 or size.max() < largest * length:
            return ""
        return (f"an element of {size.max():.3g} mm would snap back: with {self.name} = {length:.3g} mm and this "
                f"softening elements may have {largest * length:.3g} mm")


def element_sizes(cell: str, volumes: np.ndarray, n_dim: int) -> np.ndarray:
    """Size of elements of a kind, mm; volumes (n,) areas in mm^2 or volumes in mm^3  # (n,)"""
    side = (CELLS_OF_A_CUBE.get(cell, 1.0) * volumes) ** (1.0 / n_dim)
    return 0.5 * side if cell in QUADRATIC else side
