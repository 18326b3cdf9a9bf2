"""Sets of an Abaqus input file: labels and other sets, resolved once and within bounds.

A part and the assembly have names of their own: Abaqus/CAE calls the first set of each Set-1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from idic.readers.mesh_files.deck_lines import Place

_MAX_LEVELS = 100  # of sets within each other
_MAX_MEMBERS = 50_000_000  # of all sets of one kind together: 0.4 GB

Scoped = tuple[str, str]  # a part or the assembly, and the name of a set in it
Entry = tuple[int | str | Scoped, Place]  # a label or the name of a set; its line


class ScopedNames:
    """Names of the sets of a file: as they stand, with the scope before them where several scopes have the name.

    Parameters
    ----------
    kinds : iterables of (scope, name)
        The node sets, the element sets and the surfaces.
    """

    def __init__(self, *kinds: Iterable[Scoped]):
        self._places: dict[str, list[Scoped]] = {}  # NAME, which ignores case -> where it stands
        self._shared: set[str] = set()
        for kind in kinds:
            scopes: dict[str, set[str]] = {}
            for scope, name in kind:
                self._places.setdefault(name.upper(), []).append((scope, name))
                scopes.setdefault(name.upper(), set()).add(scope)
            self._shared |= {name for name, owners in scopes.items() if len(owners) > 1}

    def key(self, scope: str, name: str) -> str:
        """``Part-1_Set-1`` where another scope has such a set of this name, too."""
        return f"{scope or 'Model'}_{name}" if name.upper() in self._shared else name

    def resolved(self, member: int | str | Scoped, scope: str, sets: Iterable[Scoped]) -> int | str:
        """A member of a set or surface in `scope`, its name as `key` has it: a set of the same scope comes first."""
        if isinstance(member, int):
            return member
        scope, member = (scope, member) if isinstance(member, str) else member
        if member.upper() not in self._shared:
            return member
        places = [(place, name) for place, name in sets if name.upper() == member.upper()]
        same_scope = [(place, name) for place, name in places if place == scope]
        return self.key(*(same_scope or places)[0]) if same_scope or len(places) == 1 else member

    def flat(self, sets: Mapping[Scoped, list[Entry]]) -> dict[str, list[Entry]]:
        """{key: members} of one kind"""
        return {self.key(scope, name): [(self.resolved(member, scope, sets), line) for member, line in members]
                for (scope, name), members in sets.items()}

    def merge_alike(self, *kinds: dict) -> None:
        """Give sets that are alike in all scopes their own name again.  kinds : {key: members}"""
        for upper in self._shared:
            places = self._places[upper]
            keys = {self.key(*place) for place in places}
            keys_by_kind = [(kind, [key for key in kind if key in keys]) for kind in kinds]
            if all(_alike([kind[key] for key in kind_keys]) for kind, kind_keys in keys_by_kind):
                for kind, kind_keys in keys_by_kind:
                    values = [kind.pop(key) for key in kind_keys]
                    if values:
                        kind[places[0][1]] = values[0]


def _alike(values: list) -> bool:
    return len({frozenset(tuple(member) if isinstance(member, tuple) else int(member) for member in value)
                for value in values}) < 2


class LabelSets:
    """The sets of one kind (nodes or elements) of a file.

    Parameters
    ----------
    sets : {name: members}
        A member is ``(label | name of a set, place in the file)``.
    index : {label: position}
        Of the nodes or elements of the file.
    what : {"node", "element"}
    fail : callable (place, what, expected, found, remedy)
        Raises the InputError.
    """

    def __init__(self, sets: Mapping[str, list], index: Mapping[int, int], entity: str, fail: Callable):
        self.sets, self.index, self.entity, self.fail = sets, index, entity, fail
        self._spelling = {name.upper(): name for name in reversed(sets)}  # names ignore case; the first one counts
        self._found: dict[str, frozenset[int]] = {}
        self._n_members = 0

    def as_indices(self) -> dict[str, np.ndarray]:
        """{name: sorted positions}"""
        return {name: self.indices(self.labels(name)) for name in self.sets}

    def indices(self, labels: Iterable[int]) -> np.ndarray:
        """Sorted positions of labels  # (n,) int64"""
        return np.unique(np.array([self.index[label] for label in labels], dtype=np.int64))

    def named(self, member: int | str, place: Place, whose: str) -> frozenset[int]:
        """The labels that a line of a *SURFACE means: one label, or those of a set."""
        if isinstance(member, int):
            return frozenset([member])
        key = self._spelling.get(member.upper())
        if key is None:
            self._no_set(member, place, whose)
        return self.labels(key)

    def labels(self, name: str, outer: tuple[str, ...] = ()) -> frozenset[int]:
        """Labels of a set, including the members of its subsets; InputError if one does not exist."""
        if name in self._found:
            return self._found[name]
        if len(outer) > _MAX_LEVELS:
            self.fail(None, "sets are nested too deeply", f"{_MAX_LEVELS} levels at most", f"set {name}",
                      "write the members in place of the names of sets")
        labels: set[int] = set()
        for member in self.sets[name]:
            labels |= self._members(member, name, outer)
        self._n_members += len(labels)
        if self._n_members > _MAX_MEMBERS:
            self.fail(None, "the sets have too many members", f"{_MAX_MEMBERS} in all sets together",
                      f"more, at set {name}", "remove the sets that the experiment does not need")
        return self._found.setdefault(name, frozenset(labels))

    def _members(self, member: tuple[int | str, Place], name: str, outer: tuple[str, ...]) -> frozenset[int] | set[int]:
        reference, place = member
        if isinstance(reference, int):
            return {reference}
        key = self._spelling.get(reference.upper())
        if key is None or key in (*outer, name):
            self._no_set(reference, place, f"set {name}")
        return self.labels(key, (*outer, name))

    def _no_set(self, name: str, place: Place, whose: str) -> None:
        self.fail(place, f"{whose} names a set that does not exist", ", ".join(self.sets) or "the name of a set", name)
