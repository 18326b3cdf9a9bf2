"""What was found out about a mesh, remembered as long as the mesh lives: many models are built on one."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import TypeVar

from idic.fe.mesh.mesh import Mesh

Found = TypeVar("Found")


class PerMesh:
    """Remembers results by mesh, the object itself: meshes are never changed in place."""

    def __init__(self):
        self._known: dict[int, tuple[weakref.ref, dict[Hashable, object]]] = {}

    def once(self, mesh: Mesh, key: Hashable, make: Callable[[], Found]) -> Found:
        """What `make` returns the first time for this mesh and key; nothing is remembered where it raises."""
        number = id(mesh)
        if number not in self._known or self._known[number][0]() is not mesh:
            gone = self._known
            self._known[number] = weakref.ref(mesh, lambda _: gone.pop(number, None)), {}
        found = self._known[number][1]
        if key not in found:
            found[key] = make()
        return found[key]
