"""The export of another DIC system: a plain strip in tension, one table of points per stage, and the force.

Its motion is written down here, with noise of a passed generator.
"""

from __future__ import annotations

import numpy as np

LENGTH_MM, WIDTH_MM, THICKNESS_MM = 20.0, 10.0, 1.0
SPACING_MM, MARGIN_MM = 0.5, 0.25
E_MPA, NU = 2000.0, 0.35
STRAINS = (0.0, 0.0, 0.002, 0.004, 0.006, 0.008)
NOISE_MM, FORCE_NOISE_N = 2e-4, 0.5
POINTS, LOG = "x_mm,y_mm,u_mm,v_mm", "time_s,force_N"

EXPERIMENT = f"""[experiment]
title = "strip, exported fields"
fields = "stages/*.csv"
loads = "loads.csv"
mesh = {{ around_points_mm = [{MARGIN_MM}, {MARGIN_MM}], element_mm = 2.5 }}
kind = "plane_stress"
thickness_mm = {THICKNESS_MM}
[material.SPECIMEN]
law = "elastic"
E = {{ value = 1500, unit = "MPa", identify = true }}
nu = {{ value = 0.3, identify = true }}
[[boundary]]
nodes = "LEFT"
u = "measured"
[[boundary]]
nodes = "RIGHT"
u = "measured"
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {FORCE_NOISE_N}
"""


def stage_tables(generator: np.random.Generator) -> list[str]:
    """The table of every stage, the undeformed one first."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(MARGIN_MM, LENGTH_MM, SPACING_MM),
                                                 np.arange(MARGIN_MM, WIDTH_MM, SPACING_MM)))
    tables = []
    for strain in STRAINS:
        motion = np.column_stack([strain * x, -NU * strain * y]) + generator.normal(0.0, NOISE_MM, (len(x), 2))
        rows = np.column_stack([x, y, motion]).tolist()
        tables.append("\n".join([POINTS, *(f"{a},{b},{u:.7f},{v:.7f}" for a, b, u, v in rows), ""]))
    return tables


def log(generator: np.random.Generator) -> str:
    """Force of every stage."""
    forces = E_MPA * WIDTH_MM * THICKNESS_MM * np.array(STRAINS) + generator.normal(0.0, FORCE_NOISE_N, len(STRAINS))
    return "\n".join([LOG, *(f"{time},{force:.4f}" for time, force in enumerate(forces.tolist())), ""])
