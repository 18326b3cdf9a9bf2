"""[sets], [[boundary]] and [[channel]] as strict models: drives, loads and measured channels.

``[[channel]]``
    ``simulated`` is the force that holds a node set ``{ reaction = "TOP", component = "y" }``, the mean displacement of
    one ``{ displacement = "TOP", component = "y", minus = "BOTTOM" }`` (an extensometer; without ``minus`` an LVDT), or
    the pressure on an edge set ``{ pressure = "BELOW" }``: several load cells and gauges may be compared at once.
``pressure``, ``traction``, ``force`` in ``[[boundary]]``
    ``noise_std`` of the logged column: the load of every frame is then an unknown with the logged value as its prior.
    ``identify_scale``, ``identify_offset``: degrees of freedom ``boundary.EDGES.pressure.scale`` and ``.offset`` of a
    gauge that is not calibrated (``boundary.EDGES.force.x.scale`` for a force along x).
    ``controlled_by`` of a motion or ``force``: its size in every frame is the one at which a gauge (``displacement``,
    ``component``, ``minus``, as of a channel) reads its logged ``column``: an opening that grows while the force falls.
``[[boundary]]``
    ``u = …`` drives all components alike: ``"measured"`` or ``{ virtual = … }``. A virtual boundary,
    ``{ virtual = "bspline" | "polynomial" | "dic", modes = N, time_modes = M }``, is N shapes along the edge times M
    courses in time, whose amplitudes ``boundary.SET.COMPONENT.sItJ`` (mm) are identified; they start from a free FE-DIC
    (a ``value`` under [[dof]] wins). "dic": the N and M strongest of the measured motion itself, see
    docs/virtual-boundaries.md.
    ``corrections`` of a logged or fixed displacement: effects at the grip that the log lacks. Each entry adds a degree
    of freedom ``boundary.SET.COMPONENT.KIND``, zero if the log is right. The kinds and their keys are the terms of
    `idic.model.terms.corrections`. Some follow a ``column`` of the log; some may begin at ``start_s`` with a ``course``
    (ramp, jump, travel), or have one that the data give (free with ``knots``, jumps at ``jump_frames``).
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model, model_validator

from idic.experiment_file.schema.base import (Component, NotNegative, Pair, Positive, Strict, as_list, as_value_table,
                                              exactly_one, refuse)
from idic.model import CHANNEL_TERMS, CORRECTION_TERMS


def _as_drive_table(value: object) -> object:
    if value == "measured":
        return {"measured": True}
    if isinstance(value, str):
        raise refuse("unknown drive", 'a number, "measured", { column = … } or { virtual = … }', found=repr(value),
                     remedy='for a column of the log write { column = "name" }')
    return as_value_table(value)


class SetTable(Strict):
    where: str | None = None
    boundary: Literal["outer", "holes", "all"] | None = None

    @model_validator(mode="after")
    def _one(self):
        exactly_one(self, ("where", "boundary"), '{ where = "y < -9.9" }')
        return self


class CorrectionKeys(Strict):
    """A correction of a logged or fixed motion; its amplitude ``boundary.SET.COMPONENT.KIND`` is identified."""

    kind: str
    start_s: float | None = None
    course: Literal["ramp", "jump", "travel", "free", "jumps"] | None = None
    knots: Annotated[int, Field(ge=1, le=100)] | None = None
    jump_frames: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1, max_length=10_000)] | None = None
    column: str | None = None
    unit: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The entries of the table."""
        return {name: value for name in type(self).model_fields if (value := getattr(self, name)) is not None}

    @property
    def title(self) -> str:
        """Its kind, with the number that tells it from others of that kind."""
        number = CORRECTION_TERMS[self.kind].number
        return f"{self.kind} of {number} {getattr(self, number)}" if number else self.kind

    @model_validator(mode="after")
    def _has_own_keys(self):
        timed = [term.kind for term in CORRECTION_TERMS.values() if term.is_timed]
        logged = [term.kind for term in CORRECTION_TERMS.values() if term.is_logged]
        kinds = {"start_s": timed, "course": timed, "knots": timed, "jump_frames": timed, "column": logged,
                 "unit": logged, **{key.name: [term.kind] for term in CORRECTION_TERMS.values() for key in term.keys}}
        for key in sorted(self.model_fields_set & set(kinds)):
            if self.kind not in kinds[key]:
                raise refuse(f"{key} does not belong here", f"{key} of a {' or '.join(kinds[key])}", f"leave out {key}",
                             f"{key} of a {self.kind}")
        if self.course != "free" and self.knots is not None:
            raise refuse("knots of a time course that has none", 'knots next to course = "free"', "leave out knots",
                         f"course = {self.course}")
        if self.course in ("free", "jumps") and self.start_s is not None:
            raise refuse("a free time course has no start", "knots, which show where it begins", "leave out start_s",
                         "start_s")
        if (self.course == "jumps") != (self.jump_frames is not None):
            raise refuse("jumps and their frames belong together", 'course = "jumps" with jump_frames = [6, 12]',
                         "give both, or neither", f"course = {self.course}, jump_frames = {self.jump_frames}")
        term = CORRECTION_TERMS[self.kind]
        missing = [key for key in term.required.keys if getattr(self, key) is None] if term.required else []
        if missing:
            raise refuse(term.required.fault, term.required.expected, f"write {term.required.example}",
                         f"no {missing[0]}")
        if term.is_timed and self.column is not None and self.model_fields_set & {"start_s", "course"}:
            raise refuse("two courses of one correction", "a column, or start_s and course", "leave one of them out",
                         f"column = {self.column!r} and a course in time")
        return self


