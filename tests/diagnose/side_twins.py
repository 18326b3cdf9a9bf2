"""A strip with a hole in which one thing is not as the model says: at the grips, the load cell, the camera, the body.

The truth is simulated by `idic.fe.time_march` on a finer mesh with motions, moduli and cameras of its own, and
rendered by
`idic.virtual_tests.rendering`; nothing of the corrections, distortions or heterogeneities of an experiment.toml is used
for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.linalg import block_diag

from idic.diagnose import candidate_library, residual_evidence, screen_candidates
from idic.diagnose.screen.practical import PracticalSize
from idic.diagnose.screen.situation import situation
from idic.diagnose.screen.free_courses import with_free_courses
from idic.diagnose.screen.score_columns import score_columns
from idic.experiment_file import load_experiment, read_toml
from idic.fe import Constraints, Body, Reaction, Section, march
from idic.identification import identify
from idic.images import Camera, dense_speckle
from idic.laws import compile as compile_law
from idic.virtual_tests import (
    Sensor, clean_image, painted, record, strip_with_hole, write_images, write_inp, write_loads,
)

LENGTH, WIDTH, RADIUS, PIXEL, THICKNESS = 10.0, 6.0, 1.0, 0.06, 1.5  # mm
SHAPE, ORIGIN = (116, 184), (91.7, 57.4)  # px
HOLE_REACH = 2.6  # mm from the middle, where the mesh of a misplaced hole is that of the plain strip
TRUTH = {"E": 2000.0, "nu": 0.35}
NOISE, FORCE_NOISE, GRIP_NOISE = 2.0, 0.5, 2e-4  # GV, N, mm
TIMES = np.arange(12.0)
GRIP = 0.12 * np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.0, 1.0, 0.7, 0.4, 0.1])  # up, hold, down
ANY_SIZE = PracticalSize(px=-1.0, channel_std=-1.0)  # of made-up rivals and screenings whose size is not in question

TOML = f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {THICKNESS}

[camera]
pixel_size_mm = {PIXEL}
origin_px = [{ORIGIN[0]}, {ORIGIN[1]}]
noise_std_gv = {np.hypot(NOISE, 12**-0.5):.4f}

[material.BODY]
law = "elastic"
E = {{ value = 1800, unit = "MPa", identify = true }}
nu = {{ value = 0.3, identify = true }}

[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0

[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm", noise_std = {GRIP_NOISE} }}
uy = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {FORCE_NOISE}
"""


@dataclass(frozen=True)
class Side:
    """What really happened where it is not what the log and the model say.

    motion : {(set, component): (n_frames, 2 or more)} mean motion (mm), slope along y (rad), and (mm) the Legendre
    polynomials along the set from the second on, on top of the log's; modulus : factor of E at element centres (n, 2);
    camera, image : per frame; force : of the simulated (n_frames,).
    """

    motion: dict = field(default_factory=dict)
    modulus: Callable | None = None
    camera: Callable | None = None  # (base camera, frame) -> camera
    image: Callable | None = None  # (clean image, frame) -> image
    force: Callable | None = None
    log_late: float = 0.0  # s by which the log lags behind the images
    compliance: float = 0.0  # mm/N of the machine, in the log
    radius: float = RADIUS  # mm, of the hole
    hole_at: tuple[float, float] = (0.0, 0.0)  # mm, its centre
    toe: Callable | None = None  # way (mm) that the log shows and the specimen does not, of the force (n_frames,)


