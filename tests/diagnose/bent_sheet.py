"""The strip with a hole of `side_twins` as a thin sheet that bulges towards one camera while it is pulled.

The truth is one layer of bricks in finite strains (CalculiX), with a pressure from behind; its seen face is recorded by
ray tracing through a pinhole. The user knows a flat sheet and a size of pixel.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from idic_studies.trial.scenes.specimens import bricks
from side_twins import GRIP, GRIP_NOISE, LENGTH, NOISE, PIXEL, RADIUS, SHAPE, TIMES, TOML, TRUTH, WIDTH

from idic.fe import ExpectedOutput, gathered, inp_text
from idic.images import PinholeCamera, PlacedCamera
from idic.virtual_tests import Rig, Sensor, strip_with_hole, traced_images, write_images, write_inp, write_loads

THICKNESS, DISTANCE, FORCE_NOISE = 0.1, 40.0, 0.03  # mm, mm, N
FINE, USER = (8, 8, 6), (3, 4, 3)
AXIS = ((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2)
LENS = PinholeCamera(DISTANCE / PIXEL, DISTANCE / PIXEL, *AXIS, rotation=Rig.FROM_ABOVE,
                     translation_mm=[0.012, -0.006, DISTANCE])
LOAD = GRIP / GRIP.max()  # course of the bulge
DECK = """*MATERIAL, NAME=BODY
*ELASTIC
{E}, {nu}
*SOLID SECTION, ELSET=BODY, MATERIAL=BODY
*BOUNDARY
LEFT, 1, 3
RIGHT, 2, 3
*AMPLITUDE, NAME=GRIP
{grip}
*AMPLITUDE, NAME=PUSH
{push}
*TIME POINTS, NAME=FRAMES, GENERATE
1, {end}, 1
*STEP, NLGEOM, INC=10000
*STATIC
0.25, {end}, 1e-6, 0.5
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*DLOAD, AMPLITUDE=PUSH
BODY, P1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""


def simulated(folder: Path, bulge: np.ndarray):
    """Plane mesh of the seen face, its motion (n_frames, n_nodes, 3) mm and force (n_frames,) N

    bulge : (n_frames,) mm in the middle of a strip without a hole: a stretched membrane under even pressure
    """
    folder.mkdir(parents=True)
    flat = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *FINE, name="BODY")
    body = bricks(flat, THICKNESS)
    push = 8.0 * TRUTH["E"] * GRIP / LENGTH * THICKNESS * bulge / LENGTH**2
    course = lambda values: "\n".join(f"{t:g}, {x:.9g}" for t, x in zip(TIMES, values, strict=True))  # noqa: E731
    (folder / "sheet.inp").write_text(
        inp_text(body, "sheet", {"hex20": "C3D20R"}) + f"*NSET, NSET=ALL, GENERATE\n1, {body.n_nodes}\n"
        + DECK.format(**TRUTH, grip=course(GRIP), push=course(push), end=len(TIMES) - 1))
    done = subprocess.run(["ccx", "-i", "sheet"], cwd=folder, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    wanted = ExpectedOutput(body.node_labels, 3, np.arange(1.0, len(TIMES)), ("RIGHT.x",), body.node_sets,
                            float(LENGTH))
    found = gathered("calculix_dat", folder, "sheet", wanted)
    return flat, found.u[:, :flat.n_nodes], found.forces["RIGHT.x"]


def write_sheet(folder: Path, bulge: np.ndarray, seed: int = 0, camera: str = f"distance_mm = {DISTANCE}") -> Path:
    """The experiment folder; returns its experiment.toml. camera : what else the user knows of it"""
    mesh, u, force = simulated(folder / "ccx", bulge)
    np.save(folder / "truth.npy", u)
    rng, test = np.random.default_rng(100 + seed), folder / "test"
    (test / "images").mkdir(parents=True)
    sensor = Sensor(SHAPE, noise_std=NOISE, background=30.0)
    write_images(test, traced_images(mesh, None, PlacedCamera(LENS), u, sensor, rng))
    write_loads(test, TIMES, {"force_N": force + FORCE_NOISE * rng.standard_normal(len(TIMES)),
                              "grip_mm": GRIP + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0)})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *USER, name="BODY"), test / "mesh.inp", "twin")
    toml = TOML.replace('law = "elastic"', 'law = "elastic"\nkinematics = "finite"')
    toml = toml.replace("thickness_mm = 1.5", f"thickness_mm = {THICKNESS}").replace("[camera]", f"[camera]\n{camera}")
    (test / "experiment.toml").write_text(toml.replace("noise_std = 0.5", f"noise_std = {FORCE_NOISE}"))
    return test / "experiment.toml"
