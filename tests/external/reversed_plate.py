"""A plate with a hole that is pulled, pressed back and pulled again: combined hardening, the truth by CalculiX.

Its back stress is linear in the plastic strain (`*PLASTIC, HARDENING=COMBINED`), the size of its yield surface in the
accumulated one (`*CYCLIC HARDENING`).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "twins"))
import open_hole as plate  # noqa: E402
from test_material_cards import pulled_by_calculix  # noqa: E402
from warm_strip import THIN, solved  # noqa: E402

from idic.images import dense_speckle  # noqa: E402
from idic.laws import point  # noqa: E402
from idic.laws import compile, get_law, material_card  # noqa: E402
from idic.virtual_tests import (  # noqa: E402
    Sensor, clean_image, painted, record, strip_with_hole, write_images, write_inp, write_loads,
)

E, NU, YIELD, H, C = 70e3, 0.3, 200.0, 1500.0, 4000.0
GRIP = np.concatenate([np.linspace(0.0, 0.06, 3), np.linspace(0.06, 0.20, 5)[1:], np.linspace(0.20, -0.16, 6)[1:],
                       np.linspace(-0.16, 0.0, 3)[1:]])
TRUE = {"around": 6, "radial": 8, "beside": 4, "grading": 1.5}  # nowhere the nodes of the user
USER = {"around": 4, "radial": 6, "beside": 3}
DECK = """*INCLUDE, INPUT=mesh.inp
*MATERIAL, NAME=SHEET
*ELASTIC
{E}, {nu}
*PLASTIC, HARDENING=COMBINED
{kinematic}
*CYCLIC HARDENING
{isotropic}
*SOLID SECTION, ELSET=sheet, MATERIAL=SHEET
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
0.25, {end}, 1e-6, 0.25
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""
MATERIAL = """
[material.sheet]
law = "elastoplastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 170, unit = "MPa", identify = true }
hardening = [{ kind = "linear", H = { value = 1000, unit = "MPa", identify = true } }]
backstress = [{ kind = "prager", C = { value = 2500, unit = "MPa", identify = true } }]
"""


def truth_by_calculix(folder: Path):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    mesh = strip_with_hole(plate.LENGTH, plate.WIDTH, plate.RADIUS, "quad8", **TRUE)
    write_inp(mesh, folder / "mesh.inp", "plate")
    text = (folder / "mesh.inp").read_text()
    everything = f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n"
    (folder / "mesh.inp").write_text(text.replace("TYPE=CPS8", "TYPE=CPS8R") + everything)
    table = lambda slope: "\n".join(f"{YIELD + slope * p}, {p}" for p in (0.0, 0.5))  # noqa: E731
    (folder / "plate.inp").write_text(DECK.format(
        E=E, nu=NU, kinematic=table(C), isotropic=table(H), thickness=plate.THICKNESS / THIN, end=len(GRIP) - 1,
        grip="\n".join(f"{k}, {v:.9g}" for k, v in enumerate(GRIP))))
    return mesh, *solved(folder, "plate", mesh.n_nodes)


def fitted_to_one_element(folder: Path) -> dict[str, float]:
    """E, yield_stress, H and C with which the law follows one element of CalculiX best, through 2 and -1.5 % and back.

    Not those of the card: CalculiX has the Cauchy stress in the yield condition, and convects its back stress.
    """
    law = get_law("elastoplastic(linear+prager)")
    values = np.array([E, NU, YIELD, H, C])
    card = material_card("M", law.name, dict(zip(law.parameter_names, values, strict=True)), "calculix", reached=0.5)
    strain = np.concatenate([np.linspace(0.0, 0.02, 41), np.linspace(0.02, -0.015, 61)[1:],
                             np.linspace(-0.015, 0.0, 41)[1:]])
    theirs, free = pulled_by_calculix(folder, card.text, strain), np.array([0, 2, 3, 4])
    for _ in range(5):  # Gauss and Newton
        curve = point.uniaxial(compile(law.name), values, strain)
        slopes = curve.dP[1:, free, 0, 0] * values[free]
        values[free] *= 1.0 + np.linalg.lstsq(slopes, theirs - curve.P[1:, 0, 0], rcond=None)[0]
    return {law.parameter_names[k]: float(values[k]) for k in free}


def write_folder(folder: Path, truth, seed: int = 0) -> Path:
    """The experiment of a user with a mesh of his own."""
    mesh, u, force = truth
    speckle = dense_speckle(np.random.default_rng(5), 1.6, 20.0, 235.0, extent_px=420.0)
    texture, sensor = painted(speckle, plate.CAMERA), Sensor(plate.SHAPE, noise_std=plate.NOISE, background=25.0)
    rng = np.random.default_rng(50 + seed)
    (folder / "images").mkdir(parents=True)
    write_images(folder, (record(clean_image(x, mesh.nodes, mesh.blocks, plate.CAMERA, texture, sensor), sensor, rng)
                          for x in u))
    noise = plate.FORCE_NOISE * rng.standard_normal(len(force))
    write_loads(folder, np.arange(len(u), dtype=float), {"force_N": force + noise, "grip_mm": GRIP})
    write_inp(strip_with_hole(plate.LENGTH, plate.WIDTH, plate.RADIUS, "quad8", **USER), folder / "mesh.inp", "plate")
    text = plate.TOML.replace("NOISE", f"{sensor.total_noise_std:.4f}", 1)
    (folder / "experiment.toml").write_text(text[:text.index("[material.sheet]")] + MATERIAL)
    return folder / "experiment.toml"
