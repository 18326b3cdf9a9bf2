"""Reads any calibration file as a rig: the format is found by the content, not by the name."""

from __future__ import annotations

import zipfile
from pathlib import Path

from idic.errors import InputError
from idic.readers.calibration.dice import read_dice_text, read_dice_xml
from idic.readers.calibration.opencv import read_opencv
from idic.readers.calibration.rig import CameraRig, Conventions
from idic.readers.calibration.stereo_tables import read_stereo_table
from idic.readers.calibration.vic3d import read_vic3d
from idic.readers.formats.format import CALIBRATION, Format

FORMATS = (Format(CALIBRATION, "VIC-3D, MatchID, OpenCV, DICe, pyvale",
                  (".z3d", ".xml", ".caldat", ".yaml", ".yml", ".json", ".npz", ".txt"), "OpenCV",
                  "lenses, places", "unusual units or angles",
                  "of OpenCV; made"),)
MAX_BYTES = 64 * 2**20  # a project with its masks has a few MB


def read_calibration(path: str | Path, conventions: Conventions | None = None) -> CameraRig:
    """The cameras of a calibration file.

    VIC-3D project (XML, or the .z3d archive around it), MatchID .caldat, OpenCV YAML, XML, JSON or npz, DICe XML or
    text, pyvale text, and what `idic calibrate` writes.

    Parameters
    ----------
    path : path
    conventions : Conventions, optional
        Units and angle order where they differ from what the format usually has.

    Returns
    -------
    CameraRig
        In the frame of the file (VIC-3D, absolute DICe), else in that of camera 0.

    Raises
    ------
    InputError
        Where the file is missing, of no known format, or has values beyond a pinhole with Brown's distortion.
    """
    path = Path(path)
    conventions = conventions or Conventions()
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError("too large for a calibration file", file=path, expected=f"up to {MAX_BYTES >> 20} MiB",
                             found=f"{path.stat().st_size >> 20} MiB", remedy="give the calibration alone")
        content = path.read_bytes()
    except OSError as error:
        raise InputError("the calibration file cannot be read", file=path, expected="a readable file",
                         found=error.strerror, remedy="correct the path") from None
    if content[:2] == b"PK":
        project = _vic3d_project(path)
        return read_opencv(content, path, conventions) if project is None else read_vic3d(project, path, conventions)
    text = content.decode("utf-8-sig", errors="replace")
    if "<camera " in text and "<orientation" in text:
        return read_vic3d(text, path, conventions)
    if "<ParameterList" in text:
        return read_dice_xml(text, path, conventions)
    if text.lstrip()[:1] == "{" or text.lstrip().startswith(("%YAML", "<?xml", "<opencv_storage")):
        return read_opencv(content, path, conventions)
    if "cam0_" in text.lower() and "cam1_" in text.lower():
        return read_stereo_table(text, path, conventions)
    if path.suffix.lower() in (".yml", ".yaml"):
        return read_opencv(content, path, conventions)
    first = text.split("#")[0].split()
    if first and _is_number(first[0]):
        return read_dice_text(text, path, conventions)
    raise InputError("not a calibration file of a known format", file=path, found=text[:60].strip() or "nothing",
                     expected="VIC-3D (.xml, .z3d), MatchID (.caldat), OpenCV (.yml, .json, .npz), DICe (.xml, .txt) "
                              "or pyvale text", remedy="export the calibration in one of these formats")


def _vic3d_project(path):
    """The text of the member that holds cameras, of an archive; None where there is none."""
    try:
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                if member.filename.lower().endswith(".xml") and member.file_size <= MAX_BYTES:
                    text = archive.read(member).decode("utf-8", errors="replace")
                    if "<camera " in text:
                        return text
    except (zipfile.BadZipFile, RuntimeError, OSError, EOFError) as error:
        raise InputError("the archive cannot be read", file=path, expected="a .z3d project or a NumPy .npz",
                         found=str(error), remedy="save the project again") from None
    return None


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True
