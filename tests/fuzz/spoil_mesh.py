"""Mesh files of one plane mesh in several formats, with damage."""

from __future__ import annotations

import io
import contextlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import meshio
import numpy as np
from hypothesis import strategies as st

FORMATS = {
    ".inp": None,
    ".msh": None,
    ".msh22": dict(file_format="gmsh22", binary=False),
    ".msh-binary": dict(file_format="gmsh22", binary=True),
    ".vtk": dict(file_format="vtk", binary=True),
    ".vtk-ascii": dict(file_format="vtk", binary=False),
    ".vtu": dict(file_format="vtu", binary=True),
    ".vtu-ascii": dict(file_format="vtu", binary=False),
}
NX, NY = 4, 3


@dataclass
class Table:
    """A mesh as rows: {label: [x, y, z]}, {label: node labels}, {set: node labels}."""

    nodes: dict[int, list[float]]
    elements: dict[int, list[int]]
    sets: dict[str, list[int]]


def table() -> Table:
    nodes = {101 + 5 * j + i: [float(i), float(j), 0.0] for j in range(NY + 1) for i in range(NX + 1)}
    elements = {}
    for j in range(NY):
        for i in range(NX):
            a = 101 + 5 * j + i
            elements[1001 + NX * j + i] = [a, a + 1, a + 6, a + 5]
    return Table(nodes, elements, {"BOTTOM": list(range(101, 106)), "TOP": list(range(116, 121))})


@dataclass(frozen=True)
class Fault:
    """One thing wrong; `sure` where it must be refused in every format."""

    what: str
    which: int = 0
    value: object = None

    @property
    def sure(self) -> bool:
        return self.what in (
            "collapse",
            "fold",
            "coordinate",
            "double_element",
            "lose_set",
            "empty_set",
            "lose_node",
        )

    def apply(self, mesh: Table) -> None:
        labels = sorted(mesh.elements)
        label = labels[self.which % len(labels)]
        nodes = mesh.elements[label]
        if self.what == "invert":
            mesh.elements[label] = nodes[::-1]
        elif self.what == "fold":
            mesh.elements[label] = [nodes[0], nodes[2], nodes[1], nodes[3]]
        elif self.what == "collapse":
            mesh.elements[label] = [nodes[0], nodes[0], nodes[1], nodes[1]]
        elif self.what == "coordinate":
            mesh.nodes[sorted(mesh.nodes)[self.which % len(mesh.nodes)]][self.which % 2] = self.value
        elif self.what == "double_element":
            mesh.elements[max(labels) + 1] = list(nodes)
        elif self.what == "lose_set":
            mesh.sets.pop(("BOTTOM", "TOP")[self.which % 2], None)
        elif self.what == "empty_set":
            mesh.sets[("BOTTOM", "TOP")[self.which % 2]] = []
        elif self.what == "lose_node":
            mesh.nodes.pop(nodes[0], None)
        elif self.what == "spare_node":
            mesh.nodes[999] = [50.0, 50.0, 0.0]


faults = st.builds(
    Fault,
    st.sampled_from(
        ["invert", "fold", "collapse", "double_element", "lose_set", "empty_set", "lose_node", "spare_node"]
    ),
    st.integers(0, 11),
) | st.builds(
    Fault, st.just("coordinate"), st.integers(0, 19), st.sampled_from([float("nan"), float("inf"), 1e300, -1e300])
)


def content(mesh: Table, kind: str) -> bytes | None:
    """The file; None where the format cannot even say this."""
    return inp(mesh) if kind == ".inp" else gmsh(mesh) if kind == ".msh" else _by_meshio(mesh, kind)


def inp(mesh: Table) -> bytes:
    lines = ["*NODE"] + [f"{label}, " + ", ".join(f"{x!r}" for x in xyz) for label, xyz in mesh.nodes.items()]
    lines.append("*ELEMENT, TYPE=CPS4, ELSET=SPECIMEN")
    lines += [", ".join(map(str, (label, *nodes))) for label, nodes in mesh.elements.items()]
    for name, labels in mesh.sets.items():
        lines += [f"*NSET, NSET={name}", ", ".join(map(str, labels))]
    return ("\n".join(lines) + "\n").encode()


