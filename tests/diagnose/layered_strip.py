"""The strip with a hole of `side_twins` whose stiffness alternates in layers: the truth by CalculiX.

Elements of 0.1 mm are stiff or soft by their centres. In small strains one solution serves all frames. CalculiX
thickens plane elements to solids that are clamped at the grips through the thickness: in a hundredth of the thickness
that does not show.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from side_twins import GRIP, LENGTH, RADIUS, THICKNESS, TRUTH, WIDTH, Side, write_folder

from idic.diagnose import element_centres
from idic.fe import ExpectedOutput, gathered, inp_text
from idic.virtual_tests import strip_with_hole, write_inp

FINE = (28, 24, 22)  # elements around an eighth of the hole, from it to the square around, beside that
THIN = 100.0
DECK = """*MATERIAL, NAME=STIFF
*ELASTIC
{stiff}, {nu}
*MATERIAL, NAME=SOFT
*ELASTIC
{soft}, {nu}
*SOLID SECTION, ELSET=STIFF, MATERIAL=STIFF
{thickness}
*SOLID SECTION, ELSET=SOFT, MATERIAL=SOFT
{thickness}
*BOUNDARY
LEFT, 1, 2
RIGHT, 2, 2
*STEP
*STATIC
*BOUNDARY
RIGHT, 1, 1, {grip}
*NODE PRINT, NSET=ALL
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY
RF
*END STEP
"""


@dataclass(frozen=True)
class Layers:
    """period, offset : mm; direction : degrees, across the layers; ratio : of stiff over soft; share : of the stiff
    ones. The geometric mean of both is the modulus of `TRUTH`."""

    period: float
    direction: float
    ratio: float
    offset: float = 0.3
    share: float = 0.5

    def stiff(self, at: np.ndarray) -> np.ndarray:
        """Which points (n, 2) mm are in a stiff layer  # (n,) bool"""
        turn = np.radians(self.direction)
        way = (at @ [np.cos(turn), np.sin(turn)] - self.offset) / self.period
        return np.abs(way - np.round(way)) < 0.5 * self.share


def simulated(folder: Path, layers: Layers):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    folder.mkdir(parents=True)
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *FINE, name="BODY")
    stiff = layers.stiff(element_centres(mesh))
    mesh.element_sets.update(STIFF=np.flatnonzero(stiff), SOFT=np.flatnonzero(~stiff))  # type: ignore[attr-defined]
    root = np.sqrt(layers.ratio)
    (folder / "strip.inp").write_text(
        inp_text(mesh, "layers", {"quad8": "CPS8"}) + f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n" + DECK.format(
            stiff=TRUTH["E"] * root, soft=TRUTH["E"] / root, nu=TRUTH["nu"], thickness=THICKNESS / THIN,
            grip=GRIP.max()))
    done = subprocess.run(["ccx", "-i", "strip"], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    wanted = ExpectedOutput(mesh.node_labels, 2, np.array([1.0]), ("RIGHT.x",), mesh.node_sets, float(LENGTH))
    found = gathered("calculix_dat", folder, "strip", wanted)
    course = GRIP / GRIP.max()
    return mesh, course[:, None, None] * found.u[-1], THIN * course * found.forces["RIGHT.x"][-1]


def write_layers(folder: Path, layers: Layers, seed: int = 0, user=(8, 8, 8)):
    """The experiment folder of a strip of layers; user : elements of the model's mesh, as `FINE`."""
    path = write_folder(folder / "test", Side(), seed, simulated=simulated(folder / "ccx", layers))
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *user, name="BODY"), path.parent / "mesh.inp", "twin")
    return path
