"""[camera] and [[camera]] as strict models: calibration, noise and motion of the cameras.

``[camera]``
    ``noise_model = "grey_level"``: variance offset + slope I over the grey value I, from still_frames (or given, ``{
    offset_gv2 = 1.0, slope_gv = 0.05 }``), and every pixel weighed by its own; default uniform. Main camera only.
    ``motion = "free"``: a rigid motion of the camera in every frame, ``camera.col_at[K]``, ``row_at[K]`` (px) and
    ``turn_at[K]`` (deg) of frame K, is identified (hold the specimen firmly in the model then). A specimen that moves
    out of its plane: [[dof]] ``camera.magnification_drift`` (1/s), and with ``magnification_column``, a column of the
    log, ``camera.magnification_load``: relative magnification at that column's largest value;
    ``magnification_knots``: so many ``camera.magnification_knot[K]``, a course that the data give. ``deflections``: of
    a sheet that bends out of its plane, ``camera.bow_x_load`` …
``[[camera]]``
    The first table is the main camera, the one of ``[experiment]``. Each further one looks at the same specimen at the
    same times: ``name``, its own ``images`` (as many, same order), its calibration, and where they differ ``mask``,
    ``surface`` (another face set of a solid), ``plane`` (the two mesh axes it sees, ``["x", "z"]`` for a side view),
    ``still_frames`` (a glob), ``noise_std_gv``. Their degrees of freedom are ``NAME.rotation_deg`` and so on.
``model = "pinhole"``
    An ordinary lens; other models are files of `idic.images.lenses`. ``calibration`` (a file) and
    ``calibration_camera``, or ``fx_px`` … ``p2``, which win over the file; the pose of the mesh by ``rotation`` and
    ``translation_mm`` (mesh to camera), by an ``alignment`` (clicked points, holes, edges, the surface measured by two
    cameras), or as the calibration has it. Degrees of freedom ``camera.fx``, ``camera.t_z`` …, and ``placement.t_z`` …
    of the mesh before all cameras. Of a specimen that moves as a rigid body: ``placement.t_z_drift`` …, ``motion =
    "free"``, ``motion_column``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator, Field, create_model, model_validator

from idic.experiment_file.schema.base import Component, Pair, Positive, Strict, as_list, refuse
from idic.images import CameraMotion, LENS_MODELS, LensCamera

_TELECENTRIC = ("pixel_size_mm", "origin_px", "origin_mm", "axes", "rotation_deg", "centre_px", "matrix_px_per_unit",
                "magnification_column", "magnification_knots", "deflections", "distance_mm")
_CALIBRATED = ("calibration", "calibration_camera", "calibration_conventions", "identify_calibration")
_COEFFICIENTS = tuple(dict.fromkeys(name for lens in LENS_MODELS.values() for name in lens.coefficients))
_LENS = (*_CALIBRATED, "fx_px", "fy_px", "skew_px", "cx_px", "cy_px",
         *(name for name in _COEFFICIENTS if name != "k1"),  # a telecentric camera has one, too
         "rotation", "translation_mm", "alignment", "motion_column")
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


class NoiseModelTable(Strict):
    """Noise variance by grey value I: offset_gv2 + slope_gv I."""

    offset_gv2: float
    slope_gv: float


class ConventionsTable(Strict):
    """What a calibration file leaves open."""

    skew: Literal["px", "deg"] | None = None
    distortion: Literal["normalised", "px"] | None = None
    angles: Literal["xyz", "zyx"] = "xyz"


Point = Annotated[list[float], Field(min_length=2, max_length=3)]  # of the mesh frame, mm


class HoleTable(Strict):
    """A round hole of the mesh, and a pixel in it."""

    centre_mm: Point
    px: Pair
    radius_mm: Positive | None = None


class EdgeTable(Strict):
    """Two points on a straight edge of the mesh, and about where they are."""

    points_mm: Annotated[list[Point], Field(min_length=2, max_length=2)]
    points_px: Annotated[list[Pair], Field(min_length=2, max_length=2)]

    @model_validator(mode="after")
    def _has_length(self):
        if any(points[0] == points[1] for points in (self.points_mm, self.points_px)):
            raise refuse("an edge without length", "two points that differ", "give its two ends", "one point")
        return self


class AlignmentTable(Strict):
    """What shows the place of the mesh in the reference image of a camera: clicked points, holes, edges."""

    points_mm: list[Point] = []
    points_px: list[Pair] = []
    holes: list[HoleTable] = []
    edges: list[EdgeTable] = []
    measured_surface: bool | None = None

    @property
    def by_images(self) -> bool:
        """Whether the images have to be looked at."""
        return bool(self.holes or self.edges or self.measured_surface)

    @model_validator(mode="after")
    def _pairs(self):
        if len(self.points_mm) != len(self.points_px):
            raise refuse("the points of an alignment do not pair", "as many points_px as points_mm",
                         "give one (column, row) per point", f"{len(self.points_mm)} and {len(self.points_px)}")
        if not self.by_images and len(self.points_mm) < 3:
            raise refuse("an alignment by too few points", "three points or more, or holes and edges",
                         "click corners and holes that lie far apart", str(len(self.points_mm)))
        return self


class LensKeys(Strict):
    """The keys of a camera with a lens; the coefficients of the models join them."""

    model: str = "telecentric"
    calibration: str | None = None
    calibration_camera: Annotated[int, Field(ge=0)] | None = None
    calibration_conventions: ConventionsTable = ConventionsTable()
    identify_calibration: bool = False
    fx_px: Positive | None = None
    fy_px: Positive | None = None
    skew_px: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    rotation: Annotated[list[Triple], Field(min_length=3, max_length=3)] | None = None
    translation_mm: Triple | None = None
    alignment: AlignmentTable | None = None
    motion_column: str | None = None

    @property
    def lens(self) -> type[LensCamera] | None:
        """The model of its lens; None of a telecentric camera."""
        return LENS_MODELS.get(self.model)

    @model_validator(mode="after")
    def _one_model(self):
        foreign = [name for name in _foreign_keys(self.lens) if name in self.model_fields_set]
        if foreign:
            fitting = [f'"{name}"' for name, lens in LENS_MODELS.items() if not set(foreign) & set(_foreign_keys(lens))]
            choice = f", or write model = {' or '.join(fitting)}" if fitting else ""
            raise refuse("keys of another camera model", f"the keys of a {self.model} camera",
                         f"leave out {', '.join(foreign)}{choice}", ", ".join(foreign))
        if self.lens and self.calibration is None and None in (self.fx_px, self.fy_px, self.cx_px, self.cy_px):
            file = 'calibration = "cal.xml", or ' if self.lens.is_calibrated else ""
            raise refuse(f"a {self.model} camera without its calibration", f"{file}fx_px, fy_px, cx_px, cy_px",
                         "calibrate the camera, or give the values", "neither")
        if (self.rotation is None) != (self.translation_mm is None):
            raise refuse("half of a pose", "rotation and translation_mm, from the mesh frame to the camera's",
                         "give both, or neither", "one of them")
        if self.rotation is not None and self.alignment is not None:
            raise refuse("the pose is given twice", "rotation and translation_mm, or alignment", "leave out one",
                         "both")
        if self.identify_calibration and self.calibration is None:
            raise refuse("identify_calibration without a calibration", "a file with deviations", "name the file",
                         "none")
        return self


def _foreign_keys(lens: type[LensCamera] | None) -> list[str]:
    """The keys that belong to other models than this; None: a telecentric camera."""
    if lens is None:
        return list(_LENS)
    coefficients = [name for name in _COEFFICIENTS if name not in lens.coefficients]
    return [*_TELECENTRIC, *coefficients, *(() if lens.is_calibrated else _CALIBRATED)]


if TYPE_CHECKING:
    LensTable = LensKeys
else:
    LensTable = create_model("LensTable", __base__=LensKeys, __module__=__name__,
                             model=(Literal[("telecentric", *LENS_MODELS)], "telecentric"),
                             **dict.fromkeys(_COEFFICIENTS, (float | None, None)))


class DeflectionTable(Strict):
    """A shape in which a sheet bends out of its plane; it grows with time, a column of the log, or as the data give."""

    shape: Literal[tuple(CameraMotion.shapes)]  # type: ignore[valid-type]
    column: str | None = None
    knots: Annotated[int, Field(ge=1, le=100)] | None = None

    @model_validator(mode="after")
    def _one_course(self):
        if self.column is not None and self.knots is not None:
            raise refuse("two courses of one deflection", "column, knots, or neither: it grows with time",
                         "leave out one", "both")
        return self


class CameraTable(LensTable):
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")] = "camera"
    pixel_size_mm: Positive | None = None
    origin_px: Pair | None = None
    origin_mm: Pair | None = None  # of the mesh in the axes of measured fields
    placement: Literal["given", "outline"] = "given"  # of the mesh in the axes of measured fields
    axes: Annotated[list[Literal["+col", "-col", "+row", "-row", "+x", "-x", "+y", "-y"]],
                    Field(min_length=2, max_length=2)] | None = None  # +x … of measured fields
    rotation_deg: float = 0.0
    k1: float = 0.0
    centre_px: Pair | None = None
    matrix_px_per_unit: Annotated[list[Pair], Field(min_length=2, max_length=2)] | None = None
    noise_std_gv: Positive | None = None
    noise_model: Literal["uniform", "grey_level"] | NoiseModelTable = "uniform"
    magnification_column: str | None = None
    magnification_knots: Annotated[int, Field(ge=1, le=100)] | None = None
    deflections: Annotated[list[DeflectionTable], Field(min_length=1)] | None = None
    distance_mm: Positive | None = None  # from the specimen: of the face of a bent sheet
    motion: Literal["free"] | None = None
    texture: str | None = None  # name of the camera whose reference image its own is compared with as well

    @model_validator(mode="after")
    def _one_map(self):
        if self.matrix_px_per_unit is not None:
            extra = [name for name in ("pixel_size_mm", "axes")
                     if getattr(self, name) is not None] + (["rotation_deg"] if self.rotation_deg else [])
            if extra:
                raise refuse("the camera map is given twice",
                             "matrix_px_per_unit, or pixel_size_mm with axes and rotation_deg",
                             f"leave out matrix_px_per_unit or {', '.join(extra)}",
                             f"matrix_px_per_unit and {', '.join(extra)}")
        return self


Voxel = Annotated[list[Positive], Field(min_length=3, max_length=3)]


class ScannerTable(Strict):
    """The scanner of volumes.

    voxel_mm : side of a voxel, or its sides along column, row and slice; None: as the files state. origin_px : column,
    row and slice of the mesh origin. axes : of the volume along mesh x, y and z. motion = "free": rigid motion of every
    scan. air_below_gv : a grey value of the reference below it is air, which is not compared.
    """

    voxel_mm: Positive | Voxel | None = None
    origin_px: Triple | None = None
    axes: Annotated[list[Literal["+col", "-col", "+row", "-row", "+slice", "-slice"]],
                    Field(min_length=3, max_length=3)] | None = None
    noise_std_gv: Positive | None = None
    motion: Literal["free"] | None = None
    air_below_gv: float | None = None

    @property
    def sides(self) -> list[float] | None:
        """Sides of a voxel along column, row and slice (mm); None where they are not given."""
        return [self.voxel_mm] * 3 if isinstance(self.voxel_mm, float | int) else self.voxel_mm


class FurtherCameraTable(CameraTable):
    """The second and later [[camera]] tables: their own images, one per frame and in the same order."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]  # no default: the main camera has it
    images: Annotated[list[str], BeforeValidator(as_list), Field(min_length=1)]
    mask: str | None = None
    surface: str | None = None  # of a solid; default: that of the main camera
    plane: Annotated[list[Component], Field(min_length=2, max_length=2)] = ["x", "y"]  # mesh axes in the image
    still_frames: str | None = None  # separate images at rest

    @model_validator(mode="after")
    def _two_axes(self):
        if self.plane[0] == self.plane[1]:
            raise refuse("the plane of the camera names one axis twice", 'two mesh axes, e.g. plane = ["x", "z"]',
                         "correct plane", str(self.plane))
        return self

    @model_validator(mode="after")
    def _uniform_noise(self):
        if self.noise_model != "uniform":
            raise refuse("noise by grey value is available for the main camera only", "no noise_model",
                         "leave noise_model out", str(self.noise_model))
        return self
