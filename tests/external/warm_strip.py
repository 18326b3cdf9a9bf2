"""A waisted strip that is warmed while it is pulled: the truth by CalculiX, with tables linear in the temperature.

CalculiX (2.20) takes the thermal strain e from the displacement gradient, not from the stretch, and its Cauchy stress
is 1 / (1 + e) of the material's (`test_material_cards.py`): strains are off by e times the strain, more than the noise
here. But a body of one temperature expands alike everywhere. With s = 1 + e its motion is x = s y, where y is that of a
body that does not expand and whose boundary is at x / s; F = s F_y, and forces are s^2 times as large. CalculiX
finds y.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "twins"))
import free_hardening as strip  # noqa: E402

from idic.virtual_tests import write_inp  # noqa: E402

E, NU, YIELD, H, E_SLOPE, FLOW_SLOPE, ALPHA, ROOM, WARM = 70e3, 0.3, 200.0, 1500.0, -5e-4, -2e-3, 2e-5, 20.0, 140.0
GRIP = np.concatenate([np.linspace(0.0, 0.10, 5), np.linspace(0.10, 0.20, 5)[1:], np.linspace(0.20, 0.60, 5)[1:],
                       [0.50, 0.40]])
TEMPERATURE = np.interp(np.arange(len(GRIP)), [0, 4, 9, 12, 14], [ROOM, ROOM, WARM, WARM, 60.0])  # °C
STRAINS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.2)
THIN = 100.0  # ccx in a hundredth of the thickness (docs/external-solver.md)
DECK = """*INCLUDE, INPUT=mesh.inp
*MATERIAL, NAME=SHEET
*ELASTIC
{elastic}
*PLASTIC
{plastic}
*SOLID SECTION, ELSET=sheet, MATERIAL=SHEET
{thickness}
*INITIAL CONDITIONS, TYPE=TEMPERATURE
ALL, {room}
*AMPLITUDE, NAME=LEFTX
{left}
*AMPLITUDE, NAME=RIGHTX
{right}
*AMPLITUDE, NAME=SHRINK
{shrink}
*AMPLITUDE, NAME=WARM
{warm}
*TIME POINTS, NAME=FRAMES, GENERATE
1, {end}, 1
*STEP, NLGEOM, INC=10000
*STATIC
0.25, {end}, 1e-6, 0.25
*BOUNDARY, AMPLITUDE=LEFTX
LEFT, 1, 1, 1
*BOUNDARY, AMPLITUDE=RIGHTX
RIGHT, 1, 1, 1
*BOUNDARY, AMPLITUDE=SHRINK
{heights}
*TEMPERATURE, AMPLITUDE=WARM
ALL, 1
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
nu = 0.3
yield_stress = { value = 170, unit = "MPa", identify = true }
alpha = { value = 1e-5, unit = "1/K", identify = true }
reference_temperature = { value = 20, unit = "C" }
hardening = [{ kind = "linear", H = { value = 1000, unit = "MPa", identify = true } }]
temperature = [{ kind = "linear", of = "E", slope = { value = 0, unit = "1/K", identify = true } },
               { kind = "linear", of = "flow_stress", slope = { value = 0, unit = "1/K", identify = true } }]
[[boundary]]
temperature = { column = "oven_C" }
"""


def truth_by_calculix(folder: Path) -> strip.Truth:
    """What CalculiX makes of it on the true mesh."""
    mesh = strip.waisted(*strip.TRUE)
    write_inp(mesh, folder / "mesh.inp", "strip")
    text = (folder / "mesh.inp").read_text()
    (folder / "mesh.inp").write_text(text.replace("TYPE=CPS8", "TYPE=CPS8R")
                                     + f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n")
    rows = {T: (1.0 + E_SLOPE * (T - ROOM), 1.0 + FLOW_SLOPE * (T - ROOM)) for T in (ROOM, WARM)}
    elastic = "\n".join(f"{E * e:.9g}, {NU}, {T}" for T, (e, _) in rows.items())
    plastic = "\n".join(f"{s * (YIELD + H * p):.9g}, {p}, {T}" for T, (_, s) in rows.items() for p in STRAINS)
    course = lambda values: "\n".join(f"{k}, {v:.12g}" for k, v in enumerate(values))  # noqa: E731
    stretch, half = 1.0 + ALPHA * (TEMPERATURE - ROOM), 0.5 * strip.LENGTH
    held = np.concatenate([mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]])
    (folder / "strip.inp").write_text(DECK.format(
        elastic=elastic, plastic=plastic, room=ROOM, thickness=strip.THICKNESS / THIN, warm=course(TEMPERATURE),
        left=course(half - half / stretch), right=course((half + GRIP) / stretch - half),
        shrink=course(1.0 / stretch - 1.0),  # linear between frames: off by 6e-8
        heights="\n".join(f"{n + 1}, 2, 2, {mesh.nodes[n, 1]:.12g}" for n in held), end=len(GRIP) - 1))
    u, force = solved(folder, "strip", mesh.n_nodes)
    own = stretch[:, None, None]
    return strip.Truth(mesh, own * (mesh.nodes + u) - mesh.nodes, stretch**2 * force, np.zeros(0))


def solved(folder: Path, job: str, n_nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Motion (n_frames, n_nodes, 2) mm and force (n_frames,) N of RIGHT that CalculiX prints for `job`."""
    done = subprocess.run(["ccx", "-i", job], cwd=folder, capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    u, force = [np.zeros((n_nodes, 2))], [0.0]
    for row in (line.split() for line in (folder / f"{job}.dat").read_text().splitlines()):
        if row[:1] == ["displacements"]:
            u.append(np.zeros((n_nodes, 2)))
        elif len(row) == 4 and row[0].isdigit():
            u[-1][int(row[0]) - 1] = float(row[1]), float(row[2])
        elif len(row) == 3 and row[0][0] in "-0123456789":
            force.append(THIN * float(row[0]))
    assert len(u) == len(force)
    return np.array(u), np.array(force)


def write_folder(folder: Path, truth: strip.Truth, seed: int = 0) -> Path:
    """The experiment of a user who logs the temperature of the oven."""
    return strip.write_folder(folder, truth, seed, MATERIAL, GRIP, {"oven_C": TEMPERATURE})
