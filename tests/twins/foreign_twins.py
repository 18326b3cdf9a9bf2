"""Sheets whose truth foreign finite elements have: stiffness loss, rate with back stress, a laminate in shear."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import open_hole as plate
from foreign_sheet import Material, moved_sheet
from strip_twin import strip_toml, write_recording, write_rest

from idic.fe import make_mesh
from idic.images import Camera
from idic.virtual_tests import Patch, mesh_patches, strip_with_hole

TRUE = {"around": 6, "radial": 9, "beside": 4, "grading": 1.5}  # nowhere the nodes of the user
USER = {"around": 4, "radial": 7, "beside": 3}
FINER_TRUE = {"around": 8, "radial": 12, "beside": 5, "grading": 1.5}
FINER_USER = {"around": 6, "radial": 11, "beside": 4}
SHAPE, PIXEL, ORIGIN = (150, 220), 0.06, (8.3, 140.6)  # image (px), mm, px
AXIS, NOTCHED = 25.0, (12.0, 18.0)  # of the laminate: deg, mm
SMALL = {"around": 1, "radial": 2, "beside": 1}
SYMMETRY = """[[boundary]]
nodes = "X0"
ux = 0.0
[[boundary]]
nodes = "Y0"
uy = 0.0
"""


@dataclass(frozen=True)
class Twin:
    """A course and a material: times (s), motion (n_frames, 2) mm of RIGHT against LEFT; law : its name in idic.

    With motion to the side it is a notched sheet, else a plate with a hole, of which a quarter is seen and computed.

    truth, fixed : {name without its element set: value}, parameters that are identified and that are known
    """

    law: str
    truth: dict[str, float]
    material: Material
    times: np.ndarray
    grip: np.ndarray
    fixed: dict[str, float] = field(default_factory=dict)
    force_noise: float = plate.FORCE_NOISE  # N

    @property
    def whole(self) -> bool:
        return bool(self.grip[:, 1].any())


def start(value: float, unit: str = "MPa") -> str:
    return f'{{ value = {value}, unit = "{unit}", identify = true }}'


def damaged() -> Twin:
    """Pulled to 2.3 %, unloaded in part four times, pressed back and pulled again; linear hardening, Lemaitre's damage
    at the hole to less than where the stress would fall with the strain."""
    t = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "hardening_1_H": 3000.0, "damage_S": 0.9, "damage_s": 1.0}
    pull = 0.042 * np.array([0.0, 1, 2, 3, 4, 5, 3.7, 5.4, 6.2, 7, 8, 6.3, 8.4, 9.2, 10, 11, 9, 11.4, 12.2, 13, 11, 9,
                             7.3, 6, 4.7, 6.7, 8.7])
    material = Material((t["E"], t["nu"]), t["yield_stress"], t["hardening_1_H"],
                        damage=(t["damage_S"], t["damage_s"]))
    return Twin("elastoplastic(linear+lemaitre)", t, material, np.arange(len(pull), dtype=float),
                np.column_stack([pull, 0.0 * pull]), {"damage_threshold": 0.0, "damage_length": 0.0}, force_noise=5.0)


DAMAGED = f"""
[material.sheet]
law = "elastoplastic"
E = {start(60e3)}
nu = {start(0.33, "-")}
yield_stress = {start(170)}
hardening = [{{ kind = "linear", H = {start(2500)} }}]
[material.sheet.damage]
kind = "lemaitre"
S = {start(1.3)}
s = {start(1.3, "-")}
threshold = 0.0
length = 0.0
"""
VISCOUS = f"""
[material.sheet]
law = "elastoplastic"
E = {start(60e3)}
nu = {start(0.33, "-")}
yield_stress = {start(170)}
hardening = [{{ kind = "linear", H = {start(1500)} }}]
backstress = [{{ kind = "prager", C = {start(3000)} }}]
[material.sheet.rate]
kind = "norton"
eta = {start(80, "MPa s")}
m = {start(4, "-")}
"""


def viscous() -> Twin:
    """Rates a hundred times apart, held, reversed fast and back slowly; linear hardening, Prager and Norton."""
    t = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "hardening_1_H": 2000.0, "backstress_1_C": 4000.0,
         "rate_eta": 100.0, "rate_m": 5.0}
    fast, slow = 0.04, 0.0006  # mm per step of 0.1 s; mm/s
    courses = [(0.1 * np.arange(1, 6), fast * np.arange(1, 6)), ([1.0, 4.0, 20.0], np.full(3, 0.2)),
               ([70.0, 140.0, 220.0], 0.2 + slow * (np.array([70.0, 140.0, 220.0]) - 20.0)),
               (220.0 + 0.15 * np.arange(1, 8), 0.32 - 0.075 * np.arange(1, 8)), ([222.0, 240.0], np.full(2, -0.205)),
               ([400.0, 600.0], -0.205 + slow * np.array([160.0, 360.0]))]
    times = np.concatenate([[0.0], *(np.asarray(own) for own, _ in courses)])
    pull = np.concatenate([[0.0], *(own for _, own in courses)])
    material = Material((t["E"], t["nu"]), t["yield_stress"], t["hardening_1_H"], C=t["backstress_1_C"],
                        eta=t["rate_eta"], m=t["rate_m"])
    return Twin("elastoplastic(linear+prager+norton)", t, material, times, np.column_stack([pull, 0.0 * pull]))


def laminate() -> Twin:
    """A notched sheet, pulled until it flows, sheared by 30 % and unloaded; Hill's surface on orthotropic
    elasticity, axis 1 at 25 deg."""
    t = {"elasticity_E1": 30e3, "elasticity_E2": 15e3, "elasticity_nu12": 0.3, "elasticity_G12": 5e3,
         "yield_stress": 100.0, "yield_surface_r0": 0.8, "yield_surface_r45": 1.8, "yield_surface_r90": 1.4,
         "hardening_1_H": 400.0}
    pull = np.array([0.0, 0.01, 0.02, 0.03, 0.045, 0.08, *np.full(13, 0.14)])
    shear = np.array([*np.zeros(7), 0.02, 0.05, 0.1, 0.2, 0.33, 0.48, 0.68, 0.92, 1.2, 1.18, 1.15, 1.1])
    r0, r45, r90 = (t[f"yield_surface_{name}"] for name in ("r0", "r45", "r90"))
    g = 1.0 / (1.0 + r0)  # of Hill's f, g, h, n
    hill = (r0 * g / r90, g, r0 * g, 0.5 * (r0 + r90) * (1.0 + 2.0 * r45) * g / r90)
    material = Material((30e3, 15e3, 0.3, 5e3, np.radians(AXIS)), t["yield_stress"], t["hardening_1_H"], hill=hill)
    return Twin("elastoplastic(orthotropic+hill48+linear)", t, material, np.arange(len(pull), dtype=float),
                np.column_stack([pull, shear]), {"elasticity_angle": AXIS})


LAMINATE = f"""
[material.sheet]
law = "elastoplastic"
yield_stress = {start(85)}
yield_surface = {{ kind = "hill48", r0 = {start(1, "-")}, r45 = {start(1.1, "-")}, r90 = {start(1, "-")} }}
hardening = [{{ kind = "linear", H = {start(300)} }}]
[material.sheet.elasticity]
kind = "orthotropic"
E1 = {start(26e3)}
E2 = {start(18e3)}
nu12 = {start(0.34, "-")}
G12 = {start(6e3)}
angle = {AXIS}
"""


def notched(along: int, across: int, even: float = 0.5):
    """A sheet 12 x 18 mm, half as wide in the middle; even : 1, elements of one length; less: shorter in the middle."""
    length, width = NOTCHED

    def shape(s, t):
        k = 2.0 * s - 1.0
        x = 0.5 * length * (even * k + (1.0 - even) * k**3)
        return x, width * (t - 0.5) * (1.0 - 0.5 * np.exp(-(x / 3.0) ** 2))

    nodes, cells = mesh_patches([Patch(shape, along, across)], "quad8")
    ends = {name: np.flatnonzero(np.abs(nodes[:, 0] - x) < 1e-6)
            for name, x in (("LEFT", -0.5 * length), ("RIGHT", 0.5 * length))}
    return make_mesh(nodes, [("quad8", cells)], node_sets=ends, element_sets={"sheet": np.arange(len(cells))})


def quarter(sizes: dict):
    """A quarter of the plate with node sets X0, Y0 and RIGHT."""
    mesh = strip_with_hole(plate.LENGTH, plate.WIDTH, plate.RADIUS, "quad8", **sizes)
    cells = mesh.blocks[0].connectivity
    used, cells = np.unique(cells[(mesh.nodes[cells].mean(axis=1) > 0.0).all(axis=1)], return_inverse=True)
    nodes, cells = mesh.nodes[used], cells.reshape(-1, 8)
    sets = {"X0": nodes[:, 0], "Y0": nodes[:, 1], "RIGHT": nodes[:, 0] - 0.5 * plate.LENGTH}
    return make_mesh(nodes, [("quad8", cells)], element_sets={"sheet": np.arange(len(cells))},
                     node_sets={name: np.flatnonzero(np.abs(x) < 1e-6) for name, x in sets.items()})


def drives(twin: Twin) -> list:
    """What moves the plate, for `moved_sheet`."""
    x, y, rest = twin.grip[:, 0], twin.grip[:, 1], 0.0 * twin.times
    if twin.whole:
        return [("LEFT", 0, rest), ("LEFT", 1, rest), ("RIGHT", 0, x), ("RIGHT", 1, y)]
    return [("X0", 0, rest), ("Y0", 1, rest), ("RIGHT", 0, 0.5 * x), ("RIGHT", 1, rest)]


def moved(twin: Twin, mesh, increments: int, steps: int):
    """Motion (n_frames, n_nodes, 2) mm and force of the whole plate (n_frames, 2) N"""
    u, forces, _ = moved_sheet(mesh, plate.THICKNESS, twin.material, twin.times, drives(twin), increments, steps)
    return u, forces[:, mesh.node_sets["RIGHT"]].sum(axis=1) * (1.0 if twin.whole else 2.0)


def converged(twin: Twin, mesh, increments: int, steps: int):
    """As `moved`, extrapolated to endlessly short steps: the flow of one is of first order without a rate."""
    (u, force), (finer_u, finer_force) = moved(twin, mesh, increments, steps), moved(twin, mesh, increments, 2 * steps)
    return 2.0 * finer_u - u, 2.0 * finer_force - force


def write_folder(folder: Path, twin: Twin, material: str, mesh, u: np.ndarray, force: np.ndarray,
                 sizes: dict = USER) -> Path:
    """The experiment of a user with a mesh of his own, who knows the terms and not their parameters."""
    rng = np.random.default_rng(150)
    noise = write_recording(folder, mesh, u, Camera.from_table(PIXEL, ORIGIN), SHAPE, plate.NOISE, rng,
                            texture_px=440.0)
    force = force[:, 0] + twin.force_noise * rng.standard_normal(force.shape)[:, 0]
    toml = strip_toml(PIXEL, ORIGIN, plate.THICKNESS, twin.force_noise).replace("NOISE", f"{noise:.4f}", 1)
    toml = toml.replace('[[boundary]]\nnodes = "LEFT"\nux = 0.0\nuy = 0.0\n', SYMMETRY)
    toml = toml.replace('component = "x" }', 'component = "x", factor = 2.0 }')
    return write_rest(folder, quarter(sizes), toml + material, twin.times,
                      {"force_N": force, "grip_mm": 0.5 * twin.grip[:, 0]})


def write_laminate(folder: Path, twin: Twin, mesh, u: np.ndarray, force: np.ndarray, user_mesh) -> Path:
    """The experiment of a user who knows the terms and the axes; both forces are measured."""
    rng, force_noise = np.random.default_rng(160), 3.0
    shape, pixel, origin = (210, 150), 0.1, (73.2, 110.2)
    noise = write_recording(folder, mesh, u, Camera.from_table(pixel, origin), shape, 2.0, rng, texture_px=400.0)
    force = force + force_noise * rng.standard_normal(force.shape)
    toml = strip_toml(pixel, origin, plate.THICKNESS, force_noise).replace("NOISE", f"{noise:.4f}", 1)
    toml = toml.replace('"grip_mm" }\nuy = 0.0', '"grip_mm" }\nuy = { column = "side_mm" }')
    toml += f"""[[channel]]
column = "side_N"
simulated = {{ reaction = "RIGHT", component = "y" }}
noise_std = {force_noise}
"""
    return write_rest(folder, user_mesh, toml + LAMINATE, twin.times, {
        "force_N": force[:, 0], "side_N": force[:, 1], "grip_mm": twin.grip[:, 0], "side_mm": twin.grip[:, 1]})
