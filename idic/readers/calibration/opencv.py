"""OpenCV: camera matrices, distortion coefficients and pose under the many names of YAML, XML, JSON and npz files.

One camera: ``camera_matrix, distortion_coefficients``; two: ``K1, D1, K2, D2, R, T`` with X1 = R X0 + T (what
`stereoCalibrate` returns). Skew is the entry (1, 2) of the camera matrix. Distortion in OpenCV's sequence k1, k2, p1,
p2, k3. `idic calibrate` writes this format as JSON, with the covariance.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping

import numpy as np

from idic.errors import InputError
from idic.images import rotation_of
from idic.readers.calibration.rig import CameraRig, Conventions, camera_of

_MATRIX = ("cameramatrix", "intrinsicmatrix", "intrinsics", "intrinsic", "mtx", "k", "m")
_DISTORTION = ("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoef", "distortion", "dist", "d")
_ROTATION, _TRANSLATION = ("rotationmatrix", "rotation", "rmat", "rvec", "r"), ("translation", "tvec", "t")
_PAIRS = (("1", "2"), ("0", "1"), ("left", "right"), ("l", "r"))


def read_opencv(content: bytes, file, conventions: Conventions) -> CameraRig:
    """The rig of a file of OpenCV, Python or `idic calibrate`.

    Raises
    ------
    InputError
        Where no camera matrix is found, a matrix has another size, or the distortion has further terms.
    """
    entries = {re.sub(r"[^a-z0-9]", "", str(name).lower()): value for name, value in _entries(content, file).items()}
    suffixes = next((pair for pair in _PAIRS if all(_matrix(entries, suffix) is not None for suffix in pair)), None)
    if suffixes is None:
        suffixes = next(((s,) for s in ("", "1", "0", "left", "right") if _matrix(entries, s) is not None), None)
    if suffixes is None:
        raise InputError("no camera matrix in this file", file=file, found=", ".join(map(str, entries)) or "nothing",
                         expected="camera_matrix (3 x 3), or K1 and K2", remedy="give the file of the calibration")
    sizes = tuple(_image_size(entries, suffix) or _image_size(entries, "") for suffix in suffixes)
    cameras = []
    for number, (suffix, size) in enumerate(zip(suffixes, sizes, strict=True)):
        matrix = _matrix(entries, suffix)
        values = {"fx": matrix[0, 0], "fy": matrix[1, 1], "skew": matrix[0, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
        values |= _distortion(_first(entries, _DISTORTION, suffix), file, number)
        pose = _pose(entries, file) if number == 1 else {}
        cameras.append(camera_of(values, conventions, file, number, size, **pose))
    names, covariance = _covariance(entries.get("covariance"), file)
    return CameraRig(tuple(cameras), sizes, names, covariance)


def _entries(content, file):
    import cv2  # here: few experiments have such a file

    try:
        if content[:2] == b"PK":
            with np.load(io.BytesIO(content), allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        text = content.decode("utf-8-sig")
        if text.lstrip()[:1] == "{":
            entries = json.loads(text)
            return entries if isinstance(entries, dict) else {}
        if not text.lstrip().startswith(("%YAML", "<")):
            text = "%YAML:1.0\n---\n" + text.lstrip("-\n\r ")  # written by other libraries than OpenCV
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        entries = _node(storage.root())
        return entries if isinstance(entries, dict) else {}  # of an empty file it is a number
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  (damaged archives and headers raise many types)
        raise InputError("not readable as a file of OpenCV", file=file, expected="YAML, XML, JSON or npz",
                         found=next(iter(str(error).splitlines()), type(error).__name__),
                         remedy="write the file again") from None


def _node(node):
    if node.isMap():
        return {name: _node(node.getNode(name)) for name in node.keys()}  # noqa: SIM118 (no mapping of Python)
    if node.isSeq():
        return [_node(node.at(i)) for i in range(node.size())]
    return node.string() if node.isString() else node.real()


def _array(value):
    """An array of nested lists, of OpenCV's or ROS' {rows, cols, data} or OpenCV 5's {sizes, data}; None where it is
    none of these."""
    if isinstance(value, Mapping):
        sizes = value.get("sizes", [value.get("rows"), value.get("cols")])
        if value.get("data") is None or None in sizes:
            return None
        array, shape = np.asarray(value["data"], dtype=float), [int(size) for size in sizes]
        return array.reshape(shape) if array.size == np.prod(shape) else None
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None
    return array if np.isfinite(array).all() else None


def _first(entries, bases, suffix):
    for base in bases:
        for name in (base + suffix, suffix + base):
            if name in entries:
                return entries[name]
    return None


def _matrix(entries, suffix):
    for base in _MATRIX:
        for name in {base + suffix, suffix + base}:
            array = _array(entries[name]) if name in entries else None
            if array is not None and array.size == 9:
                return array.reshape(3, 3)
    return None


def _distortion(value, file, camera):
    if value is None:
        return {}
    array = _array(value)
    if array is None or array.size not in (0, 4, 5, 8, 12, 14) or np.any(array.ravel()[5:]):
        raise InputError("a distortion that this camera model does not have", file=file, key=f"camera {camera}",
                         expected="k1, k2, p1, p2, k3 (further terms zero)", found=value,
                         remedy="calibrate without the rational, thin-prism and tilted models")
    return dict(zip(("k1", "k2", "p1", "p2", "k3"), array.ravel().tolist(), strict=False))


def _pose(entries, file):
    rotation, shift = (_array(_first(entries, names, "")) for names in (_ROTATION, _TRANSLATION))
    if rotation is None or shift is None or rotation.size not in (3, 9) or shift.size != 3:
        raise InputError("the pose of the second camera is missing", file=file, key="R, T",
                         expected="R (3 x 3, or a rotation vector in rad) and T (3, mm)",
                         found=", ".join(map(str, entries)), remedy="store what stereoCalibrate returned")
    rotation = rotation.reshape(3, 3) if rotation.size == 9 else rotation_of(np.degrees(rotation.ravel()))
    return {"rotation": rotation, "translation_mm": shift.ravel()}


def _image_size(entries, suffix):
    size = _array(entries.get(f"imagesize{suffix}"))
    if size is not None and size.size == 2:
        return int(size.ravel()[0]), int(size.ravel()[1])
    width, height = (entries.get(f"{name}{suffix}") for name in ("imagewidth", "imageheight"))
    return None if width is None or height is None else (int(np.asarray(width).item()), int(np.asarray(height).item()))


def _covariance(value, file):
    if not isinstance(value, Mapping):
        return (), None
    names, matrix = tuple(value.get("names", ())), _array(value.get("matrix"))
    if matrix is None or matrix.shape != (len(names), len(names)):
        raise InputError("not a covariance", file=file, key="covariance",
                         expected="names, and a matrix with a row and a column for each",
                         found=f"{len(names)} names", remedy="run idic calibrate again")
    return names, matrix
