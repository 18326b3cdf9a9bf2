"""A plane mesh cut along a path: element edges lie on the path, and its nodes exist twice, one on each side.

Nodes near the path are moved onto it where their elements keep their shape; what it still crosses is split, quads
first into triangles. The last node of the path stays one, the first one too where the path begins inside the body.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from idic.errors import InputError
from idic.fe.mesh.element import cell_type
from idic.fe.mesh.mesh import Block, Mesh

LINEAR = {"tri6": "tri3", "quad8": "quad4"}  # kinds with mid-side nodes, and the same without
MAX_MOVE_SHARE = 0.3  # of the shortest edge at a node: how far it is moved onto the path
MIN_AREA_SHARE = 0.4  # of the area at a corner before, kept by every corner of an element whose node is moved
ON_EDGE_SHARE = 0.15  # of an edge: a point of the path nearer than this to it splits the edge
ON_PATH = 1e-9  # of the size of the body: rounding of a point on a line


@dataclass(frozen=True)
class Cut:
    """A cut along a path.

    Attributes
    ----------
    path : (m, 2) mm, its corner points, the first at the edge where it begins
    left_nodes, right_nodes : (n + 1,) node indices on either side, as one looks along the path; an end that
        stays one node is in both
    place : (n + 1,) mm along the path
    """

    path: np.ndarray
    left_nodes: np.ndarray
    right_nodes: np.ndarray
    place: np.ndarray


def cut_along(mesh: Mesh, path: np.ndarray, nodes_of_cuts: np.ndarray | None = None) -> tuple[Mesh, Cut]:
    """A plane mesh cut along a polyline (m, 2) mm, of tri3 and quad4 elements: mid-side nodes are left out.

    nodes_of_cuts : nodes of earlier cuts, which stay where they are and are not reached
    A path that begins outside of the body, or within half an element of its edge, begins at the edge.

    Raises
    ------
    InputError
        Elements of another kind; a path that leaves the body, meets itself, crosses a cut or ends outside.
    """
    kinds = {block.cell for block in mesh.blocks}
    if not kinds <= {"tri3", "quad4", *LINEAR}:
        raise InputError("a cut through elements that cannot be split", key="experiment.mesh",
                         expected=f"elements tri3, quad4, {', '.join(LINEAR)}", found=", ".join(sorted(kinds)),
                         remedy="give a plane mesh of triangles and quadrilaterals")
    mesh = _of_corners(mesh) if kinds & set(LINEAR) else mesh
    work = _Cells.of(mesh)
    path = _from_the_edge(work, np.asarray(path, dtype=float))
    work.move_to(path)
    corners = [work.node_at(point) for point in path]
    chain = [corners[0]]
    for corner in corners[1:]:
        chain += work.edges_to(chain[-1], corner)
    if len(set(chain)) < len(chain) or not all(work.edge_cells.get(_key(a, b)) for a, b in pairwise(chain)):
        raise InputError("the path of a crack meets itself", expected="a path that is at every point once",
                         found=f"{path.tolist()}", remedy="correct the points of the path, or give a branch as a "
                         "[[crack]] of its own")
    if nodes_of_cuts is not None and np.isin(chain, nodes_of_cuts).any():
        raise _outside(path[-1])
    right_nodes = work.separated(chain)
    steps = np.linalg.norm(np.diff(np.array([work.nodes[node] for node in chain]), axis=0), axis=1)
    return work.mesh(mesh), Cut(path, np.array(chain), right_nodes, np.concatenate([[0.0], np.cumsum(steps)]))


def _of_corners(mesh: Mesh) -> Mesh:
    """The mesh without its mid-side nodes."""
    blocks = [(LINEAR.get(block.cell, block.cell), block) for block in mesh.blocks]
    corners = [block.connectivity[:, :cell_type(cell).n_corners] for cell, block in blocks]
    used = np.unique(np.concatenate([part.ravel() for part in corners]))
    place = np.full(mesh.n_nodes, -1)
    place[used] = np.arange(len(used))
    sets = {name: place[members][place[members] >= 0] for name, members in mesh.node_sets.items()}
    return replace(mesh, nodes=mesh.nodes[used], node_sets=sets, node_labels=mesh.node_labels[used],
                   blocks=tuple(Block(cell, place[part], block.first)
                                for (cell, block), part in zip(blocks, corners, strict=True)))


def side_pairs(mesh: Mesh, cut: Cut) -> list[np.ndarray]:
    """Nodes in the middle of the edges of a cut, in the mesh of raised order, else none  # per edge (0 | 1, 2)"""
    middle: dict[tuple[int, int], int] = {}
    for block in mesh.blocks:
        n_corners, edges = block.kind.n_corners, block.kind.edges
        if block.connectivity.shape[1] == n_corners:
            continue
        for k, edge in enumerate(edges):
            ends = np.sort(block.connectivity[:, list(edge)[:2]], axis=1)
            middle.update(zip(map(tuple, ends.tolist()), block.connectivity[:, n_corners + k].tolist(), strict=True))
    pairs = []
    for ends in zip(pairwise(cut.left_nodes), pairwise(cut.right_nodes), strict=True):
        edge, opposite = (_key(*pair) for pair in ends)
        pair = [middle[edge], middle[opposite]] if edge in middle else []
        pairs.append(np.array(pair, dtype=np.int64).reshape(-1, 2))
    return pairs


