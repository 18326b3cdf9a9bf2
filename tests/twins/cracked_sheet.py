"""A sheet whose crack grows from its left edge, pulled by a known force: the truth by CalculiX (CPS8), one mesh per
length of the crack, whose nodes exist twice along it; images by `idic.virtual_tests`.

Nothing of the truth is made by idic's code of cracks. Energy release rates are differences of the work of the force
between cracks a little shorter and longer.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

from idic.fe import Mesh, make_mesh
from idic.images import Camera
from idic.virtual_tests import (
    Sensor, clean_image, empty_folder, medium_speckle, record, write_images, write_inp, write_loads,
)

WIDTH, HEIGHT, THICKNESS = 20.0, 24.0, 1.5  # mm
E, NU = 3000.0, 0.36  # MPa
LENGTHS = (4.0, 4.0, 4.6, 5.5, 6.7, 7.3)  # mm, per frame, the reference first
FORCES = (0.0, 300.0, 300.0, 290.0, 270.0, 250.0)  # N
PIXEL, SHAPE = 0.1, (270, 230)
NOISE = 1.5  # GV
ACROSS = 14.3  # mm, where the crack lies: no row of nodes of the mesh that correlates

HEAD = f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {THICKNESS}

[camera]
pixel_size_mm = {PIXEL}
origin_px = [14.6, 254.3]
noise_std_gv = {NOISE}

[material.SHEET]
law = "elastic"
E = {{ value = 2500, unit = "MPa", identify = true }}
nu = {{ value = 0.3, identify = true }}

[[boundary]]
nodes = "BOTTOM"
ux = 0.0
uy = 0.0
[[boundary]]
edges = "TOP"
force = {{ column = "force_N", component = "y" }}
"""
CRACK = f"""
[[crack]]
name = "edge"
path_mm = [[-1.0, {ACROSS}], [11.0, {ACROSS}]]
length_mm = {{ value = 3.0, identify = true }}
"""
CLAMPED_PIXEL, CLAMPED_ORIGIN, CLAMPED_SHAPE = 0.2, (5.6, 124.6), (130, 112)
GRIP, GRIP_NOISE, FORCE_NOISE = 0.08 * np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0]), 3e-4, 0.5  # mm, mm, N
GRIPS = """[[boundary]]
nodes = "BOTTOM"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "TOP"
ux = 0.0
uy = { column = "grip_mm", noise_std = 3e-4 }

[[channel]]
column = "force_N"
simulated = { reaction = "TOP", component = "y" }
noise_std = 0.5
"""
GROWING = "knots = [1, 2, 3, 4, 5]\n"

DECK = """*MATERIAL, NAME=M
*ELASTIC
{E}, {nu}
*SOLID SECTION, ELSET=SHEET, MATERIAL=M
{thickness}
*BOUNDARY
BOTTOM, 1, 2, 0
*STEP
*STATIC
{loads}
*NODE PRINT, NSET=ALL
U
*NODE PRINT, NSET=TOP, TOTALS=ONLY
RF
*END STEP
"""


def graded(start: float, end: float, size: float, finest: float, at: float) -> np.ndarray:
    """Places from start to end with steps that grow from `finest` at one of them."""
    def one_way(length: float) -> np.ndarray:
        steps, step = [], finest
        while sum(steps) < length:
            steps.append(step)
            step = min(1.25 * step, size)
        return np.cumsum(steps) * length / sum(steps)
    return np.concatenate([at - one_way(at - start)[::-1], [at], at + one_way(end - at)])


