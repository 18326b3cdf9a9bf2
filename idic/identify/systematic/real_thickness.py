"""The same test as bricks of the specimen's real thickness, where the model is a sheet in plane stress.

A thick sheet is not in plane stress: bending bulges its surface across the beam, and a grip keeps it from contracting.
The bricks reach from the seen surface to the plane of symmetry in the middle. An edge that is held or moved in both
components is taken as gripped: it keeps its thickness. All other motions, temperatures and variations of the stiffness
act through the thickness as they do on the sheet, and holes and edges have their shape through it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.fe.mesh.mesh import Mesh, make_mesh
from idic.fe.mesh.morph import Morph
from idic.model.experiment import (Channel, Column, Constant, Experiment, Prescribed, Temperature,
                                   TemperatureField)

MIDDLE = "plane of symmetry"
LAYER_SHARE = 2.0  # depth of a layer over the size of an element, at most
MAX_LAYERS = 3


def can_be_thick(experiment: Experiment) -> bool:
    """Whether bricks of its thickness can be made: a sheet of eight-node quadrilaterals in plane stress, of known
    thickness, moved by its edges and its temperature alone."""
    plain = (experiment.solver is None and experiment.kind == "plane_stress" and experiment.thickness is not None
             and experiment.length_unit == "mm" and experiment.symmetry is None and experiment.surface_side == 0
             and "geometry.thickness" not in experiment.parameters)
    uneven = any(entry.form == "thickness" for entry in experiment.heterogeneities)
    return (plain and not (experiment.loads or uneven)
            and all(block.cell == "quad8" for block in experiment.mesh.blocks)
            and all(isinstance(entry.drive, (Constant, Column)) for entry in experiment.prescribed)
            and all(channel.kind == "reaction" for channel in experiment.channels))


def thick(experiment: Experiment) -> Experiment:
    """The test on bricks of half the thickness; its first nodes are those of the sheet, on the seen surface.

    experiment : of which `can_be_thick` holds
    """
    mesh = extruded(experiment.mesh, 0.5 * float(experiment.thickness))  # type: ignore[arg-type]
    components: dict[str, set[str]] = {}
    for entry in experiment.prescribed:
        components.setdefault(entry.nodes, set()).add(entry.component)
    flat = [MIDDLE, *(name for name, own in components.items() if own >= {"x", "y"})]
    prescribed = (*experiment.prescribed, *(Prescribed(name, "z", Constant(0.0)) for name in flat))
    front = in_front(experiment.mesh, mesh)
    return replace(experiment, kind="solid", mesh=mesh, thickness=None, prescribed=prescribed, motion_error=None,
                   temperatures=tuple(_through(entry, front) for entry in experiment.temperatures),
                   morphs=tuple(_flat(morph, front) for morph in experiment.morphs),
                   channels=tuple(_of_both_halves(channel) for channel in experiment.channels))


def extruded(sheet: Mesh, depth: float) -> Mesh:
    """Twenty-node bricks behind eight-node quadrilaterals, down to the node set `MIDDLE` at z = 0.

    Node sets reach through the depth; edge sets are left out.
    """
    cells = np.concatenate([block.connectivity for block in sheet.blocks])
    size = float(np.median(np.linalg.norm(sheet.nodes[cells[:, 0]] - sheet.nodes[cells[:, 1]], axis=1)))
    layers = int(np.clip(np.ceil(depth / (LAYER_SHARE * size)), 1, MAX_LAYERS))
    corners = np.unique(cells[:, :4])
    n, own = sheet.n_nodes, np.arange(sheet.n_nodes)
    between = np.full(n, -1)
    between[corners] = np.arange(len(corners))
    pitch, bricks = n + len(corners), []
    points = [np.column_stack([sheet.nodes, np.full(n, depth)])]
    for layer in range(layers):
        top, bottom, half = own + layer * pitch, own + (layer + 1) * pitch, between + layer * pitch + n
        z = depth * (1.0 - (layer + np.array([0.5, 1.0])) / layers)
        points += [np.column_stack([sheet.nodes[corners], np.full(len(corners), z[0])]),
                   np.column_stack([sheet.nodes, np.full(n, z[1])])]
        bricks.append(np.hstack([bottom[cells[:, :4]], top[cells[:, :4]], bottom[cells[:, 4:]], top[cells[:, 4:]],
                                 half[cells[:, :4]]]))
    through = {name: np.concatenate([nodes + layer * pitch for layer in range(layers + 1)]
                                    + [between[nodes][between[nodes] >= 0] + layer * pitch + n
                                       for layer in range(layers)])
               for name, nodes in sheet.node_sets.items()}
    elements = {name: np.concatenate([np.asarray(members) + layer * len(cells) for layer in range(layers)])
                for name, members in sheet.element_sets.items()}
    return make_mesh(np.concatenate(points), [("hex20", np.concatenate(bricks))],
                     node_sets=through | {MIDDLE: own + layers * pitch}, element_sets=elements)


def in_front(sheet: Mesh, bricks: Mesh) -> np.ndarray:
    """The node of the sheet in front of every node of its bricks (`extruded`)  # (n_nodes of the bricks,)"""
    own, corners = np.arange(sheet.n_nodes), np.unique(np.concatenate([b.connectivity[:, :4] for b in sheet.blocks]))
    layers = (bricks.n_nodes - len(own)) // (len(own) + len(corners))
    return np.concatenate([own, *([corners, own] * layers)])


def _through(entry: Temperature, front: np.ndarray) -> Temperature:
    """A temperature that does not change through the thickness; of a field every node behind one has its values."""
    if not isinstance(entry.drive, TemperatureField):
        return entry
    return replace(entry, drive=replace(entry.drive, values=entry.drive.values[:, front]))


def _flat(morph: Morph, front: np.ndarray) -> Morph:
    """A geometric degree of freedom that moves every node behind one along with it."""
    return replace(morph, velocity=np.column_stack([morph.velocity[front], np.zeros(len(front))]))


def _of_both_halves(channel: Channel) -> Channel:
    return replace(channel, factor=2.0 * channel.factor)
