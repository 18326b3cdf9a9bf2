"""The strip with a hole of `side_twins` of a metal that softens in cycles: the truth by CalculiX, finite strains.

Its yield stress falls with the accumulated plastic strain; the user knows linear isotropic hardening.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from material_twins import PLASTIC
from side_twins import LENGTH, RADIUS, THICKNESS, TIMES, TRUTH, WIDTH, Side, write_folder

import side_twins
from idic.fe import ExpectedOutput, gathered, inp_text
from idic.virtual_tests import strip_with_hole, write_inp

FINE, USER = (8, 8, 6), (4, 5, 4)
THIN = 100.0
YIELD, Q, B = 30.0, -7.0, 25.0  # MPa, MPa, -
GRIP = 0.25 * np.array([0.0, 0.6, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.2])
DECK = """*MATERIAL, NAME=BODY
*ELASTIC
{E}, {nu}
*PLASTIC
{curve}
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
0.05, {end}, 1e-6, 0.1
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""


def simulated(folder: Path):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    folder.mkdir(parents=True)
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *FINE, name="BODY")
    p = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 60)])
    lines = lambda x, y: "\n".join(f"{a:.9g}, {b:.9g}" for a, b in zip(x, y, strict=True))  # noqa: E731
    (folder / "strip.inp").write_text(
        inp_text(mesh, "metal", {"quad8": "CPS8R"}) + f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n" + DECK.format(
            **TRUTH, curve=lines(YIELD + Q * (1.0 - np.exp(-B * p)), p), thickness=THICKNESS / THIN, end=len(GRIP) - 1,
            grip=lines(TIMES, GRIP)))
    done = subprocess.run(["ccx", "-i", "strip"], cwd=folder, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    wanted = ExpectedOutput(mesh.node_labels, 2, np.arange(1.0, len(GRIP)), ("RIGHT.x",), mesh.node_sets, float(LENGTH))
    found = gathered("calculix_dat", folder, "strip", wanted)
    return mesh, found.u, THIN * found.forces["RIGHT.x"]


def write_softening(folder: Path, monkeypatch, seed: int = 0):
    """The experiment folder."""
    head, _, tail = side_twins.TOML.partition("[material.BODY]\n")
    toml = f"{head}[material.BODY]\n{PLASTIC.table}{tail[tail.index('[[boundary]]'):]}"
    monkeypatch.setattr(side_twins, "GRIP", GRIP)
    path = write_folder(folder / "test", Side(), seed, toml, simulated(folder / "ccx"))
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *USER, name="BODY"), path.parent / "mesh.inp", "twin")
    return path