def truth_mesh(length: float) -> Mesh:
    """Eight-node quadrilaterals, fine at the tip; the nodes of the faces exist twice."""
    x, y = graded(0.0, WIDTH, 1.0, 0.04, length), graded(0.0, HEIGHT, 1.0, 0.04, ACROSS)
    xs, ys = (np.sort(np.concatenate([v, 0.5 * (v[1:] + v[:-1])])) for v in (x, y))
    number = np.arange(len(xs) * len(ys)).reshape(len(ys), len(xs))
    i, j = np.meshgrid(np.arange(0, len(xs) - 1, 2), np.arange(0, len(ys) - 1, 2))
    i, j = i.ravel(), j.ravel()
    around = [(0, 0), (0, 2), (2, 2), (2, 0), (0, 1), (1, 2), (2, 1), (1, 0)]
    cells = np.stack([number[j + dj, i + di] for dj, di in around], axis=1)
    nodes = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    faces = np.flatnonzero((np.abs(nodes[:, 1] - ACROSS) < 1e-9) & (nodes[:, 0] < length - 1e-9))
    double = np.arange(len(nodes))
    double[faces] = len(nodes) + np.arange(len(faces))
    below = nodes[cells[:, :4], 1].mean(axis=1) < ACROSS
    cells[below] = double[cells[below]]
    nodes = np.vstack([nodes, nodes[faces]])
    used = np.unique(cells)
    renumbered = np.full(len(nodes), -1)
    renumbered[used] = np.arange(len(used))
    nodes = nodes[used]
    return make_mesh(nodes, [("quad8", renumbered[cells])], element_sets={"SHEET": np.arange(len(cells))},
                     node_sets={"BOTTOM": np.flatnonzero(nodes[:, 1] < 1e-9), "ALL": np.arange(len(nodes))})


def top_nodes(mesh: Mesh) -> np.ndarray:
    return np.flatnonzero(mesh.nodes[:, 1] > HEIGHT - 1e-9)


def top_forces(mesh: Mesh) -> np.ndarray:
    """Nodal forces of a uniform pull of 1 N along y  # (n_nodes,)"""
    forces = np.zeros(mesh.n_nodes)
    for cell in mesh.blocks[0].connectivity:
        top = [node for node in cell[[3, 6, 2]] if abs(mesh.nodes[node, 1] - HEIGHT) < 1e-9]
        if len(top) == 3:
            span = np.ptp(mesh.nodes[top, 0]) / WIDTH
            forces[top] += span * np.array([1.0, 4.0, 1.0]) / 6.0
    return forces


