"""Holes and edges of the mesh as degrees of freedom: geometry.hole_x, hole_y, hole_radius, of several holes with [k];
geometry.outline, the distance by which free edges lie further out than in the mesh; of one edge with .EDGE1, …."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import (
    Hole, Mesh, Morph, OUTLINE, admissible, edges_by_name, find_holes, free_edges, on_circle, outward_velocity,
)
from idic.parameters import Parameter

_NAME = re.compile(r"geometry\.hole_(x|y|radius)(?:\[(\d+)\])?")
_OUTLINE = re.compile(re.escape(OUTLINE) + r"(?:\.(.+))?")
_MAX_HOLE_TRAVEL_SHARE = 0.8  # of the admissible range of one hole, as two holes may move at once
_MIN_JACOBIAN_OF_EDGES = 0.1  # of its first value, of every element: an outline of points may be off by an element


@dataclass(frozen=True)
class Geometry:
    """Degrees of freedom of a mesh: itself with mid-side nodes on the circles of holes, morphs, parameters, notes."""

    mesh: Mesh
    morphs: tuple[Morph, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    notes: tuple[str, ...] = ()


def geometry_of(mesh: Mesh, config: ExperimentFile, length_unit: str, file) -> Geometry:
    """The degrees of freedom of [[dof]] that move nodes of the mesh.

    Raises
    ------
    InputError
        There is no such hole or free edge.
    """
    names = [entry.name for entry in config.dof]
    driven_ends = {table.nodes: mesh.node_sets[table.nodes] for table in config.boundary
                   if table.nodes in mesh.node_sets
                   and any(drive is not None for drive in (table.u, table.ux, table.uy, table.uz))}
    holes = holes_of(mesh, names, length_unit, file)
    outline = outline_of_mesh(holes.mesh, names, driven_ends, length_unit, file)
    return Geometry(holes.mesh, (*holes.morphs, *outline.morphs), (*holes.parameters, *outline.parameters),
                    holes.notes)


def holes_of(mesh: Mesh, names: Sequence[str], length_unit: str, file) -> Geometry:
    """The degrees of freedom among `names` (of [[dof]]) that move a hole.

    Start values are those of the circle through the rim's corner nodes; bounds keep every element in shape.

    Raises
    ------
    InputError
        The mesh has no round hole, a number is missing although there are several holes, or a number is too large.
    """
    matches = [(number, match) for number, name in enumerate(names) if (match := _NAME.fullmatch(name))]
    if not matches:
        return Geometry(mesh)
    mesh_holes, holes_by_name = find_holes(mesh), {}
    for number, match in matches:
        holes_by_name[match[0]] = _pick(mesh_holes, match, file, f"dof[{number}].name")
    holes = list({id(hole): hole for hole in holes_by_name.values()}.values())
    straight = mesh.nodes
    mesh = on_circle(mesh, holes)
    fields = {id(hole): hole.velocities(mesh) for hole in holes}
    morphs, parameters = [], []
    for name, hole in holes_by_name.items():
        quantity = _NAME.fullmatch(name)[1]
        start = float(np.round({"x": hole.centre[0], "y": hole.centre[1], "radius": hole.radius}[quantity], 9)) + 0.0
        velocity = fields[id(hole)][quantity]
        low, high = (start + _MAX_HOLE_TRAVEL_SHARE * change for change in admissible(mesh, velocity))
        if quantity == "radius":
            low = max(low, 0.05 * hole.radius)
        morphs.append(Morph(name, start, velocity))
        parameters.append(Parameter(name, start, length_unit, bounds=(float(low), float(high)),
                                    scale=hole.radius))
    notes = []
    if np.any(mesh.nodes != straight):
        notes.append("mid-side nodes of holes that may move were put on their circles")
    return Geometry(mesh, tuple(morphs), tuple(parameters), tuple(notes))


def _pick(holes: tuple[Hole, ...], match: re.Match, file, key: str) -> Hole:
    """The hole of a name in [[dof]]."""
    listed = "; ".join(f"[{k}] at ({hole.centre[0]:.4g}, {hole.centre[1]:.4g}), radius {hole.radius:.4g}"
                       for k, hole in enumerate(holes, 1))
    if not holes:
        raise InputError("the mesh has no round hole", file=file, key=key,
                         expected="a closed rim inside the mesh, corner nodes within 5 % of a circle",
                         found="none", remedy="remove the entry, or mesh the hole whole (a quarter model has none)")
    if match[2] is None and len(holes) > 1:
        raise InputError("the number of the hole is missing", file=file, key=key,
                         expected=f"{match[0]}[1] … {match[0]}[{len(holes)}]",
                         found=f"{match[0]}, and {len(holes)} holes: {listed}", remedy="add the number in brackets")
    index = int(match[2] or 1)
    if not 1 <= index <= len(holes):
        raise InputError("no such hole", file=file, key=key, expected=listed, found=match[0],
                         remedy="correct the number in brackets")
    return holes[index - 1]


def outline_of_mesh(mesh: Mesh, names: Sequence[str], driven_ends: Mapping[str, np.ndarray], length_unit: str,
                    file) -> Geometry:
    """The degrees of freedom among `names` (of [[dof]]) that move free edges outwards, from 0 on; mm.

    driven_ends : {name: (n,) nodes} of driven ends, which stay

    Raises
    ------
    InputError
        A solid, no free edge, or a name that is no set of free edges.
    """
    matches = [(number, match) for number, name in enumerate(names) if (match := _OUTLINE.fullmatch(name))]
    if not matches:
        return Geometry(mesh)
    key = f"dof[{matches[0][0]}].name"
    if mesh.n_dim != 2:
        raise InputError("the outline of a solid does not move", file=file, key=key, expected="a plane model",
                         found="a solid", remedy="remove the entry, or identify geometry.hole_radius")
    edges = free_edges(mesh, driven_ends)
    named_edges = edges_by_name(mesh, edges)
    morphs, parameters = [], []
    for number, match in matches:
        faces = edges if match[1] is None else named_edges.get(match[1], edges[:0])
        if not len(faces):
            raise InputError("no such free edge", file=file, key=f"dof[{number}].name",
                             expected=", ".join(f"{OUTLINE}.{name}" for name in named_edges) or "a free edge",
                             found=match[0], remedy="ends that [[boundary]] moves do not count; correct the name")
        velocity = outward_velocity(mesh, faces)
        low, high = (_MAX_HOLE_TRAVEL_SHARE * change for change in admissible(mesh, velocity, _MIN_JACOBIAN_OF_EDGES))
        morphs.append(Morph(match[0], 0.0, velocity))
        parameters.append(Parameter(match[0], 0.0, length_unit, bounds=(float(low), float(high)),
                                    scale=float(min(high, -low))))
    return Geometry(mesh, tuple(morphs), tuple(parameters))
