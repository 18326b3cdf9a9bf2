"""The pinhole cameras of an experiment file at the place of the mesh that their reference images show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.pinhole.lenses import Lenses, camera_tables, check_image
from idic.experiment_file.pinhole.measured_alignment import Eye, placed_by_images
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import Mesh
from idic.images import Stack


def placed_lenses(lens: Lenses, config: ExperimentFile, mesh: Mesh, stacks: Sequence[Stack], reference: int,
                  file) -> Lenses:
    """The same lenses, placed where an alignment by holes, edges or the measured surface is asked for.

    stacks : images of every camera, the main one first; reference : number of the reference image

    Raises
    ------
    InputError
        The images do not show the place of the mesh, or another key gives it as well.
    """
    tables = camera_tables(config)
    asked = [i for i, table in enumerate(tables) if table.alignment is not None and table.alignment.by_images]
    if not asked:
        return lens
    key = "camera" if len(tables) == 1 else f"camera[{asked[0]}]"
    if any(table.rotation is not None for table in tables):
        raise InputError("the pose is given twice", file=file, key=f"{key}.alignment",
                         expected="rotation and translation_mm, or alignment", found="both", remedy="leave out one")
    if config.experiment.mesh.file is None:
        raise InputError("a mesh made on the image, aligned by the image", file=file, key=f"{key}.alignment",
                         expected="a mesh file", found="a mesh that is made where the image shows it",
                         remedy="click points (points_mm, points_px), or name a mesh file")
    eyes, solid = [], config.experiment.kind == "solid"
    for i, (table, camera) in enumerate(zip(tables, lens.cameras, strict=True)):
        if camera is None:
            continue
        name = "camera" if len(tables) == 1 else f"camera[{i}]"
        if stacks[i].n_frames <= reference:
            raise InputError("the cameras have different numbers of images", file=file, key=f"{name}.images",
                             expected=f"{reference + 1} or more", found=str(stacks[i].n_frames),
                             remedy="name the same frames in both patterns")
        check_image(camera, lens.sizes[i], stacks[i].shape, name, file)
        surface = (getattr(table, "surface", None) or config.experiment.surface) if solid else None
        eyes.append(Eye(name, camera, np.asarray(stacks[i].frame(reference)), table.alignment, surface))
    placed = placed_by_images(mesh, eyes, file)
    cameras = tuple(camera and replace(camera, rotation=placed.rotation, translation_mm=placed.translation_mm)
                    for camera in lens.cameras)
    return replace(lens, cameras=cameras, placement_prior=placed.prior, notes=(*lens.notes, *placed.notes))
