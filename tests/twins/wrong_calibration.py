"""A plate before two cameras whose calibration file is wrong, with standard deviations of that size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from idic.virtual_tests import PlateSize, PlateTest



def write_wrongly_calibrated(folder: Path) -> tuple[Path, dict[str, float]]:
    """The experiment.toml, which identifies the calibration, and the truth. The file says 0.1 degrees more between the
    cameras and 0.3 % more focal length; the distance between them is right."""
    test = PlateTest.simulated(PlateSize.of_example(reduced=True))
    left, right = test.rig.cameras
    turn = Rotation.from_rotvec([0.0, np.deg2rad(0.1), 0.0]).as_matrix()
    between = right.rotation @ left.rotation.T
    translation = right.translation_mm - between @ left.translation_mm + turn @ between @ left.translation_mm
    believed = replace(test.rig, cameras=(
        replace(left, fx=1.003 * left.fx, fy=1.003 * left.fy),
        replace(right, fx=1.003 * right.fx, fy=1.003 * right.fy, rotation=turn @ right.rotation,
                translation_mm=translation)))
    stated = {f"{number}.{name}": 0.003 * left.fx for number in (0, 1) for name in ("fx", "fy")} | {"1.rotation_y": 0.1}
    file = test.write(folder, believed=believed, deviations=stated)
    file.write_text(file.read_text().replace('calibration = "calibration.json"',
                                             'calibration = "calibration.json"\nidentify_calibration = true'))
    return file, PlateTest.TRUTH | {"left.fx": left.fx, "left.fy": left.fy, "right.fx": right.fx, "right.fy": right.fy,
                          "right.rotation_y": -0.1}
