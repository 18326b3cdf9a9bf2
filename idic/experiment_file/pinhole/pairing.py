"""Left and right: whether the images of a rig belong to the cameras that the experiment file gives them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from idic.correlation import COARSE_PX, MIN_CORRELATION, Seen, speckle_agreement
from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import Mesh
from idic.images import PlacedCamera, Stack
from idic.model import FurtherCamera

CLEAR, MIN_GAIN = 0.9, 0.1  # correlation of the speckles: right beyond doubt; gain by exchanging left and right
GOOD = 0.8


def pairing_notes(config: ExperimentFile, mesh: Mesh, camera, stack: Stack, further_cameras: Sequence[FurtherCamera],
                  reference: int, file) -> list[str]:
    """Notes on how well the cameras agree on the speckle.

    Raises
    ------
    InputError
        If two cameras agree with left and right exchanged, and not as given.
    """
    surface = config.experiment.surface if config.experiment.kind == "solid" else None
    views = [(config.camera.name if config.camera else "camera", Seen(camera, stack.frame(reference), surface))]
    views += [(entry.name, Seen(entry.camera, entry.stack.frame(reference), entry.surface))
              for entry in further_cameras]
    views = [(name, view) for name, view in views if isinstance(view.camera, PlacedCamera)]
    if len(views) < 2:
        return []
    (first, first_view), notes = views[0], []
    for name, second_view in views[1:]:
        correlation = speckle_agreement(mesh, first_view, second_view).correlation
        are_opposite = mesh.n_dim == 2 and first_view.camera.side != second_view.camera.side  # both sides of a sheet
        if np.isnan(correlation) or are_opposite:
            continue
        if correlation < CLEAR and first_view.image.shape == second_view.image.shape:
            exchanged = replace(first_view, image=second_view.image), replace(second_view, image=first_view.image)
            fine = speckle_agreement(mesh, *exchanged).correlation
            coarse, swapped = (speckle_agreement(mesh, *pair, COARSE_PX).correlation
                               for pair in ((first_view, second_view), exchanged))
            if fine > max(CLEAR, correlation + MIN_GAIN) or swapped > max(0.5, coarse + 0.5):
                raise InputError("the images of two cameras are swapped", file=file, key="camera.calibration_camera",
                                 expected="images that show one speckle at the same points of the mesh",
                                 found=f"{first} and {name}: correlation {correlation:.2f} as given, "
                                       f"{fine:.2f} exchanged",
                                 remedy="exchange their images, or their calibration_camera")
        if correlation < GOOD:
            notes.append(f"{first} and {name} see different grey values at the same points of the mesh (correlation "
                         f"{correlation:.2f}): placement or calibration are off by about a speckle, or the light "
                         "differs; idic check draws the mesh on both images")
    return notes + list(_textures(mesh, dict(views), further_cameras, file))


def _textures(mesh: Mesh, views: dict[str, Seen], further_cameras: Sequence[FurtherCamera], file) -> Iterator[str]:
    """Notes on the cameras that are compared with the texture of another one."""
    for number, entry in enumerate(further_cameras, 1):
        if entry.texture is None:
            continue
        agreement = speckle_agreement(mesh, views[entry.texture], views[entry.name])
        if np.isnan(agreement.correlation):
            raise InputError("two cameras with one texture see different parts of the surface", file=file,
                             key=f"camera[{number}].texture", expected=f"points of the mesh that {entry.texture} and "
                             f"{entry.name} both see",
                             found=f"{100.0 * agreement.share:.2g} % of those of {entry.texture}",
                             remedy="name a camera that sees the same part, or leave texture out")
        yield (f"{entry.name} is compared with the texture of {entry.texture}: it sees {100.0 * agreement.share:.0f} % "
               f"of the pixels of {entry.texture} that lie on the mesh (correlation {agreement.correlation:.2f} at the "
               "start)")
        if agreement.correlation < MIN_CORRELATION:
            yield (f"the textures of {entry.texture} and {entry.name} are compared from a correlation of "
                   f"{MIN_CORRELATION:g} on; until the search reaches it, only the frames of each camera count")
