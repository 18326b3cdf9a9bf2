"""A mesh as an Abaqus (CalculiX) input file: nodes, elements, sets and surfaces, lengths in mm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.fe.mesh.mesh import Mesh
from idic.input_decks import first_edge

ABAQUS_TYPES = {"quad4": "CPS4", "quad8": "CPS8", "tri3": "CPS3", "tri6": "CPS6", "tet4": "C3D4",
                "tet10": "C3D10", "hex8": "C3D8", "hex20": "C3D20R"}
NUMBERS_PER_LINE = 12  # of a set or an element; 16 are allowed


def inp_text(mesh: Mesh, title: str, types: Mapping[str, str] | None = None) -> str:
    """The mesh with its node, element and edge (face) sets; all nodes are the set ALL.

    Edges are numbered as CalculiX numbers the faces of the element type: S3 is the first edge of a shell.

    types : cell -> element type, over those of plane stress and of solids.
    """
    types = ABAQUS_TYPES | dict(types or {})
    lines = ["*HEADING", f"{title} (mm)", "*NODE, NSET=ALL"]
    lines += [
        ", ".join([str(label), *(f"{x:.9g}" for x in point)])
        for label, point in zip(mesh.node_labels, mesh.nodes, strict=True)
    ]
    for block in mesh.blocks:
        lines.append(f"*ELEMENT, TYPE={types[block.cell]}")
        labels = mesh.element_labels[block.first : block.first + block.n_elements]
        for label, nodes in zip(labels, block.connectivity, strict=True):
            lines += _numbers([label, *mesh.node_labels[nodes]])
    lines += _sets("NSET", mesh.node_sets, mesh.node_labels) + _sets("ELSET", mesh.element_sets, mesh.element_labels)
    for name, faces in mesh.edge_sets.items():
        lines.append(f"*SURFACE, NAME={name}, TYPE=ELEMENT")
        lines += [f"{mesh.element_labels[e]}, S{k + first_edge(types[mesh.block_of(int(e)).cell])}" for e, k in faces]
    return "\n".join(lines) + "\n"


def _sets(kind: str, sets: Mapping[str, np.ndarray], labels: np.ndarray) -> list[str]:
    lines = []
    for name, members in sets.items():
        lines.append(f"*{kind}, {kind}={name}")
        lines += [line.removesuffix(",") for line in _numbers(labels[members])]
    return lines


def _numbers(values: Sequence[int]) -> list[str]:
    """Lines of at most `NUMBERS_PER_LINE`; a comma at the end says that the list goes on."""
    parts = [", ".join(map(str, values[i:i + NUMBERS_PER_LINE])) for i in range(0, len(values), NUMBERS_PER_LINE)]
    return [part + "," for part in parts[:-1]] + parts[-1:]
