"""The same test as solid elements of the specimen's real thickness, where the model is a sheet in plane stress.

A thick sheet is not in plane stress: bending bulges its surface across the beam, and a grip keeps it from contracting.
The bricks reach from the seen surface to the plane of symmetry in the middle. An edge that is held or moved in both
components is taken as gripped: it keeps its thickness. An edge whose motion the images give lies within the specimen:
its thickness is free, and what is behind the seen surface moves along with it. All other motions, loads, temperatures
and variations of the stiffness act through the thickness as they do on the sheet, and holes and edges have their shape
through it. Extensometers sit on the seen surface.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.fe import cell_type, make_mesh, Mesh, Morph
from idic.model import (
    Channel,
    Constant,
    Controlled,
    Experiment,
    Model,
    Parametrised,
    Prescribed,
    Temperature,
    TemperatureField,
    mode_shapes,
)

MIDDLE = "plane of symmetry"
SEEN = "seen surface"
SOLID_CELLS = {"quad8": "hex20", "tri6": "tet10"}
TRIANGLE_EDGES = ((0, 1), (0, 2), (1, 2))
# of a prism whose corners are numbered upwards: (corner, 0 at the bottom or 1 at the top) of three tetrahedra
DIVIDED_PRISM = (((0, 0), (1, 0), (2, 0), (2, 1)), ((0, 0), (1, 0), (2, 1), (1, 1)), ((0, 0), (1, 1), (2, 1), (0, 1)))
MIRRORED_TET = [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]  # the same tetrahedron, its first two corners exchanged
LAYER_SHARE = 2.0  # depth of a layer over the size of an element, at most
MAX_LAYERS = 3


def can_be_thick(experiment: Experiment) -> bool:
    """Whether bricks of its thickness can be made: a sheet of eight-node quadrilaterals, or of six-node triangles, in
    plane stress, of known thickness."""
    model = experiment.model
    plain = (model.solver is None and not model.cracks and model.kind == "plane_stress" and model.thickness is not None
             and model.length_unit == "mm" and model.symmetry is None and experiment.surface_side == 0
             and "geometry.thickness" not in model.parameters)
    uneven = any(entry.form == "thickness" for entry in model.heterogeneities)
    return (plain and not uneven
            and {block.cell for block in model.mesh.blocks} in ({"quad8"}, {"tri6"}))


def thick(experiment: Experiment) -> Experiment:
    """The test on bricks of half the thickness; its first nodes are those of the sheet, on the seen surface.

    experiment : of which `can_be_thick` holds
    """
    model = experiment.model
    mesh = extruded(model.mesh, 0.5 * float(model.thickness))
    front, flat = in_front(model.mesh, mesh), [MIDDLE, *model.gripped_ends]
    prescribed = (*(_moved_through(model, entry, mesh, front) for entry in model.prescribed),
                  *(Prescribed(name, "z", Constant(0.0)) for name in flat))
    return replace(experiment, model=replace(model, kind="solid", mesh=mesh, thickness=None, prescribed=prescribed,
                                             motion_error=None, surface=SEEN,
                                             loads=tuple(replace(load, share=0.5 * load.share)
                                                         for load in model.loads),
                                             temperatures=tuple(_through(entry, front)
                                                                for entry in model.temperatures),
                                             morphs=tuple(_flat(morph, front) for morph in model.morphs),
                                             channels=tuple(_of_solid(channel) for channel in model.channels)))


def extruded(sheet: Mesh, depth: float) -> Mesh:
    """Solid elements behind those of a sheet, down to the node set `MIDDLE` at z = 0: twenty-node bricks behind
    eight-node quadrilaterals, three ten-node tetrahedra behind a six-node triangle, which need a finer mesh.

    The nodes of the sheet come first. Node sets reach through the depth, those that `as_seen` names lie on the seen
    surface, the edge set `SEEN`; edge sets of the sheet are the upright faces behind their edges.
    """
    cells = np.concatenate([block.connectivity for block in sheet.blocks])
    size = float(np.median(np.linalg.norm(sheet.nodes[cells[:, 0]] - sheet.nodes[cells[:, 1]], axis=1)))
    layers = int(np.clip(np.ceil(depth / (LAYER_SHARE * size)), 1, MAX_LAYERS))
    inner = _nodes_inside_a_layer(sheet)
    n, nodes = sheet.n_nodes, np.arange(sheet.n_nodes)
    between = np.full(n, -1)
    between[inner] = np.arange(len(inner))
    pitch, solid = n + len(inner), []
    points = [np.column_stack([sheet.nodes, np.full(n, depth)])]
    for layer in range(layers):
        top, bottom, half = nodes + layer * pitch, nodes + (layer + 1) * pitch, between + layer * pitch + n
        z = depth * (1.0 - (layer + np.array([0.5, 1.0])) / layers)
        points += [np.column_stack([sheet.nodes[inner], np.full(len(inner), z[0])]),
                   np.column_stack([sheet.nodes, np.full(n, z[1])])]
        solid.append((_bricks if _is_of_quadrilaterals(sheet) else _tetrahedra)(cells, bottom, half, top))
    through = {name: np.concatenate([members + layer * pitch for layer in range(layers + 1)]
                                    + [between[members][between[members] >= 0] + layer * pitch + n
                                       for layer in range(layers)])
               for name, members in sheet.node_sets.items()}
    n_behind = len(solid[0]) // len(cells)  # elements behind one, in a layer
    elements = {name: np.concatenate([((np.asarray(members) + layer * len(cells))[:, None] * n_behind
                                       + np.arange(n_behind)).ravel() for layer in range(layers)])
                for name, members in sheet.element_sets.items()}
    on_surface = {as_seen(name): np.asarray(members) for name, members in sheet.node_sets.items()}
    sets = {"node_sets": through | on_surface | {MIDDLE: nodes + layers * pitch}, "element_sets": elements}
    body = np.concatenate(points), [(SOLID_CELLS[sheet.blocks[0].cell], np.concatenate(solid))]
    closed = make_mesh(*body, **sets)
    return make_mesh(*body, **sets, edge_sets=_face_sets(sheet, closed))


def _face_sets(sheet: Mesh, solid: Mesh) -> dict[str, np.ndarray]:
    """The seen surface, and the faces behind every edge set of the sheet  # each (n, 2) [element, local face]"""
    front, faces = in_front(sheet, solid), solid.boundary_faces()
    corners = solid.blocks[0].kind.n_face_corners
    places = [front[solid.face_nodes(face)[:corners]] for face in faces]
    on_surface = [bool((solid.face_nodes(face) < sheet.n_nodes).all()) for face in faces]
    upright: dict[frozenset[int], list[int]] = {}
    for number, place in enumerate(places):
        if len(set(place.tolist())) == 2:
            upright.setdefault(frozenset(place.tolist()), []).append(number)
    sets = {SEEN: faces[on_surface]}
    for name, edges in sheet.edge_sets.items():
        ends = [frozenset(sheet.face_nodes(edge)[:2].tolist()) for edge in edges]
        sets[name] = faces[[number for pair in ends for number in upright.get(pair, ())]]
    return sets


