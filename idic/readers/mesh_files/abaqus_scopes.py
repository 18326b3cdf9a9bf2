"""Parts, instances and the assembly of an input file, and their nodes and elements under one numbering.

A part is a mesh of its own: its labels begin at 1 again, and each instance is a copy that is moved by a translation
and turned about an axis (Abaqus Analysis User's Guide, "Defining an assembly").
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from idic.readers.mesh_files.deck_lines import Place, fail
from idic.readers.mesh_files.local_systems import turned


class Member(NamedTuple):
    """What a line of a set names: a label, a range of labels or a set; of an instance where it says so."""

    reference: int | range | str
    place: Place
    instance: str | None = None


class Element(NamedTuple):
    """A line of *ELEMENT: its type, cell and the labels of its nodes."""

    type: str
    cell: str | None  # None: no part of the body
    nodes: list[int]
    place: Place


class Surface(NamedTuple):
    """A *SURFACE: kind NODE or ELEMENT, and per line what it names and the face of it (empty: all free faces)."""

    kind: str
    rows: list[tuple[Member, str]]
    place: Place


@dataclass
class Sets:
    """Sets of one kind; names ignore case and keep the spelling of the first line."""

    members: dict[str, list[Member]] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, members: Iterable[Member]) -> None:
        self.members.setdefault(self.spelling.setdefault(name.upper(), name), []).extend(members)


@dataclass
class Scope:
    """What stands at the top of a file, in a part, in an instance or in the assembly."""

    title: str
    nodes: dict[int, np.ndarray] = field(default_factory=dict)  # label -> (3,), unit of the file
    elements: dict[int, Element] = field(default_factory=dict)
    node_sets: Sets = field(default_factory=Sets)
    element_sets: Sets = field(default_factory=Sets)
    surfaces: dict[str, Surface] = field(default_factory=dict)
    of_elements: list[tuple[str, Member]] = field(default_factory=list)  # *NSET, ELSET=: node set, element set

    def with_part(self, part: Scope) -> Scope:
        """This instance with the contents of its part."""
        copy = Scope(self.title, {**part.nodes, **self.nodes}, {**part.elements, **self.elements},
                     surfaces={**part.surfaces, **self.surfaces}, of_elements=[*part.of_elements, *self.of_elements])
        for scope in (part, self):
            for source, target in ((scope.node_sets, copy.node_sets), (scope.element_sets, copy.element_sets)):
                for name, members in source.members.items():
                    target.add(name, members)
        return copy


@dataclass(frozen=True)
class Instance:
    """An *INSTANCE of a part and where it is placed; `rotation` is start and end of the axis and the angle in deg."""

    scope: Scope
    part: str
    place: Place
    translation: np.ndarray  # (3,)
    rotation: tuple[np.ndarray, np.ndarray, float] | None

    def placed(self, nodes: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Translated first, then rotated."""
        if not nodes or (self.rotation is None and not self.translation.any()):
            return nodes
        points = np.array(list(nodes.values())) + self.translation
        if self.rotation is not None:
            try:
                points = turned(points, *self.rotation)
            except ValueError as problem:
                fail(self.place, "an instance without a place", "two different points on the axis of rotation",
                     str(problem))
        return dict(zip(nodes, points, strict=True))


@dataclass(frozen=True)
class Body:
    """A scope in the numbering of the whole file: label + shift; instance: its name there, in capitals."""

    scope: Scope
    instance: str
    node_shift: int = 0
    element_shift: int = 0


def bodies(top: Scope, parts: dict[str, Scope], instances: list[Instance], assembly: Scope | None) -> list[Body]:
    """The scopes that hold nodes, elements and sets, numbered so that no label occurs twice.

    A part with one instance keeps its name as the title of its sets, as a part without any in a file without an
    assembly does.
    """
    numbers = [instance.part.upper() for instance in instances]
    scopes: list[tuple[Scope, str]] = [(top, "")]
    if not instances:
        scopes += [(part, part.title.upper()) for part in parts.values()]
    for instance in instances:
        part = parts.get(instance.part.upper())
        if part is None and instance.part:
            fail(instance.place, "an instance of a part that does not exist",
                 ", ".join(scope.title for scope in parts.values()) or "*PART before it", f"PART={instance.part}")
        is_single = part is not None and numbers.count(instance.part.upper()) == 1
        title = instance.part if is_single else instance.scope.title
        scope = instance.scope if part is None else instance.scope.with_part(part)
        scope.title, scope.nodes = title, instance.placed(scope.nodes)
        scopes.append((scope, instance.scope.title.upper()))
    if assembly is not None:
        scopes.append((assembly, ""))
    return list(_numbered(scopes))


def _numbered(scopes: list[tuple[Scope, str]]) -> Iterator[Body]:
    """Those with elements first keep their labels where they can; reference points of the assembly give way."""
    used_nodes: set[int] = set()
    used_elements: set[int] = set()
    for scope, instance in sorted(scopes, key=lambda entry: not entry[0].elements):
        node_shift = _shift(scope.nodes, used_nodes)
        element_shift = _shift(scope.elements, used_elements)
        used_nodes |= {label + node_shift for label in scope.nodes}
        used_elements |= {label + element_shift for label in scope.elements}
        yield Body(scope, instance, node_shift, element_shift)


def _shift(labels: Iterable[int], used: set[int]) -> int:
    return 0 if used.isdisjoint(labels) else max(used) + 1 - min(min(labels), 1)
