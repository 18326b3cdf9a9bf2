"""What softening laws owe to the mesh, in words: with a length (crack band) nothing, else what follows the peak."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.fe import EXTERNAL, Mesh
from idic.laws import element_sizes, get_law
from idic.model import Material
from idic.parameters import Parameter


def softening_notes(materials: Sequence[Material], parameters: Sequence[Parameter], mesh: Mesh,
                    unit: str) -> list[str]:
    """A note for every material that softens.

    unit : of lengths in the mesh, mm or px
    """
    values, notes = {p.name: p.value for p in parameters}, []
    for material in materials:
        band = None if material.law == EXTERNAL else get_law(material.law).crack_band
        if band is None:
            continue
        sizes = sizes_of(mesh, mesh.element_sets[material.element_set])
        rows = f"{sizes.min():.3g} to {sizes.max():.3g} {unit}" if np.ptp(sizes) > 0.01 * sizes.max() \
            else f"{sizes.max():.3g} {unit}"
        length, key = values.get(f"{material.element_set}.{band.name}", 0.0), band.name.rpartition("_")[2]
        if length > 0.0:
            notes.append(f"material.{material.element_set}: softening for rows of {length:.3g} {unit} is scaled to "
                         f"elements of {rows}, so that the dissipated work does not depend on them (crack band; "
                         "elements about as long as wide)")
        else:
            notes.append(f"material.{material.element_set}: softening without a length: damage localises in one row "
                         f"of elements ({rows}), so after the peak force, motion and damage parameters depend on "
                         f"this mesh; give `{key}`, the element size that they hold for")
    return notes


def sizes_of(mesh: Mesh, elements: np.ndarray) -> np.ndarray:
    """Sizes of elements as softening laws see them  # (n,) global indices -> (n,) mm"""
    sizes = np.zeros(mesh.n_elements)
    for block in mesh.blocks:
        xi, w = block.kind.quadrature_rule(None)
        jac = np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], block.kind.shape_gradients(xi))
        volumes = (np.linalg.det(jac) * w).sum(axis=1)
        sizes[block.first:block.first + block.n_elements] = element_sizes(block.cell, volumes, mesh.n_dim)
    return sizes[elements]
