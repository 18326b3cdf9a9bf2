"""A small body with everything that can be a degree of freedom, in memory: for the derivative tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.correlation import (
    CorrelationContext, FrameResponse, Weights, build_experiment_reference, camera_at, frame_equations,
)
from idic.experiment_file.tables.geometry import holes_of
from idic.fe import make_mesh
from idic.images import ArrayStack, Camera, CameraMotion, dense_speckle
from idic.model import (
    CORRECTION_TERMS, Channel, Column, Constant, Correction, Experiment, Heterogeneity, Load, Material, Model, Noise,
    Options, Parametrised, Prescribed, Recording, boundary_parameters, build_forward, solve,
)
from idic.parameters import Parameter, ParameterSet
from idic.virtual_tests import painted, render, Sensor, strip_with_hole

TIMES = np.array([0.0, 1.0, 2.0, 3.0, 4.5])  # s
LENGTH, WIDTH, PIXEL = 6.0, 4.0, 0.06  # mm
SHAPE = (100, 130)  # px: the body is 100 x 67 px
CAMERA = Camera.from_table(PIXEL, (64.3, 49.6), rotation_deg=1.5, k1=2e-6, centre=(60.0, 45.0))


def plate(cells=(4, 3)):
    """quad8 cells over a plate with a waist, so that every strain component varies; sets LEFT, RIGHT, edges RIGHT."""
    n = (2 * cells[0] + 1, 2 * cells[1] + 1)
    s, t = np.meshgrid(np.linspace(-1, 1, n[0]), np.linspace(-1, 1, n[1]), indexing="ij")
    waist = 1.0 - 0.3 * np.cos(0.5 * np.pi * s) * (1.0 + 0.3 * s)
    nodes = np.stack([0.5 * LENGTH * s, 0.5 * WIDTH * t * waist], axis=-1).reshape(-1, 2)
    at = np.arange(len(nodes)).reshape(n)
    conn = [[at[i, j], at[i + 2, j], at[i + 2, j + 2], at[i, j + 2], at[i + 1, j], at[i + 2, j + 1], at[i + 1, j + 2],
             at[i, j + 1]] for i in range(0, n[0] - 1, 2) for j in range(0, n[1] - 1, 2)]
    used = np.unique(conn)
    number = np.full(len(nodes), -1)
    number[used] = np.arange(len(used))
    nodes, conn = nodes[used], number[np.array(conn)]
    x = nodes[:, 0]
    sets = {"LEFT": np.flatnonzero(x < -0.5 * LENGTH + 1e-9), "RIGHT": np.flatnonzero(x > 0.5 * LENGTH - 1e-9)}
    mesh = make_mesh(nodes, [("quad8", conn)], node_sets=sets, element_sets={"BODY": np.arange(len(conn))})
    right = [face for face in mesh.boundary_faces() if np.isin(mesh.face_nodes(face), sets["RIGHT"]).all()]
    return replace(mesh, edge_sets={"RIGHT": np.array(right)})


def column(name, top, noise_std=0.0, **more):
    """A logged history over `TIMES` that rises and falls back a little, with its rates."""
    values = top * np.array([0.0, 0.4, 0.8, 1.0, 0.9])
    return Column(name, values, noise_std, rates=np.gradient(values, TIMES), **more)


def parametrised(component):
    return Prescribed("RIGHT", component, Parametrised("bspline", 3, 2))


def held_left():
    return (Prescribed("LEFT", "x", Constant(0.0)), Prescribed("LEFT", "y", Constant(0.0)))


def pulled(top=0.05, offset=True, noise_std=0.0):
    """Held on the left, pulled on the right by a logged motion of `top` mm."""
    drive = column("grip", top, noise_std, identify_offset=offset)
    return (*held_left(), Prescribed("RIGHT", "x", drive), Prescribed("RIGHT", "y", Constant(0.0)))


def correction(kind, course, unit, reach=1.0):
    return Correction(kind, course, unit, reach, CORRECTION_TERMS[kind].pattern)


def corrected_grips():
    """The same with everything that may be wrong about a log: slip, compliance, seating, rotation, motion askew; both
    ends."""
    force = np.array([0.0, 5.0, 9.0, 12.0, 10.0])
    drive = column("grip", 0.1)
    corrections = (Correction("slip", -np.array([0.0, 0.0, 0.2, 0.6, 1.0]), "mm"),
                   Correction("compliance", -force, "mm/N"),
                   Correction("seating", -(1.0 - np.exp(-force / 4.0)), "mm"),
                   correction("rotation", drive.values, "rad/mm", WIDTH / 2.0),
                   correction("misalignment", drive.values, ""))
    return (Prescribed("LEFT", "x", Constant(0.0, (correction("rotation", force / 12.0, "rad", WIDTH / 2.0),))),
            Prescribed("LEFT", "y", Constant(0.0)),
            Prescribed("RIGHT", "x", replace(drive, corrections=corrections)), Prescribed("RIGHT", "y", Constant(0.0)))


def experiment(law="elastic", values=None, extra=(), prescribed=None, loads=(), kinematics="small", **options):
    """The plate as an Experiment without images; every law parameter and every extra is free."""
    prescribed = pulled() if prescribed is None else prescribed
    values = {"E": 1000.0, "nu": 0.3} if values is None else values
    made = [Parameter(f"BODY.{name}", value, "MPa", True) for name, value in values.items()]
    made += [replace(p, value=0.3 * p.scale * PIXEL) for p in boundary_parameters(prescribed, PIXEL)]
    made += [Parameter(name, value, free=True, scale=scale) for name, value, scale in extra]
    force = 10.0 * np.array([0.0, 0.45, 0.8, 1.1, 0.95])
    channel = Channel("force", force, 0.1, "RIGHT", "x", 2.0, np.gradient(force, TIMES))
    free_edge = all(entry.nodes != "RIGHT" for entry in prescribed)
    model = Model("plane_stress", plate(), 1.5, (Material("BODY", law, kinematics),), ParameterSet(made),
                  tuple(prescribed), tuple(loads), () if free_edge else (channel,), CAMERA, TIMES)
    recording = Recording(None, tuple(map(str, range(len(TIMES)))), noise=Noise(1.0))
    return Experiment("plate", "", recording, model,
                      options=Options(**({"brightness": "none", "lowpass_px": 0.0} | options)))


def extended(body, parameters):
    """The parameters of a body and these."""
    return ParameterSet([*body.model.parameters.values(), *parameters])


def uneven(body):
    """The same with a soft spot and a stiffness that falls along the axes, all of it free."""
    spot = {"stiffness": (0.6, 1.0), "radius": (0.9, 1.0), "x": (0.7, 1.0), "y": (0.2, 1.0)}
    slopes = {"along_x": (0.2, 0.3), "along_y": (-0.1, 0.3)}
    free = [Parameter(f"BODY.{name}.{last}", value, free=True, scale=scale)
            for name, values in (("inclusion", spot), ("gradient", slopes)) for last, (value, scale) in values.items()]
    records = (Heterogeneity("BODY", "inclusion", "inclusion"), Heterogeneity("BODY", "gradient", "gradient"))
    return replace(body, model=replace(body.model, heterogeneities=records, parameters=extended(body, free)))


def on_the_move(body):
    """The same before a camera that comes nearer, turns and shifts from frame to frame; the sheet bends towards it."""
    frames, none = np.arange(len(TIMES)), np.zeros(len(TIMES))
    values = {"magnification_drift": ("magnification", TIMES, 1e-3, 0.02),
              "turn_at[4]": ("turn", frames == 4, 0.2, 3.0), "col_at[4]": ("column", frames == 4, 0.4, 3.0),
              "row_at[4]": ("row", frames == 4, -0.3, 3.0), "bow_x_drift": ("bow_x", TIMES, 1e-3, 0.02),
              "buckle_y_knot[4]": ("buckle_y", frames == 4, 2e-3, 0.02)}
    motion = CameraMotion(tuple(values), tuple(kind for kind, *_ in values.values()),
                          np.array([course + none for _, course, *_ in values.values()]),
                          np.array([value for *_, value, _ in values.values()]),
                          np.array([[-0.5, -0.5], [0.5, 0.5]]) * [LENGTH, WIDTH], lever=0.5)
    free = [Parameter(f"camera.{name}", value, free=True, scale=scale) for name, (*_, value, scale) in values.items()]
    return replace(body, model=replace(body.model, camera=replace(body.model.camera, motion=motion),
                                       parameters=extended(body, free)))


HOLE = {"geometry.hole_x": 0.1, "geometry.hole_y": -0.05, "geometry.hole_radius": 1.05}  # mm; the mesh has 0, 0, 1


def with_hole(cell="quad8", cells=(2, 3, 1), **options):
    """A strip with a hole whose place and size are free, besides E and nu; `cells`: around, radial, beside."""
    mesh = strip_with_hole(LENGTH, WIDTH, 1.0, cell, *cells, name="BODY")
    holes = holes_of(mesh, tuple(HOLE), "mm", None)
    body = experiment(prescribed=pulled(0.3, offset=False), **options)
    free = [replace(p, value=HOLE[p.name], free=True) for p in holes.parameters]
    return replace(body, model=replace(body.model, mesh=holes.mesh, morphs=holes.morphs,
                                       parameters=extended(body, free)))


def force_on_the_right(kind, top, component="x"):
    return Load("RIGHT", kind, column("load", top), None if kind == "pressure" else component)


def photographed(body):
    """The same with noise-free images of its own motion: at its own parameters the residual is interpolation error."""
    forward = build_forward(body)
    camera = camera_at(body, body.model.parameters)
    texture = painted(dense_speckle(np.random.default_rng(3), 2.0, extent_px=400.0), CAMERA)
    u, mesh = solve(forward, body.model.parameters).u, body.at_geometry(body.model.parameters).model.mesh
    sensor, rng = Sensor(SHAPE, bits=0, background=128.0), np.random.default_rng(0)
    images = [next(render([moved], mesh.nodes, mesh.blocks, camera.at(k), texture, sensor, rng))
              for k, moved in enumerate(u)]
    return replace(body, recording=replace(body.recording, stack=ArrayStack(np.array(images))))


def responses(body, parameters, names=(), steps=None):
    """Every frame of a simulation with its derivatives  # list of FrameResponse, steps"""
    forward, made, state = build_forward(body), [], None
    for state in forward.march(parameters, names, steps=steps):
        made.append(FrameResponse(state.frame, state.u.copy(), state.channels.copy(), state.du.copy(),
                                  state.dchannels.copy(), state.local_du.copy(), state.local_dchannels.copy()))
    return made, np.array(state.steps.times)


def context(body, parameters):
    """Noise-weighted context of all free degrees of freedom."""
    forward = build_forward(body)
    names = parameters.free
    body = body.at_geometry(parameters)
    camera = camera_at(body, parameters)
    noise = np.array([channel.noise_std for channel in body.model.channels])
    return CorrelationContext(body, parameters, names, tuple(n for n in names if forward.moves(n)), camera,
                              build_experiment_reference(body, camera), Weights(0.5, 1.0, noise**-2, noise),
                              forward.drives.local_precision)


def all_rows(body, parameters, steps=None):
    """The context and (NodalEquations, FrameEquations) of every frame after the reference, and the responses."""
    shared = context(body, parameters)
    found, steps = responses(body, parameters, shared.moving, steps)
    none = np.zeros(0)
    return shared, [frame_equations(shared, response, none) for response in found[1:]], found, steps
