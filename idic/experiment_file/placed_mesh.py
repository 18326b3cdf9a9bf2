"""The mesh and the cameras of an experiment file, where the images show the specimen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from idic.errors import InputError
from idic.experiment_file.checks.height_maps import pitch_in_words, pitch_notes
from idic.experiment_file.checks.model import check_surface
from idic.experiment_file.measured_fields.placement import field_camera, laid_on_outline
from idic.experiment_file.pinhole.lenses import Lenses, camera_tables, check_image, lenses, middle_of
from idic.experiment_file.pinhole.placed_lenses import placed_lenses
from idic.experiment_file.recording import RecordedFiles
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.tables.further_cameras import with_surfaces
from idic.experiment_file.tables.lengths import Lengths, lengths
from idic.experiment_file.tables.mesh_on_image import mesh_on_image
from idic.experiment_file.tables.mesh_sets import with_edge_set, with_sets
from idic.experiment_file.volumes.scanner_table import scanner_scale
from idic.fe import Mesh
from idic.images import Camera, Scanner
from idic.readers import FieldStack, factor_between


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """The mesh (mm) with its sets, before the orders of elements are raised, and the cameras that look at it.

    scale : with the main camera; lens : of every camera; tables : what it was made of
    """

    mesh: Mesh
    scale: Lengths
    lens: Lenses
    notes: tuple[str, ...]
    tables: tuple

    def is_of(self, config: ExperimentFile) -> bool:
        """Whether these tables make the same mesh and cameras."""
        return self.tables == tables_of(config)


def tables_of(config: ExperimentFile) -> tuple:
    """The tables that decide mesh and cameras: motions of a camera are none of them."""
    still = tuple(table.model_copy(update={"motion": None}) for table in camera_tables(config))
    return config.experiment, config.sets, config.camera is None, still, config.scanner


def placed_mesh(config: ExperimentFile, recording: RecordedFiles, file: Path) -> PlacedMesh:
    """Mesh and cameras on the images of a recording.

    Raises
    ------
    InputError
        The mesh is damaged or has no such set, a scale is missing or contradicts the images, the images do not show the
        place of the mesh.
    """
    return _Placement(config, recording, file).placed()


@dataclass(frozen=True)
class _Placement:
    config: ExperimentFile
    recording: RecordedFiles
    file: Path

    def placed(self) -> PlacedMesh:
        table, frames = self.config.experiment, self.recording.frames
        lens = lenses(self.config, self.recording.calibrations, self.file)
        scale = self.scale(lens)
        mesh, notes = self.mesh(scale)
        if table.surface is not None:
            mesh = with_edge_set(mesh, table.surface, self.file, "experiment.surface")
        mesh = with_surfaces(mesh, self.config, self.file)
        lens = lens.about(middle_of(mesh))
        if lens.cameras[0] is not None:
            stacks = [frames.stack, *(camera.stack for camera in self.recording.cameras)]
            lens = placed_lenses(lens, self.config, mesh, stacks, frames.reference, self.file)
            scale = replace(scale, camera=lens.cameras[0])
        scale = self.on_outline(scale, mesh)
        if isinstance(scale.camera, Scanner):
            scale = replace(scale, camera=replace(scale.camera, pivot_mm=middle_of(mesh)))
        else:
            check_surface(mesh, table.kind, table.surface, self.file)
        if table.quantity == "height" and isinstance(scale.camera, Camera):
            is_section = table.surface is not None and table.kind != "solid"
            notes += pitch_notes(frames.stack, scale.camera, is_section, self.file)
        return PlacedMesh(mesh, scale, lens, tuple(notes), tables_of(self.config))

    def scale(self, lens: Lenses) -> Lengths:
        table, frames = self.config.experiment, self.recording.frames
        if table.volumes:
            return scanner_scale(self.config, frames.stack, self.file)
        if isinstance(frames.stack, FieldStack):
            unit = table.mesh_unit or "mm"
            if unit == "px":
                raise InputError("a mesh in px on measured fields", file=self.file, key="experiment.mesh_unit",
                                 expected="a unit of length: the points are in mm", found='"px"',
                                 remedy="multiply every length of the mesh by pixel_size_mm, leave mesh_unit out")
            factor = factor_between(unit, "mm", file=self.file, key="experiment.mesh_unit")
            return Lengths("mm", factor, field_camera(self.config, frames.stack.points, self.file), (), unit)
        if lens.cameras[0] is not None:
            check_image(lens.cameras[0], lens.sizes[0], frames.shape, "camera", self.file)
        scale = lengths(self.config, frames.shape, self.file, lens.cameras[0])
        if table.quantity == "height" and scale.unit == "px":
            raise InputError("height images without a scale", file=self.file, key="camera.pixel_size_mm",
                             expected=f"the size of a pixel: heights are in {table.height_unit}", found="lengths in px",
                             remedy="give pixel_size_mm" + (f" = {pitch}, the pitch of the files" if (
                                 pitch := pitch_in_words(frames.stack)) else ""))
        return scale

    def mesh(self, scale: Lengths) -> tuple[Mesh, list[str]]:
        table, key = self.config.experiment.mesh, "experiment.mesh"
        n_dim = 3 if self.config.experiment.kind == "solid" else 2
        source = self.file
        if table.file is not None:
            raw = self.recording.mesh
            assert raw is not None  # of the file
            source = raw.file
            mesh, notes = raw.to_mesh(n_dim, scale.factor)
            notes += _other_kinds(raw.stated_kinds, self.config.experiment.kind)
        else:
            mesh, notes = mesh_on_image(self.config, scale, self.recording.frames.stack, self.file)
        try:
            mesh.check_elements()
        except InputError as error:
            raise InputError(error.what, file=source, key=key,
                             expected=error.expected, found=error.found,
                             remedy=error.remedy) from None
        return with_sets(mesh, self.config.sets, scale.factor, self.file), notes

    def on_outline(self, scale: Lengths, mesh: Mesh) -> Lengths:
        """With the camera of a mesh that is laid onto measured points by its outline."""
        frames = self.recording.frames
        if self.config.camera is None or self.config.camera.placement == "given":
            return scale
        if not isinstance(frames.stack, FieldStack) or self.config.experiment.mesh.file is None:
            raise InputError("a placement by the outline of points", file=self.file, key="camera.placement",
                             expected="measured fields and a mesh file", found="images" if frames.points is None else
                             "a mesh that is made of the points", remedy="leave placement out")
        camera, note = laid_on_outline(self.config, frames.stack.points, mesh, scale.camera, self.file)
        return replace(scale, camera=camera, notes=(*scale.notes, note))


def _other_kinds(stated_kinds: Mapping[str, str], kind: str) -> list[str]:
    """Notes on elements that another program takes for another state of the body than idic."""
    return [f"the mesh has {name} elements, which are {stated_kind.replace('_', ' ')} elsewhere: idic takes their "
            f"shape alone and computes {kind.replace('_', ' ')} (kind under [experiment])"
            for name, stated_kind in stated_kinds.items() if stated_kind != kind]
