"""[experiment] and [setup] as strict models: images, log, mesh and kind of the model; the laboratory in words.

``[experiment]``
    ``reference``, ``exclude_frames``, ``still_frames`` name frames by file name, or by number: the number in the file
    names (the changing number of the names) where every number given occurs there, else the index in the stack.
    ``frame_interval_s`` (with ``first_frame_s``) or ``image_times`` (a CSV with one ``time_s`` per image) give the
    times of the images; a log with times is then interpolated at them. ``still_frames`` may also be a glob
    of separate images taken at rest. Several ``reference`` frames, all taken at rest, are averaged: less
    shared noise. ``height_unit`` belongs to ``quantity = "height"``. ``symmetry = "x"``: the mesh is the half x >= 0 of
    a cross-section, and its height images show both halves.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from idic.experiment_file.schema.base import Positive, Strict, as_list, exactly_one, refuse

MIN_ELEMENT_PX = 1.0  # a smaller element has no pixel of its own
MIN_THICKNESS_MM = 1e-7  # an atom is 2e-7 mm thick
Frame = Annotated[object, BeforeValidator(lambda value: _frame(value))]


def _frame(value: object) -> object:
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    raise refuse("not a frame", "a file name or a whole number", "give a file name in quotes, or a number", value)


def _order(value: object) -> object:
    if isinstance(value, str) and re.fullmatch(r"names|signed|wrapped|clock|decimals|listed|number [1-9]", value):
        return value
    raise refuse("not an order of images", "names, signed, wrapped, clock, decimals, number 1, number 2 … or listed",
                 "write one of these, or leave order out", value)


def _as_frames(value: object) -> object:
    return value if isinstance(value, list) else [value]


def _as_margins(value: object) -> object:
    return [value] if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _as_file_table(value: object) -> object:
    return {"file": value} if isinstance(value, str) else value


Circle = Annotated[list[float], Field(min_length=3, max_length=3)]
Points = list[list[float]]  # of an outline: [x, y], or [xm, ym, x, y] for an arc


class MeshTable(Strict):
    """A mesh file, or a mesh made on the image: in px, or in mm where the camera knows the scale."""

    file: str | None = None
    roi_px: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    outline_px: Circle | Points | None = None
    element_px: Annotated[float, Field(ge=MIN_ELEMENT_PX)] | None = None
    holes_px: list[Circle | Points] = []
    roi_mm: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    outline_mm: Circle | Points | None = None
    element_mm: Positive | None = None
    holes_mm: list[Circle | Points] = []
    around_points_mm: Annotated[list[float], BeforeValidator(_as_margins),
                                Field(min_length=1, max_length=2)] | None = None
    outline_points_mm: Annotated[float, Field(ge=0)] | None = None  # margin around the outline of measured points
    elements: Literal["quads", "triangles"] = "quads"  # of an outline
    through_mm: Positive | None = None  # thickness of a solid that is made of the plane mesh
    layers: Annotated[int, Field(ge=1, le=50)] = 2  # of elements through it
    edge_names: dict[str, list[int]] = {}
    mesher: Literal["idic", "gmsh"] = "idic"

    @property
    def is_drawn(self) -> bool:
        return self.outline_px is not None or self.outline_mm is not None

    @property
    def in_px(self) -> bool:
        return self.roi_px is not None or self.outline_px is not None

    @model_validator(mode="after")
    def _complete(self):
        if self.through_mm is None and "layers" in self.model_fields_set:
            raise refuse("layers without a thickness", "through_mm = 2.0 next to layers", "give through_mm, or leave "
                         "layers out", "no through_mm")
        if self.file is not None and self.through_mm is not None:
            raise refuse("a mesh file has its thickness already", "through_mm next to a mesh that is made here",
                         "leave out through_mm", "through_mm")
        exactly_one(self, ("file", "roi_px", "outline_px", "roi_mm", "outline_mm", "around_points_mm",
                           "outline_points_mm"),
                    '"mesh.inp" or { roi_px = [x0, y0, x1, y1], element_px = 20 }')
        if self.around_points_mm is not None:
            self._leave_out("element_mm and holes_mm", ("element_px", "holes_px", "edge_names"))
            return self._circles()
        if self.outline_points_mm is not None:
            self._leave_out("element_mm", ("element_px", "holes_px", "holes_mm", "edge_names"))
            return self
        unit = "px" if self.in_px else "mm"
        shape = "outline" if self.is_drawn else "roi"
        if self.file is None and getattr(self, f"element_{unit}") is None:
            raise refuse("the size of the elements is missing", f"element_{unit} next to {shape}_{unit}",
                         f"write {{ {shape}_{unit} = …, element_{unit} = … }}", "no element size")
        foreign_keys = {"px": ("element_mm", "holes_mm"), "mm": ("element_px", "holes_px")}[unit]
        if self.file is not None:
            foreign_keys = ("element_px", "holes_px", "element_mm", "holes_mm")
        self._leave_out(f"{shape}, element and holes in one unit", foreign_keys)
        if not self.is_drawn:
            self._leave_out("edge_names next to an outline", ("edge_names",))
        return self if self.is_drawn else self._circles()

    def _leave_out(self, expected: str, names: tuple[str, ...]) -> None:
        extra = [name for name in names if getattr(self, name)]
        if extra:
            raise refuse("the keys of the mesh contradict each other", expected, f"leave out {', '.join(extra)}",
                         ", ".join(extra))

    def _circles(self):
        for hole in (*self.holes_px, *self.holes_mm):
            if any(isinstance(number, list) for number in hole):
                raise refuse("a hole in a rectangle is round", "[column, row, radius]",
                             "write outline_px in the place of roi_px: its holes have any shape", "a list of points")
        return self


class StagesTable(Strict):
    """Which stages of measured fields are compared (`idic.readers.fields.chosen_stages`)."""

    every_strain: Positive | None = None
    every_change_um: Positive | None = None
    every_time_s: Positive | None = None
    max: Annotated[int, Field(ge=2)] | None = None

    @model_validator(mode="after")
    def _one_rule(self):
        if not any((self.every_strain, self.every_change_um, self.every_time_s, self.max)):
            raise refuse("a rule without a criterion", "every_strain, every_change_um, every_time_s or max",
                         "write e.g. stages = { every_strain = 1e-4, max = 100 }", "an empty table")
        return self


class ColumnsTable(Strict):
    """Columns of a table of points, as its header names them (`idic.readers.NamedColumns`)."""

    x: str
    y: str
    ux: str
    uy: str
    z: str | None = None
    uz: str | None = None
    id: str | None = None
    stage: str | None = None
    time: str | None = None
    flag: str | None = None  # 0 where a point failed
    quality: str | None = None
    quality_min: float | None = None
    quality_max: float | None = None
    unit: Literal["m", "mm", "um", "px", "in"] | None = None  # None: as the header says
    y_axis: Literal["up", "down"] | None = None  # None: down in px, else up

    @model_validator(mode="after")
    def _complete(self):
        if (self.z is None) != (self.uz is None):
            raise refuse("a third coordinate needs its displacement", "z and uz, or neither", "add or leave out one",
                         "z" if self.uz is None else "uz")
        bounds = [name for name in ("quality_min", "quality_max") if getattr(self, name) is not None]
        if (self.quality is None) == bool(bounds):
            raise refuse("the quality of a point needs a column and a bound", "quality with quality_min or quality_max",
                         'write e.g. quality = "zncc", quality_min = 0.9', ", ".join(bounds) or "quality alone")
        names = [name for name in (self.x, self.y, self.z, self.ux, self.uy, self.uz) if name is not None]
        if len(set(names)) < len(names):
            raise refuse("a column is named twice", "a column of its own for every coordinate", "correct the names",
                         ", ".join(names))
        return self


class FieldsTable(Strict):
    """How the files of `experiment.fields` are read."""

    columns: ColumnsTable


class ExperimentTable(Strict):
    title: str = ""
    images: Annotated[list[str], BeforeValidator(as_list)] = []  # none: a plan, for `idic design`
    volumes: Annotated[list[str], BeforeValidator(as_list)] = []  # in the place of images: scans of a solid
    fields: Annotated[list[str], BeforeValidator(as_list)] = []  # in the place of images: measured displacements
    fields_format: Literal["auto", "aramis", "nodemap", "vic", "matchid", "dice", "pyvale", "al-dic", "sun-dic",
                           "py3dic", "ncorr", "mudic", "table", "vtu"] = "auto"
    fields_unit: Literal["m", "mm", "um", "px", "in"] | None = None  # None: as the files say
    fields_subset_mm: Positive | None = None  # width of the subsets (facets) of the other system
    fields_noise_um: Positive | None = None  # of one component of a point; None: from the stages
    fields_seen_from: Literal["+z", "-z"] = "+z"  # of three coordinates: where the cameras were
    fields_thickness_change: bool | None = None  # of a sheet: compared; None: where it can exceed the noise
    stages: StagesTable | None = None  # of fields: which ones are compared; None: all
    order: Annotated[str | None, BeforeValidator(_order)] = None  # of images or fields; None: as their names show
    loads: str | None = None
    decimal: Literal[".", ","] | None = None  # mark in loads and image_times; None: as their numbers show
    mesh: Annotated[MeshTable, BeforeValidator(_as_file_table)]
    mesh_unit: str | None = None
    kind: Literal["plane_stress", "plane_strain", "solid"]
    thickness_mm: Annotated[float, Field(ge=MIN_THICKNESS_MM)] | None = None
    surface: str | None = None
    symmetry: Literal["x"] | None = None
    quantity: Literal["grey", "height", "displacement", "volume"] = "grey"  # the last two: set by `fields`, `volumes`
    height_unit: Literal["m", "mm", "um", "nm"] | None = None
    mask: str | None = None
    reference: Annotated[list[Frame], BeforeValidator(_as_frames), Field(min_length=1)] | None = None
    exclude_frames: list[Frame] = []
    still_frames: str | list[Frame] | None = None
    frame_interval_s: Positive | None = None
    first_frame_s: float = 0.0
    image_times: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _displacements_of_fields(cls, values: object) -> object:
        if isinstance(values, dict) and values.get("fields") and "quantity" not in values:
            return {**values, "quantity": "displacement"}
        if isinstance(values, dict) and values.get("volumes") and "quantity" not in values:
            return {**values, "quantity": "volume"}
        return values

    @model_validator(mode="after")
    def _volumes_alone(self):
        if not self.volumes:
            if self.quantity == "volume":
                raise refuse("volumes without scans", 'volumes = "scans/*.tif"', "name the scans", "no volumes")
            return self
        extra = [name for name in ("images", "fields", "symmetry", "surface") if getattr(self, name)]
        if extra or self.quantity != "volume":
            raise refuse("a key of images next to volumes", "volumes without images, fields, surface, symmetry and "
                         "quantity", f"leave out {', '.join(extra) or 'quantity'}",
                         ", ".join(extra) or self.quantity)
        if self.kind != "solid":
            raise refuse("volumes of a plane model", 'kind = "solid"', "mesh the specimen with hex8, hex20, tet4 or "
                         "tet10", self.kind)
        if self.mesh.file is None:
            raise refuse("volumes without a mesh file", 'mesh = "mesh.inp"', "mesh the specimen as a solid, in mm",
                         "a mesh on images")
        if isinstance(self.still_frames, str):
            raise refuse("separate scans at rest", "still_frames = [0, 1], numbers or names of scans of `volumes`",
                         "name them among the scans of the test", self.still_frames)
        return self

    @model_validator(mode="after")
    def _fields_or_images(self):
        if self.fields and self.images:
            raise refuse("images and fields in one experiment", "images, or fields",
                         "leave out one of these keys; idic compare shows two runs of one test side by side", "both")
        if self.fields and self.quantity != "displacement":
            raise refuse("fields are displacements", 'no quantity, or "displacement"', "leave out quantity",
                         self.quantity)
        if not self.fields and self.quantity == "displacement":
            raise refuse("displacements without fields", 'fields = "stages/*.csv"', "name the exported stages",
                         "no fields")
        extra = [name for name in ("mask", "symmetry") if getattr(self, name) is not None]
        if self.fields and extra:
            raise refuse("a key of images next to fields", "neither mask nor symmetry",
                         f"leave out {', '.join(extra)}", ", ".join(extra))
        if self.fields and self.kind == "solid" and self.surface is None:
            raise refuse("fields on a solid without the surface they show", 'surface = "FRONT"',
                         "name the face set that the cameras see", "no surface")
        if not self.fields and self.stages is not None:
            raise refuse("stages without fields", 'fields = "stages/*.csv"', "use exclude_frames for images",
                         "no fields")
        if not self.fields and (self.mesh.around_points_mm is not None or self.mesh.outline_points_mm is not None):
            raise refuse("a mesh around the points needs points", 'fields = "stages/*.csv"', "name the stages",
                         "no fields")
        return self

    @model_validator(mode="after")
    def _consistent(self):
        if (self.quantity == "height") != (self.height_unit is not None):
            raise refuse("quantity and height_unit contradict each other",
                         'quantity = "height" with height_unit = "um" (or mm, nm, m), or neither',
                         "add or remove height_unit",
                         f"quantity = {self.quantity!r}, height_unit = {self.height_unit!r}")
        if self.symmetry is not None and (self.surface is None or self.kind == "solid" or self.quantity != "height"):
            raise refuse("symmetry is for height images of a cross-section",
                         'symmetry = "x" with a plane mesh, its edge set in `surface` and quantity = "height"',
                         "leave out symmetry", f'symmetry = "{self.symmetry}"')
        if self.frame_interval_s is not None and self.image_times is not None:
            raise refuse("the times of the images are given twice", "frame_interval_s or image_times",
                         "leave out one of these keys", "both")
        return self


class SetupTable(Strict):
    """The laboratory in words with units; only the report shows it."""

    camera: str | None = None
    lens: str | None = None
    aperture: str | None = None
    stand_off: str | None = None
    exposure: str | None = None
    lighting: str | None = None
    pattern: str | None = None  # how it was made: "black spray on white"
    specimen: str | None = None
    machine: str | None = None

    @property
    def entries(self) -> dict[str, str]:
        """The given entries."""
        return {name: text for name in type(self).model_fields if (text := getattr(self, name))}
