"""The strip with a hole of `side_twins`, pulled and pressed in three cycles, of a metal whose elastic range shrinks.

The truth is CalculiX's combined hardening in finite strains: its back stress is linear in the plastic strain
(`*PLASTIC, HARDENING=COMBINED`), its elastic range a table over the accumulated one (`*CYCLIC HARDENING`). CalculiX
thickens plane elements to solids that are clamped at the grips through the thickness: in a hundredth of the thickness
that does not show.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "external"))
from test_material_cards import pulled_by_calculix  # noqa: E402
from side_twins import GRIP_NOISE, LENGTH, NOISE, ORIGIN, PIXEL, RADIUS, SHAPE, THICKNESS, TOML, WIDTH  # noqa: E402

from idic.fe import ExpectedOutput, gathered, inp_text  # noqa: E402
from idic.images import Camera, dense_speckle  # noqa: E402
from idic.laws import compile as compile_law  # noqa: E402
from idic.laws import point  # noqa: E402
from idic.virtual_tests import (  # noqa: E402
    Sensor, clean_image, painted, record, strip_with_hole, write_images, write_inp, write_loads,
)

TRUE = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "C": 4000.0, "b": 20.0}  # MPa; and Q
AMPLITUDE, HALF_CYCLES, FRAMES = 0.08, 5, 5  # mm of the grip; half cycles after the first quarter, frames in each
GRIP = np.concatenate([[0.0], AMPLITUDE * np.linspace(0.25, 1.0, 4),
                       *(AMPLITUDE * (-1) ** k * np.linspace(1.0, -1.0, FRAMES + 1)[1:] for k in range(HALF_CYCLES))])
TIMES = np.arange(float(len(GRIP)))
FINE, USER = (6, 7, 5), (3, 4, 3)
THIN, FORCE_NOISE = 100.0, 4.0  # N: 2/1000 of the largest force
HARDENS = """*MATERIAL, NAME={name}
*ELASTIC
{E}, {nu}
*PLASTIC, HARDENING=COMBINED
{kinematic}
*CYCLIC HARDENING
{isotropic}
"""
DECK = """*SOLID SECTION, ELSET=BODY, MATERIAL=BODY
{thickness}
*BOUNDARY
LEFT, 1, 2
RIGHT, 2, 2
*AMPLITUDE, NAME=GRIP
{grip}
*TIME POINTS, NAME=FRAMES, GENERATE
1, {end}, 1
*STEP, NLGEOM, INC=10000
*STATIC
0.5, {end}, 1e-6, 0.5
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""
MATERIAL = """law = "j2_kinematic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 170, unit = "MPa", identify = true }
hardening_modulus = 0.0
C = { value = 2500, unit = "MPa", identify = true }
"""


def material(name: str, Q: float) -> str:
    """CalculiX's lines; Q : MPa by which the elastic range grows."""
    p = np.concatenate([np.linspace(0.0, 0.3, 61), [0.4, 0.6, 1.0, 2.0]])
    rows = lambda values, at: "\n".join(f"{s:.9g}, {x:.9g}" for s, x in zip(values, at, strict=True))  # noqa: E731
    first, ends = TRUE["yield_stress"], np.array([0.0, 1.0])
    return HARDENS.format(name=name, E=TRUE["E"], nu=TRUE["nu"], kinematic=rows(first + TRUE["C"] * ends, ends),
                          isotropic=rows(first + Q * (1.0 - np.exp(-TRUE["b"] * p)), p))


def fitted_to_one_element(folder: Path, Q: float) -> dict[str, float]:
    """The parameters with which the law follows one element of CalculiX best through these cycles of the mean strain.

    Not those of the card: CalculiX has the Cauchy stress in the yield condition, and convects its back stress.
    """
    law, turns = compile_law("j2_chaboche"), AMPLITUDE / LENGTH * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    strain = np.concatenate([[0.0], *(np.linspace(a, b, 21)[1:] for a, b in zip(turns[:-1], turns[1:], strict=True))])
    theirs = pulled_by_calculix(folder, material("M", Q), strain)
    names = law.spec.parameter_names
    values = np.array([(TRUE | {"Q": Q}).get(name, 0.0) for name in names])
    free = [names.index(name) for name in ("E", "yield_stress", "Q", "b", "C")]
    for _ in range(6):  # Gauss and Newton
        curve = point.uniaxial(law, values, strain)
        slopes = curve.dP[1:, free, 0, 0] * values[free]
        values[free] *= 1.0 + np.linalg.lstsq(slopes, theirs - curve.P[1:, 0, 0], rcond=None)[0]
    return {names[k]: float(values[k]) for k in free}


def simulated(folder: Path, Q: float):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    folder.mkdir(parents=True)
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *FINE, name="BODY")
    grip = "\n".join(f"{t:g}, {x:.9g}" for t, x in zip(TIMES, GRIP, strict=True))
    (folder / "strip.inp").write_text(
        inp_text(mesh, "cycles", {"quad8": "CPS8R"}) + f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n"
        + material("BODY", Q) + DECK.format(thickness=THICKNESS / THIN, grip=grip, end=len(GRIP) - 1))
    done = subprocess.run(["ccx", "-i", "strip"], cwd=folder, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    wanted = ExpectedOutput(mesh.node_labels, 2, np.arange(1.0, len(GRIP)), ("RIGHT.x",), mesh.node_sets, float(LENGTH))
    found = gathered("calculix_dat", folder, "strip", wanted)
    return mesh, found.u, THIN * found.forces["RIGHT.x"]


def write_strip(folder: Path, Q: float, seed: int = 0) -> Path:
    """The experiment folder of a user who knows a back stress and an elastic range that stays."""
    mesh, u, force = simulated(folder / "ccx", Q)
    test = folder / "test"
    (test / "images").mkdir(parents=True)
    camera = Camera.from_table(PIXEL, ORIGIN)
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 30.0, 225.0, extent_px=400.0), camera)
    rng, sensor = np.random.default_rng(100 + seed), Sensor(SHAPE, noise_std=NOISE, background=30.0)
    clean = Sensor(SHAPE, background=30.0)
    write_images(test, (record(clean_image(moved, mesh.nodes, mesh.blocks, camera, texture, clean), sensor, rng)
                        for moved in u))
    write_loads(test, TIMES, {"force_N": force + FORCE_NOISE * rng.standard_normal(len(TIMES)),
                              "grip_mm": GRIP + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0)})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *USER, name="BODY"), test / "mesh.inp", "twin")
    head, _, rest = TOML.partition("[material.BODY]\n")
    toml = f"{head}[material.BODY]\n{MATERIAL}\n{rest[rest.index('[[boundary]]'):]}"
    (test / "experiment.toml").write_text(toml.replace("noise_std = 0.5", f"noise_std = {FORCE_NOISE}"))
    return test / "experiment.toml"
