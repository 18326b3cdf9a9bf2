"""A sheet that bends or buckles out of its plane before one camera: a false motion within the plane."""

from __future__ import annotations

from collections.abc import Collection

from idic.diagnose.candidates.magnification import PROBE_MAGNIFICATION, changing_columns
from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import camera_key, camera_table
from idic.images import Camera, CameraMotion
from idic.parameters import PlausibleSize

LEANING = ("lean_x", "lean_y")
BENDING = tuple(shape for shape in CameraMotion.shapes if shape not in LEANING)


def variants(situation: Situation) -> tuple[Variant, ...]:
    return deflections(situation, BENDING)


def deflections(situation: Situation, shapes: Collection[str]) -> tuple[Variant, ...]:
    """Each of these shapes, with time and with every logged quantity; () where the specimen is no sheet in grey images.
    """
    experiment, stem = situation.experiment, situation.experiment.recording.camera_name
    model, entries = experiment.model, list(camera_table(situation).get("deflections", ()))
    if not isinstance(model.camera, Camera) or model.n_dim != 2 or model.surface is not None \
            or experiment.recording.quantity != "grey":
        return ()
    courses: list[tuple[str, str, dict[str, str], float]] = []
    if model.has_times:
        courses.append(("drift", "time", {}, PROBE_MAGNIFICATION / situation.duration))
    courses += [("load", column, {"column": column}, PROBE_MAGNIFICATION) for column in changing_columns(situation)]
    proposals = []
    for shape in shapes:
        if any(entry["shape"] == shape for entry in entries):
            continue
        for ending, course, keys, probe in courses:
            name, addition = f"{stem}.{shape}_{ending}", {"shape": shape, **keys}
            proposals.append(Variant(f"the sheet {CameraMotion.shapes[shape].words}, with {course}",
                                     {camera_key(situation, "deflections"): [*entries, addition]}, (name,), {name: 0.0},
                                     {name: probe}, direct=True))
    return tuple(proposals)


register(Candidate(
    "sheet_bending", "camera", "bending or buckling out of the plane", "a sheet that stays plane",
    rivals={"magnification": "a motion of the whole sheet towards the camera",
            "specimen_motion": "a sheet that leans as a whole",
            "poisson_ratio": "both stretch the image across the load",
            "heterogeneity": "a strain that differs from the middle to the ends",
            "lens_distortion": "both displace points from and towards the axis of the camera",
            "orthotropy": "another ratio of the strains along and across"},
    separating_tests=("a second camera at an angle", "a camera from behind: the false motion changes its sign",
                      "a longer lens from farther away: it falls as 1 / distance; a telecentric one has none"),
    variants=variants,
    paraphrase="parts of the sheet come nearer to the camera and look larger; the images show deflection over distance",
    size=PlausibleSize(1.0, "0.1 % of the distance to the camera",
                       "an estimate: 0.8 mm before a lens of 55 mm (Sutton et al. 2008: 1.25e-3 of strain per mm)")))