def _key(a: int, b: int) -> tuple[int, int]:
    return (int(a), int(b)) if a < b else (int(b), int(a))


def _cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


@dataclass
class _Cells:
    """The elements while they are split; a cell is a list of its corners, counter-clockwise."""

    nodes: list[np.ndarray]
    cells: list[list[int]]
    parent: list[int]
    edge_cells: dict[tuple[int, int], list[int]]
    node_cells: dict[int, set[int]]
    tolerance: float
    halves: dict[tuple[int, int], int] = field(default_factory=dict)  # new node of an edge that was split
    outer_halves: set[int] = field(default_factory=set)  # of these, nodes on an edge of the body, before it is cut
    source: dict[int, int] = field(default_factory=dict)  # node that a further one doubles

    @classmethod
    def of(cls, mesh: Mesh) -> _Cells:
        cells = [row for block in mesh.blocks for row in block.connectivity.tolist()]
        work = cls(list(mesh.nodes[:, :2].copy()), [], [], {}, {}, ON_PATH * mesh.size)
        for number, cell in enumerate(cells):
            work.add(cell, number)
        return work

    def add(self, cell: list[int], parent: int) -> None:
        number = len(self.cells)
        self.cells.append(cell)
        self.parent.append(parent)
        for edge in self.edges_of(number):
            self.edge_cells.setdefault(edge, []).append(number)
        for node in cell:
            self.node_cells.setdefault(node, set()).add(number)

    def drop(self, number: int) -> int:
        """Takes a cell out; returns its parent."""
        for edge in self.edges_of(number):
            self.edge_cells[edge].remove(number)
        for node in self.cells[number]:
            self.node_cells[node].discard(number)
        self.cells[number] = []
        return self.parent[number]

    def edges_of(self, number: int) -> list[tuple[int, int]]:
        cell = self.cells[number]
        return [_key(a, b) for a, b in zip(cell, cell[1:] + cell[:1], strict=True)]

    def is_outer(self, node: int) -> bool:
        return any(len(self.edge_cells[edge]) == 1 for number in self.node_cells[node]
                   for edge in self.edges_of(number) if node in edge)

    def outer_edges(self) -> list[tuple[int, int]]:
        return [edge for edge, owners in self.edge_cells.items() if len(owners) == 1]

    def shortest_edge(self, node: int) -> float:
        edges = {edge for number in self.node_cells[node] for edge in self.edges_of(number) if node in edge}
        return min(float(np.linalg.norm(self.nodes[a] - self.nodes[b])) for a, b in edges)

    # moving ---------------------------------------------------------------------------------------
    def move(self, node: int, place: np.ndarray) -> bool:
        """Moves a node where its cells keep their shape; whether it was moved."""
        start_areas = [self.corner_areas(number) for number in self.node_cells[node]]
        start, self.nodes[node] = self.nodes[node], place
        areas = [self.corner_areas(number) for number in self.node_cells[node]]
        keeps_shape = all((b >= MIN_AREA_SHARE * a).all() for a, b in zip(start_areas, areas, strict=True))
        if not keeps_shape:
            self.nodes[node] = start
        return keeps_shape

    def corner_areas(self, number: int) -> np.ndarray:
        points = np.array([self.nodes[node] for node in self.cells[number]])
        to_next, to_previous = np.roll(points, -1, axis=0) - points, np.roll(points, 1, axis=0) - points
        return to_next[:, 0] * to_previous[:, 1] - to_next[:, 1] * to_previous[:, 0]

    def move_to(self, path: np.ndarray) -> None:
        """Moves nodes near the path onto it: first one to each of its corners, then those beside it."""
        corner_nodes = set()
        for number, point in enumerate(path):
            corner_nodes.add(self._nearest_moved(point, outer=number == 0))
        nodes = np.array(self.nodes)
        for start, end in pairwise(path):
            along, length = (end - start) / np.linalg.norm(end - start), float(np.linalg.norm(end - start))
            part, aside = (nodes - start) @ along, np.abs((nodes - start) @ [-along[1], along[0]])
            for node in np.flatnonzero((part > 0.0) & (part < length) & (aside > self.tolerance)).tolist():
                if node in corner_nodes or not self.node_cells.get(node) or self.is_outer(node):
                    continue
                if aside[node] <= MAX_MOVE_SHARE * self.shortest_edge(node):
                    self.move(node, start + part[node] * along)

    def _nearest_moved(self, point: np.ndarray, outer: bool) -> int:
        distance = np.linalg.norm(np.array(self.nodes) - point, axis=1)
        for node in np.argsort(distance)[:4].tolist():
            is_near = distance[node] <= 1.5 * MAX_MOVE_SHARE * self.shortest_edge(node)
            if distance[node] <= self.tolerance:
                return node
            on_edge = outer and self.is_outer(node) and self._slides(node, point)
            if is_near and (on_edge or not self.is_outer(node)) and self.move(node, point):
                return node
        return -1

    def _slides(self, node: int, point: np.ndarray) -> bool:
        """Whether an outer node stays on its straight edge when it is moved to a point."""
        ends = [a if b == node else b for a, b in self.outer_edges() if node in (a, b)]
        return all(abs(_cross(self.nodes[end] - self.nodes[node], point - self.nodes[node]))
                   <= self.tolerance * np.linalg.norm(self.nodes[end] - self.nodes[node]) for end in ends)

    # splitting ------------------------------------------------------------------------------------
    def node_at(self, point: np.ndarray) -> int:
        """The node at a point of the body; a new one where there is none."""
        distance = np.linalg.norm(np.array(self.nodes) - point, axis=1)
        if distance.min() <= self.tolerance:
            return int(np.argmin(distance))
        number, weights = self._cell_with(point)
        while len(self.cells[number]) == 4:
            self._to_triangles(number)
            number, weights = self._cell_with(point)
        cell = self.cells[number]
        smallest = int(np.argmin(weights))
        if weights[smallest] < ON_EDGE_SHARE:
            return self.split_edge(_key(cell[smallest - 2], cell[smallest - 1]), point)
        node, parent = self._new(point), self.drop(number)
        for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
            self.add([a, b, node], parent)
        return node

    def _new(self, point: np.ndarray) -> int:
        self.nodes.append(np.asarray(point, dtype=float))
        return len(self.nodes) - 1

    def _cell_with(self, point: np.ndarray) -> tuple[int, np.ndarray]:
        """The cell that holds a point, and the share of the area of its triangle opposite to each corner (tri3)."""
        for number, cell in enumerate(self.cells):
            if not cell:
                continue
            corners = np.array([self.nodes[node] for node in cell])
            sides = np.roll(corners, -1, axis=0) - corners
            areas = sides[:, 0] * (point - corners)[:, 1] - sides[:, 1] * (point - corners)[:, 0]
            if (areas >= -self.tolerance * np.linalg.norm(sides, axis=1)).all():
                return number, np.roll(areas, -1) / areas.sum()
        raise _outside(point)

    def _to_triangles(self, number: int, through: int | None = None) -> None:
        """Splits a quad along a diagonal: that through a node, else the shorter one."""
        cell = self.cells[number]
        ways = [(np.linalg.norm(self.nodes[cell[0]] - self.nodes[cell[2]]), 0),
                (np.linalg.norm(self.nodes[cell[1]] - self.nodes[cell[3]]), 1)]
        first = min(ways)[1] if through is None else cell.index(through) % 2
        a, b, c, d = cell[first:] + cell[:first]
        parent = self.drop(number)
        self.add([a, b, c], parent)
        self.add([a, c, d], parent)

    def split_edge(self, edge: tuple[int, int], point: np.ndarray) -> int:
        """A new node on an edge; its quads become triangles before."""
        for number in list(self.edge_cells[edge]):
            if len(self.cells[number]) == 4:
                self._to_triangles(number)
        node = self._new(point)
        self.halves[edge] = node
        for number in list(self.edge_cells[edge]):
            cell = self.cells[number]
            k = next(i for i in range(3) if _key(cell[i], cell[(i + 1) % 3]) == edge)
            a, b, c = cell[k], cell[(k + 1) % 3], cell[(k + 2) % 3]
            parent = self.drop(number)
            self.add([a, node, c], parent)
            self.add([node, b, c], parent)
        return node

    def edges_to(self, start: int, end: int) -> list[int]:
        """Nodes after `start` along the straight line to `end`, with edges between them; what it crosses is split."""
        chain, node = [], start
        while node != end:
            node = self._next(node, end)
            chain.append(node)
        return chain

    def _next(self, node: int, end: int) -> int:
        place, way = self.nodes[node], self.nodes[end] - self.nodes[node]
        along = way / np.linalg.norm(way)
        for number in sorted(self.node_cells[node]):
            for a, b in self.edges_of(number):
                if node in (a, b):
                    neighbour = b if a == node else a
                    step = self.nodes[neighbour] - place
                    if step @ along > 0.0 and abs(_cross(along, step)) <= self.tolerance:
                        return neighbour
        for number in sorted(self.node_cells[node]):
            cell = self.cells[number]
            k = cell.index(node)
            following, previous = cell[(k + 1) % len(cell)], cell[k - 1]
            p, q = self.nodes[following], self.nodes[previous]
            if not _cross(p - place, along) > 0.0 > _cross(q - place, along):
                continue
            if len(cell) == 4:
                self._to_triangles(number, through=node)
                return self._next(node, end)
            share = _cross(p - place, along) / (_cross(p - place, along) - _cross(q - place, along))
            return self.split_edge(_key(following, previous), p + share * (q - p))
        raise _outside(place)

    # separating -----------------------------------------------------------------------------------
    def separated(self, chain: list[int]) -> np.ndarray:
        """Doubles the nodes of a chain of edges, but the last, and the first where it is inside; the right side."""
        along = {_key(a, b) for a, b in pairwise(chain)}
        if any(len(self.edge_cells[edge]) != 2 for edge in along) or any(map(self.is_outer, chain[1:])):
            raise _outside(self.nodes[chain[-1]])
        begins_inside = not self.is_outer(chain[0])
        self.outer_halves = {node for node in self.halves.values() if self.is_outer(node)}
        parts = [self._right_of(node, chain[k + 1], along) for k, node in enumerate(chain[:-1])]
        right = list(chain)
        for k, (node, cells) in enumerate(zip(chain[:-1], parts, strict=True)):
            if k == 0 and begins_inside:
                continue
            right[k] = self._new(self.nodes[node].copy())
            self.source[right[k]] = node
            for number in cells:
                self.cells[number] = [right[k] if corner == node else corner for corner in self.cells[number]]
        return np.array(right)

    def _right_of(self, node: int, ahead: int, along: set[tuple[int, int]]) -> set[int]:
        """Cells at a node that hang together with the one on the right of the edge ahead."""
        edge = _key(node, ahead)
        seed = next(number for number in self.edge_cells[edge]
                    if self.cells[number][(self.cells[number].index(ahead) + 1) % len(self.cells[number])] == node)
        part, waiting = {seed}, [seed]
        while waiting:
            for edge in self.edges_of(waiting.pop()):
                if node in edge and edge not in along:
                    more = set(self.edge_cells[edge]) - part
                    part |= more
                    waiting += more
        return part

    # the mesh -------------------------------------------------------------------------------------
    def mesh(self, plain: Mesh) -> Mesh:
        """The mesh of the cells, with the sets of the one before."""
        alive = [number for number, cell in enumerate(self.cells) if cell]
        blocks, order = [], []
        for cell, n in (("quad4", 4), ("tri3", 3)):
            numbers = sorted((k for k in alive if len(self.cells[k]) == n), key=lambda k: (self.parent[k], k))
            if numbers:
                blocks.append(Block(cell, np.array([self.cells[k] for k in numbers], dtype=np.int64), len(order)))
                order += numbers
        parents = np.array([self.parent[k] for k in order])
        nodes = np.zeros((len(self.nodes), plain.n_dim))
        nodes[:, :2] = self.nodes
        cut = Mesh(nodes, tuple(blocks), self._node_sets(plain),
                   {name: np.flatnonzero(np.isin(parents, members)) for name, members in plain.element_sets.items()},
                   {}, self._node_labels(plain), _labels(plain.element_labels, parents))
        return replace(cut, edge_sets=self._edge_sets(plain, cut))

    def _node_labels(self, plain: Mesh) -> np.ndarray:
        more = len(self.nodes) - plain.n_nodes
        return np.concatenate([plain.node_labels, np.max(plain.node_labels) + 1 + np.arange(more)])

    def _node_sets(self, plain: Mesh) -> dict[str, np.ndarray]:
        sets = {}
        for name, members in plain.node_sets.items():
            joined = set(np.asarray(members).tolist())
            for (a, b), node in self.halves.items():
                if a in joined and b in joined and node in self.outer_halves:
                    joined.add(node)
            more = [node for node, source in self.source.items() if source in joined]
            fresh = sorted((joined | set(more)) - set(np.asarray(members).tolist()))
            sets[name] = np.concatenate([members, np.array(fresh, dtype=np.int64)]).astype(np.int64)
        return sets

    def _edge_sets(self, plain: Mesh, cut: Mesh) -> dict[str, np.ndarray]:
        place = {}
        for element, local in cut.boundary_faces().tolist():
            a, b = (self.source.get(int(node), int(node)) for node in cut.face_nodes((element, local))[:2])
            place.setdefault(_key(a, b), []).append((element, local))
        sets = {}
        for name, edges in plain.edge_sets.items():
            rows = []
            for edge in edges:
                a, b = plain.face_nodes(edge)[:2]
                rows += [row for part in self._parts(_key(a, b)) for row in place.get(part, [])]
            sets[name] = np.array(rows, dtype=np.int64).reshape(-1, 2)
        return sets

    def _parts(self, edge: tuple[int, int]) -> list[tuple[int, int]]:
        node = self.halves.get(edge)
        if node is None:
            return [edge]
        return [part for end in edge for part in self._parts(_key(end, node))]


