"""The second and later [[camera]] tables: further cameras on the same specimen at the same times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.checks.height_maps import check_height_unit
from idic.experiment_file.checks.model import (check_surface, check_visible, corners_px, seen_nodes, seen_region,
                                               visible_cells)
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.cameras import FurtherCameraTable
from idic.experiment_file.checks.images_at_rest import check_depth, check_exposures
from idic.experiment_file.tables.lengths import Lengths, further_camera
from idic.experiment_file.tables.mesh_sets import with_edge_set
from idic.experiment_file.pinhole.lenses import Lenses, calibration_files, check_image
from idic.fe import Mesh
from idic.images import PlacedCamera, still_noise
from idic.model import FurtherCamera, Noise
from idic.readers import FileStack, existing_file, matching_files, open_stack, read_image


def with_surfaces(mesh: Mesh, config: ExperimentFile, file) -> Mesh:
    """The mesh with the face sets that the further cameras see."""
    for number, table in enumerate(config.further_cameras, 1):
        if table.surface is not None:
            mesh = with_edge_set(mesh, table.surface, file, f"camera[{number}].surface")
    return mesh


@dataclass(frozen=True, eq=False)
class CameraFrames:
    """Images, mask and separate images at rest of a further camera, as its files hold them."""

    stack: FileStack
    mask: np.ndarray | None  # (ny, nx) bool
    still_stack: FileStack | None


def camera_frames(config: ExperimentFile, folder: Path, file) -> tuple[CameraFrames, ...]:
    """The images of the further cameras.

    Raises
    ------
    InputError
        A pattern without images, a mask of another size.
    """
    return tuple(_CameraFiles(config, table, f"camera[{number}]", folder, file).frames()
                 for number, table in enumerate(config.further_cameras, 1))


def further_cameras(config: ExperimentFile, recorded: Sequence[CameraFrames], mesh: Mesh, scale: Lengths, n_frames: int,
                    still: Sequence[int], file, lenses: Lenses,
                    noises: Sequence[Noise] | None = None) -> tuple[tuple[FurtherCamera, ...], list[str]]:
    """The further cameras, and notes on the assumptions.

    recorded : their images; still : frames in which the specimen is at rest (of all cameras); noises : where they are
    known

    Raises
    ------
    InputError
        The number of images differs from the main camera, the scale is missing, the mesh lies outside the image, or a
        plane specimen has the key plane.
    """
    cameras, notes = [], []
    for number, (table, frames) in enumerate(zip(config.further_cameras, recorded, strict=True), 1):
        seen_by = _Camera(config, table, f"camera[{number}]", frames, file)
        noise = None if noises is None else noises[number - 1]
        camera, remarks = seen_by.placed(mesh, scale, n_frames, still, lenses.cameras[number], lenses.sizes[number],
                                         noise)
        cameras.append(camera)
        notes.extend(remarks)
    return tuple(cameras), notes


def camera_files(config: ExperimentFile, folder: Path) -> list[Path]:
    """Masks of the further cameras, calibrations of all."""
    masks = [folder / table.mask for table in config.further_cameras if table.mask is not None]
    return [*masks, *calibration_files(config, folder)]


def camera_images(config: ExperimentFile, folder: Path) -> list[Path]:
    """Images of the further cameras (found before)."""
    return [path for table in config.further_cameras
            for path in matching_files(folder, table.images, file=None, key="camera", order=config.experiment.order)]


class _CameraFiles:
    """The files of one table."""

    def __init__(self, config: ExperimentFile, table: FurtherCameraTable, key: str, folder: Path, file):
        self.config, self.table, self.key, self.folder, self.file = config, table, key, folder, file

    def frames(self) -> CameraFrames:
        stack = self.stack(self.table.images, "images")
        still = self.table.still_frames
        return CameraFrames(stack, self.mask(stack), None if still is None else self.stack([still], "still_frames"))

    def stack(self, patterns, name: str) -> FileStack:
        key = f"{self.key}.{name}"
        table = self.config.experiment
        order = table.order if name == "images" else None
        stack = open_stack(matching_files(self.folder, patterns, file=self.file, key=key, order=order), file=self.file,
                           key=key, with_gaps=table.quantity == "height")
        check_height_unit(stack, table.height_unit, self.file, key)
        return stack

    def mask(self, stack: FileStack) -> np.ndarray | None:
        name, key = self.table.mask, f"{self.key}.mask"
        if name is None:
            return None
        mask = read_image(existing_file(self.folder, name, file=self.file, key=key)) > 0
        if mask.shape != stack.shape or not mask.any():
            raise InputError("not a mask for the images of this camera", file=self.file, key=key,
                             expected=f"{stack.shape[1]} x {stack.shape[0]} px, white where it is to be correlated",
                             found=f"{mask.shape[1]} x {mask.shape[0]} px, {int(mask.sum())} white",
                             remedy="make it from this camera's reference image")
        return mask


class _Camera:
    """One table and its images."""

    def __init__(self, config: ExperimentFile, table: FurtherCameraTable, key: str, frames: CameraFrames, file):
        self.config, self.table, self.key, self.frames, self.file = config, table, key, frames, file

    def placed(self, mesh: Mesh, scale: Lengths, n_frames: int, still: Sequence[int], lens: PlacedCamera | None,
               calibrated_size: tuple[int, int] | None, noise: Noise | None) -> tuple[FurtherCamera, list[str]]:
        table, kind, stack, mask = self.table, self.config.experiment.kind, self.frames.stack, self.frames.mask
        if stack.n_frames != n_frames:
            raise InputError("the cameras have different numbers of images", file=self.file, key=f"{self.key}.images",
                             expected=f"{n_frames} images, one per image of the main camera and in the same order",
                             found=f"{stack.n_frames}", remedy="name the same frames in both patterns; replace a "
                             "missing image by a black one: idic leaves it out")
        order = self.axis_order(mesh)
        if order:
            mesh = replace(mesh, nodes=mesh.nodes[:, list(order)])
        surface = table.surface or (self.config.experiment.surface if kind == "solid" else None)
        check_surface(mesh, kind, surface, self.file, f"{self.key}.surface")
        if lens is None:
            camera, notes = further_camera(table, self.key, stack.shape, scale, self.file)
        else:
            check_image(lens, calibrated_size, stack.shape, self.key, self.file)
            camera, notes = lens, []
        check_visible(mesh, kind, surface, camera, stack.shape, mask, self.file, (self.key, f"{self.key}.mask"))
        if noise is None:
            corners = corners_px(*seen_nodes(mesh, kind, surface), kind, surface, camera)
            visible = visible_cells(mesh, kind, surface, camera, stack.shape)
            noise = self.noise(seen_region(corners, visible, stack.shape, mask), still)
        notes += [f"{table.name}: {note}" for note in stack.notes()]
        return FurtherCamera(table.name, camera, stack, stack.labels, noise, mask, surface, order, table.texture), notes

    def axis_order(self, mesh: Mesh) -> tuple[int, ...]:
        order = tuple("xyz".index(axis) for axis in self.table.plane)
        if order == (0, 1):
            return ()
        if self.table.lens:
            raise InputError("a plane of mesh axes next to a pose", file=self.file, key=f"{self.key}.plane",
                             expected="no plane: the pose says how the camera looks", found=str(self.table.plane),
                             remedy="leave plane out")
        if mesh.n_dim == 2:
            raise InputError("a plane specimen is seen face on", file=self.file, key=f"{self.key}.plane",
                             expected='no plane (a mirrored or turned view is given by axes)',
                             found=str(self.table.plane), remedy='leave plane out, or set kind = "solid"')
        return (*order, 3 - sum(order))

    def noise(self, region: np.ndarray, still: Sequence[int]) -> Noise:
        """The noise: given, else from its own still images, else from the still frames of the test, else open."""
        if self.table.noise_std_gv is not None:
            return Noise(self.table.noise_std_gv, "given")
        stack, at_rest = self.frames.stack, self.frames.still_stack
        images, labels = [stack.frame(k) for k in still], [stack.labels[k] for k in still]
        if at_rest is not None:
            if at_rest.shape != stack.shape or at_rest.n_frames < 2:
                raise InputError("no still images of this camera", file=self.file, key=f"{self.key}.still_frames",
                                 expected=f"two or more of {stack.shape[1]} x {stack.shape[0]} px, taken at rest",
                                 found=f"{at_rest.n_frames} of {at_rest.shape[1]} x {at_rest.shape[0]} px",
                                 remedy="correct the pattern, or leave the key out")
            check_depth(at_rest, stack, self.file, f"{self.key}.still_frames")
            images, labels = [at_rest.frame(k) for k in range(at_rest.n_frames)], list(at_rest.labels)
        if not images:
            return Noise(None, "")
        if self.config.experiment.quantity == "grey":
            key = "experiment" if self.table.still_frames is None else self.key
            check_exposures(images, labels, region, self.file, f"{key}.still_frames")
        return Noise(still_noise(images, region).std_gv, "still_frames")
