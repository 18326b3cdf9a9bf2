"""The unit of length and the camera: source of the scale, assumptions without one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.cameras import FurtherCameraTable
from idic.images import AnyCamera, Camera, PlacedCamera
from idic.readers import factor_between


@dataclass(frozen=True)
class Lengths:
    """``factor``: internal length (mm; px without scale) per mesh unit; ``unit``: "mm" or "px"."""

    unit: str
    factor: float
    camera: AnyCamera
    notes: tuple[str, ...] = ()
    mesh_unit: str = "mm"


def lengths(config: ExperimentFile, image_shape: tuple[int, int], file, lens: PlacedCamera | None = None) -> Lengths:
    """Scale and camera of an experiment.

    lens : of the main camera where that is a pinhole camera: then everything is in mm.

    Without a camera table the mesh is in px: x = column, y = row. Without ``mesh_unit`` the mesh is in mm where the
    camera knows the scale, else in px.

    Raises
    ------
    InputError
        The mesh is in a unit of length but no scale is given, or the origin or a unit is missing.
    """
    table, notes = config.camera, []
    if lens is not None:
        unit = config.experiment.mesh_unit or ("px" if config.experiment.mesh.roi_px is not None else "mm")
        if unit == "px" and not config.experiment.mesh.in_px:
            raise InputError("a mesh in px before a camera with a lens", file=file, key="experiment.mesh_unit",
                             expected="a unit of length: a lens has no scale that holds everywhere", found='"px"',
                             remedy="give the mesh in mm, or draw it on the image (roi_px, outline_px)")
        factor = 1.0 if unit == "px" else factor_between(unit, "mm", file=file, key="experiment.mesh_unit")
        return Lengths("mm", factor, lens, (), unit)
    matrix = None if table is None else table.matrix_px_per_unit
    on_image = config.experiment.mesh.in_px
    mesh_unit, scaled = config.experiment.mesh_unit, table is not None and (table.pixel_size_mm is not None)
    if mesh_unit is None:
        in_mm = (scaled or matrix is not None or config.experiment.mesh.roi_mm is not None
                 or config.experiment.mesh.outline_mm is not None)
        mesh_unit = "mm" if in_mm and not on_image else "px"
        if mesh_unit == "px" and not scaled and matrix is None:
            notes.append("no scale: lengths are in px" + ("" if on_image else ", the mesh file included"))
    if on_image and mesh_unit != "px":
        raise InputError("a mesh made on the image is in px", file=file, key="experiment.mesh_unit",
                         expected='"px", or no mesh_unit', found=repr(mesh_unit),
                         remedy="leave mesh_unit out; pixel_size_mm gives the scale")
    if mesh_unit == "px":
        factor = table.pixel_size_mm if scaled else 1.0
    else:
        factor = factor_between(mesh_unit, "mm", file=file, key="experiment.mesh_unit")
        if not scaled and matrix is None:
            raise InputError("a mesh in a unit of length without a scale", file=file, key="camera.pixel_size_mm",
                             expected=f"the size of a pixel, for a mesh in {mesh_unit}",
                             found="no pixel_size_mm and no matrix_px_per_unit",
                             remedy='give one of these keys, or set mesh_unit = "px" for a mesh in px')
    unit = "mm" if scaled or mesh_unit != "px" else "px"
    camera = _camera(table, "camera", image_shape, mesh_unit, factor, scaled, file, notes)
    return Lengths(unit, factor, camera, tuple(notes), mesh_unit)


def further_camera(table: FurtherCameraTable, key: str, image_shape: tuple[int, int], scale: Lengths,
                   file) -> tuple[Camera, list[str]]:
    """A further telecentric camera on a mesh of known length unit, and notes on the assumptions.

    Raises
    ------
    InputError
        The camera has no scale in the unit of the mesh, or no origin.
    """
    notes: list[str] = []
    scaled = table.pixel_size_mm is not None and scale.unit == "mm"
    if table.matrix_px_per_unit is None and not scaled:
        keys = "matrix_px_per_unit" if scale.unit == "px" else "pixel_size_mm, or matrix_px_per_unit"
        raise InputError("a further camera without its scale", file=file, key=f"{key}.pixel_size_mm", expected=keys,
                         found="no such key" if table.pixel_size_mm is None else f"{table.pixel_size_mm:g} mm",
                         remedy="calibrate this camera on the same mesh: px per unit of the mesh")
    if table.origin_px is None:
        raise _no_origin(key, file)
    camera = _camera(table, key, image_shape, scale.mesh_unit, scale.factor, scaled, file, notes)
    return camera, [f"{table.name}: {note}" for note in notes]


def _no_origin(key: str, file) -> InputError:
    return InputError("a key is missing", file=file, key=f"{key}.origin_px",
                      expected="(column, row) of the mesh origin", found="no such key",
                      remedy="measure it in the reference image; the picture of  idic check  shows the mesh")


def _camera(table, key, image_shape, mesh_unit, factor, scaled, file, notes) -> Camera:
    middle = ((image_shape[1] - 1) / 2, (image_shape[0] - 1) / 2)
    if table is None:
        return Camera.from_table(1.0, (0.0, 0.0), ("+col", "+row"), centre=middle)
    centre = table.centre_px or middle
    foreign = [axis for axis in table.axes or () if axis[1:] in ("x", "y")]
    if foreign or table.origin_mm is not None:
        raise InputError("a key of measured fields next to images", file=file,
                         key=f"{key}.{'axes' if foreign else 'origin_mm'}", expected='origin_px, axes such as "+col"',
                         found=str(foreign[0] if foreign else table.origin_mm), remedy="write the keys of images")
    origin = table.origin_px
    if origin is None:
        if mesh_unit != "px":
            raise _no_origin(key, file)
        origin = [0.0, 0.0]
    if table.matrix_px_per_unit is not None:
        matrix = np.array(table.matrix_px_per_unit) / factor
        if not maps_a_plane(matrix):
            raise InputError("the matrix does not map a plane", file=file, key=f"{key}.matrix_px_per_unit",
                             expected="two directions that differ",
                             found=str(table.matrix_px_per_unit),
                             remedy="give d column/dx, d column/dy; d row/dx, d row/dy in px per mesh unit")
        return Camera.from_matrix(matrix, origin, table.k1, centre)
    axes = table.axes
    if axes is None:
        axes = ["+col", "+row"] if mesh_unit == "px" else ["+col", "-row"]
        notes.append(f"{key}.axes not given: x to the right, y {'down' if mesh_unit == 'px' else 'up'} in the image")
    if axes[0][1:] == axes[1][1:]:
        raise InputError("both axes point along the same image direction", file=file, key=f"{key}.axes",
                         expected='one along the columns, one along the rows, e.g. ["+col", "-row"]',
                         found=str(axes), remedy="correct one of them")
    return Camera.from_table(table.pixel_size_mm if scaled else 1.0, origin, axes, table.rotation_deg, table.k1, centre)


def maps_a_plane(matrix: np.ndarray) -> bool:
    """Whether the matrix (2, 2) is regular, independent of its scale."""
    size = float(np.abs(matrix).max())
    return bool(0.0 < size < np.inf and abs(np.linalg.det(matrix / size)) > 1e-9)