def truth(side: Side):
    """Clean motion and force on the fine mesh  # mesh, (n_frames, n_nodes, 2), (n_frames,)"""
    mesh = strip_with_hole(LENGTH, WIDTH, side.radius, "quad8", 8, 8, 6, name="BODY")
    if any(side.hole_at):  # the nodes around it move along, less and less outwards
        share = np.clip((HOLE_REACH - np.hypot(*mesh.nodes.T)) / (HOLE_REACH - side.radius), 0.0, 1.0)
        mesh = replace(mesh, nodes=mesh.nodes + share[:, None] * side.hole_at)
    factor = np.ones(mesh.n_elements)
    if side.modulus is not None:
        centres = np.array([mesh.nodes[conn[:4]].mean(axis=0) for conn in mesh.blocks[0].connectivity])
        factor = np.round(side.modulus(centres), 2)
    dofs, basis, load_histories = [], [], []
    for name in ("LEFT", "RIGHT"):
        nodes = mesh.node_sets[name]
        for k, component in enumerate("xy"):
            extra = side.motion.get((name, component), np.zeros((len(TIMES), 2)))
            mean = extra[:, 0] + (GRIP if (name, component) == ("RIGHT", "x") else 0.0)
            y = mesh.nodes[nodes, 1]
            further = legvander(2.0 * y / WIDTH, max(extra.shape[1] - 1, 1))[:, 2:]
            dofs.append(2 * nodes + k)
            basis.append(np.column_stack([np.ones(len(y)), y, further]))
            load_histories += [mean, *extra.T[1:]]
    dofs = np.concatenate(dofs)
    pattern = block_diag(*basis)
    law = compile_law("elastic", None)
    values, sections = {}, []
    for f in np.unique(factor):
        name = f"BODY{f}"
        sections.append(Section(name, law, np.flatnonzero(factor == f)))
        values[name] = np.array([{"E": TRUTH["E"] * f, "nu": TRUTH["nu"]}[p] for p in law.spec.parameter_names])
    model = Body(mesh=mesh, kind="plane_stress", sections=tuple(sections), thickness=THICKNESS,
                  constraints=Constraints(dofs, pattern, np.array(load_histories).T),
                  channels=(Reaction(2 * mesh.node_sets["RIGHT"]),))
    states = [(s.u.copy(), s.channels[0]) for s in march(model, values, TIMES)]
    return mesh, np.array([u for u, _ in states]), np.array([f for _, f in states])


def write_folder(folder, side: Side, seed: int = 0, toml: str = TOML, simulated=None):
    """The experiment folder of a twin; returns its experiment.toml.

    simulated : mesh, motion and force of another code in place of `truth(side)`
    """
    mesh, u, force = truth(side) if simulated is None else simulated
    camera = Camera.from_table(PIXEL, ORIGIN, centre=((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2))
    first = camera if side.camera is None else side.camera(camera, 0)
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 30.0, 225.0, extent_px=400.0), first)
    rng = np.random.default_rng(100 + seed)
    sensor, clean = Sensor(SHAPE, noise_std=NOISE, background=30.0), Sensor(SHAPE, background=30.0)

    def images():
        for k, moved in enumerate(u):
            seen = camera if side.camera is None else side.camera(camera, k)
            image = clean_image(moved, mesh.nodes, mesh.blocks, seen, texture, clean)
            yield record(image if side.image is None else side.image(image, k), sensor, rng)

    folder.mkdir(parents=True)
    (folder / "images").mkdir()
    write_images(folder, images())
    late = lambda values: np.interp(TIMES - side.log_late, TIMES, values)  # noqa: E731
    lost = 0.0 if side.toe is None else side.toe(force)
    grip = late(GRIP + side.compliance * force + lost) + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0)
    shown = force if side.force is None else side.force(force)
    write_loads(folder, TIMES, {"force_N": late(shown) + FORCE_NOISE * rng.standard_normal(len(TIMES)),
                                "grip_mm": grip})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 3, 4, 3, name="BODY"), folder / "mesh.inp", "twin")
    (folder / "experiment.toml").write_text(toml)
    return folder / "experiment.toml"


def screening(path, names=None, own_courses=False):
    """The null model identified and all candidates (or those named) scored  # Identification, Screening

    own_courses : with courses that the data give, too, as `idic diagnose` does
    """
    def load(edits):
        return load_experiment(path, edits)

    found = identify(load_experiment(path))
    residual = residual_evidence(found)
    where = situation(found, residual, read_toml(path))
    trials = [(c, v) for c in candidate_library() if names is None or c.name in names for v in c.variants(where)]
    if own_courses:
        trials += with_free_courses(trials, where.document, found.parameters.free, load)
    labels, columns = score_columns(found, residual, trials, load)
    return found, screen_candidates(residual.evidence, residual.null, labels, columns)


def refit(path, variant):
    """The enriched experiment identified, from the variant's probe where it is finite  # Identification"""
    return identify(load_experiment(path, dict(variant.edits) | dict(variant.refit)))
