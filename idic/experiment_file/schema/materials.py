"""[material.SET], [[heterogeneity]] and [[dof]] as strict models: parameters, their start values, bounds and priors.

``[[heterogeneity]]``
    ``set`` (an element set with a material), ``form`` and, of a spot (inclusion, void, thickness), ``centre_mm`` (with
    three coordinates a ball in a solid, with two a column through it), ``identify_centre``, ``radius_mm`` and
    ``stiffness`` (``thickness`` of that form): its stress relative to the surrounding material; of a gradient
    ``along_x``, ``along_y``: relative change from the middle of the set to its ends; of layers ``period_mm``,
    ``direction_deg`` (across the layers, from x to y), ``stiffness_ratio`` (stiff over soft), ``offset_mm`` (of the
    middle of a stiff layer from the middle of the set) and ``share`` (of the stiff layers, 0.5). Each a number, or
    ``{ value = 0.7, identify = true }``. Degrees of freedom ``SET.inclusion.stiffness``, ``.radius``, ``.x``, ``.y``,
    ``SET.gradient.along_x``, ``SET.layers.stiffness_ratio`` … (``name`` in place of the form if there are several). In
    plane models thickness and modulus are indistinguishable.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from idic.experiment_file.schema.base import Positive, Strict, as_list, as_value_table, refuse


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
    shared: bool = True  # by experiments that are identified together; false: each has its own

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


class SmoothnessTable(Strict):
    """The stated smoothness of a free curve; evidence: ln Z per number of knots, where they were chosen by it."""

    strength: Positive = 1.0
    over: Literal["strain", "root"] | None = None  # None: as the curve has it
    size: Positive | None = None  # MPa; None: of the starting curve
    by_evidence: bool = False  # knots and strength are still to be chosen
    evidence: dict[str, float] = {}


class MaterialTable(BaseModel):
    """``law``, ``kinematics``, ``smoothness`` of free curves, ``sets`` of the mesh that it fills (default: that of its
    name); every other key is a parameter of the law.
    """

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, Annotated[ParameterTable, BeforeValidator(as_value_table)]] = Field(init=False)
    law: str
    kinematics: Literal["small", "finite"] | None = None
    smoothness: dict[str, SmoothnessTable] = {}
    sets: Annotated[list[str], BeforeValidator(as_list)] = []

    @property
    def parameters(self) -> dict[str, ParameterTable]:
        return dict(self.__pydantic_extra__ or {})


Value = Annotated[ParameterTable, BeforeValidator(as_value_table)]


class HeterogeneityTable(Strict):
    """A part of an element set that is stiffer or softer, a stiffness that changes along the axes, or layers."""

    set: str
    form: Literal["inclusion", "void", "thickness", "gradient", "layers"]
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")] | None = None  # default: the form
    centre_mm: Annotated[list[float], Field(min_length=2, max_length=3)] | None = None
    identify_centre: bool = False
    radius_mm: Value | None = None
    stiffness: Value | None = None
    thickness: Value | None = None
    along_x: Value | None = None
    along_y: Value | None = None
    along_z: Value | None = None
    period_mm: Value | None = None
    direction_deg: Value | None = None
    stiffness_ratio: Value | None = None
    offset_mm: Value | None = None
    share: Value | None = None

    @model_validator(mode="after")
    def _own_keys(self):
        spot = ("centre_mm", "identify_centre", "radius_mm")
        keys = {"inclusion": (*spot, "stiffness"), "void": (*spot, "stiffness"), "thickness": (*spot, "thickness"),
                "gradient": ("along_x", "along_y", "along_z"),
                "layers": ("period_mm", "direction_deg", "stiffness_ratio", "offset_mm", "share")}[self.form]
        extra = sorted(self.model_fields_set - {"set", "form", "name", *keys})
        if extra:
            raise refuse(f"{extra[0]} does not belong here", f"{', '.join(keys)} of a {self.form}",
                         f"leave out {extra[0]}", extra[0])
        needed = {"gradient": (), "layers": ("period_mm", "direction_deg")}.get(self.form, ("centre_mm", "radius_mm"))
        missing = [key for key in needed if getattr(self, key) is None]
        if self.form == "gradient" and not self.model_fields_set & set(keys):
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
