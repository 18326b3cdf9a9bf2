"""experiment.toml as strict models: every key, its type and its default. Unknown keys are refused, not ignored.

docs/experiment-file.md names every key with its default. More on some of them:

``[experiment]``
    ``reference``, ``exclude_frames``, ``still_frames`` name frames by file name, or by number: the number in the file
    names (the one that differs from file to file) where every number given occurs there, else the index in the stack.
    ``frame_interval_s`` (with ``first_frame_s``) or ``image_times`` (a CSV with one ``time_s`` per image) give the
    times of the images; a log with times is then interpolated at them. ``still_frames`` may also be a glob
    of separate images taken at rest. Several ``reference`` frames, all taken at rest, are averaged: less
    shared noise. ``height_unit`` belongs to ``quantity = "height"``. ``symmetry = "x"``: the mesh is the half x >= 0 of
    a cross-section, and its height images show both halves.
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
``[[channel]]``
    ``simulated`` is the force that holds a node set ``{ reaction = "TOP", component = "y" }``, the mean displacement of
    one ``{ displacement = "TOP", component = "y", minus = "BOTTOM" }`` (an extensometer; without ``minus`` an LVDT), or
    the pressure on an edge set ``{ pressure = "BELOW" }``: several load cells and gauges may be compared at once.
``pressure``, ``traction``, ``force`` in ``[[boundary]]``
    ``noise_std`` of the logged column: the load of every frame is then an unknown with the logged value as its prior.
    ``identify_scale``, ``identify_offset``: degrees of freedom ``boundary.EDGES.pressure.scale`` and ``.offset`` of a
    gauge that is not calibrated (``boundary.EDGES.force.x.scale`` for a force along x).
``[design]``
    What `idic design` takes where there are no images or no log yet: ``image_px`` = [columns, rows], ``n_frames``,
    ``duration_s``, ``noise_std_gv``, ``speckle_px``, ``contrast_gv`` (standard deviation of the pattern), and
    ``[design.program]`` with one course per column of the log, [[time_s, value], ...], in the column's unit.
``[[boundary]]``
    ``u = …`` drives all components alike: ``"measured"`` or ``{ virtual = … }``. A virtual boundary,
    ``{ virtual = "bspline" | "polynomial" | "dic", modes = N, time_modes = M }``, is N shapes along the edge times M
    courses in time, whose amplitudes ``boundary.SET.COMPONENT.sItJ`` (mm) are identified; they start from a free FE-DIC
    (a ``value`` under [[dof]] wins). "dic": the N and M strongest of the measured motion itself, see
    docs/virtual-boundaries.md.
    ``corrections`` of a logged or fixed displacement: what really happened at the grip. Each entry brings one degree
    of freedom ``boundary.SET.COMPONENT.KIND``, zero where the log is right: ``{ kind = "slip", start_s = 12.0 }`` (mm
    by which the specimen moves less than the log in the end; ``course`` = ramp | jump | travel), ``{ kind =
    "compliance", column = "force_N" }`` (mm/N: the log contains the deflection of the machine), ``{ kind = "rotation"
    }`` (rad/mm: the set turns with the motion; with ``column`` rad at the column's largest value), ``{ kind =
    "misalignment" }`` (it moves across in proportion; ``towards`` = x, y or z).
``[[heterogeneity]]``
    ``set`` (an element set with a material), ``form`` and, of a spot (inclusion, void, thickness), ``centre_mm`` (with
    three coordinates a ball in a solid, with two a column through it), ``identify_centre``, ``radius_mm`` and
    ``stiffness`` (``thickness`` of that form): its stress relative to that around it; of a gradient ``along_x``,
    ``along_y``: relative change from the middle of the set to its ends. Each a number, or ``{ value = 0.7, identify =
    true }``. Degrees of freedom ``SET.inclusion.stiffness``, ``.radius``, ``.x``, ``.y``, ``SET.gradient.along_x`` …
    (``name`` in place of the form, where there are several). In plane models thickness and modulus are twins.
``[solver]``
    An external program simulates: see `idic.experiment_file.schema_solver` and docs/external-solver.md. Materials may then have
    ``law = "external"`` with parameters of any name, which the template of the deck asks for.
``[setup]`` words for the good-practice table of the report, see `idic.experiment_file.schema_setup`.
``[[stage]]``
    ``free`` (names, or "all"), ``max_iterations``; ``lowpass_px`` blurs the images of this stage, which are then
    matched from farther away, ``until_s`` ends its frames. What such a stage finds is where the next one starts; a last
    one without either follows by itself.
``[options]``: see `idic.model.experiment.Options`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from idic.experiment_file.schema_base import (Positive, Pair, Component, Strict, refuse, as_value_table, as_list,
                                              exactly_one)
from idic.experiment_file.schema_boundary import SetTable, BoundaryTable, ChannelTable
from idic.experiment_file.schema_setup import SetupTable
from idic.experiment_file.schema_solver import SolverTable

Frame = Annotated[object, BeforeValidator(lambda value: _frame(value))]


def _frame(value: object) -> object:
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    raise refuse("not a frame", "a file name or a whole number", found=value)


def _as_frames(value: object) -> object:
    return value if isinstance(value, list) else [value]


def _as_file_table(value: object) -> object:
    return {"file": value} if isinstance(value, str) else value


# [experiment] -----------------------------------------------------------------------------------------
class MeshTable(Strict):
    """A mesh file, or a quad mesh made on the image: in px, or in mm where the camera knows the scale."""

    file: str | None = None
    roi_px: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    element_px: Positive | None = None
    holes_px: list[Annotated[list[float], Field(min_length=3, max_length=3)]] = []
    roi_mm: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None
    element_mm: Positive | None = None
    holes_mm: list[Annotated[list[float], Field(min_length=3, max_length=3)]] = []

    @model_validator(mode="after")
    def _complete(self):
        exactly_one(self, ("file", "roi_px", "roi_mm"), '"mesh.inp" or { roi_px = [x0, y0, x1, y1], element_px = 20 }')
        unit = "px" if self.roi_px is not None else "mm"
        if self.file is None and getattr(self, f"element_{unit}") is None:
            raise refuse("the size of the elements is missing", f"element_{unit} next to roi_{unit}",
                         f"write {{ roi_{unit} = …, element_{unit} = … }}", "no element size")
        other = {"px": ("element_mm", "holes_mm"), "mm": ("element_px", "holes_px")}[unit]
        if self.file is not None:
            other = ("element_px", "holes_px", "element_mm", "holes_mm")
        extra = [name for name in other if getattr(self, name)]
        if extra:
            raise refuse("keys that do not go together", "roi, element and holes in one unit",
                         f"leave out {', '.join(extra)}", ", ".join(extra))
        return self


class ExperimentTable(Strict):
    title: str = ""
    images: Annotated[list[str], BeforeValidator(as_list)] = []  # none: a plan, for `idic design`
    loads: str | None = None
    mesh: Annotated[MeshTable, BeforeValidator(_as_file_table)]
    mesh_unit: str | None = None
    kind: Literal["plane_stress", "plane_strain", "solid"]
    thickness_mm: Positive | None = None
    surface: str | None = None
    symmetry: Literal["x"] | None = None
    quantity: Literal["grey", "height"] = "grey"
    height_unit: Literal["m", "mm", "um", "nm"] | None = None
    mask: str | None = None
    reference: Annotated[list[Frame], BeforeValidator(_as_frames), Field(min_length=1)] | None = None
    exclude_frames: list[Frame] = []
    still_frames: str | list[Frame] | None = None
    frame_interval_s: Positive | None = None
    first_frame_s: float = 0.0
    image_times: str | None = None

    @model_validator(mode="after")
    def _consistent(self):
        if (self.quantity == "height") != (self.height_unit is not None):
            raise refuse("quantity and height_unit do not go together",
                         'quantity = "height" with height_unit = "um" (or mm, nm, m), or neither',
                         "add or remove height_unit",
                         f"quantity = {self.quantity!r}, height_unit = {self.height_unit!r}")
        if self.symmetry is not None and (self.surface is None or self.kind == "solid" or self.quantity != "height"):
            raise refuse("symmetry is for height images of a cross-section",
                         'symmetry = "x" with a plane mesh, its edge set in `surface` and quantity = "height"',
                         "leave out symmetry", f'symmetry = "{self.symmetry}"')
        if self.frame_interval_s is not None and self.image_times is not None:
            raise refuse("the times of the images are given twice", "frame_interval_s or image_times", "leave out one",
                         "both")
        return self


class NoiseModelTable(Strict):
    """Noise variance by grey value I: offset_gv2 + slope_gv I."""

    offset_gv2: float
    slope_gv: float


class CameraTable(Strict):
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")] = "camera"
    pixel_size_mm: Positive | None = None
    origin_px: Pair | None = None
    axes: Annotated[list[Literal["+col", "-col", "+row", "-row"]], Field(min_length=2, max_length=2)] | None = None
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
                raise refuse("the map is given twice",
                             "matrix_px_per_unit, or pixel_size_mm with axes and rotation_deg",
                             f"leave out matrix_px_per_unit or {', '.join(extra)}",
                             f"matrix_px_per_unit and {', '.join(extra)}")
        return self


_OF_THE_MAIN_CAMERA = ("images", "mask", "surface", "still_frames")
_NOT_A_CAMERA = ("channel", "boundary", "geometry", "time")  # first words of other degrees of freedom


class FurtherCameraTable(CameraTable):
    """The second and later [[camera]] tables: their own images, one per frame and in the same order."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]  # no default: the main camera has it
    images: Annotated[list[str], BeforeValidator(as_list), Field(min_length=1)]
    mask: str | None = None
    surface: str | None = None  # of a solid; default: that of the main camera
    plane: Annotated[list[Component], Field(min_length=2, max_length=2)] = ["x", "y"]  # mesh axes that it sees
    still_frames: str | None = None  # separate images at rest

    @model_validator(mode="after")
    def _two_axes(self):
        if self.plane[0] == self.plane[1]:
            raise refuse("a camera that sees one axis twice", 'two mesh axes, e.g. plane = ["x", "z"]', "correct plane",
                         str(self.plane))
        return self

    @model_validator(mode="after")
    def _uniform_noise(self):
        if self.noise_model != "uniform":
            raise refuse("noise by grey value is for the main camera only", "no noise_model", "leave noise_model out",
                         str(self.noise_model))
        return self


