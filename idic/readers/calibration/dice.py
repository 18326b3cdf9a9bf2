"""DICe: the camera system as XML (ParameterList) or as plain text of 16 + 6 or 16 + 12 values (+ height, width).

XML: poses of all cameras in one frame, or relative to camera 0 where ``extrinsics_relative_camera_to_camera`` is true.
Text: ``cx cy fx fy skew k1 k2 k3`` of two cameras, then the relative pose as angles or as a matrix, then tx ty tz.
Angles in degrees, R = Rz Ry Rx. Skew in px: that is how DICe uses it, whatever the comment of its file says.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np

from idic.errors import InputError
from idic.readers.calibration.rig import CameraRig, Conventions, camera_of, rotation_of_angles

_ORDER = ("cx", "cy", "fx", "fy", "skew", "k1", "k2", "k3")
_NAMES = {"CX": "cx", "CY": "cy", "FX": "fx", "FY": "fy", "FS": "skew", "K1": "k1", "K2": "k2", "K3": "k3",
          "P1": "p1", "P2": "p2"}
_OTHER = ("K4", "K5", "K6", "S1", "S2", "S3", "S4", "T1", "T2")  # rational, prism and tilted-sensor terms of OpenCV
_ANGLES, _SHIFTS = ("ALPHA", "BETA", "GAMMA"), ("TX", "TY", "TZ")
# powers of the radius as DICe applies them; K1R3_K2R5_K3R7 is Brown's polynomial
_BROWN = {"", "NONE", "NO_LENS_DISTORTION", "OPENCV_DIS", "OPENCV_LENS_DISTORTION", "K1R3_K2R5_K3R7", "VIC3D_DIS",
          "VIC3D_LENS_DISTORTION"}


def read_dice_xml(text: str, file, conventions: Conventions) -> CameraRig:
    """The rig of a camera system file of DICe.

    Raises
    ------
    InputError
        Where the file is no such file, or has distortion terms other than Brown's.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError("not readable as XML", file=file, expected="a camera system file of DICe", found=str(error),
                         remedy="export the calibration again") from None
    head = _parameters(root)
    relative = head.get("extrinsics_relative_camera_to_camera", "false").lower() == "true"
    from_vic = head.get("system_type_3D", "").upper() == "VIC3D"
    cameras, sizes = [], []
    for entry in root.findall("ParameterList"):
        if not re.fullmatch(r"CAMERA \d+", entry.get("name", "")):
            continue
        number, values = len(cameras), _parameters(entry)
        _refuse_other_terms(values, from_vic, file, entry.get("name"))
        lens_values = {_NAMES[name]: _number(values[name], file, name) for name in _NAMES if name in values}
        size = re.findall(r"\d+", values.get("IMAGE_HEIGHT_WIDTH", ""))
        sizes.append((int(size[1]), int(size[0])) if len(size) == 2 else None)
        if relative and number == 0:
            rotation, shift = np.eye(3), np.zeros(3)
        else:
            rotation = _rotation(entry, values, conventions, file)
            shift = np.array([_number(values.get(name, "0"), file, name) for name in _SHIFTS])
        cameras.append(camera_of(lens_values, conventions, file, number, sizes[-1], rotation, shift))
    if not cameras:
        raise InputError("no camera in this file", file=file, expected='<ParameterList name="CAMERA 0">', found="none",
                         remedy="give the camera system file of DICe")
    return CameraRig(tuple(cameras), tuple(sizes))


def read_dice_text(text: str, file, conventions: Conventions) -> CameraRig:
    """The rig of a calibration text of DICe (two cameras, relative pose).

    Raises
    ------
    InputError
        Where the number of values is none of 22, 24, 28, 30.
    """
    words = [word for line in text.splitlines() for word in line.split("#")[0].split()]
    values = [_number(word, file, f"value {i + 1}") for i, word in enumerate(words)]
    if len(values) not in (22, 24, 28, 30):
        raise InputError("not a calibration text of DICe", file=file, found=f"{len(values)} values",
                         expected="16 values of two cameras, 6 (angles) or 12 (matrix) of the pose, height and width",
                         remedy="give the calibration file itself")
    size = (int(values[-1]), int(values[-2])) if len(values) in (24, 30) else None
    matrix = len(values) >= 28
    rotation = np.reshape(values[16:25], (3, 3)) if matrix else rotation_of_angles(values[16:19], conventions)
    shift = np.array(values[25:28] if matrix else values[19:22])
    first = camera_of(dict(zip(_ORDER, values[:8], strict=True)), conventions, file, 0, size)
    second = camera_of(dict(zip(_ORDER, values[8:16], strict=True)), conventions, file, 1, size, rotation, shift)
    return CameraRig((first, second), (size, size))


def _parameters(entry):
    return {p.get("name", ""): p.get("value", "") for p in entry.findall("Parameter")}


def _number(text, file, key):
    try:
        return float(text)
    except ValueError:
        raise InputError("not a number", file=file, key=key, expected="a number", found=text,
                         remedy="export the calibration again") from None


def _rotation(entry, values, conventions, file):
    for part in entry.findall("ParameterList"):
        rows = _parameters(part)
        if all(f"ROW {i}" in rows for i in range(3)):
            matrix = [[_number(word, file, f"ROW {i}") for word in rows[f"ROW {i}"].strip("{} ").split(",")]
                      for i in range(3)]
            if any(len(row) != 3 for row in matrix):
                raise InputError("not a rotation matrix", file=file, key=part.get("name"),
                                 expected="three rows of three",
                                 found=matrix, remedy="export the calibration again")
            return np.array(matrix)
    return rotation_of_angles([_number(values.get(name, "0"), file, name) for name in _ANGLES], conventions)


def _refuse_other_terms(values, from_vic, file, camera):
    model = values.get("LENS_DISTORTION_MODEL", "").upper()
    distorted = any(float(values.get(name, 0.0) or 0.0) for name in ("K1", "K2", "K3"))
    other_terms = [name for name in _OTHER if float(values.get(name, 0.0) or 0.0)]
    # with the values of VIC-3D in it, the file means VIC-3D's polynomial, whichever of its own DICe takes for that
    if other_terms or (distorted and model not in _BROWN and not (from_vic and model == "K1R1_K2R2_K3R3")):
        raise InputError("a distortion that this camera model does not have", file=file, key=camera,
                         expected="k1, k2, k3, p1, p2 of Brown's model (OPENCV_DIS, K1R3_K2R5_K3R7, VIC3D_DIS)",
                         found=", ".join([model, *other_terms]), remedy="calibrate with one of these models")
