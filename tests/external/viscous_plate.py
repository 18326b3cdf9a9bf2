"""A plate with a hole at rates a hundred times apart, held and reversed: rate with back stress, by CalculiX.

`*CREEP` beside `*PLASTIC, HARDENING=COMBINED` is viscoplasticity there: the rate is A times the overstress to the n,
which is the term `norton` with eta = A^(-1/n) and m = n.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plate_by_calculix as calculix

TRUTH = {"E": 200e3, "nu": 0.3, "yield_stress": 200.0, "hardening_1_H": 2000.0, "backstress_1_C": 4000.0,
         "rate_eta": 100.0, "rate_m": 5.0}
LAW = "elastoplastic(linear+prager+norton)"
TIMES = np.array([0.0, 0.02, 0.04, 0.06, 0.08, 0.2, 1, 10, 60, 110, 160, 160.04, 160.08, 160.12, 160.16, 160.2, 160.4,
                  162, 180, 280, 380])  # s
GRIP = np.interp(TIMES, [0, 0.04, 0.08, 10, 160, 160.04, 160.2, 180, 380], [0.0, 0.04, 0.12, 0.12, 0.20, 0.13, -0.14,
                                                                         -0.14, 0.0])
INCREMENTS = 5  # per interval between frames, or more
PROCEDURE = "*VISCO, CETOL=0.1"  # the increments are those of the table
MATERIAL = """
[material.sheet]
law = "elastoplastic"
E = { value = 180e3, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 170, unit = "MPa", identify = true }
hardening = [{ kind = "linear", H = { value = 1500, unit = "MPa", identify = true } }]
backstress = [{ kind = "prager", C = { value = 3000, unit = "MPa", identify = true } }]
[material.sheet.rate]
kind = "norton"
eta = { value = 80, unit = "MPa s", identify = true }
m = { value = 4, identify = true }
"""


def card() -> str:
    """The material of CalculiX."""
    t = TRUTH
    return (f"*ELASTIC\n{t['E']}, {t['nu']}\n*PLASTIC, HARDENING=COMBINED\n"
            + calculix.table(t["yield_stress"], t["backstress_1_C"]) + "*CYCLIC HARDENING\n"
            + calculix.table(t["yield_stress"], t["hardening_1_H"])
            + f"*CREEP, LAW=NORTON\n{t['rate_eta'] ** -t['rate_m']:.12g}, {t['rate_m']}, 0.\n")


def truth_by_calculix(folder: Path):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    return calculix.truth_by_calculix(folder, card(), TIMES, GRIP, INCREMENTS, PROCEDURE)


def fitted_to_one_element(folder: Path) -> dict[str, float]:
    """What the law owes to other definitions: through the strains of the plate near its hole."""
    ends = calculix.ends_of(TIMES, 10)
    strain = np.interp(ends, TIMES, 0.08 * GRIP)
    free = [name for name in TRUTH if name != "nu"]
    lines = "*MATERIAL, NAME=M\n" + card()
    return calculix.fitted_to_one_element(folder, LAW, lines, TRUTH, free, strain, times=ends, procedure=PROCEDURE)


def write_folder(folder: Path, truth, seed: int = 0) -> Path:
    """The experiment of a user with a mesh of his own."""
    return calculix.write_folder(folder, truth, MATERIAL, TIMES, GRIP, seed)
