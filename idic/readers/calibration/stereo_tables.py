"""Tables of names and values for two cameras: MatchID .caldat (name;value) and pyvale text (name,value).

The pose is that of camera 1 relative to camera 0: X1 = Rz(psi) Ry(phi) Rx(theta) X0 + T, mm and degrees. Skew in px
where the name says nothing else; MatchID writes the unit into the name: ``Cam0_Fs [pixels]`` or ``[deg]``.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.readers.calibration.rig import CameraRig, Conventions, camera_of, rotation_of_angles

_NAMES = {"fx": "fx", "fy": "fy", "fs": "skew", "cx": "cx", "cy": "cy", "k1": "k1", "k2": "k2", "k3": "k3",
          "kappa1": "k1", "kappa2": "k2", "kappa3": "k3", "p1": "p1", "p2": "p2"}
_POSE = ("theta", "phi", "psi", "tx", "ty", "tz")
_DEGREES = {"deg", "degree", "degrees", "°"}


def read_stereo_table(text: str, file, conventions: Conventions) -> CameraRig:
    """The rig of a table of two cameras.

    Raises
    ------
    InputError
        With the name of a value that is missing or not a number.
    """
    table, units = _table(text, file)
    cameras = []
    for number in (0, 1):
        values, camera_conventions = {}, conventions
        for name, value in table.items():
            match = re.fullmatch(rf"cam{number}_(\w+)", name)
            if match and match[1] in _NAMES:
                values[_NAMES[match[1]]] = value
                if match[1] == "fs" and units[name] in _DEGREES and conventions.skew is None:
                    camera_conventions = replace(conventions, skew="deg")
            elif match:
                raise InputError("a value that this camera model does not have", file=file, key=name,
                                 expected=", ".join(_NAMES), found=value,
                                 remedy="calibrate with the pinhole model and k1, k2, k3, p1, p2")
        pose = {}
        if number == 1:
            missing = [name for name in _POSE if name not in table]
            if missing:
                raise InputError("the pose of the second camera is incomplete", file=file, key=", ".join(missing),
                                 expected=", ".join(_POSE), found=", ".join(table),
                                 remedy="export the calibration again")
            pose = {"rotation": rotation_of_angles([table[name] for name in _POSE[:3]], conventions),
                    "translation_mm": np.array([table[name] for name in _POSE[3:]])}
        cameras.append(camera_of(values, camera_conventions, file, number, **pose))
    return CameraRig(tuple(cameras), (None, None))


def _table(text, file):
    table, units = {}, {}
    for line in text.splitlines():
        if not line.strip():
            continue
        name, separator, value = re.split(r"([;,])", line, maxsplit=1) if re.search("[;,]", line) else (line, "", "")
        unit = re.search(r"\[(.*?)\]", name)
        bare = re.sub(r"\[.*?\]|\s+", "", name).lower()
        bare, plain_unit = re.fullmatch(r"(.*?)(?:_(px|mm|deg))?", bare).groups()
        try:
            table[bare] = float(value.strip().rstrip(";").replace(",", ".") if separator == ";" else value)
        except ValueError:
            raise InputError("not a name and a number", file=file, key=name.strip(),
                             expected="name;value or name,value",
                             found=line.strip(), remedy="export the calibration again") from None
        units[bare] = (unit[1].strip().lower() if unit else plain_unit) or ""
    return table, units
