"""A public series of cracks: the nodemaps of dlr-wf/crackpy, plates with a crack in the middle simulated by ANSYS.

    python studies/evidence/crack_series.py NODEMAPS OUT       # test_data/simulations/Nodemaps of that repository

Half of each plate (x >= 0) as measured fields of four stages with noise of 0.3 µm; motion of the ends as measured. The
points beside the crack (1 mm) are left out: those of both faces lie on each other. Truth: E 72000 MPa, nu 0.33, half
length a of the name times 100 mm; K_I = sigma sqrt(pi a sec(pi a / W)), of long plates (Feddersen 1966), 200 mm wide.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

import idic

WIDTH, THICKNESS, NOISE = 200.0, 2.0, 3e-4  # mm
ENDS, BESIDE = 70.0, 1.0  # mm from the crack: height of the half plate that is looked at, points that are left out
STAGES = 4

FILE = f"""
[experiment]
fields = "fields.csv"
loads = "loads.csv"
kind = "plane_stress"
thickness_mm = {THICKNESS}
mesh = {{ roi_mm = [0, {-ENDS}, {0.5 * WIDTH}, {ENDS}], element_mm = 5 }}
[[boundary]]
nodes = "TOP"
u = "measured"
[[boundary]]
nodes = "BOTTOM"
u = "measured"
[[boundary]]
nodes = "AXIS"
ux = 0.0
[[channel]]
column = "force_N"
simulated = {{ reaction = "TOP", component = "y", factor = 2.0 }}
noise_std = 5.0
[[crack]]
name = "middle"
path_mm = [[-1, 0], [70, 0]]
length_mm = {{ value = 35, identify = true }}
[sets.AXIS]
where = "x < 0.01 and y > {0.01 - ENDS} and y < {ENDS - 0.01}"
[material.SPECIMEN]
law = "elastic"
E = {{ value = 65000, unit = "MPa", identify = true }}
nu = {{ value = 0.3, identify = true }}
"""


def write_plate(nodemap: Path, folder: Path, force: float) -> None:
    """The experiment folder of one plate, which a force (N) pulls."""
    nodes = np.loadtxt(nodemap, delimiter=";", comments="#")
    height = np.abs(nodes[:, 2])
    nodes, rng = nodes[(nodes[:, 1] > -1e-6) & (height <= ENDS) & (height > BESIDE)], np.random.default_rng(1)
    folder.mkdir(parents=True, exist_ok=True)
    rows = [(stage, int(node[0]), *node[1:3], *(node[4:6] * stage / (STAGES - 1) + rng.normal(0.0, NOISE, 2)))
            for stage in range(STAGES) for node in nodes]
    np.savetxt(folder / "fields.csv", rows, "%.7g", ",", header="stage,id,x_mm,y_mm,ux_mm,uy_mm", comments="")
    np.savetxt(folder / "loads.csv", force * np.arange(STAGES) / (STAGES - 1), header="force_N", comments="")
    (folder / "experiment.toml").write_text(FILE, encoding="utf-8")


def main() -> None:
    nodemaps, out = map(Path, sys.argv[1:3])
    for nodemap in sorted(nodemaps.glob("File_F_*.txt")):
        force, share = (float(text) for text in re.findall(r"_[Fa]_([\d.]+)(?=_)", nodemap.name))
        a = 0.5 * share * WIDTH
        write_plate(nodemap, out / f"plate-{a:g}", force)
        result = idic.identify(out / f"plate-{a:g}", out / f"run-{a:g}").content
        crack, E = result["cracks"]["middle"], result["parameters"]["SPECIMEN.E"]
        handbook = force / (WIDTH * THICKNESS) * np.sqrt(np.pi * a / np.cos(np.pi * a / WIDTH) / 1000.0)
        sys.stdout.write(f"a {a:g} mm: {crack['length_mm'][-1]:.3f} ± {crack['length_mm_std'][-1]:.3f} mm, "
                         f"E {E['value']:.0f} ± {E['std']:.0f} MPa, K_I {crack['K_I'][-1]:.3f} ± "
                         f"{crack['K_I_std'][-1]:.3f} of {handbook:.3f} MPa sqrt(m)\n")


if __name__ == "__main__":
    main()
