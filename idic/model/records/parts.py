"""The parts of a model: laws of element sets, drives and loads, temperatures, heterogeneities, channels.

Every array is in internal units (mm, s, MPa, N).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from idic.fe import Cut, Mesh
from idic.model.records.free_course import jump_name, knot_name, without_knot


@dataclass(frozen=True)
class Material:
    """The law of one element set; its parameters are ``SET.name`` in the experiment's ParameterSet."""

    element_set: str
    law: str
    kinematics: str  # "small" | "finite"


def uniform(correction: Correction, mesh: Mesh, nodes: np.ndarray, component: str) -> tuple[str, np.ndarray]:
    """All nodes alike, along the motion."""
    return component, np.ones(len(nodes))


Pattern = Callable[["Correction", Mesh, np.ndarray, str], tuple[str, np.ndarray]]


@dataclass(frozen=True)
class Correction:
    """What a drive may lack: ``amplitude * course(t) * pattern(X)``.

    kind : of a term of `idic.model.terms.corrections`; reach : largest value of the pattern (mm for a rotation);
    pattern : (correction, mesh, nodes of the set, component) -> the component that it moves, (n,) on the nodes;
    keys : entries of its table that no other kind has; number : that ends its name; knot : frame of its knot, of an
    identified time course (`idic.model.records.free_course`); jumps : whether it is the frame of a jump instead.
    """

    kind: str
    course: np.ndarray  # (n_frames,), zero at the reference
    unit: str
    reach: float = 1.0
    pattern: Pattern = uniform
    keys: Mapping[str, Any] = field(default_factory=dict)
    number: int | None = None
    knot: int | None = None
    jumps: bool = False

    @property
    def name(self) -> str:
        """Last word of its degree of freedom."""
        stem = self.kind if self.number is None else f"{self.kind}{self.number}"
        if self.knot is None:
            return stem
        return (jump_name if self.jumps else knot_name)(stem, self.knot)


@dataclass(frozen=True)
class Constant:
    """A value that does not change with time."""

    value: float
    corrections: tuple[Correction, ...] = ()


@dataclass(frozen=True)
class Column:
    """A logged column, one value per frame, relative to the reference frame where it drives a displacement.

    ``noise_std`` > 0 makes the value of every frame an unknown with the logged value as prior (frame-local nuisance).
    """

    column: str
    values: np.ndarray  # (n_frames,)
    noise_std: float = 0.0
    identify_offset: bool = False
    rates: np.ndarray | None = None  # (n_frames,) d(values)/dt, for `time.offset`
    corrections: tuple[Correction, ...] = ()


@dataclass(frozen=True)
class Measured:
    """The motion is measured from the images and co-estimated with the parameters, frame by frame."""

    smoothing: float = 1.0


@dataclass(frozen=True)
class Parametrised:
    """A motion given by degrees of freedom ``boundary.SET.COMPONENT.sItJ``: shapes along an edge times courses in time.

    kind "dic": shapes and courses are the strongest of a free FE-DIC; they come with the preparation of a run.
    """

    kind: str  # "bspline" | "polynomial" | "dic"
    modes: int
    time_modes: int
    shapes: np.ndarray | None = None  # (n_nodes of the set, modes)
    courses: np.ndarray | None = None  # (n_frames, time_modes)


@dataclass(frozen=True)
class Controlled:
    """A motion or force of unknown size: in every frame the one at which a gauge reads its logged course.

    course : (n_frames,) mm from the reference on; nodes, component, minus : mean displacement of a node set, less that
    of another; rates : (n_frames,) d(course)/dt, for `time.offset`
    """

    column: str
    course: np.ndarray
    nodes: str
    component: str
    minus: str | None = None
    rates: np.ndarray | None = None


Drive = Constant | Column | Measured | Parametrised | Controlled


def corrections_of(drive: Drive) -> tuple[Correction, ...]:
    """The corrections that a drive has; only logged motions and fixed values have any."""
    return getattr(drive, "corrections", ())


@dataclass(frozen=True)
class Prescribed:
    """Prescribed displacement of one component ("x", "y", "z") of a node set, in mm."""

    nodes: str
    component: str
    drive: Drive

    @property
    def mode_names(self) -> list[str]:
        """Degrees of freedom of a parametrised drive, the courses of a shape one after the other."""
        stem, drive = f"boundary.{self.nodes}.{self.component}", self.drive
        return [f"{stem}.s{i}t{j}" for i in range(drive.modes) for j in range(drive.time_modes)]


@dataclass(frozen=True)
class Load:
    """A load on an edge (2D) or face (3D) set.

    kind "pressure": MPa, positive pushes onto the body, ``follower`` turns with it; kind "traction": MPa along
    ``component``; kind "force": N in total along ``component``, spread evenly over the edge set. share : of a force
    that acts on this body, 0.5 of one half of it.
    """

    edges: str
    kind: str
    drive: Constant | Column | Controlled
    component: str | None = None
    follower: bool = False
    identify_scale: bool = False  # its scale is a degree of freedom: a gauge that is not calibrated
    share: float = 1.0

    @property
    def stem(self) -> str:
        """``boundary.EDGES.pressure``, ``boundary.EDGES.force.x``: the prefix of its degrees of freedom."""
        along = "" if self.component is None else f".{self.component}"
        return f"boundary.{self.edges}.{self.kind}{along}"


