"""A plate whose stages were measured by another system: elastic, both ends as measured, the force in a log."""

from __future__ import annotations

from pathlib import Path

TOML = """
[experiment]
fields = "FIELDS"
loads = "log.csv"
mesh = { around_points_mm = [0.0, DISTANCE], element_mm = SIZE }
kind = "plane_stress"
thickness_mm = 2.0
[material.SPECIMEN]
law = "elastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = 0.3
[[boundary]]
nodes = "LEFT"
u = "measured"
[[boundary]]
nodes = "RIGHT"
u = "measured"
[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
"""


def write_point_plate(folder: Path, fields: str, distance_mm: float, element_mm: float) -> None:
    """Write the tables; stages and ``log.csv`` are the test's own.

    fields : file, or pattern of files; distance_mm : by which the mesh goes beyond the points
    """
    text = TOML.replace("FIELDS", fields).replace("DISTANCE", str(distance_mm)).replace("SIZE", str(element_mm))
    (folder / "experiment.toml").write_text(text)