def as_seen(name: str) -> str:
    """The node set of a solid on the seen surface, of a node set of its sheet."""
    return f"{name} on the {SEEN}"


def in_front(sheet: Mesh, solid: Mesh) -> np.ndarray:
    """The node of the sheet in front of every node of the solid behind it (`extruded`)  # (n_nodes of the solid,)"""
    nodes, inner = np.arange(sheet.n_nodes), _nodes_inside_a_layer(sheet)
    layers = (solid.n_nodes - len(nodes)) // (len(nodes) + len(inner))
    return np.concatenate([nodes, *([inner, nodes] * layers)])


def _is_of_quadrilaterals(sheet: Mesh) -> bool:
    return sheet.blocks[0].cell == "quad8"


def _nodes_inside_a_layer(sheet: Mesh) -> np.ndarray:
    """Nodes of the sheet behind which there is one half way through a layer: corners, on the upright edges; of
    triangles all, as the upright faces have diagonals."""
    if not _is_of_quadrilaterals(sheet):
        return np.arange(sheet.n_nodes)
    return np.unique(np.concatenate([block.connectivity[:, :4] for block in sheet.blocks]))


def _bricks(cells: np.ndarray, bottom: np.ndarray, half: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Bricks of a layer; bottom, half, top : node of the solid behind every node of the sheet  # (n_cells, 20)"""
    return np.hstack([bottom[cells[:, :4]], top[cells[:, :4]], bottom[cells[:, 4:]], top[cells[:, 4:]],
                      half[cells[:, :4]]])


def _tetrahedra(cells: np.ndarray, bottom: np.ndarray, half: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Tetrahedra of a layer, as for `_bricks`: the diagonal of an upright face runs from the bottom of its corner with
    the smaller number, so that neighbours share it  # (3 n_cells, 10)"""
    order = np.argsort(cells[:, :3], axis=1)
    odd = (order[:, 1] - order[:, 0]) % 3 != 1  # the corners in ascending order run clockwise
    corners = np.take_along_axis(cells[:, :3], order, axis=1)
    middles = np.take_along_axis(cells[:, 3:], np.stack([
        np.where((order[:, i] + 1) % 3 == order[:, j], order[:, i], order[:, j]) for i, j in TRIANGLE_EDGES], axis=1),
        axis=1)
    tetrahedra = []
    for corners_of_tet in DIVIDED_PRISM:
        nodes = [(bottom, top)[level][corners[:, corner]] for corner, level in corners_of_tet]
        for i, j in cell_type("tet4").edges:
            (start, low), (end, high) = corners_of_tet[i], corners_of_tet[j]
            edge = (min(start, end), max(start, end))
            on = corners[:, start] if start == end else middles[:, TRIANGLE_EDGES.index(edge)]
            nodes.append((bottom if low == high == 0 else top if low == high else half)[on])
        cell = np.stack(nodes, axis=1)
        cell[odd] = cell[odd][:, MIRRORED_TET]
        tetrahedra.append(cell)
    return np.stack(tetrahedra, axis=1).reshape(-1, 10)


def _through(entry: Temperature, front: np.ndarray) -> Temperature:
    """A temperature that does not change through the thickness; of a field every node behind one has its values."""
    if not isinstance(entry.drive, TemperatureField):
        return entry
    return replace(entry, drive=replace(entry.drive, values=entry.drive.values[:, front]))


def _flat(morph: Morph, front: np.ndarray) -> Morph:
    """A geometric degree of freedom that moves every node behind one along with it."""
    return replace(morph, velocity=np.column_stack([morph.velocity[front], np.zeros(len(front))]))


def _of_solid(channel: Channel) -> Channel:
    """Both halves give a reaction; an extensometer sits on the seen surface."""
    if channel.kind != "displacement":
        return replace(channel, factor=2.0 * channel.factor) if channel.kind == "reaction" else channel
    return replace(channel, nodes=as_seen(channel.nodes),
                   minus=None if channel.minus is None else as_seen(channel.minus))


def _moved_through(model: Model, entry: Prescribed, solid: Mesh, front: np.ndarray) -> Prescribed:
    """A motion of the sheet through the thickness: shapes of an edge as in front, gauges on the seen surface."""
    drive = entry.drive
    if isinstance(drive, Controlled):
        return replace(entry, drive=replace(drive, nodes=as_seen(drive.nodes),
                                            minus=None if drive.minus is None else as_seen(drive.minus)))
    if not isinstance(drive, Parametrised):
        return entry
    edge = model.node_set(entry.nodes)
    shapes, courses = mode_shapes(model, edge, drive, f"boundary.{entry.nodes}.{entry.component}")
    place = np.full(model.mesh.n_nodes, -1)
    place[edge] = np.arange(len(edge))
    return replace(entry, drive=replace(drive, shapes=shapes[place[front[solid.node_sets[entry.nodes]]]],
                                        courses=courses))
