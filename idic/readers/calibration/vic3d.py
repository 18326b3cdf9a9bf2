"""VIC-3D: the `<calibration>` of a project XML, also inside a .z3d archive; absolute poses of all cameras.

    <camera id="0">cx cy fx fy skew k1 k2 k3 <orientation>alpha beta gamma tx ty tz</orientation></camera>

Angles in degrees about x, y, z, R = Rz Ry Rx, from the project's frame to the camera's; skew in px; distortion of
normalised coordinates. Only this part is read: projects hold much else, and cut-outs of them are not valid XML.
"""

from __future__ import annotations

import re

import numpy as np

from idic.errors import InputError
from idic.readers.calibration.rig import CameraRig, Conventions, camera_of, rotation_of_angles

_CAMERA = re.compile(r"<camera\b[^>]*\bid=[\"'](\d+)[\"'][^>]*>([^<]*)<orientation[^>]*>([^<]*)</orientation>",
                     re.DOTALL)
_ORDER = ("cx", "cy", "fx", "fy", "skew", "k1", "k2", "k3")


def read_vic3d(text: str, file, conventions: Conventions) -> CameraRig:
    """The rig of a VIC-3D project.

    Raises
    ------
    InputError
        Without cameras, or with values that this camera model does not have.
    """
    cameras, numbers = [], []
    for number, intrinsic, orientation in _CAMERA.findall(text):
        values = _numbers(intrinsic, file, f"camera {number}")
        pose = _numbers(orientation, file, f"camera {number}: orientation")
        if len(values) < len(_ORDER) or len(pose) != 6 or any(values[len(_ORDER):]):
            raise InputError("not the values of a camera", file=file, key=f"camera {number}",
                             expected="cx cy fx fy skew k1 k2 k3 and six values of the orientation",
                             found=f"{len(values)} and {len(pose)} values",
                             remedy="calibrate without further distortion terms")
        cameras.append(camera_of(dict(zip(_ORDER, values, strict=False)), conventions, file, int(number),
                                 rotation=rotation_of_angles(pose[:3], conventions), translation_mm=np.array(pose[3:])))
        numbers.append(int(number))
    if numbers != list(range(len(numbers))) or not numbers:
        raise InputError("no calibration of cameras in this project", file=file, key="calibration",
                         expected='<camera id="0">, <camera id="1"> … with their orientation', found=numbers or "none",
                         remedy="give the project in which the calibration was accepted")
    return CameraRig(tuple(cameras), (None,) * len(cameras))


def _numbers(text, file, key):
    try:
        return [float(word) for word in text.split()]
    except ValueError as error:
        raise InputError("not a number", file=file, key=key, expected="numbers separated by blanks", found=str(error),
                         remedy="export the calibration again") from None
