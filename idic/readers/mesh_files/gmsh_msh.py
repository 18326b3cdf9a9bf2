"""Reads msh files of gmsh, versions 2.2 and 4.1, text and binary.

meshio is no substitute: it refuses files in which only some entities are in a group or nodes carry parameters, loses
the names of reversed groups and of a curve and a surface of one name, and repeats the elements of overlapping groups.
Format: gmsh reference manual, "MSH file format".
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from idic.errors import InputError
from idic.readers.mesh_files.raw_mesh import RawMesh

VERSIONS = ("2.2", "4.1")
_HEAD_BYTES = 4096  # in which the version stands
_TYPES = {  # number of the type: (dimension, nodes, cell)
    15: (0, 1, "point"), 1: (1, 2, "line2"), 8: (1, 3, "line3"), 2: (2, 3, "tri3"), 9: (2, 6, "tri6"),
    3: (2, 4, "quad4"), 16: (2, 8, "quad8"), 10: (2, 9, "quad9"), 4: (3, 4, "tet4"), 11: (3, 10, "tet10"),
    5: (3, 8, "hex8"), 17: (3, 20, "hex20"), 12: (3, 27, "hex27"), 6: (3, 6, "wedge6"), 18: (3, 15, "wedge15"),
    13: (3, 18, "wedge18"), 7: (3, 5, "pyramid5"), 19: (3, 13, "pyramid13"), 14: (3, 14, "pyramid14"),
}
_ORDER = {  # where the mid-side nodes of a cell stand in the file
    "tet10": (0, 1, 2, 3, 4, 5, 6, 7, 9, 8),
    "hex20": (0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
}
_GROUP = re.compile(r'\s*(\d+)\s+(-?\d+)\s+"(.*)"\s*$')


@dataclass
class _Content:
    """Nodes, elements and groups: (dimension, group) -> indices of elements."""

    labels: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    cells: list[tuple[str, np.ndarray, np.ndarray]] = field(default_factory=list)  # cell, nodes by label, labels
    groups: list[list[tuple[int, np.ndarray]]] = field(default_factory=list)  # per entry of cells: group, bool per row
    names: dict[tuple[int, int], str] = field(default_factory=dict)


def gmsh_version(path: Path) -> str | None:
    """The version that a msh file states; None where it states none, as that of other programs."""
    with path.open("rb") as stream:
        match = re.search(rb"\$MeshFormat\s+(\d+(?:\.\d+)?)\s", stream.read(_HEAD_BYTES))
    return None if match is None else match.group(1).decode()


def read_msh(path: Path) -> RawMesh:
    """The cells of a msh file; physical groups are sets, ``physical_7`` where they have no name.

    Raises
    ------
    InputError
        The file is cut off or contradicts itself, or holds cells of an order that idic does not have.
    """
    data = path.read_bytes()
    try:
        return _assembled(path, _content(path, data))
    except (ValueError, IndexError, KeyError, OverflowError) as problem:
        raise InputError("the mesh cannot be read", file=path, key="mesh",
                         expected="complete sections $MeshFormat, $Nodes and $Elements of gmsh", found=str(problem),
                         remedy="save the mesh again: the file ends early or was changed") from None


def _content(path: Path, data: bytes) -> _Content:
    content = _Content()
    sections = _sections(data)
    version, is_binary, size = sections["MeshFormat"].split(b"\n")[0].split()[:3]
    for line in sections.get("PhysicalNames", b"").decode("utf-8", errors="replace").splitlines()[1:]:
        match = _GROUP.match(line)
        if match:
            content.names[int(match.group(1)), abs(int(match.group(2)))] = match.group(3)
    binary = int(is_binary) != 0
    order = "<"
    if binary:
        order = "<" if sections["MeshFormat"].split(b"\n", 1)[1][:4] == b"\x01\x00\x00\x00" else ">"
    streams = {name: _Binary(sections[name], order) if binary else _Text(sections[name])
               for name in ("Nodes", "Elements", "Entities", "PartitionedEntities") if name in sections}
    if version.startswith(b"2"):
        _nodes_2(streams["Nodes"], content)
        _elements_2(path, streams["Elements"], content)
    else:
        if int(size) != 8:
            _refuse(path, "numbers of another size", "8 bytes", size.decode(), "save the mesh on a 64-bit system")
        groups = _entities(streams["Entities"]) if "Entities" in streams else {}
        if "PartitionedEntities" in streams:
            groups |= _partitioned_entities(streams["PartitionedEntities"], groups)
        _nodes_4(streams["Nodes"], content)
        _elements_4(path, streams["Elements"], content, groups)
    return content


def _sections(data: bytes) -> dict[str, bytes]:
    """{name: what stands between $NAME and $EndNAME}"""
    sections, start = {}, 0
    while (begin := data.find(b"$", start)) >= 0:
        name, _, _ = data[begin + 1:begin + 80].partition(b"\n")
        name = name.strip()
        end = data.find(b"$End" + name, begin)
        if end < 0:
            raise ValueError(f"${name.decode(errors='replace')[:40]} has no end")
        sections[name.decode("ascii", errors="replace")] = data[data.index(b"\n", begin) + 1:end]
        start = end + 4 + len(name)
    for name in ("MeshFormat", "Nodes", "Elements"):
        if name not in sections:
            raise ValueError(f"no ${name}")
    return sections


class _Text:
    """Numbers of a section in a text file, one after the other."""

    def __init__(self, section: bytes):
        self.words, self.place = section.split(), 0

    def _next(self, number: int) -> list[bytes]:
        if not 0 <= number <= len(self.words) - self.place:
            raise ValueError(f"{number} numbers announced, {len(self.words) - self.place} there")
        self.place += number
        return self.words[self.place - number:self.place]

    def integers(self, number: int) -> np.ndarray:
        return np.array([int(word) for word in self._next(number)], dtype=np.int64)

    sizes = integers

    def reals(self, number: int) -> np.ndarray:
        return np.array(self._next(number), dtype=float)

    @property
    def is_read(self) -> bool:
        return self.place >= len(self.words)


class _Binary:
    """The same of a binary file: int of 4 bytes, size_t and double of 8."""

    def __init__(self, section: bytes, order: str):
        self.section, self.order, self.place = section, order, 0

    def _next(self, number: int, kind: str) -> np.ndarray:
        size = int(number) * int(kind[1:])
        if not 0 <= size <= len(self.section) - self.place:
            raise ValueError(f"{number} numbers announced, {len(self.section) - self.place} bytes there")
        values = np.frombuffer(self.section, self.order + kind, int(number), self.place)
        self.place += size
        return values

    def integers(self, number: int) -> np.ndarray:
        return self._next(number, "i4").astype(np.int64)

    def sizes(self, number: int) -> np.ndarray:
        return self._next(number, "i8").astype(np.int64)

    def reals(self, number: int) -> np.ndarray:
        return self._next(number, "f8").astype(float)

    def line(self) -> bytes:
        """A line of text, as the counts of version 2.2 are."""
        end = self.section.index(b"\n", self.place)
        text, self.place = self.section[self.place:end], end + 1
        return text

    @property
    def is_read(self) -> bool:
        return len(self.section) - self.place <= 2  # the end of the line


_Stream = _Text | _Binary


# version 4.1 ---------------------------------------------------------------------------------------
def _entities(stream: _Stream) -> dict[tuple[int, int], list[int]]:
    """{(dimension, entity): its groups}; a group with a minus is one whose orientation is reversed."""
    groups: dict[tuple[int, int], list[int]] = {}
    numbers = stream.sizes(4)
    for dimension, number in enumerate(numbers):
        for _ in range(int(number)):
            tag = int(stream.integers(1)[0])
            stream.reals(3 if dimension == 0 else 6)
            groups[dimension, tag] = [abs(int(group)) for group in stream.integers(int(stream.sizes(1)[0]))]
            if dimension:
                stream.integers(int(stream.sizes(1)[0]))  # what bounds it
    return groups


def _partitioned_entities(stream: _Stream, parents: dict[tuple[int, int], list[int]]
                          ) -> dict[tuple[int, int], list[int]]:
    """The same of a mesh in partitions, whose entities are parts of others; together they are the mesh.

    parents : groups of the entities that were parted
    """
    groups: dict[tuple[int, int], list[int]] = {}
    stream.integers(2 * int(stream.sizes(2)[1]))  # ghost entities: they hold copies
    numbers = stream.sizes(4)
    for dimension, number in enumerate(numbers):
        for _ in range(int(number)):
            tag, of_dimension, of_tag = (int(value) for value in stream.integers(3))
            stream.integers(int(stream.sizes(1)[0]))  # its partitions
            stream.reals(3 if dimension == 0 else 6)
            written = [abs(int(group)) for group in stream.integers(int(stream.sizes(1)[0]))]
            inherited = parents.get((of_dimension, of_tag), []) if of_dimension == dimension else []
            groups[dimension, tag] = list(dict.fromkeys([*written, *inherited]))
            if dimension:
                stream.integers(int(stream.sizes(1)[0]))  # what bounds it
    return groups


def _nodes_4(stream: _Stream, content: _Content) -> None:
    n_blocks = int(stream.sizes(4)[0])
    for _ in range(n_blocks):
        dimension, _, parametric = stream.integers(3)
        number = int(stream.sizes(1)[0])
        content.labels.append(stream.sizes(number))
        width = 3 + (int(dimension) if parametric else 0)
        content.points.append(stream.reals(width * number).reshape(number, width)[:, :3])


def _elements_4(path: Path, stream: _Stream, content: _Content, groups: dict[tuple[int, int], list[int]]) -> None:
    n_blocks = int(stream.sizes(4)[0])
    for _ in range(n_blocks):
        dimension, entity, kind = (int(number) for number in stream.integers(3))
        number = int(stream.sizes(1)[0])
        _, n_nodes, cell = _type(path, kind)
        rows = stream.sizes((1 + n_nodes) * number).reshape(number, 1 + n_nodes)
        content.cells.append((cell, rows[:, 1:], rows[:, 0]))
        everything = np.ones(number, dtype=bool)
        content.groups.append([(group, everything) for group in groups.get((dimension, entity), [])])


# version 2.2 ---------------------------------------------------------------------------------------
def _nodes_2(stream: _Stream, content: _Content) -> None:
    if isinstance(stream, _Binary):
        number = int(stream.line())
        record = np.dtype([("label", stream.order + "i4"), ("point", stream.order + "f8", (3,))])
        if not 0 <= number * record.itemsize <= len(stream.section) - stream.place:
            raise ValueError(f"{number} nodes announced, {len(stream.section)} bytes there")
        rows = np.frombuffer(stream.section, record, number, stream.place)
        content.labels.append(rows["label"].astype(np.int64))
        content.points.append(rows["point"].astype(float))
        return
    number = int(stream.integers(1)[0])
    words = np.array(stream.reals(4 * number)).reshape(number, 4)
    content.labels.append(words[:, 0].astype(np.int64))
    content.points.append(words[:, 1:])


def _elements_2(path: Path, stream: _Stream, content: _Content) -> None:
    """An element of several groups stands in the file once for each, with the next number."""
    rows: dict[tuple[int, int], list[np.ndarray]] = defaultdict(list)  # type, number of tags
    if isinstance(stream, _Binary):
        number, count = int(stream.line()), 0
        while count < number:
            kind, many, n_tags = (int(value) for value in stream.integers(3))
            width = 1 + n_tags + _type(path, kind)[1]
            if many < 1:
                raise ValueError("an empty block of elements")
            rows[kind, n_tags].append(stream.integers(width * many).reshape(many, width))
            count += many
    else:
        for _ in range(int(stream.integers(1)[0])):
            label, kind, n_tags = (int(value) for value in stream.integers(3))
            row = stream.integers(n_tags + _type(path, kind)[1])
            rows[kind, n_tags].append(np.concatenate([[label], row])[None])
    for (kind, n_tags), parts in rows.items():
        table = np.concatenate(parts)
        tags = np.abs(table[:, 1]) if n_tags else np.zeros(len(table), dtype=np.int64)
        nodes = table[:, 1 + n_tags:]
        _, first, number = np.unique(np.sort(nodes, axis=1), axis=0, return_index=True, return_inverse=True)
        original = first[number.ravel()]  # the first element on the same nodes
        entities = table[:, 2] if n_tags > 1 else tags
        is_single = (entities != entities[original]) | (tags == tags[original])
        position = np.cumsum(is_single) - 1
        target = np.where(is_single, position, position[original])
        groups = []
        for tag in np.unique(tags[tags != 0]):
            inside = np.zeros(int(is_single.sum()), dtype=bool)
            inside[target[tags == tag]] = True
            groups.append((int(tag), inside))
        content.cells.append((_type(path, kind)[2], nodes[is_single], table[is_single, 0]))
        content.groups.append(groups)


# assembly ------------------------------------------------------------------------------------------
def _assembled(path: Path, content: _Content) -> RawMesh:
    labels = np.concatenate([*content.labels, np.zeros(0, np.int64)])
    points = np.concatenate([*content.points, np.zeros((0, 3))])
    order = np.argsort(labels, kind="stable")
    if len(labels) and (np.diff(labels[order]) == 0).any():
        raise ValueError("a node number occurs twice")
    cells, sets, start = [], defaultdict(list), 0
    for (cell, nodes, numbers), groups in zip(content.cells, content.groups, strict=True):
        place = np.searchsorted(labels[order], nodes)
        if nodes.size and (place.max() >= len(labels) or (labels[order][place] != nodes).any()):
            raise ValueError("an element refers to a node that is not in the file")
        connectivity = order[place] if nodes.size else nodes
        cells.append((cell, connectivity[:, list(_ORDER.get(cell, range(nodes.shape[1])))], numbers))
        dimension = next(entry[0] for entry in _TYPES.values() if entry[2] == cell)
        for group, inside in groups:
            sets[content.names.get((dimension, group), f"physical_{group}")].append(np.flatnonzero(inside) + start)
        start += len(nodes)
    if start == 0:
        raise ValueError("the file holds no elements")
    empty = sorted(set(content.names.values()) - set(sets))
    notes = [f"{path.name}: no element is in the groups {', '.join(empty)} (with SaveAll gmsh writes none in version "
             "2.2)"] if empty else []
    return RawMesh(path, points, labels, cells, notes=notes,
                   element_sets={name: np.unique(np.concatenate(parts)) for name, parts in sets.items()})


def _type(path: Path, kind: int) -> tuple[int, int, str]:
    if kind not in _TYPES:
        _refuse(path, "elements of a type that idic does not know", "elements of first or second order",
                f"type {kind} of gmsh", "set Mesh.ElementOrder to 1 or 2")
    return _TYPES[kind]


def _refuse(path: Path, message: str, expected: str, finding: str, remedy: str) -> NoReturn:
    raise InputError(message, file=path, key="mesh", expected=expected, found=finding, remedy=remedy)
