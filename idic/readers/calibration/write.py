"""A rig as JSON in the names of OpenCV, with the covariance: what `read_calibration` reads again."""

from __future__ import annotations

import json
from pathlib import Path

from idic.inside import write_inside
from idic.readers.calibration.rig import CameraRig


def write_rig(path: str | Path, rig: CameraRig, about: dict[str, object]) -> None:
    """Write one or two cameras, camera 0 at the origin.

    Parameters
    ----------
    path : path
    rig : CameraRig
    about : dict
        Further entries for people and scripts, e.g. ``rms_px``; they do not bear names of OpenCV.
    """
    content: dict[str, object] = dict(about)
    sizes = [size for size in rig.image_size_px if size is not None]
    if len(set(sizes)) == 1:
        content["image_size"] = list(sizes[0])
    else:  # cameras of unlike size
        content |= {f"image_size{number}": list(size) for number, size in enumerate(rig.image_size_px, 1) if size}
    for number, camera in enumerate(rig.cameras):
        suffix = "" if len(rig.cameras) == 1 else str(number + 1)
        content[f"camera_matrix{suffix}"] = camera.matrix.tolist()
        content[f"distortion_coefficients{suffix}"] = [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3]
    if len(rig.cameras) == 2:
        content["R"], content["T"] = rig.cameras[1].rotation.tolist(), rig.cameras[1].translation_mm.tolist()
    if rig.covariance is not None:
        content["covariance"] = {"names": list(rig.names), "matrix": rig.covariance.tolist()}
    write_inside(Path(path).parent, Path(path).name, json.dumps(content, indent=1) + "\n")