def solved(folder: Path, length: float, clamped: bool = False) -> tuple[Mesh, np.ndarray, float]:
    """Mesh, motion under 1 N (n_nodes, 2) mm, and the work of the force (N mm), by CalculiX; clamped : under 1 mm of a
    stiff grip, whose force in N is twice that work."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = truth_mesh(length)
    forces = top_forces(mesh)
    loads = "*CLOAD\n" + "\n".join(f"{k + 1}, 2, {force:.12g}" for k, force in enumerate(forces) if force)
    if clamped:
        loads = "*BOUNDARY\nTOP, 1, 1, 0\nTOP, 2, 2, 1.0"
    lines = ["*NODE, NSET=ALL", *(f"{k + 1}, {x:.12g}, {y:.12g}, 0" for k, (x, y) in enumerate(mesh.nodes)),
             "*ELEMENT, TYPE=CPS8, ELSET=SHEET",
             *(f"{k + 1}, " + ", ".join(map(str, cell + 1)) for k, cell in enumerate(mesh.blocks[0].connectivity)),
             "*NSET, NSET=BOTTOM", *(f"{k + 1}," for k in mesh.node_sets["BOTTOM"]),
             "*NSET, NSET=TOP", *(f"{k + 1}," for k in top_nodes(mesh))]
    (folder / "sheet.inp").write_text("\n".join(lines) + "\n" + DECK.format(E=E, nu=NU, thickness=THICKNESS,
                                                                            loads=loads))
    done = subprocess.run(["ccx", "-i", "sheet"], cwd=folder, capture_output=True, text=True, timeout=600, check=False,
                          env={"OMP_NUM_THREADS": "1", "PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, done.stdout[-2000:]
    entries = [line.split() for line in (folder / "sheet.dat").read_text().splitlines()]
    rows = np.array([entry for entry in entries if len(entry) == 4 and entry[0].isdigit()], dtype=float)
    u = np.zeros((mesh.n_nodes, 2))
    u[rows[:, 0].astype(int) - 1] = rows[:, 1:3]
    if clamped:
        (total,) = [entry for entry in entries if len(entry) == 3 and entry[0][-1].isdigit()]
        return mesh, u, 0.5 * float(total[1])
    return mesh, u, 0.5 * float(forces @ u[:, 1])


def release_rate(folder: Path, length: float, step: float = 0.1) -> float:
    """Energy release rate under 1 N, N/mm per N²"""
    works = [solved(folder / f"{length + way * step:.3f}", length + way * step)[2] for way in (-1.0, 1.0)]
    return (works[1] - works[0]) / (2.0 * step) / THICKNESS


def write_sheet(folder: Path, ccx: Path, tables: str = CRACK + GROWING, n_across: int = 20, seed: int = 3,
                lengths: tuple = LENGTHS) -> Path:
    """The experiment folder of the sheet; n_across : elements over the width of the mesh that correlates."""
    camera = Camera.from_table(PIXEL, (14.6, 254.3))
    empty_folder(folder)
    rng, sensor = np.random.default_rng(seed), Sensor(SHAPE, bits=8, noise_std=np.sqrt(NOISE**2 - 1.0 / 12.0),
                                                      background=10.0)
    texture = medium_speckle(camera, SHAPE)(rng, 255.0)
    images, known = [], {}
    for length, force in zip(lengths, FORCES, strict=True):
        mesh, u, _ = known.setdefault(length, solved(ccx / f"{length:.3f}", length))
        images.append(record(clean_image(force * u, mesh.nodes, mesh.blocks, camera, texture, sensor), sensor, rng))
    write_images(folder, images)
    write_loads(folder, np.arange(len(FORCES), dtype=float), {"force_N": np.array(FORCES)})
    write_inp(plain_mesh(n_across), folder / "mesh.inp", "sheet")
    (folder / "experiment.toml").write_text(HEAD + tables)
    return folder / "experiment.toml"


def clamped_sheet(folder: Path, ccx: Path, lengths: tuple, n_across: int = 14, seed: int = 3) -> Path:
    """The experiment folder of the same sheet between stiff grips, in small images and without a [[crack]]."""
    camera = Camera.from_table(CLAMPED_PIXEL, CLAMPED_ORIGIN)
    empty_folder(folder)
    rng, sensor = np.random.default_rng(seed), Sensor(CLAMPED_SHAPE, bits=8, noise_std=np.sqrt(NOISE**2 - 1.0 / 12.0),
                                                      background=10.0)
    texture = medium_speckle(camera, CLAMPED_SHAPE)(rng, 255.0)
    known = {length: solved(ccx / f"{length:.3f}", length, clamped=True) for length in set(lengths)}
    images, force = [], []
    for length, grip in zip(lengths, GRIP, strict=True):
        mesh, u, work = known[length]
        images.append(record(clean_image(grip * u, mesh.nodes, mesh.blocks, camera, texture, sensor), sensor, rng))
        force.append(2.0 * work * grip)
    write_images(folder, images)
    loaded = GRIP > 0.0
    write_loads(folder, np.arange(len(GRIP), dtype=float), {
        "force_N": np.array(force) + FORCE_NOISE * loaded * rng.standard_normal(len(GRIP)),
        "grip_mm": GRIP + GRIP_NOISE * loaded * rng.standard_normal(len(GRIP))})
    write_inp(plain_mesh(n_across), folder / "mesh.inp", "sheet")
    head = HEAD[:HEAD.index("[[boundary]]")].replace(f"= {PIXEL}", f"= {CLAMPED_PIXEL}").replace(
        "[14.6, 254.3]", f"[{CLAMPED_ORIGIN[0]}, {CLAMPED_ORIGIN[1]}]")
    (folder / "experiment.toml").write_text(head + GRIPS)
    return folder


def plain_mesh(n_across: int) -> Mesh:
    """Four-node squares, without a crack."""
    n, m = n_across, round(n_across * HEIGHT / WIDTH)
    nodes = np.stack(np.meshgrid(np.linspace(0, WIDTH, n + 1), np.linspace(0, HEIGHT, m + 1)), axis=-1).reshape(-1, 2)
    first = (np.arange(m)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1)
    top = np.stack([np.arange(n * (m - 1), n * m), np.full(n, 2)], axis=1)
    return make_mesh(nodes, [("quad4", cells)], element_sets={"SHEET": np.arange(len(cells))},
                     node_sets={"BOTTOM": np.arange(n + 1), "TOP": np.arange((n + 1) * m, len(nodes))},
                     edge_sets={"TOP": top})