def _own_keys() -> dict[str, Any]:
    """The keys that single kinds have, as fields."""
    return {key.name: (Literal[key.words] if key.words
                       else Annotated[key.type, Field(gt=key.above, ge=key.least, le=key.most)] | None, None)
            for term in CORRECTION_TERMS.values() for key in term.keys}


if TYPE_CHECKING:
    CorrectionTable = CorrectionKeys
else:
    CorrectionTable = create_model("CorrectionTable", __base__=CorrectionKeys, __module__=__name__,
                                   kind=(Literal[tuple(CORRECTION_TERMS)], ...), **_own_keys())


class ControlTable(Strict):
    """The gauge that decides the size of a motion or force: mean displacement of a set, minus that of another."""

    displacement: str
    component: Component
    minus: str | None = None
    column: str
    unit: str | None = None


class DriveTable(Strict):
    """A prescribed displacement: value | column | measured | virtual | controlled_by."""

    value: float | None = None
    column: str | None = None
    measured: Literal[True] | None = None
    virtual: Literal["bspline", "polynomial", "dic"] | None = None
    controlled_by: ControlTable | None = None
    unit: str | None = None
    noise_std: NotNegative = 0.0
    identify_offset: bool = False
    corrections: list[CorrectionTable] = []
    smoothing: Positive = 1.0
    modes: Annotated[int, Field(ge=1, le=100)] = 6
    time_modes: Annotated[int, Field(ge=1, le=1000)] = 6

    @model_validator(mode="after")
    def _one(self):
        exactly_one(self, ("value", "column", "measured", "virtual", "controlled_by"),
                    '{ column = "grip_displacement_mm" }')
        if self.controlled_by is not None and self.unit is not None:
            raise refuse("unit does not belong here", "the unit of the gauge in controlled_by", "move unit there",
                         self.unit)
        belongs = {"noise_std": "column", "identify_offset": "column", "smoothing": "measured", "modes": "virtual",
                   "time_modes": "virtual"}
        for key in sorted(self.model_fields_set & set(belongs)):
            if getattr(self, belongs[key]) is None:
                raise refuse(f"{key} does not belong here", f"{key} next to {belongs[key]}", f"leave out {key}", key)
        if self.corrections and self.value is None and self.column is None:
            raise refuse("corrections do not belong here", "corrections next to column or value",
                         "leave out corrections: this motion is measured or identified already", "corrections")
        kinds = [entry.title for entry in self.corrections]
        if len(set(kinds)) < len(kinds):
            raise refuse("a correction is given twice", "every kind once", "remove one of them", ", ".join(kinds))
        return self


