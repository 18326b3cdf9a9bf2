"""Reads the mesh of a Nastran bulk data file: grid points in their systems, elements and their properties.

meshio is no substitute: it takes coordinates of local systems for x, y, z, skips wide cards beside others, and refuses
blank fields.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.readers.mesh_files.deck_lines import fail
from idic.readers.mesh_files.local_systems import IDENTITY, RECTANGULAR, Frame, frame_of, rectangular
from idic.readers.mesh_files.nastran_cards import Card, cards, nastran_lines
from idic.readers.mesh_files.raw_mesh import RawMesh

SUFFIXES = (".bdf", ".fem", ".nas")
_PLANE_3, _PLANE_4, _PLANE_6, _PLANE_8 = {3: "tri3"}, {4: "quad4"}, {3: "tri3", 6: "tri6"}, {4: "quad4", 8: "quad8"}
_ELEMENTS = {  # card: {number of nodes: cell}
    "CTRIA3": _PLANE_3, "CTRIAR": _PLANE_3, "CTRIA6": _PLANE_6, "CTRIAX": _PLANE_6, "CPLSTN3": _PLANE_3,
    "CPLSTS3": _PLANE_3, "CPLSTN6": _PLANE_6, "CPLSTS6": _PLANE_6,
    "CQUAD4": _PLANE_4, "CQUADR": _PLANE_4, "CSHEAR": _PLANE_4, "CPLSTN4": _PLANE_4, "CPLSTS4": _PLANE_4,
    "CQUAD8": _PLANE_8, "CPLSTN8": _PLANE_8, "CPLSTS8": _PLANE_8,
    "CQUAD": {**_PLANE_8, 9: "quad9"}, "CQUADX": {**_PLANE_8, 9: "quad9"},
    "CTETRA": {4: "tet4", 10: "tet10"}, "CHEXA": {8: "hex8", 20: "hex20"}, "CPENTA": {6: "wedge6", 15: "wedge15"},
    "CPYRAM": {5: "pyramid5", 13: "pyramid13"}, "CPYRA": {5: "pyramid5", 13: "pyramid13"},
    "CBAR": {2: "line2"}, "CBEAM": {2: "line2"}, "CROD": {2: "line2"}, "CTUBE": {2: "line2"}, "CBEND": {2: "line2"},
    "CONROD": {2: "line2"}, "PLOTEL": {2: "line2"}, "CBEAM3": {2: "line2", 3: "line3"},
}
_WITHOUT_PROPERTY = ("CONROD", "PLOTEL")
_HEX20_ORDER = (*range(12), *range(16, 20), *range(12, 16))  # Nastran: the mid-side nodes of the upright edges first
_NO_BODY = ("CBUSH", "CBUSH1D", "CBUSH2D", "CELAS1", "CELAS2", "CELAS3", "CELAS4", "CDAMP1", "CDAMP2", "CDAMP3",
            "CDAMP4", "CDAMP5", "CMASS1", "CMASS2", "CMASS3", "CMASS4", "CONM1", "CONM2", "CGAP", "CVISC", "CWELD",
            "CFAST", "CSEAM", "RBAR", "RBE1", "RBE2", "RBE3", "RROD", "RTRPLT", "CTRIAX6", "CRAC2D", "CRAC3D",
            "CIFPENT", "CIFHEX", "CIFQUAD", "CIFQDX", "CACINF3", "CACINF4", "CHACAB", "CHACBR", "CSLOT3", "CSLOT4")
_SYSTEMS = tuple(f"CORD{number}{kind}" for number in (1, 2) for kind in "RCS")
_MAX_SYSTEMS = 50  # defined in one another


def read_nastran(path: Path) -> RawMesh:
    """The mesh of a Nastran bulk data file; the elements of property 7 are the set ``property_7``.

    Raises
    ------
    InputError
        A card that cannot be used, with its line; no elements.
    """
    lines = nastran_lines(path)
    bulk = _Bulk(path)
    for card in cards(lines):
        bulk.take(card)
    raw = bulk.mesh()
    raw.files = tuple(lines.files)
    return raw


@dataclass(frozen=True)
class _Grid:
    """A grid point: the number of its system, None for that of GRDSET; coordinates in it."""

    card: Card
    system: int | None
    point: tuple[float, float, float]


@dataclass(frozen=True)
class _System:
    """A CORDij card: its kind R, C or S; the system of its three points, or the three grid points."""

    card: Card
    kind: str
    reference: int
    points: tuple[tuple[float, ...], ...] = ()
    grids: tuple[int, ...] = ()


class _Bulk:
    """The cards of a file that make a mesh."""

    def __init__(self, path: Path):
        self.path = path
        self.grids: dict[int, _Grid] = {}
        self.default_system = 0
        self.systems: dict[int, _System] = {}
        self.elements: dict[int, tuple[str, list[int], int | None, Card]] = {}  # label -> cell, nodes, property, card
        self.frames: dict[int, tuple[Frame, str]] = {0: (IDENTITY, RECTANGULAR)}
        self.omitted: Counter[str] = Counter()
        self.names: Counter[str] = Counter()

    def take(self, card: Card) -> None:
        self.names[card.name] += 1
        if card.name == "GRID":
            self._grid(card)
        elif card.name == "GRDSET":
            self.default_system = card.integer(1, "the coordinate system", 0)
        elif card.name in _SYSTEMS:
            self._system(card)
        elif card.name in _ELEMENTS:
            self._element(card)
        elif card.name in _NO_BODY:
            self.omitted[card.name] += 1

    def _grid(self, card: Card) -> None:
        label = card.integer(0, "the number of the grid point")
        system = card.integer(1, "the coordinate system") if card.text(1) else None
        grid = _Grid(card, system, (card.real(2, "x"), card.real(3, "y"), card.real(4, "z")))
        first = self.grids.setdefault(label, grid)
        if (first.system, first.point) != (grid.system, grid.point):
            fail(card.place, f"grid point {label} occurs twice", "every number once, or at one place",
                 f"line {first.card.place.number}: {first.point}, line {card.place.number}: {grid.point}")

    def _system(self, card: Card) -> None:
        kind = card.name[-1]
        if card.name.startswith("CORD2"):
            label = card.integer(0, "the number of the system")
            points = tuple(tuple(card.real(2 + 3 * k + j, "a coordinate") for j in range(3)) for k in range(3))
            self.systems[label] = _System(card, kind, card.integer(1, "the reference system", 0), points)
            return
        for start in (0, 4):  # two systems on a card
            if card.text(start):
                label = card.integer(start, "the number of the system")
                grids = tuple(card.integer(start + k, "a grid point") for k in (1, 2, 3))
                self.systems[label] = _System(card, kind, 0, grids=grids)

    def _element(self, card: Card) -> None:
        label = card.integer(0, "the number of the element")
        first = 1 if card.name in _WITHOUT_PROPERTY else 2
        kinds = _ELEMENTS[card.name]
        most, fewest = max(kinds), min(kinds)
        nodes = [card.integer(first + k, f"node {k + 1}", 0) for k in range(most)]
        number = next((n for n in sorted(kinds) if not any(nodes[n:])), most)
        if 0 in nodes[:number]:
            missing = "a corner" if 0 in nodes[:fewest] else "some of its mid-side nodes"
            fail(card.place, f"{card.name} {label} lacks {missing}", f"{' or '.join(map(str, kinds))} nodes",
                 ", ".join(str(node) if node else "blank" for node in nodes[:number]),
                 "export elements with all their mid-side nodes, or with none")
        nodes = nodes[:number]
        if kinds[number] == "hex20":
            nodes = [nodes[k] for k in _HEX20_ORDER]
        if label in self.elements:
            fail(card.place, f"element {label} occurs twice", "every number once",
                 f"{self.elements[label][3].name} in line {self.elements[label][3].place.number}, and {card.name}")
        group = card.integer(1, "the property") if first == 2 and card.text(1) else None
        self.elements[label] = (kinds[number], nodes, group, card)

    # assembly -------------------------------------------------------------------------------------
    def mesh(self) -> RawMesh:
        if not self.elements:
            fail(None, "the file holds no elements that idic reads", ", ".join(_ELEMENTS),
                 ", ".join(f"{number} {name}" for name, number in self.names.most_common(8)) or "no cards",
                 "export the elements of the specimen, too", self.path)
        index = {label: k for k, label in enumerate(self.grids)}
        rows: dict[str, list[tuple[int, list[int], int | None]]] = defaultdict(list)
        for label, (cell, nodes, group, card) in self.elements.items():
            missing = next((node for node in nodes if node not in index), None)
            if missing is not None:
                fail(card.place, f"{card.name} {label} refers to a grid point that does not exist",
                     "a GRID card of the file", f"grid point {missing}")
            rows[cell].append((label, [index[node] for node in nodes], group))
        cells = [(cell, np.array([nodes for _, nodes, _ in part], dtype=np.int64),
                  np.array([label for label, _, _ in part], dtype=np.int64)) for cell, part in rows.items()]
        groups = [group for part in rows.values() for _, _, group in part]
        sets = {f"property_{number}": np.array([k for k, group in enumerate(groups) if group == number], dtype=np.int64)
                for number in sorted({group for group in groups if group is not None})}
        notes = [f"{self.path.name}: {number} {name} cards are no part of the meshed body and are left out"
                 for name, number in sorted(self.omitted.items())]
        return RawMesh(self.path, self._positions(), np.array(list(self.grids), dtype=np.int64), cells,
                       element_sets=sets, notes=notes)

    def _positions(self) -> np.ndarray:
        """Grid points in the basic system  # (n, 3)"""
        points = np.array([grid.point for grid in self.grids.values()], dtype=float).reshape(-1, 3)
        numbers = np.array([self._number(grid) for grid in self.grids.values()], dtype=np.int64)
        grids = list(self.grids.values())
        for number in np.unique(numbers):
            if number != 0:
                inside = np.flatnonzero(numbers == number)
                points[inside] = self._outside(int(number), points[inside], grids[inside[0]].card, 0)
        return points

    def _number(self, grid: _Grid) -> int:
        return self.default_system if grid.system is None else grid.system

    def _outside(self, number: int, points: np.ndarray, card: Card, depth: int) -> np.ndarray:
        """Points of a system in the basic one  # (n, 3) -> (n, 3)"""
        frame, kind = self._frame(number, card, depth)
        return frame.outside(rectangular(points, kind))

    def _frame(self, number: int, card: Card, depth: int) -> tuple[Frame, str]:
        if number in self.frames:
            return self.frames[number]
        system = self.systems.get(number)
        if system is None:
            fail(card.place, f"{card.name} refers to a coordinate system that does not exist",
                 ", ".join(_SYSTEMS) + " of that number", f"system {number}")
        if depth > _MAX_SYSTEMS:
            fail(system.card.place, f"{system.card.name} {number} is defined by itself",
                 "a system that others do not need", f"system {number}")
        if system.grids:
            points = np.array([self._grid_position(label, system.card, depth) for label in system.grids])
        else:
            points = self._outside(system.reference, np.array(system.points), system.card, depth + 1)
        try:
            self.frames[number] = frame_of(points[0], "z", points[1], points[2]), system.kind
        except ValueError as problem:
            fail(system.card.place, f"{system.card.name} {number} has no axes", "three points, not on a line",
                 str(problem))
        return self.frames[number]

    def _grid_position(self, label: int, card: Card, depth: int) -> np.ndarray:
        if label not in self.grids:
            fail(card.place, f"{card.name} refers to a grid point that does not exist", "a GRID card of the file",
                 f"grid point {label}")
        grid = self.grids[label]
        return self._outside(self._number(grid), np.array([grid.point]), grid.card, depth + 1)[0]