# [material.SET], [[dof]] --------------------------------------------------------------------------------
class PriorTable(Strict):
    mean: float
    std: Positive


class ParameterTable(Strict):
    value: float
    unit: str | None = None
    identify: bool = False
    bounds: Annotated[list[Annotated[float, Field(allow_inf_nan=True)]],
                      Field(min_length=2, max_length=2)] | None = None
    prior: PriorTable | None = None

    @model_validator(mode="after")
    def _within(self):
        if self.bounds is not None:
            low, high = self.bounds
            if not low < high:
                raise refuse("bounds in the wrong order", "[low, high] with low < high", "swap them", str(self.bounds))
            if not low <= self.value <= high:
                raise refuse("the start value is outside its bounds", f"{low:g} <= value <= {high:g}",
                             "move the value or the bounds", f"{self.value:g}")
        return self


class MaterialTable(BaseModel):
    """``law``, ``kinematics``; every other key is a parameter of the law."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, Annotated[ParameterTable, BeforeValidator(as_value_table)]] = Field(init=False)
    law: str
    kinematics: Literal["small", "finite"] | None = None

    @property
    def parameters(self) -> dict[str, ParameterTable]:
        return dict(self.__pydantic_extra__ or {})


Value = Annotated[ParameterTable, BeforeValidator(as_value_table)]


class HeterogeneityTable(Strict):
    """A part of an element set that is stiffer or softer, or a stiffness that changes along the axes."""

    set: str
    form: Literal["inclusion", "void", "thickness", "gradient"]
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")] | None = None  # default: the form
    centre_mm: Annotated[list[float], Field(min_length=2, max_length=3)] | None = None
    identify_centre: bool = False
    radius_mm: Value | None = None
    stiffness: Value | None = None
    thickness: Value | None = None
    along_x: Value | None = None
    along_y: Value | None = None
    along_z: Value | None = None

    @model_validator(mode="after")
    def _own_keys(self):
        spot = ("centre_mm", "identify_centre", "radius_mm")
        own = {"inclusion": (*spot, "stiffness"), "void": (*spot, "stiffness"), "thickness": (*spot, "thickness"),
               "gradient": ("along_x", "along_y", "along_z")}[self.form]
        extra = sorted(self.model_fields_set - {"set", "form", "name", *own})
        if extra:
            raise refuse(f"{extra[0]} does not belong here", f"{', '.join(own)} of a {self.form}",
                         f"leave out {extra[0]}", extra[0])
        needed = ("centre_mm", "radius_mm") if self.form != "gradient" else ()
        missing = [key for key in needed if getattr(self, key) is None]
        if self.form == "gradient" and not self.model_fields_set & set(own):
            missing = ["along_x"]
        if missing:
            raise refuse(f"a {self.form} without {missing[0]}", missing[0], f"add {missing[0]} = …", "no such key")
        return self


class DofTable(ParameterTable):
    name: str
    value: float | None = None  # default: the value that the rest of the file gives
    identify: bool = True

    @model_validator(mode="after")
    def _within(self):
        if self.bounds is not None and not self.bounds[0] < self.bounds[1]:
            raise refuse("bounds in the wrong order", "[low, high] with low < high", "swap them", str(self.bounds))
        return self


# [[stage]], [options] --------------------------------------------------------------------------------
class StageTable(Strict):
    free: Annotated[list[str], Field(min_length=1)] | Literal["all"] = "all"
    max_iterations: Annotated[int, Field(ge=1)] | None = None
    lowpass_px: Annotated[float, Field(gt=0, le=20)] | None = None
    until_s: Positive | None = None


class OptionsTable(Strict):
    interpolation: Literal["cubic", "quintic"] = "quintic"
    lowpass_px: Annotated[float, Field(ge=0, le=5)] | None = None  # 0.6; height images 0
    border_px: Annotated[int, Field(ge=0, le=50)] = 0
    edge_margin_px: Annotated[int, Field(ge=0, le=50)] = 3
    element_order: Literal["auto", "as_given", "quadratic"] = "auto"
    brightness: Literal["none", "frame", "patch", "tilt"] | None = None  # frame; height images none
    patch_px: Positive = 100.0
    defocus: Literal["none", "frame"] = "none"
    method: Literal["integrated", "two_step", "two_step_unweighted"] = "integrated"
    dic_regularisation: Literal["auto", "none", "mechanical", "gradient"] = "auto"
    weighting: Literal["noise", "paper"] = "noise"
    estimator: Literal["auto", "ordinary", "generalised"] = "auto"
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.01
    step_limit: Positive | None = None
    trial_steps: Annotated[int, Field(ge=1, le=8)] = 1
    max_iterations: Annotated[int, Field(ge=1)] = 40
    search: Literal["auto", "never"] = "auto"
    schedule: Literal["all", "spectrum"] = "all"
    tolerance: Positive = 0.02
    substeps: Annotated[int, Field(ge=1)] = 1
    perturbation: Annotated[float, Field(gt=0, le=0.1)] | None = None  # 1e-4; external solver 1e-3
    locking: Literal["auto", "none", "mean_dilatation"] = "auto"


# [design] ---------------------------------------------------------------------------------------------------
class DesignTable(Strict):
    """What a test that is still to be made will record: read by `idic design` and `idic simulate` only."""

    image_px: Annotated[list[Annotated[int, Field(ge=16, le=50000)]], Field(min_length=2, max_length=2)] | None = None
    n_frames: Annotated[int, Field(ge=2, le=100000)] | None = None
    duration_s: Positive | None = None
    noise_std_gv: Positive | None = None
    speckle_px: Annotated[float, Field(ge=1, le=100)] = 4.0
    contrast_gv: Positive = 50.0
    program: dict[str, Annotated[list[Pair], Field(min_length=2)]] = {}


class ExperimentFile(Strict):
    """The whole of experiment.toml."""

    experiment: ExperimentTable
    camera: CameraTable | None = None  # the main one
    further_cameras: list[FurtherCameraTable] = []  # further [[camera]] tables
    material: Annotated[dict[str, MaterialTable], Field(min_length=1)]
    sets: dict[str, SetTable] = {}
    heterogeneity: list[HeterogeneityTable] = []
    boundary: list[BoundaryTable] = []
    channel: list[ChannelTable] = []
    dof: list[DofTable] = []
    stage: list[StageTable] = []
    options: OptionsTable = OptionsTable()
    design: DesignTable | None = None
    solver: SolverTable | None = None
    setup: SetupTable = SetupTable()

    @model_validator(mode="before")
    @classmethod
    def _main_and_further(cls, raw: object) -> object:
        """[[camera]] tables: the first is the main camera, its images are those of [experiment]."""
        if not isinstance(raw, Mapping) or not isinstance(raw.get("camera"), list):
            return raw
        main, *others = raw["camera"] or [{}]
        extra = [key for key in _OF_THE_MAIN_CAMERA if isinstance(main, Mapping) and key in main]
        if extra:
            raise refuse("the first [[camera]] is the main one: its images stand in [experiment]",
                         f"{extra[0]} under [experiment]", f"move {', '.join(extra)} of the first camera there",
                         f"{extra[0]} in the first [[camera]]")
        return {**raw, "camera": main, "further_cameras": others}

    @model_validator(mode="after")
    def _camera_names(self):
        taken = set(self.material) | set(_NOT_A_CAMERA)
        main = self.camera.name if self.camera else "camera"
        for name in (main, *(camera.name for camera in self.further_cameras)):
            if name in taken:
                raise refuse("two things of one name in [[camera]]", "for every camera a name that no other camera and "
                             "no material has", "choose another name", name)
            taken.add(name)
        return self
