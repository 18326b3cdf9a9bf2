"""The strip with a hole of `side_twins` of a rubber that stiffens (Yeoh): the truth by CalculiX, in finite strains.

dW/dI1 grows with I1; no candidate has a term for it. CalculiX thickens plane elements to solids that are clamped at the
grips through the thickness: in a hundredth of the thickness that does not show.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from material_twins import RUBBER
from side_twins import LENGTH, RADIUS, THICKNESS, TIMES, WIDTH, Side, write_folder

import side_twins
from idic.fe import ExpectedOutput, gathered, inp_text
from idic.virtual_tests import strip_with_hole, write_inp

FINE, USER = (8, 8, 6), (4, 5, 4)
THIN = 100.0
C10, C20, C30, KAPPA = 0.4, 0.08, 0.05, 20.0  # MPa
GRIP = 3.0 * np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.9, 1.0, 0.8, 0.5, 0.2])
DECK = """*MATERIAL, NAME=BODY
*HYPERELASTIC, YEOH
{C10}, {C20}, {C30}, {D1}, 1e8, 1e8
*SOLID SECTION, ELSET=BODY, MATERIAL=BODY
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


def slope(i1: np.ndarray) -> np.ndarray:
    """dW/dI1 (MPa) at I1 - 3."""
    return C10 + 2.0 * C20 * i1 + 3.0 * C30 * i1**2


def simulated(folder: Path):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    folder.mkdir(parents=True)
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *FINE, name="BODY")
    (folder / "strip.inp").write_text(
        inp_text(mesh, "rubber", {"quad8": "CPS8R"}) + f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n" + DECK.format(
            C10=C10, C20=C20, C30=C30, D1=2.0 / KAPPA, thickness=THICKNESS / THIN, end=len(GRIP) - 1,
            grip="\n".join(f"{t:g}, {x:.9g}" for t, x in zip(TIMES, GRIP, strict=True))))
    done = subprocess.run(["ccx", "-i", "strip"], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    wanted = ExpectedOutput(mesh.node_labels, 2, np.arange(1.0, len(GRIP)), ("RIGHT.x",), mesh.node_sets, float(LENGTH))
    found = gathered("calculix_dat", folder, "strip", wanted)
    return mesh, found.u, THIN * found.forces["RIGHT.x"]


def write_rubber(folder: Path, monkeypatch, seed: int = 0):
    """The experiment folder; the user believes in neo-Hooke's law."""
    head, _, rest = side_twins.TOML.partition("[material.BODY]\n")
    toml = f"{head}[material.BODY]\n{RUBBER.table}{rest[rest.index('[[boundary]]'):]}"
    monkeypatch.setattr(side_twins, "GRIP", GRIP)
    monkeypatch.setattr(side_twins, "FORCE_NOISE", 0.02)
    path = write_folder(folder / "test", Side(), seed, toml.replace("noise_std = 0.5", "noise_std = 0.02"),
                        simulated(folder / "ccx"))
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *USER, name="BODY"), path.parent / "mesh.inp", "twin")
    return path
