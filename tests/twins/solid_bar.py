"""A bent solid bar seen from the front (x, y) and from its side (x, z), in memory and without noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.fe import make_mesh
from idic.images import ArrayStack, Camera, dense_speckle
from idic.model import (
    Column, Constant, Experiment, FurtherCamera, Material, Model, Noise, Options, Prescribed, Recording, build_forward,
)
from idic.parameters import Parameter, ParameterSet
from idic.virtual_tests import painted, render, Sensor

SIZE, CELLS = (6.0, 3.0, 2.0), (8, 4, 3)  # mm
FRONT, SIDE = Camera.from_table(0.06, (15.0, 65.0)), Camera.from_table(0.05, (135.0, 10.0), ("-col", "+row"))
SHAPES = ((80, 130), (60, 150))
ORDER = (0, 2, 1)  # x, z; then y


def bar():
    """hex8 cells; nodes LEFT, RIGHT; faces FRONT (z = 2), BELOW (y = 0)."""
    x, y, z = np.meshgrid(*(np.linspace(0, s, n + 1) for s, n in zip(SIZE, CELLS, strict=True)), indexing="ij")
    nodes, at = np.stack([x, y, z], axis=-1).reshape(-1, 3), np.arange(x.size).reshape(x.shape)
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    conn = np.array([[at[i + a, j + b, k + c] for a, b, c in corner]
                     for i in range(CELLS[0]) for j in range(CELLS[1]) for k in range(CELLS[2])])
    sets = {"LEFT": np.flatnonzero(nodes[:, 0] == 0.0), "RIGHT": np.flatnonzero(nodes[:, 0] == SIZE[0])}
    mesh = make_mesh(nodes, [("hex8", conn)], node_sets=sets, element_sets={"BODY": np.arange(len(conn))})
    on = lambda axis, value: np.array([f for f in mesh.boundary_faces()  # noqa: E731
                                       if np.all(nodes[mesh.face_nodes(f)][:, axis] == value)])
    return replace(mesh, edge_sets={"FRONT": on(2, SIZE[2]), "BELOW": on(1, 0.0)})


def side_and_front():
    """The experiment with images of its own motion in both cameras, and that motion with its derivatives."""
    mesh, times = bar(), np.arange(3.0)
    moves = [Prescribed("LEFT", c, Constant(0.0)) for c in "xyz"]
    tops = zip("xyz", (0.1, 0.15, -0.2), strict=True)  # mm
    moves += [Prescribed("RIGHT", c, Column(c, top * times / 2)) for c, top in tops]
    parameters = ParameterSet([Parameter("BODY.E", 1000.0, "MPa"), Parameter("BODY.nu", 0.3, "", True)])
    model = Model("solid", mesh, None, (Material("BODY", "elastic", "small"),), parameters, tuple(moves), (), (), FRONT,
                  times, surface="FRONT")
    body = Experiment(
        "bar", "", Recording(None, ("0", "1", "2"), noise=Noise(1.0)), model,
        options=Options(brightness="none", lowpass_px=0.0),
        cameras=(FurtherCamera("side", SIDE, None, ("0", "1", "2"), Noise(1.0), surface="BELOW", axis_order=ORDER),))
    states = list(build_forward(body).march(parameters, ("BODY.nu",)))
    stacks = []
    for seed, (surface, order, camera, shape) in enumerate((("FRONT", (0, 1), FRONT, SHAPES[0]),
                                                            ("BELOW", (0, 2), SIDE, SHAPES[1]))):
        texture = painted(dense_speckle(np.random.default_rng(seed), 2.0, extent_px=300.0), camera)
        stacks.append(ArrayStack(np.array(list(render(
            [state.u[:, order] for state in states], mesh.nodes[:, order], mesh.surface_cells(surface), camera,
            texture, Sensor(shape, bits=0, background=128.0), np.random.default_rng(0))))))
    return replace(body, recording=replace(body.recording, stack=stacks[0]),
                   cameras=(replace(body.cameras[0], stack=stacks[1]),)), states
