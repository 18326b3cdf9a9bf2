"""Reads meshes of Abaqus and CalculiX input files: nodes, elements, sets, surfaces, parts and their instances.

meshio is no substitute: it drops labels and sets of sets, and knows neither CPE4 nor CPS8. Other keywords (materials,
steps) are skipped; keywords that make nodes and elements by a rule are refused.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from functools import partial
from pathlib import Path

import numpy as np

from idic.input_decks import fortran_real
from idic.fe import cell_type, CELL_TYPES
from idic.readers.mesh_files.abaqus_elements import (
    N_NODES, cell_of, face_corners, face_names, has_no_body, ordered, side_of_sheet, stated_kind,
)
from idic.readers.mesh_files.abaqus_keywords import Keyword, Row, keyword_lines, keywords, unquoted
from idic.readers.mesh_files.abaqus_scopes import Body, Element, Instance, Member, Scope, Surface, bodies
from idic.readers.mesh_files.abaqus_sets import LabelSets, ScopedNames
from idic.readers.mesh_files.deck_lines import Place, fail
from idic.readers.mesh_files.local_systems import CYLINDRICAL, IDENTITY, Frame, frame_of, rectangular
from idic.readers.mesh_files.raw_mesh import DIMENSION, RawMesh

_MAKING = ("ELGEN", "ELCOPY", "NCOPY", "NFILL", "NGEN", "NMAP")  # of nodes and elements, by rules
_ORPHAN = "write the mesh as an orphan mesh: every node with its x, y, z, every element with its nodes"
_MAX_LABEL = 2**31 - 1  # labels beyond the range of the programs that write such files are a damage


def read_inp(path: Path) -> RawMesh:
    """The mesh of an Abaqus or CalculiX input file.

    Raises
    ------
    InputError
        A number is invalid, an element type is unknown, or a node or element does not exist; with the line.
    """
    lines, statements = keyword_lines(path), _Statements()
    for keyword in keywords(lines):
        statements.take(keyword)
    raw = _Assembled(path, statements).mesh()
    raw.files = tuple(lines.files)
    return raw


class _Statements:
    """What the keywords of a file state, by scope."""

    def __init__(self) -> None:
        self.top = Scope("")
        self.parts: dict[str, Scope] = {}  # by name in capitals
        self.instances: list[Instance] = []
        self.assembly: Scope | None = None
        self.open: list[Scope] = [self.top]
        self.systems: list[Frame] = [IDENTITY]  # of *SYSTEM, one per open scope

    def take(self, keyword: Keyword) -> None:
        scope, name = self.open[-1], keyword.name
        if name == "NODE":
            self._nodes(keyword, scope)
        elif name == "ELEMENT":
            _elements(keyword, scope)
        elif name in ("NSET", "ELSET"):
            _set(keyword, scope)
        elif name == "SURFACE":
            _surface(keyword, scope)
        elif name == "SYSTEM":
            self.systems[-1] = _system(keyword)
        elif name in ("PART", "ASSEMBLY", "INSTANCE"):
            self._enter(keyword)
        elif name in ("END PART", "END ASSEMBLY", "END INSTANCE") and len(self.open) > 1:
            del self.open[-1], self.systems[-1]
        elif name in _MAKING:
            fail(keyword.place, "nodes or elements that are made by a rule", "*NODE and *ELEMENT alone", f"*{name}",
                 _ORPHAN)

    def _enter(self, keyword: Keyword) -> None:
        scope = Scope(keyword.options.get("NAME", keyword.name.capitalize()))
        if keyword.name == "PART":
            scope = self.parts.setdefault(scope.title.upper(), scope)
        elif keyword.name == "ASSEMBLY":
            self.assembly = scope
        else:
            if "LIBRARY" in keyword.options:
                fail(keyword.place, "an instance of another analysis", "the nodes and elements in this file",
                     f"LIBRARY={keyword.options['LIBRARY']}", _ORPHAN)
            self.instances.append(_instance(keyword, scope))
        self.open.append(scope)
        self.systems.append(IDENTITY)

    def _nodes(self, keyword: Keyword, scope: Scope) -> None:
        kind = keyword.options.get("SYSTEM", "R").upper()
        if kind not in ("R", CYLINDRICAL):
            fail(keyword.place, "nodes in spherical coordinates", "SYSTEM=R or SYSTEM=C", f"*NODE, SYSTEM={kind}",
                 _ORPHAN)
        labels, points = [], []
        for row in keyword.rows:
            labels.append(_integer(row.cells[0], row.place))
            values = [_real(cell, row.place) if cell else 0.0 for cell in row.cells[1:4]]  # an empty cell is zero
            points.append(values + [0.0] * (3 - len(values)))
        if points and (kind == CYLINDRICAL or self.systems[-1] is not IDENTITY):
            points = self.systems[-1].outside(rectangular(np.array(points), kind)).tolist()
        for label, point, row in zip(labels, points, keyword.rows, strict=True):
            if scope.nodes.setdefault(label, point) != point:
                fail(row.place, f"a node label occurs twice: {label}", "every label once, or at one place",
                     f"{label} at {', '.join(f'{x:g}' for x in scope.nodes[label])} and at "
                     f"{', '.join(f'{x:g}' for x in point)}", "write one part, as an orphan mesh")
        if "NSET" in keyword.options:
            scope.node_sets.add(keyword.options["NSET"], [Member(label, keyword.place) for label in labels])


def _system(keyword: Keyword) -> Frame:
    """*SYSTEM: origin and a point on the local x axis; on the second line a point in the local x-y plane."""
    if not keyword.rows:
        return IDENTITY
    rows = [[_real(cell, row.place) if cell else 0.0 for cell in row.cells] for row in keyword.rows]
    first = rows[0] + [0.0] * (6 - len(rows[0]))
    if len(rows[0]) < 6:  # only the origin
        return Frame(np.array(first[:3]), np.eye(3))
    origin, on_x = np.array(first[:3]), np.array(first[3:6])
    if len(rows) > 1:
        in_plane = np.array((rows[1] + [0.0] * 3)[:3])
    else:  # the local z axis is that of the mesh
        in_plane = origin + np.cross([0.0, 0.0, 1.0], on_x - origin)
    try:
        return frame_of(origin, "x", on_x, in_plane)
    except ValueError as problem:
        return fail(keyword.place, "a coordinate system without axes",
                    "an origin and two further points, not on a line", str(problem))


def _instance(keyword: Keyword, scope: Scope) -> Instance:
    """*INSTANCE: on its first line the translation, on the second two points of an axis and the angle in degrees."""
    rows = [[_real(cell, row.place) if cell else 0.0 for cell in row.cells] for row in keyword.rows]
    translation = np.array(((rows[0] if rows else []) + [0.0] * 3)[:3])
    rotation = None
    if len(rows) > 1:
        values = rows[1] + [0.0] * (7 - len(rows[1]))
        rotation = (np.array(values[:3]), np.array(values[3:6]), values[6])
    return Instance(scope, keyword.options.get("PART", ""), keyword.place, translation, rotation)


def _elements(keyword: Keyword, scope: Scope) -> None:
    name = keyword.options.get("TYPE", "")
    cell = cell_of(name)
    if cell is None and not has_no_body(name):
        fail(keyword.place, "an element type that idic does not know", "CPS4, CPE4, CPS3, CPS6, CPS8, C3D8 or the like",
             f"TYPE={name}",
             "change the type: idic reads only the shape from it; kind in [experiment] gives the physics")
    elements = _without_body(keyword) if cell is None else _complete_rows(keyword, cell)
    for place, values in elements:
        element = Element(name.upper(), cell, ordered(cell, values[1:]) if cell else values[1:], place)
        if values[0] in scope.elements:
            fail(place, f"element label {values[0]} occurs twice", "every label once", str(values[0]),
                 "write one part, as an orphan mesh")
        scope.elements[values[0]] = element
    if "ELSET" in keyword.options:
        scope.element_sets.add(keyword.options["ELSET"],
                               [Member(values[0], keyword.place) for _, values in elements])


def _complete_rows(keyword: Keyword, cell: str) -> list[tuple[Place, list[int]]]:
    """Label and nodes of each element; an element may take several lines."""
    elements, cells, place = [], [], keyword.place
    for row in keyword.rows:
        place = row.place if not cells else place
        cells += [value for value in row.cells if value]
        if len(cells) < 1 + N_NODES[cell]:
            continue
        values = [_integer(value, place) for value in cells]
        if len(values) != 1 + N_NODES[cell]:
            fail(place, f"element {values[0]} has another number of nodes than its type",
                 f"{N_NODES[cell]} nodes ({keyword.options['TYPE']})", f"{len(values) - 1}")
        elements.append((place, values))
        cells = []
    if cells:
        fail(place, "an element with too few nodes", f"{N_NODES[cell]} nodes ({keyword.options.get('TYPE')})",
             f"{len(cells) - 1}", "export the mesh again: the file may be truncated")
    return elements


def _without_body(keyword: Keyword) -> list[tuple[Place, list[int]]]:
    """Labels of springs, masses and the like, one line each unless a comma says that it goes on."""
    elements, goes_on = [], False
    for row in keyword.rows:
        if not goes_on:
            elements.append((row.place, [_integer(row.cells[0], row.place)]))
        goes_on = row.goes_on
    return elements


def _set(keyword: Keyword, scope: Scope) -> None:
    options, instance = keyword.options, keyword.options.get("INSTANCE")
    name = options.get(keyword.name) or fail(keyword.place, f"*{keyword.name} without a name", f"{keyword.name}=NAME",
                                             "none")
    sets = scope.node_sets if keyword.name == "NSET" else scope.element_sets
    sets.add(name, [Member(reference, row.place, instance) for row in keyword.rows
                    for reference in _references(row, "GENERATE" in options)])
    if keyword.name == "NSET" and "ELSET" in options:
        scope.of_elements.append((sets.spelling[name.upper()], Member(options["ELSET"], keyword.place, instance)))


def _references(row: Row, is_range: bool) -> list[int | range | str]:
    cells = [cell for cell in row.cells if cell]
    if not is_range:
        return [_label_or_name(cell, row.place) for cell in cells]
    numbers = [_integer(cell, row.place) for cell in cells]
    if len(numbers) not in (2, 3) or not numbers[0] <= numbers[1] or min(numbers[2:], default=1) < 1:
        fail(row.place, "not a range of labels", "first, last, step; upwards", ", ".join(cells))
    return [range(numbers[0], numbers[1] + 1, *numbers[2:])]


def _surface(keyword: Keyword, scope: Scope) -> None:
    kind = keyword.options.get("TYPE", "ELEMENT").upper()
    if kind not in ("ELEMENT", "NODE") or "COMBINE" in keyword.options:  # no cuts, no rigid or joined surfaces
        return
    name = keyword.options.get("NAME", f"surface_{keyword.place.number}")
    rows = [(Member(_label_or_name(row.cells[0], row.place), row.place), unquoted(row.cells[1])
             if len(row.cells) > 1 else "") for row in keyword.rows]
    scope.surfaces[name] = Surface(kind, rows, keyword.place)


class _Assembled:
    """All bodies of a file under one numbering of their nodes and elements."""

    def __init__(self, path: Path, statements: _Statements):
        self.path, self.fail = path, partial(fail, file=path)
        self.bodies = bodies(statements.top, statements.parts, statements.instances, statements.assembly)
        self.by_instance = {body.instance: body for body in self.bodies if body.instance}
        self.elements: dict[int, Element] = {}  # shifted labels
        self.titles = Counter(body.scope.title for body in self.bodies)

    def mesh(self) -> RawMesh:
        labels = np.array([label + body.node_shift for body in self.bodies for label in body.scope.nodes],
                          dtype=np.int64)
        nodes = [point for body in self.bodies for point in body.scope.nodes.values()]
        self.index = {int(label): k for k, label in enumerate(labels)}
        position, cells = self._cells()
        node_members = self._members("node_sets")
        element_members = self._members("element_sets")
        names = ScopedNames(node_members, element_members,
                            [(body.scope.title, name) for body in self.bodies for name in body.scope.surfaces])
        elements_of = LabelSets(names.flat(element_members), position, "element", self.fail)
        for body in self.bodies:
            self._add_nodes_of_elements(body, names, element_members, node_members, elements_of)
        nodes_of = LabelSets(names.flat(node_members), self.index, "node", self.fail)
        raw = RawMesh(self.path, np.array(nodes, dtype=float).reshape(-1, 3), labels, cells, nodes_of.as_indices(),
                      elements_of.as_indices(), notes=self._notes(), stated_kinds=self._stated_kinds())
        surfaces = _Surfaces(self, names, nodes_of, elements_of, node_members, element_members)
        for body in self.bodies:
            for name, surface in body.scope.surfaces.items():
                surfaces.add(raw, names.key(body.scope.title, name), body, surface)
        names.merge_alike(raw.node_sets, raw.element_sets, raw.face_sets)
        return raw

    def _cells(self) -> tuple[dict[int, int], list[tuple[str, np.ndarray, np.ndarray]]]:
        rows: dict[str, list[tuple[int, list[int]]]] = defaultdict(list)
        for body in self.bodies:
            nodes = body.scope.nodes
            for label, element in body.scope.elements.items():
                if element.cell is None:
                    continue
                missing = next((node for node in element.nodes if node not in nodes), None)
                if missing is not None:
                    self.fail(element.place, f"element {label} refers to a node that does not exist",
                              "a node of the file" if not body.instance else "a node of the part", f"node {missing}")
                shifted = element._replace(nodes=[node + body.node_shift for node in element.nodes])
                self.elements[label + body.element_shift] = shifted
                rows[element.cell].append((label + body.element_shift, shifted.nodes))
        if not rows:
            self.fail(None, "the file holds no elements", "*ELEMENT", "none")
        position = {label: k for k, label in enumerate(label for part in rows.values() for label, _ in part)}
        return position, [(cell, np.array([[self.index[node] for node in nodes] for _, nodes in part], dtype=np.int64),
                           np.array([label for label, _ in part], dtype=np.int64)) for cell, part in rows.items()]

    def _stated_kinds(self) -> dict[str, str]:
        """Element types with what their names say of the state; idic reads only the shape."""
        types = {element.type for body in self.bodies for element in body.scope.elements.values()}
        return {name: kind for name in sorted(types) if (kind := stated_kind(name)) is not None}

    def _notes(self) -> list[str]:
        types = Counter(element.type for body in self.bodies for element in body.scope.elements.values()
                        if element.cell is None)
        return [f"{self.path.name}: {number} {name} elements are no part of the meshed body and are left out"
                for name, number in sorted(types.items())]

    def _members(self, kind: str) -> dict[tuple[str, str], list]:
        """{(title of the scope, name): [(label of the whole file | name of a set, place)]}"""
        members: dict[tuple[str, str], list] = {}
        for body in self.bodies:
            for name, part in getattr(body.scope, kind).members.items():
                target = members.setdefault((body.scope.title, name), [])
                for member in part:
                    target += self.resolved(body, member, "node" if kind == "node_sets" else "element", f"set {name}")
        return members

    def resolved(self, body: Body, member: Member, entity: str, owner: str) -> list[tuple]:
        """A label, a range of labels or the name of a set, with its scope, as the whole file numbers it."""
        target, reference = self._target(body, member)
        if isinstance(reference, str):
            sets = body.scope.node_sets if entity == "node" else body.scope.element_sets
            is_inside = member.reference == reference and reference.upper() in sets.spelling  # a set of this scope
            return [(reference if is_inside or target is body else (target.scope.title, reference), member.place)]
        labels, shift = ((target.scope.nodes, target.node_shift) if entity == "node"
                         else (target.scope.elements, target.element_shift))
        if isinstance(reference, range):
            if not labels or reference[-1] > max(labels):
                self.fail(member.place, f"{owner} ends beyond the last {entity}",
                          f"{entity} labels up to {max(labels, default=0)}", str(reference[-1]),
                          "export the mesh again: the file may be truncated")
            existing = [label for label in labels if label in reference]  # Abaqus and CalculiX skip gaps
        elif reference not in labels:
            self.fail(member.place,
                      f"{owner} names {'an' if entity == 'element' else 'a'} {entity} that does not exist",
                      f"{entity}s of the file", f"{entity} {reference}")
        else:
            existing = [reference]
        if entity == "element":
            existing = [label for label in existing if target.scope.elements[label].cell is not None]
        return [(label + shift, member.place) for label in existing]

    def _target(self, body: Body, member: Member) -> tuple[Body, int | range | str]:
        """The scope that a line names, and the label or name in it: 7, SET, Part-1-1.7, Part-1-1.SET."""
        reference = member.reference
        if member.instance is not None:
            return self._instance(member.instance, member.place), reference
        if isinstance(reference, str) and "." in reference:
            name, _, inner = reference.rpartition(".")
            if name.upper() in self.by_instance:
                return self._instance(name, member.place), _label_or_name(unquoted(inner), member.place)
        holders = [other_body for other_body in self.bodies if other_body.scope.nodes]
        if not isinstance(reference, str) and not body.scope.nodes and len(holders) == 1:
            return holders[0], reference  # a set at the top of a file whose nodes stand in a part
        return body, reference

    def _instance(self, name: str, place: Place) -> Body:
        target = self.by_instance.get(name.upper())
        if target is None:
            self.fail(place, "an instance that does not exist",
                      ", ".join(body.instance for body in self.bodies if body.instance) or "*INSTANCE", name)
        return target

    def _add_nodes_of_elements(self, body, names, element_members, node_members, elements_of: LabelSets) -> None:
        for name, member in body.scope.of_elements:
            for reference, place in self.resolved(body, member, "element", f"set {name}"):
                key = names.resolved(reference, body.scope.title, element_members)
                labels = {node for label in elements_of.named(key, place, f"set {name}")
                          for node in self.elements[label].nodes}
                node_members[body.scope.title, name] += [(node, place) for node in labels]


class _Surfaces:
    """The node and face sets of the surfaces of a file."""

    def __init__(self, assembled: _Assembled, names: ScopedNames, nodes_of: LabelSets, elements_of: LabelSets,
                 node_members: dict, element_members: dict):
        self.assembled, self.names, self.nodes_of, self.elements_of = assembled, names, nodes_of, elements_of
        self.node_members, self.element_members = node_members, element_members
        self._owners: Counter | None = None  # of the corners of every face

    def add(self, raw: RawMesh, name: str, body: Body, surface: Surface) -> None:
        """Add the nodes or faces of a surface; sides of a sheet are no edges of it and add nothing."""
        if surface.kind == "NODE":
            labels = {label for member, _ in surface.rows
                      for label in self._labels(body, member, "node", name, self.nodes_of, self.node_members)}
            raw.node_sets.setdefault(name, self.nodes_of.indices(sorted(labels)))
            return
        faces, has_edges = [], not surface.rows
        for member, face in surface.rows:
            for label in sorted(self._labels(body, member, "element", name, self.elements_of, self.element_members)):
                element = self.assembled.elements[label]
                if DIMENSION[element.cell or "point"] < 2 or side_of_sheet(element.type, face):
                    continue
                has_edges = True
                faces += [self._face(element, corners) for corners in self._corners(element, face, member, name)]
        if has_edges:
            raw.face_sets[name] = faces

    def _labels(self, body: Body, member: Member, entity: str, name: str, sets: LabelSets, members: dict) -> set[int]:
        return {label for reference, place in self.assembled.resolved(body, member, entity, f"surface {name}")
                for label in sets.named(self.names.resolved(reference, body.scope.title, members), place,
                                        f"surface {name}")}

    def _corners(self, element: Element, face: str, member: Member, name: str) -> list[tuple[int, ...]]:
        cell = element.cell or ""
        if not face:
            return self._free(element, cell)
        corners = face_corners(element.type, cell, face)
        if corners is None:
            self.assembled.fail(member.place, f"surface {name}: a {element.type} has no such face",
                                face_names(element.type, cell), face)
        return [corners]

    def _free(self, element: Element, cell: str) -> list[tuple[int, ...]]:
        """The faces that no other element has: a surface without face names (Abaqus keyword guide, *SURFACE)."""
        if self._owners is None:
            self._owners = Counter(tuple(sorted(self._face(other_element, corners)))
                                   for other_element in self.assembled.elements.values()
                                   for corners in _faces(other_element.cell or ""))
        return [corners for corners in _faces(cell) if self._owners[tuple(sorted(self._face(element, corners)))] == 1]

    def _face(self, element: Element, corners: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(self.assembled.index[element.nodes[k]] for k in corners)


def _faces(cell: str) -> list[tuple[int, ...]]:
    """Corner nodes of the faces of a cell that has any."""
    if cell not in CELL_TYPES or CELL_TYPES[cell].dim < 2:
        return []
    return [face[:cell_type(cell).n_face_corners] for face in CELL_TYPES[cell].faces]


def _label_or_name(cell: str, place: Place) -> int | str:
    return _integer(cell, place) if cell.lstrip("+").isdecimal() else cell


def _integer(cell: str, place: Place) -> int:
    try:
        label = int(cell)
    except ValueError:
        fail(place, "not a whole number", "a label", repr(cell),
             "correct the mesh file, or export it again: it may be truncated")
    if abs(label) > _MAX_LABEL:
        fail(place, "a label beyond the largest one", f"labels up to {_MAX_LABEL}", cell,
             "renumber nodes and elements, or export the mesh again: it may be damaged")
    return label


def _real(cell: str, place: Place) -> float:
    try:
        return fortran_real(cell)
    except ValueError:
        return fail(place, "not a number", "a coordinate", repr(cell),
                    "correct the mesh file, or export it again: it may be truncated")