def _labels(labels_of_mesh: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """The first piece of an element keeps its label; the others follow the largest one."""
    labels, labelled = labels_of_mesh[parents].copy(), set()
    following = int(np.max(labels_of_mesh)) + 1
    for k, parent in enumerate(parents.tolist()):
        if parent in labelled:
            labels[k], following = following, following + 1
        labelled.add(parent)
    return labels


def _outside(point: np.ndarray) -> InputError:
    return InputError("the path of a crack leaves the body", expected="points inside the specimen, the first one on or "
                      "beside an edge, away from other cracks", found=f"({point[0]:.4g}, {point[1]:.4g})",
                      remedy="correct the points of the path")


def _from_the_edge(work: _Cells, path: np.ndarray) -> np.ndarray:
    """The path from where it enters the body; one that begins within half an element of the edge begins there."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    if len(path) < 2 or not (steps > work.tolerance).all():
        raise InputError("a crack without a path", expected="two different points or more", found=f"{path.tolist()}",
                         remedy="give the points along which it grows")
    along = (path[1] - path[0]) / steps[0]
    edges = np.array(work.outer_edges())
    a, b = np.array(work.nodes)[edges].transpose(1, 0, 2)
    side = b - a
    reach = 0.5 * float(np.median(np.linalg.norm(side, axis=1)))
    det = along[0] * side[:, 1] - along[1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = a - path[0]
        distance = (offset[:, 0] * side[:, 1] - offset[:, 1] * side[:, 0]) / det  # along the path
        share = (offset[:, 0] * along[1] - offset[:, 1] * along[0]) / det  # along the edge
    hits = distance[(share >= -1e-12) & (share <= 1.0 + 1e-12) & (distance > -reach) & (distance < steps[0])]
    if not len(hits):
        return path
    inside = _is_inside(work, path[0])
    entries = hits[hits <= reach] if inside else hits
    if not len(entries):
        return path
    start = entries[np.argmin(np.abs(entries))] if inside else entries.max()
    return np.vstack([path[0] + start * along, path[1:]])


def _is_inside(work: _Cells, point: np.ndarray) -> bool:
    try:
        work._cell_with(point)
    except InputError:
        return False
    return True
