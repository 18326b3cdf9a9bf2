"""Left and right: whether the images of a rig belong to the cameras that the experiment file gives them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from idic.correlation import COARSE_PX, MIN_CORRELATION, Seen, agreements, speckle_agreement
from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import Mesh
from idic.images import PlacedCamera, Stack
from idic.model import FurtherCamera

CLEAR, MIN_GAIN = 0.9, 0.1  # correlation of the speckles: right beyond doubt; gain by exchanging left and right
GOOD = 0.8


def pairing_notes(config: ExperimentFile, mesh: Mesh, camera, stack: Stack, others: Sequence[FurtherCamera],
                  reference: int, file) -> list[str]:
    """Notes on how well the cameras agree on the speckle.

    Raises
    ------
    InputError
        If two cameras agree with left and right exchanged, and not as given.
    """
    surface = config.experiment.surface if config.experiment.kind == "solid" else None
    seen = [(config.camera.name if config.camera else "camera", Seen(camera, stack.frame(reference), surface))]
    seen += [(other.name, Seen(other.camera, other.stack.frame(reference), other.surface)) for other in others]
    seen = [(name, own) for name, own in seen if isinstance(own.camera, PlacedCamera)]
    if len(seen) < 2:
        return []
    (first, one), notes = seen[0], []
    for (name, two), agreement in zip(seen[1:], agreements(mesh, [own for _, own in seen]), strict=True):
        found = agreement.correlation
        if np.isnan(found) or (mesh.n_dim == 2 and one.camera.side != two.camera.side):  # both sides of a sheet
            continue
        if found < CLEAR and one.image.shape == two.image.shape:
            exchanged = replace(one, image=two.image), replace(two, image=one.image)
            fine = speckle_agreement(mesh, *exchanged).correlation
            given, swapped = (speckle_agreement(mesh, *pair, COARSE_PX).correlation
                              for pair in ((one, two), exchanged))
            if fine > max(CLEAR, found + MIN_GAIN) or swapped > max(0.5, given + 0.5):
                raise InputError("the images of two cameras are swapped", file=file, key="camera.calibration_camera",
                                 expected="images that show one speckle at the same points of the mesh",
                                 found=f"{first} and {name}: correlation {found:.2f} as given, {fine:.2f} exchanged",
                                 remedy="exchange their images, or their calibration_camera")
        if found < GOOD:
            notes.append(f"{first} and {name} see different grey values at the same points of the mesh (correlation "
                         f"{found:.2f}): placement or calibration are off by about a speckle, or the light differs; "
                         "idic check draws the mesh on both images")
    return notes + list(_textures(mesh, dict(seen), others, file))


def _textures(mesh: Mesh, seen: dict[str, Seen], others: Sequence[FurtherCamera], file) -> Iterator[str]:
    """Notes on the cameras that are compared with the texture of another one."""
    for number, other in enumerate(others, 1):
        if other.texture is None:
            continue
        found = speckle_agreement(mesh, seen[other.texture], seen[other.name])
        if np.isnan(found.correlation):
            raise InputError("two cameras with one texture see different parts of the surface", file=file,
                             key=f"camera[{number}].texture", expected=f"points of the mesh that {other.texture} and "
                             f"{other.name} both see", found=f"{100.0 * found.share:.2g} % of those of {other.texture}",
                             remedy="name a camera that sees the same part, or leave texture out")
        yield (f"{other.name} is compared with the texture of {other.texture}: it sees {100.0 * found.share:.0f} % of "
               f"the pixels of {other.texture} that lie on the mesh (correlation {found.correlation:.2f} at the start)")
        if found.correlation < MIN_CORRELATION:
            yield (f"the textures of {other.texture} and {other.name} are compared from a correlation of "
                   f"{MIN_CORRELATION:g} on; until the search reaches it, only the frames of each camera count")
