"""Reads meshes of Abaqus and CalculiX input files: *NODE, *ELEMENT, *NSET, *ELSET, *SURFACE.

meshio is no substitute: it drops labels and sets of sets, and knows neither CPE4 nor CPS8. Other keywords (materials,
steps) are skipped. The file must hold a flat mesh without *INSTANCE transforms; keywords that make or move nodes and
elements are refused.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NoReturn

import numpy as np

from idic.errors import InputError
from idic.fe import CELL_TYPES, n_face_corners
from idic.readers.abaqus_sets import LabelSets, ScopedNames
from idic.readers.delimited.text_files import text_of
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
_MAKING = ("ELGEN", "ELCOPY", "NCOPY", "NFILL", "NGEN", "NMAP", "SYSTEM")  # of nodes and elements, by rules
_ORPHAN = "write the mesh as an orphan mesh: every node with its x, y, z, every element with its nodes"
_OF_SHELLS = ("SPOS", "SNEG")  # faces of shells
_MAX_LABEL = 2**31 - 1  # labels beyond the range of the programs that write such files are a damage


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
    for number, line in enumerate(_text(path).splitlines(), 1):
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


def _text(path: Path) -> str:
    """The file as text, as editors save it; bytes that are no letters may stand in names and comments."""
    data = path.read_bytes()
    try:
        return text_of(data, path, "mesh")[0]
    except InputError:
        return data.decode("utf-8", errors="replace")


class _Reader:
    """Collects the blocks of one file."""

    def __init__(self, path: Path):
        self.path = path
        self.node_labels: list[int] = []
        self.coordinates: list[list[float]] = []
        self.elements: dict[str, list[tuple[int, list[int], int]]] = {}  # kind -> (label, node labels, line)
        self.scopes: list[str] = []  # the open part, or the assembly and an instance in it
        self.node_sets: dict[tuple[str, str], list] = {}  # (scope, name) -> members
        self.element_sets: dict[tuple[str, str], list] = {}
        self.surfaces: dict[tuple[str, str], tuple[str, list]] = {}
        self.of_elements: list[tuple[str, str, str, int]] = []  # *NSET, ELSET=: scope, name, element set, line

    @property
    def scope(self) -> str:
        return self.scopes[-1] if self.scopes else ""

    def take(self, number, keyword, options, data) -> None:
        if keyword == "NODE":
            self._nodes(number, options, data)
        elif keyword == "ELEMENT":
            self._elements(number, options, data)
        elif keyword in ("NSET", "ELSET"):
            target = self.node_sets if keyword == "NSET" else self.element_sets
            name = options.get(keyword) or self.fail(number, f"*{keyword} without a name", f"{keyword}=NAME", "none")
            target.setdefault((self.scope, name), []).extend(self._members(options, data))
            if keyword == "NSET" and "ELSET" in options:
                self.of_elements.append((self.scope, name, options["ELSET"], number))
        elif keyword == "SURFACE":
            kind = options.get("TYPE", "ELEMENT").upper()
            if kind in ("ELEMENT", "NODE") and "COMBINE" not in options:  # no cuts, no rigid or joined surfaces
                self.surfaces[self.scope, options.get("NAME", f"surface_{number}")] = (
                    kind, [(n, cells) for n, cells, _ in data])
        elif keyword in ("PART", "ASSEMBLY", "INSTANCE"):
            self._enter(number, keyword, options, data)
        elif keyword in ("END PART", "END ASSEMBLY", "END INSTANCE"):
            del self.scopes[-1:]
        elif keyword in _MAKING and (data or keyword != "SYSTEM"):
            self.fail(number, "nodes or elements that are made or placed by a rule", "*NODE and *ELEMENT alone",
                       f"*{keyword}", _ORPHAN)
        elif keyword == "INCLUDE":
            self._in_another_file(number, keyword)

    def _enter(self, number, keyword, options, data) -> None:
        if keyword == "INSTANCE" and data:
            self.fail(number, "a part instance with a transform", "a flat mesh, or instances without transform",
                       "*INSTANCE with a position",
                       "write the mesh as an orphan mesh")
        self.scopes.append(options.get("NAME", keyword.capitalize()))

    def _in_another_file(self, number, keyword) -> NoReturn:
        self.fail(number, "the mesh is in another file", "one file", f"*{keyword}",
                   f"replace *{keyword} by the contents of that file")

    def _nodes(self, number, options, data) -> None:
        if options.get("SYSTEM", "R").upper() != "R":
            self.fail(number, "nodes in cylindrical or spherical coordinates", "x, y, z",
                       f"*NODE, SYSTEM={options['SYSTEM']}", _ORPHAN)
        if "INPUT" in options:
            self._in_another_file(number, "NODE, INPUT")
        labels = []
        for number, cells, _ in data:
            label = self._integer(cells[0], number)
            values = [self._real(cell, number) if cell else 0.0 for cell in cells[1:4]]  # an empty cell is zero
            self.node_labels.append(label)
            self.coordinates.append(values + [0.0] * (3 - len(values)))
            labels.append(label)
        if "NSET" in options:
            self.node_sets.setdefault((self.scope, options["NSET"]), []).extend((label, None) for label in labels)

    def _elements(self, number, options, data) -> None:
        if "INPUT" in options:
            self._in_another_file(number, "ELEMENT, INPUT")
        kind = self._kind(options.get("TYPE", ""), number)
        cells, first, labels = [], number, []
        for line, part, _ in data:
            first = line if not cells else first
            cells += [cell for cell in part if cell]
            if len(cells) < 1 + _N_NODES[kind]:
                continue
            values = [self._integer(cell, first) for cell in cells]
            if len(values) != 1 + _N_NODES[kind]:
                self.fail(first, f"element {values[0]} has another number of nodes than its type",
                           f"{_N_NODES[kind]} nodes", f"{len(values) - 1}")
            self.elements.setdefault(kind, []).append((values[0], values[1:], first))
            labels.append(values[0])
            cells = []
        if cells:
            self.fail(first, "an element with too few nodes", f"{_N_NODES[kind]} nodes ({options.get('TYPE')})",
                       f"{len(cells) - 1}", "export the mesh again: the file may be truncated")
        if "ELSET" in options:
            self.element_sets.setdefault((self.scope, options["ELSET"]), []).extend((label, None) for label in labels)

    def _kind(self, name: str, number: int) -> str:
        for pattern, kinds in _FAMILIES:
            match = pattern.match(name.upper())
            if match and name.upper().startswith("STRI65"):
                return "tri6"
            if match and int(match.group(1)) in kinds:
                return kinds[int(match.group(1))]
        return self.fail(number, "an element type that idic does not know",
                          "CPS4, CPE4, CPS3, CPS6, CPS8, C3D8 or the like", f"TYPE={name}",
                          "change the type: idic reads only the shape from it; kind in [experiment] gives the physics")

    def _members(self, options, data) -> list:
        members: list = []
        for number, cells, _ in data:
            cells = [cell for cell in cells if cell]
            if "GENERATE" in options:
                numbers = [self._integer(cell, number) for cell in cells]
                if len(numbers) not in (2, 3) or not numbers[0] <= numbers[1] or min(numbers[2:], default=1) < 1:
                    self.fail(number, "not a range of labels", "first, last, step; upwards", ", ".join(cells))
                members.append((range(numbers[0], numbers[1] + 1, *numbers[2:]), number))
            else:
                members.extend((self._label_or_name(cell, number), number) for cell in cells)
        return members

    # assembly -------------------------------------------------------------------------------------
    def mesh(self) -> RawMesh:
        labels = np.array(self.node_labels, dtype=np.int64)
        index = {int(label): k for k, label in enumerate(labels)}
        if len(index) < len(labels):
            self.fail(None, "a node label occurs twice", "every label once",
                       f"{len(labels)} nodes, {len(index)} labels", "write one part, as an orphan mesh")
        if not self.elements:
            self.fail(None, "the file holds no elements", "*ELEMENT", "none")
        cells, position, elements = [], {}, {}
        for kind, rows in self.elements.items():
            for label, nodes, line in rows:
                if any(node not in index for node in nodes):
                    missing = next(node for node in nodes if node not in index)
                    self.fail(line, f"element {label} refers to a node that does not exist", "a node of the file",
                               f"node {missing}", "correct the mesh file")
                if label in position:
                    self.fail(line, f"element label {label} occurs twice", "every label once", str(label),
                               "write one part, as an orphan mesh")
                position[label] = len(position)
                elements[label] = (kind, nodes)
            connectivity = np.array([[index[n] for n in nodes] for _, nodes, _ in rows], dtype=np.int64)
            cells.append((kind, connectivity, np.array([label for label, _, _ in rows], dtype=np.int64)))
        names = ScopedNames(self.node_sets, self.element_sets, self.surfaces)
        elements_of = LabelSets(names.flat(self.element_sets), position, "element", self.fail)
        for scope, name, member, line in self.of_elements:
            inside = elements_of.named(names.resolved(member, scope, self.element_sets), line, f"set {name}")
            self.node_sets[scope, name] += [(node, line) for node in {n for e in inside for n in elements[e][1]}]
        nodes_of = LabelSets(names.flat(self.node_sets), index, "node", self.fail)
        raw = RawMesh(self.path, np.array(self.coordinates, dtype=float).reshape(-1, 3), labels, cells,
                      nodes_of.as_indices(), elements_of.as_indices())
        for (scope, name), (kind, data) in self.surfaces.items():
            sets = self.node_sets if kind == "NODE" else self.element_sets
            rows = [(number, [names.resolved(cells[0], scope, sets), *cells[1:]]) for number, cells in data]
            self._surface(raw, names.key(scope, name), kind, rows, elements, nodes_of, elements_of)
        names.merge_alike(raw.node_sets, raw.element_sets, raw.face_sets)
        return raw

    def _surface(self, raw, name, kind, data, elements, nodes_of: LabelSets, elements_of: LabelSets) -> None:
        if kind == "NODE":
            members = [nodes_of.named(self._label_or_name(cells[0], number), number, f"surface {name}")
                       for number, cells in data]
            raw.node_sets.setdefault(name, nodes_of.indices(sorted(set().union(*members))))
            return
        index, faces = nodes_of.index, []
        if any(cell.upper() in _OF_SHELLS for _, cells in data for cell in cells[1:2]):
            return  # the whole sheet, which is no edge of it
        for number, cells in data:
            match = re.fullmatch(r"[SE]?([0-9])", cells[1].upper()) if len(cells) > 1 else None
            if match is None:
                self.fail(number, f"surface {name} is not given by elements and faces", "ELEMENT or ELSET, S1 … S6",
                           ", ".join(cells))
            for label in elements_of.named(self._label_or_name(cells[0], number), number, f"surface {name}"):
                cell, nodes = elements[label]
                table = CELL_TYPES[cell].faces if cell in CELL_TYPES else ()
                if not 1 <= int(match.group(1)) <= len(table):
                    self.fail(number, f"surface {name}: a {cell} has no such face", f"S1 … S{len(table)}", cells[1])
                corners = n_face_corners(cell)
                faces.append(tuple(index[nodes[k]] for k in table[int(match.group(1)) - 1][:corners]))
        raw.face_sets[name] = faces

    # numbers --------------------------------------------------------------------------------------
    def _label_or_name(self, cell: str, number: int) -> int | str:
        return self._integer(cell, number) if cell.lstrip("+").isdecimal() else cell

    def _integer(self, cell: str, number: int) -> int:
        try:
            label = int(cell)
        except ValueError:
            self.fail(number, "not a whole number", "a label", repr(cell),
                       "correct the mesh file, or export it again: it may be truncated")
        if abs(label) > _MAX_LABEL:
            self.fail(number, "a label beyond the largest one", f"labels up to {_MAX_LABEL}", cell,
                       "renumber nodes and elements, or export the mesh again: it may be damaged")
        return label

    def _real(self, cell: str, number: int) -> float:
        try:
            return float(cell.replace("D", "E").replace("d", "e"))
        except ValueError:
            self.fail(number, "not a number", "a coordinate", repr(cell),
                       "correct the mesh file, or export it again: it may be truncated")

    def fail(self, number, message, expected, finding, remedy="correct the mesh file") -> NoReturn:
        raise InputError(message, file=self.path, key="mesh" if number is None else f"line {number}", expected=expected,
                         found=finding, remedy=remedy)