def gmsh(mesh: Table) -> bytes:
    """Version 4.1 as text: the quadrilaterals on surface 1, a chain of lines on a curve for every set."""
    names = [(2, 1, "SPECIMEN"), *((1, k + 2, name) for k, name in enumerate(mesh.sets))]
    parts = [(2, 1, 3, list(mesh.elements.values()))]
    parts += [(1, k + 1, 1, list(zip(m[:-1], m[1:], strict=True))) for k, m in enumerate(mesh.sets.values())]
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", f"{len(names)}"]
    lines += [f'{dim} {tag} "{name}"' for dim, tag, name in names]
    lines += ["$EndPhysicalNames", "$Entities", f"0 {len(mesh.sets)} 1 0"]
    lines += [f"{k + 1} 0 0 0 4 3 0 1 {k + 2} 0" for k in range(len(mesh.sets))]
    lines += [
        "1 0 0 0 4 3 0 1 1 0",
        "$EndEntities",
        "$Nodes",
        f"1 {len(mesh.nodes)} 1 {max(mesh.nodes)}",
        f"2 1 0 {len(mesh.nodes)}",
        *map(str, mesh.nodes),
    ]
    lines += [" ".join(f"{x!r}" for x in xyz) for xyz in mesh.nodes.values()]
    total, label = sum(len(cells) for *_, cells in parts), 0
    lines += ["$EndNodes", "$Elements", f"{len(parts)} {total} 1 {total}"]
    for dim, tag, shape, cells in parts:
        lines.append(f"{dim} {tag} {shape} {len(cells)}")
        for cell in cells:
            label += 1
            lines.append(" ".join(map(str, (label, *cell))))
    return ("\n".join([*lines, "$EndElements"]) + "\n").encode()


def _by_meshio(mesh: Table, kind: str) -> bytes | None:
    order = {label: k for k, label in enumerate(mesh.nodes)}
    if any(n not in order for nodes in mesh.elements.values() for n in nodes):
        return None
    if any(n not in order for labels in mesh.sets.values() for n in labels):
        return None
    points = np.array(list(mesh.nodes.values()))
    quads = np.array([[order[n] for n in nodes] for nodes in mesh.elements.values()])
    sets = {name: [order[n] for n in labels] for name, labels in mesh.sets.items()}
    if kind.startswith((".vtu", ".vtk")):
        data = {name: np.isin(np.arange(len(points)), members).astype(np.int32) for name, members in sets.items()}
        made = meshio.Mesh(
            points, [("quad", quads)], point_data=data, cell_data={"SPECIMEN": [np.ones(len(quads), np.int32)]}
        )
    else:
        lines = {name: np.array(list(zip(m[:-1], m[1:], strict=True))).reshape(-1, 2) for name, m in sets.items()}
        lines = {name: cells for name, cells in lines.items() if len(cells)}
        cells = [("quad", quads), *(("line", found) for found in lines.values())]
        tags = [np.full(len(part), k + 1, np.int32) for k, (_, part) in enumerate(cells)]
        names = {"SPECIMEN": np.array([1, 2])} | {name: np.array([k + 2, 1]) for k, name in enumerate(lines)}
        made = meshio.Mesh(points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}, field_data=names)
    return _written(made, kind)


def _written(mesh: meshio.Mesh, kind: str) -> bytes:
    with (
        TemporaryDirectory() as folder,
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        path = Path(folder) / f"mesh{suffix(kind)}"
        mesh.write(path, **FORMATS[kind])
        return path.read_bytes()


def suffix(kind: str) -> str:
    return kind[:4]


@lru_cache(maxsize=None)
def whole(kind: str) -> bytes:
    return content(table(), kind)