@dataclass(frozen=True)
class TemperatureField:
    """Temperature of the nodes in every frame, NaN where it is not known."""

    values: np.ndarray  # (n_frames, n_nodes) K or °C
    source: str = ""


@dataclass(frozen=True)
class Temperature:
    """The temperature of a node set (None: of the whole mesh): one value per frame, or a field.

    It acts through ``SET.alpha`` (1/K), which every law accepts, and through laws whose parameters depend on it; see
    `idic.model.temperature`, `idic.fe.assembly.expansion` and `idic.laws.core.temperature`. ``above_celsius`` is
    what the values of the drive are above °C: 273.15 where they are in K. knots : frames of the knots of a course that
    the data give, hats : (n_knots, n_frames) their courses; degrees of freedom ``temperature_knot[FRAME]``, K.
    """

    nodes: str | None
    drive: Column | TemperatureField
    above_celsius: float = 0.0
    knots: tuple[int, ...] = ()
    hats: np.ndarray | None = None


@dataclass(frozen=True)
class Heterogeneity:
    """An element set whose stiffness varies; its values are ``SET.NAME.stiffness`` and so on in the ParameterSet.

    form : "inclusion" | "void" | "thickness" (a spot, values `amount`, x, y, (z), radius) | "gradient" (values along_x,
    along_y, (along_z)) | "layers" (values stiffness_ratio, period, direction, offset, share). See
    `idic.fe.body.variation`.
    """

    element_set: str
    name: str
    form: str

    @property
    def is_spot(self) -> bool:
        """Whether it has a centre and a radius."""
        return self.form not in ("gradient", "layers")

    @property
    def amount(self) -> str:
        """The parameter that scales the stress of a spot."""
        return "thickness" if self.form == "thickness" else "stiffness"


@dataclass(frozen=True, eq=False)
class Crack:
    """A cut of a sheet whose open part grows; its lengths are ``crack.NAME.length`` in the ParameterSet.

    cut : along which the nodes of the mesh exist twice; knots : frames with a length of their own, () for one that
    stays; hats : (n_knots or 1, n_frames) how each length counts in every frame
    """

    name: str
    cut: Cut
    knots: tuple[int, ...]
    hats: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Its degrees of freedom, one per row of `hats`."""
        stem = f"crack.{self.name}.length"
        return tuple(knot_name(stem, frame) for frame in self.knots) or (stem,)


@dataclass(frozen=True)
class Channel:
    """A measured channel and its simulated counterpart.

    kind "reaction": factor x sum of the reactions of a node set along ``component`` (N); "displacement": mean
    displacement of a node set along ``component``, less that of the set ``minus`` (mm: an extensometer, an LVDT);
    "pressure": the pressure on the edge set ``nodes`` (MPa).
    starts : s, when the course of a term begins, by the last word of its degree of freedom, others at the reference
    frame; hats : (n_frames,) course of every knot, by the last word of its degree of freedom; full_scale : largest
    reading of the test that these frames are a part of, None: these are all; times : (n_frames,) s of the readings
    among those of other experiments, None: those of the experiment; shown_unit, shown_factor : unit of the column,
    which tables and results for the user have, and internal units per such unit
    """

    column: str
    values: np.ndarray  # (n_frames,)
    noise_std: float | None
    nodes: str
    component: str | None
    factor: float = 1.0
    rates: np.ndarray | None = None
    unit: str = "N"
    kind: str = "reaction"
    minus: str | None = None
    starts: Mapping[str, float] = field(default_factory=dict)
    hats: Mapping[str, np.ndarray] = field(default_factory=dict)
    full_scale: float | None = None
    times: np.ndarray | None = None
    shown_unit: str = ""
    shown_factor: float = 1.0

    def __post_init__(self):
        if not self.shown_unit:
            object.__setattr__(self, "shown_unit", self.unit)

    def dof(self, name: str) -> str:
        """Full name of its degree of freedom with this last word."""
        return f"channel.{self.column}.{name}"

    def hats_of(self, stem: str) -> dict[str, np.ndarray]:
        """The courses of the knots of one degree of freedom, by its last word  # (n_frames,) each"""
        return {name: hat for name, hat in self.hats.items() if without_knot(name) == stem}

    @property
    def is_load(self) -> bool:
        """Whether it reads a force or a pressure, no motion."""
        return self.kind != "displacement"

    @property
    def largest(self) -> float:
        """Largest reading of the whole test, 1 where all are zero."""
        return self.full_scale or float(np.abs(self.values).max()) or 1.0
