"""Reads meshes of Abaqus and CalculiX input files: *NODE, *ELEMENT, *NSET, *ELSET, *SURFACE.

meshio is no substitute: it drops labels and sets of sets, and knows neither CPE4 nor CPS8. Other keywords (materials,
steps) are skipped. The file must hold a flat mesh without *INSTANCE transforms.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NoReturn

import numpy as np

from idic.errors import InputError
from idic.fe.mesh import element
from idic.readers.raw_mesh import RawMesh

_FAMILIES = (  # type name -> (dimension word, nodes)
    (re.compile(r"C3D(\d+)"), {4: "tet4", 6: "wedge6", 8: "hex8", 10: "tet10", 15: "wedge15", 20: "hex20"}),
    (re.compile(r"(?:CPS|CPEG|CPE|CAX|CGAX|DC2D|M3D|SFM3D|R3D|DS|S)(\d)"),
     {3: "tri3", 4: "quad4", 6: "tri6", 8: "quad8", 9: "quad9"}),
    (re.compile(r"STRI(\d)"), {3: "tri3", 6: "tri6"}),
    (re.compile(r"(?:T2D|T3D|B2|B3)(\d)"), {2: "line2", 3: "line3", 1: "line2"}),
)
_N_NODES = {"tet4": 4, "wedge6": 6, "hex8": 8, "tet10": 10, "wedge15": 15, "hex20": 20, "tri3": 3, "quad4": 4,
            "tri6": 6,
            "quad8": 8, "quad9": 9, "line2": 2, "line3": 3}


def read_inp(path: Path) -> RawMesh:
    """The mesh of an Abaqus or CalculiX input file.

    Raises
    ------
    InputError
        A number is invalid, an element type is unknown, or a node or element does not exist; with the line.
    """
    reader = _Reader(path)
    for number, keyword, options, data in _blocks(path):
        reader.take(number, keyword, options, data)
    return reader.mesh()


def _blocks(path: Path):
    """(line number, keyword, options, [(line number, cells)]) for every keyword line."""
    current = None
    pending = ""
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        line = pending + line.strip()
        pending = ""
        if not line or line.startswith("**"):
            continue
        if line.startswith("*"):
            if line.endswith(","):
                pending = line
                continue
            if current is not None:
                yield current
            parts = [part.strip() for part in line[1:].split(",")]
            options = {key.strip().upper(): value.strip().strip('"') for key, _,
                       value in (p.partition("=") for p in parts[1:] if p)}
            current = (number, " ".join(parts[0].upper().split()), options, [])
        elif current is not None:
            current[3].append((number, [cell.strip() for cell in line.split(",")], line.endswith(",")))
    if current is not None:
        yield current


class _Reader:
    """Collects the blocks of one file."""

    def __init__(self, path: Path):
        self.path = path
        self.node_labels: list[int] = []
        self.coordinates: list[list[float]] = []
        self.elements: dict[str, list[tuple[int, list[int], int]]] = {}  # kind -> (label, node labels, line)
        self.node_sets: dict[str, list] = {}
        self.element_sets: dict[str, list] = {}
        self.surfaces: dict[str, tuple[str, list]] = {}

    def take(self, number, keyword, options, data) -> None:
        if keyword == "NODE":
            self._nodes(options, data)
        elif keyword == "ELEMENT":
            self._elements(number, options, data)
        elif keyword in ("NSET", "ELSET"):
            target = self.node_sets if keyword == "NSET" else self.element_sets
            name = options.get(keyword) or self._fail(number, f"*{keyword} without a name", f"{keyword}=NAME", "none")
            target.setdefault(name, []).extend(self._members(options, data))
        elif keyword == "SURFACE":
            self.surfaces[options.get("NAME", f"surface_{number}")] = (options.get("TYPE", "ELEMENT").upper(),
                                                                       [(n, cells) for n, cells, _ in data])
        elif keyword == "INSTANCE" and data:
            self._fail(number, "a part instance with a transform", "a flat mesh, or instances without transform",
                       "*INSTANCE with a position",
                       "write the mesh as an orphan mesh")
        elif keyword == "INCLUDE":
            self._fail(number, "the mesh is in another file", "one file", "*INCLUDE",
                       "replace *INCLUDE by the contents of that file")

    def _nodes(self, options, data) -> None:
        labels = []
        for number, cells, _ in data:
            label = self._integer(cells[0], number)
            values = [self._real(cell, number) for cell in cells[1:4] if cell]
            self.node_labels.append(label)
            self.coordinates.append(values + [0.0] * (3 - len(values)))
            labels.append(label)
        if "NSET" in options:
            self.node_sets.setdefault(options["NSET"], []).extend(labels)

    def _elements(self, number, options, data) -> None:
        kind = self._kind(options.get("TYPE", ""), number)
        cells, first, labels = [], number, []
        for line, part, _ in data:
            first = line if not cells else first
            cells += [cell for cell in part if cell]
            if len(cells) < 1 + _N_NODES[kind]:
                continue
            values = [self._integer(cell, first) for cell in cells]
            if len(values) != 1 + _N_NODES[kind]:
                self._fail(first, f"element {values[0]} has another number of nodes than its type",
                           f"{_N_NODES[kind]} nodes", f"{len(values) - 1}")
            self.elements.setdefault(kind, []).append((values[0], values[1:], first))
            labels.append(values[0])
            cells = []
        if cells:
            self._fail(first, "an element with too few nodes", f"{_N_NODES[kind]} nodes ({options.get('TYPE')})",
                       f"{len(cells) - 1}", "export the mesh again: the file may be truncated")
        if "ELSET" in options:
            self.element_sets.setdefault(options["ELSET"], []).extend(labels)

    def _kind(self, name: str, number: int) -> str:
        for pattern, kinds in _FAMILIES:
            match = pattern.match(name.upper())
            if match and name.upper().startswith("STRI65"):
                return "tri6"
            if match and int(match.group(1)) in kinds:
                return kinds[int(match.group(1))]
        return self._fail(number, "an element type that idic does not know",
                          "CPS4, CPE4, CPS3, CPS6, CPS8, C3D8 or the like", f"TYPE={name}",
                          "change the type: idic reads only the shape from it; kind in [experiment] gives the physics")

    def _members(self, options, data) -> list:
        members: list = []
        for number, cells, _ in data:
            cells = [cell for cell in cells if cell]
            if "GENERATE" in options:
                numbers = [self._integer(cell, number) for cell in cells]
                if len(numbers) not in (2, 3) or numbers[-1] == 0:
                    self._fail(number, "not a range of labels", "first, last, step", ", ".join(cells))
                members.extend(range(numbers[0], numbers[1] + 1, *numbers[2:]))
            else:
                members.extend(int(cell) if cell.lstrip("+").isdigit() else (cell, number) for cell in cells)
        return members

    # assembly -------------------------------------------------------------------------------------
    def mesh(self) -> RawMesh:
        labels = np.array(self.node_labels, dtype=np.int64)
        index = {int(label): k for k, label in enumerate(labels)}
        if len(index) < len(labels):
            self._fail(None, "a node label occurs twice", "every label once",
                       f"{len(labels)} nodes, {len(index)} labels", "write one part, as an orphan mesh")
        if not self.elements:
            self._fail(None, "the file holds no elements", "*ELEMENT", "none")
        cells, position, where = [], {}, {}
        for kind, rows in self.elements.items():
            for label, nodes, line in rows:
                if any(node not in index for node in nodes):
                    missing = next(node for node in nodes if node not in index)
                    self._fail(line, f"element {label} refers to a node that does not exist", "a node of the file",
                               f"node {missing}", "correct the mesh file")
                if label in position:
                    self._fail(line, f"element label {label} occurs twice", "every label once", str(label),
                               "write one part, as an orphan mesh")
                position[label] = len(position)
                where[label] = (kind, nodes)
            connectivity = np.array([[index[n] for n in nodes] for _, nodes, _ in rows], dtype=np.int64)
            cells.append((kind, connectivity, np.array([label for label, _, _ in rows], dtype=np.int64)))
        node_sets = {name: self._resolve(name, self.node_sets, index, "node") for name in self.node_sets}
        element_sets = {name: self._resolve(name, self.element_sets, position, "element") for name in self.element_sets}
        raw = RawMesh(self.path, np.array(self.coordinates, dtype=float).reshape(-1, 3), labels, cells, node_sets,
                      element_sets)
        element_labels = {name: self._labels(name, self.element_sets) for name in self.element_sets}
        for name, (kind, data) in self.surfaces.items():
            self._surface(raw, name, kind, data, where, index, element_labels)
        return raw

    def _labels(self, name: str, sets: dict[str, list], seen: tuple[str, ...] = ()) -> list[int]:
        """Labels of a set, including the members of its subsets."""
        labels = []
        for member in sets[name]:
            if isinstance(member, int):
                labels.append(member)
                continue
            other, line = member
            key = next((known for known in sets if known.upper() == other.upper()), None)
            if key is None or key in seen:
                self._fail(line, f"set {name} names a set that does not exist", ", ".join(sets), other)
            labels.extend(self._labels(key, sets, (*seen, name)))
        return labels

    def _resolve(self, name, sets, index, what) -> np.ndarray:
        labels = self._labels(name, sets)
        missing = [label for label in labels if label not in index]
        if missing:
            self._fail(None, f"set {name} names a {what} that does not exist", f"{what}s of the file",
                       f"{what} {missing[0]}", "correct the mesh file")
        return np.unique(np.array([index[label] for label in labels], dtype=np.int64))

    def _surface(self, raw, name, kind, data, where, index, element_labels) -> None:
        if kind == "NODE":
            labels = [label for _,
                      cells in data for cell in cells[:1] for label in ([int(cell)] if cell.isdigit()
                                                                        else self._labels(cell, self.node_sets))]
            raw.node_sets.setdefault(name, np.unique([index[label] for label in labels]))
            return
        faces = []
        for number, cells in data:
            labels = [int(cells[0])] if cells[0].isdigit() else element_labels.get(cells[0])
            match = re.fullmatch(r"[SE]?(\d)", cells[1].upper()) if len(cells) > 1 else None
            if labels is None or match is None:
                self._fail(number, f"surface {name} is not given by elements and faces", "ELEMENT or ELSET, S1 … S6",
                           ", ".join(cells))
            for label in labels:
                if label not in where:
                    self._fail(number, f"surface {name} names an element that does not exist", "an element of the file",
                               str(label))
                cell, nodes = where[label]
                table = element.CELLS[cell].faces if cell in element.CELLS else ()
                if int(match.group(1)) > len(table):
                    self._fail(number, f"surface {name}: a {cell} has no such face", f"S1 … S{len(table)}", cells[1])
                corners = element.face_corners(cell)
                faces.append(tuple(index[nodes[k]] for k in table[int(match.group(1)) - 1][:corners]))
        raw.face_sets[name] = faces

    # numbers --------------------------------------------------------------------------------------
    def _integer(self, cell: str, number: int) -> int:
        try:
            return int(cell)
        except ValueError:
            self._fail(number, "not a whole number", "a label", repr(cell),
                       "correct the mesh file, or export it again: it may be truncated")

    def _real(self, cell: str, number: int) -> float:
        try:
            return float(cell.replace("D", "E").replace("d", "e"))
        except ValueError:
            self._fail(number, "not a number", "a coordinate", repr(cell),
                       "correct the mesh file, or export it again: it may be truncated")

    def _fail(self, number, what, expected, found, remedy="correct the mesh file") -> NoReturn:
        raise InputError(what, file=self.path, key="mesh" if number is None else f"line {number}", expected=expected,
                         found=found, remedy=remedy)
