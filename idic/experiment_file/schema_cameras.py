"""[camera] and [[camera]] as strict models: calibration, noise and motion of the cameras.

``[camera]``
    ``noise_model = "grey_level"``: variance offset + slope I over the grey value I, from still_frames (or given, ``{
    offset_gv2 = 1.0, slope_gv = 0.05 }``), and every pixel weighed by its own; default uniform. Main camera only.
    ``motion = "free"``: a rigid motion of the camera in every frame, ``camera.col_at[K]``, ``row_at[K]`` (px) and
    ``turn_at[K]`` (deg) of frame K, is identified (hold the specimen firmly in the model then). A specimen that moves
    out of its plane: [[dof]] ``camera.magnification_drift`` (1/s), and with ``magnification_column``, a column of the
    log, ``camera.magnification_load``: relative magnification at that column's largest value.
``[[camera]]``
    The first table is the main camera, the one of ``[experiment]``. Each further one looks at the same specimen at the
    same times: ``name``, its own ``images`` (as many, same order), its calibration, and where they differ ``mask``,
    ``surface`` (another face set of a solid), ``plane`` (the two mesh axes it sees, ``["x", "z"]`` for a side view),
    ``still_frames`` (a glob), ``noise_std_gv``. Their degrees of freedom are ``NAME.rotation_deg`` and so on.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from idic.experiment_file.schema_base import Component, Pair, Positive, Strict, as_list, refuse


class NoiseModelTable(Strict):
    """Noise variance by grey value I: offset_gv2 + slope_gv I."""

    offset_gv2: float
    slope_gv: float


class CameraTable(Strict):
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")] = "camera"
    pixel_size_mm: Positive | None = None
    origin_px: Pair | None = None
    origin_mm: Pair | None = None  # of the mesh in the axes of measured fields
    axes: Annotated[list[Literal["+col", "-col", "+row", "-row", "+x", "-x", "+y", "-y"]],
                    Field(min_length=2, max_length=2)] | None = None  # +x … of measured fields
    rotation_deg: float = 0.0
    k1: float = 0.0
    centre_px: Pair | None = None
    matrix_px_per_unit: Annotated[list[Pair], Field(min_length=2, max_length=2)] | None = None
    noise_std_gv: Positive | None = None
    noise_model: Literal["uniform", "grey_level"] | NoiseModelTable = "uniform"
    magnification_column: str | None = None
    motion: Literal["free"] | None = None

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
