"""Stages as VTU or VTK files: points, and the displacement as point data.

A file names no unit of length: pyxel writes pixels, with y upwards as codes of finite elements have it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.fields.stages.failed_points import sound_points
from idic.readers.fields.stages.stage import KEY, Stage

SUFFIXES = (".vtu", ".vtk")
_NAMES = ("displacement", "u", "disp", "displacements")


def read_vtu(path: Path) -> Stage:
    """One stage.

    Raises
    ------
    InputError
        The file cannot be read, or has no displacement.
    """
    import meshio

    try:
        mesh = meshio.read(path)
    except (Exception, SystemExit) as problem:  # noqa: BLE001  (meshio raises all kinds, and exits)
        raise InputError("not a readable VTU file", file=path, key=KEY, expected="points with a displacement",
                         found=str(problem) or type(problem).__name__, remedy="export the stage again") from None
    point_data = {name.lower(): np.asarray(values, float) for name, values in mesh.point_data.items()}
    values = next((point_data[name] for name in _NAMES if name in point_data), None)
    if values is None or values.ndim != 2 or values.shape[1] not in (2, 3):
        raise InputError("a stage without displacements", file=path, key=KEY,
                         expected=f"point data named {', '.join(_NAMES)}", found=", ".join(mesh.point_data) or "none",
                         remedy="export the displacement of the points as a vector")
    points = np.asarray(mesh.points, float)
    n = 3 if points.shape[1] == 3 and values.shape[1] == 3 and np.ptp(points[:, 2]) > 0 else 2
    flags = {name: column for name, column in point_data.items() if column.ndim == 1}
    sound = sound_points(points[:, :n], values[:, :n], None, "vtu", flags)
    return Stage(sound.points, sound.displacement, "mm", unit_assumed=True, failed=sound.failed,
                 placeless=sound.placeless)