class LoadTable(Strict):
    """A load on an edge or face set: value | column | controlled_by; noise of the log, unknown scale or offset."""

    value: float | None = None
    column: str | None = None
    controlled_by: ControlTable | None = None
    unit: str | None = None
    edges: str | None = None
    component: Component | None = None
    follower: bool = False
    noise_std: NotNegative = 0.0
    identify_scale: bool = False
    identify_offset: bool = False

    @model_validator(mode="after")
    def _one(self):
        exactly_one(self, ("value", "column", "controlled_by"), '{ column = "pressure_MPa", edges = "BELOW" }')
        for key in ("identify_scale", "unit"):
            if self.controlled_by is not None and key in self.model_fields_set:
                raise refuse(f"{key} does not belong here", f"{key} of a load that is logged", f"leave out {key}", key)
        for key in ("noise_std", "identify_offset"):
            if self.column is None and key in self.model_fields_set:
                raise refuse(f"{key} does not belong here", f"{key} next to column", f"leave out {key}", key)
        return self


class TemperatureTable(Strict):
    """The temperature of a set of nodes (default: all): a column of the log, one infrared image per frame, or a course
    over time, ``[[time_s, temperature], ...]``, linear in between and constant outside, or "free": ``knots`` give it.
    """

    column: str | None = None
    course: Literal["free"] | Annotated[list[Pair], Field(min_length=2)] | None = None
    knots: Annotated[int, Field(ge=1, le=100)] | None = None
    images: Annotated[list[str], BeforeValidator(as_list), Field(min_length=1)] | None = None
    unit: str | None = None
    nodes: str | None = None
    noise_std: Positive | None = None  # of a pixel; for the note on the noise of a nodal value
    scale: float = 1.0  # temperature = scale * pixel value + offset
    offset: float = 0.0
    matrix_px_per_unit: Annotated[list[Pair], Field(min_length=2, max_length=2)] | None = None
    origin_px: Pair | None = None
    smoothing_px: Annotated[float, Field(gt=0, le=20)] = 0.1
    edge_margin_px: Annotated[int, Field(ge=0, le=50)] = 1

    @model_validator(mode="after")
    def _one(self):
        exactly_one(self, ("column", "images", "course"), '{ column = "temperature_C" }')
        extra = sorted(self.model_fields_set - {"column", "course", "knots", "unit", "nodes"})
        if self.images is None and extra:
            raise refuse(f"{extra[0]} does not belong here", f"{extra[0]} next to images", f"leave out {extra[0]}",
                         extra[0])
        if self.course == "free" and (self.nodes is not None or self.unit is not None):
            raise refuse("a free course of the temperature of a part", "the temperature of the whole body, in K",
                         "leave out nodes and unit", f"nodes = {self.nodes}, unit = {self.unit}")
        if self.knots is not None and self.course != "free":
            raise refuse("knots of a time course that has none", 'knots next to course = "free"', "leave out knots",
                         f"course = {self.course}")
        times = [] if self.course == "free" else [time for time, _ in self.course or ()]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise refuse("the times of the course do not increase", "[[time_s, temperature], ...] in order of time",
                         "sort the pairs, and give every time once", str(times))
        if (self.matrix_px_per_unit is None) != (self.origin_px is None):
            raise refuse("the calibration of the infrared camera is incomplete",
                         "matrix_px_per_unit and origin_px, or neither", "give both keys", "only one of them")
        return self


Drive = Annotated[DriveTable, BeforeValidator(_as_drive_table)]
LoadDrive = Annotated[LoadTable, BeforeValidator(as_value_table)]


class BoundaryTable(Strict):
    nodes: str | None = None
    edges: str | None = None
    ux: Drive | None = None
    uy: Drive | None = None
    uz: Drive | None = None
    u: Drive | None = None
    pressure: LoadDrive | None = None
    traction: LoadDrive | None = None
    force: LoadDrive | None = None
    temperature: TemperatureTable | None = None

    @model_validator(mode="after")
    def _something(self):
        keys = [name for name in type(self).model_fields if name not in ("nodes", "edges")
                and getattr(self, name) is not None]
        if not keys:
            raise refuse("a [[boundary]] without drive or load",
                         "ux, uy, uz, u, pressure, traction, force or temperature", 'add e.g. uy = 0.0', "none of them")
        if self.u is not None and self.u.measured is None and self.u.virtual is None:
            raise refuse("u stands for all components", 'u = "measured" or u = { virtual = … }',
                         "give ux and uy one by one", "another drive")
        if self.u is not None and {"ux", "uy", "uz"} & set(keys):
            raise refuse("a component is driven twice", 'u alone, or ux, uy, uz', "leave out one of them",
                         ", ".join(keys))
        for name in ("pressure", "traction"):
            if (load := getattr(self, name)) is not None and load.controlled_by is not None:
                raise refuse(f"a {name} that a gauge controls", "a motion or a force", "write force = { … } (N), "
                             f"or log the {name}", f"{name} = {{ controlled_by = … }}")
        if self.nodes is None and {"ux", "uy", "uz", "u"} & set(keys):
            raise refuse("the node set is missing", "nodes", 'write nodes = "NAME"', "no nodes")
        return self


class SimulatedTable(Strict):
    """The simulated value of a channel: reaction force or mean displacement of a set, or pressure on an edge set."""

    reaction: str | None = None
    displacement: str | None = None
    pressure: str | None = None
    component: Component | None = None
    minus: str | None = None  # displacement: minus the mean of this set (extensometer)
    factor: float = 1.0

    @model_validator(mode="after")
    def _one(self):
        exactly_one(self, ("reaction", "displacement", "pressure"), '{ reaction = "TOP", component = "y" }')
        if self.pressure is None and self.component is None:
            raise refuse("the direction of the channel is missing", "component = x, y or z", 'add component = "y"',
                         "no component")
        if self.pressure is not None and self.component is not None:
            raise refuse("a pressure has no direction", "no component", "leave component out", self.component)
        if self.minus is not None and self.displacement is None:
            raise refuse("minus does not belong here", "minus next to displacement", "leave out minus", self.minus)
        return self


class ChannelKeys(Strict):
    """A measured channel; the keys of the courses of its terms join these."""

    column: str
    simulated: SimulatedTable
    noise_std: Positive | None = None
    unit: str | None = None

    @model_validator(mode="after")
    def _one_course(self):
        for course in COURSES:
            has_knots = getattr(self, course.knots) is not None
            if has_knots and course.is_directed and self.simulated.reaction is None:
                raise refuse(f"{course.stem} of a channel that is no force", f"{course.knots} of a reaction",
                             f"leave {course.knots} out", "no reaction")
            if has_knots and course.start and getattr(self, course.start) is not None:
                raise refuse(f"two courses of one {course.stem}", f"{course.knots} or {course.start}",
                             "leave one of them out", "both")
        return self


COURSES = tuple(term.course for term in CHANNEL_TERMS if term.course)
if TYPE_CHECKING:
    ChannelTable = ChannelKeys
else:
    ChannelTable = create_model(
        "ChannelTable", __base__=ChannelKeys, __module__=__name__,
        **{course.start: (float | None, None) for course in COURSES if course.start},
        **{course.knots: (Annotated[int, Field(ge=1, le=100)] | None, None) for course in COURSES})
