"""The experiment as recorded and as modelled: stack, times, channels, mesh, camera, ROI, noise, drives.

Every array is in internal units (mm, s, MPa, N; pixels for images). Records only: `idic.experiment_file` reads files,
`idic.model.forward` simulates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from idic.errors import InputError
from idic.fe import ExternalSetup, Mesh, Morph, morphed
from idic.images import AnyCamera, PlacedCamera, Stabiliser, Stack, normal_sign
from idic.model.free_course import jump_name, knot_name, without_knot
from idic.model.gauges import Gauge
from idic.parameters import ParameterSet

if TYPE_CHECKING:  # it knows the frames of a simulation, which know no experiment
    from idic.model.motion_error import MotionError


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
    identified time course (`idic.model.free_course`); jumps : whether it is the frame of a jump instead.
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


@dataclass(frozen=True)
class CorrelatedNoise:
    """Noise with correlation between neighbours, as the recording shows it (docs/method.md, section 11).

    recorded_gv : standard deviation of a pixel as recorded (GV)
    sum_std_gv : of independent pixel noise that scatters sums against the gradient as this noise does (GV)
    correlation : (2 L + 1, 2 L + 1) of pixels so many rows and columns apart, 1 in the middle
    stated_gv : what was given or found before (GV)
    source : "still_frames" | "consecutive_images" | "free_residual", "" of measured fields
    """

    recorded_gv: float
    sum_std_gv: float
    correlation: tuple[tuple[float, ...], ...]
    stated_gv: float
    source: str = ""

    @property
    def neighbour_correlation(self) -> float:
        """Correlation of pixels beside each other, the mean of rows and columns."""
        middle = len(self.correlation) // 2
        return 0.5 * (self.correlation[middle][middle + 1] + self.correlation[middle + 1][middle])


@dataclass(frozen=True)
class Noise:
    """Grey-value noise of one image (standard deviation) and where the figure comes from.

    std_gv : of independent noise that has the same variance in the compared pixels
    stabiliser : where the noise depends on the grey value: the transform of the images that makes it `std_gv` all over
    correlated : where neighbours are correlated, or the noise is larger than stated
    """

    std_gv: float | None
    source: str = "given"  # given | still_frames | residual_of_free_dic
    stabiliser: Stabiliser | None = None
    correlated: CorrelatedNoise | None = None

    @property
    def in_sums_gv(self) -> float | None:
        """Standard deviation that counts in sums against the gradient."""
        return self.std_gv if self.correlated is None else self.correlated.sum_std_gv

    @property
    def recorded_gv(self) -> float | None:
        """Standard deviation of a pixel as recorded."""
        return self.std_gv if self.correlated is None else self.correlated.recorded_gv


@dataclass(frozen=True)
class Depth:
    """How the displacement along the normal of the points is compared: on the surface of a solid, or on a sheet in
    plane stress, whose seen side moves by half of the change of its thickness.

    weight : of its rows: noise of a component in the plane over its own, as sums over many points have it;
    noise_gain : variance of a weighted row over that of a row in the plane; std_um : noise of a point;
    rigid_motion : an offset and two tilts of every frame are unknown; side : of a sheet, +1 where the side is seen to
    which the normal points, -1 the other one; its bending in every frame, a polynomial of the third degree, is unknown
    """

    weight: float = 1.0
    noise_gain: float = 1.0
    std_um: float = 0.0
    rigid_motion: bool = False
    side: int = 0


@dataclass(frozen=True, eq=False)
class FieldPoints:
    """The points of a measured field, on a grid whose unit is the distance of neighbours.

    positions_px : (n, 2) columns and rows of the points; shape : (ny, nx) of the grid; pitch_mm : distance of
    neighbours;
    subset_px : width of the square over which the other system averaged the motion of a point, 0 where it is not known;
    free_rigid : a rigid motion of all points is an unknown of every frame; depth : None where motion in the plane alone
    is compared
    """

    positions_px: np.ndarray
    shape: tuple[int, int]
    pitch_mm: float
    subset_px: float = 0.0
    free_rigid: bool = False
    depth: Depth | None = None

    @property
    def n_components(self) -> int:
        """Of the displacement of a point that is compared: 2, or 3 with the one along the normal."""
        return 2 if self.depth is None else 3

    @property
    def um_per_px(self) -> float:
        """µm per distance of neighbours."""
        return 1e3 * self.pitch_mm


@dataclass(frozen=True)
class FurtherCamera:
    """Another camera on the same specimen: one image per frame, taken at the same times, with its own everything.

    axis_order : the mesh axes as it sees them, () = as the main camera; e.g. (0, 2, 1) sees x and z. texture : name of
    the camera whose reference image its own is compared with as well.
    """

    name: str  # its degrees of freedom are NAME.rotation_deg, ...
    camera: AnyCamera
    stack: Stack | None
    labels: tuple[str, ...]
    noise: Noise
    mask: np.ndarray | None = None
    surface: str | None = None
    axis_order: tuple[int, ...] = ()
    texture: str | None = None


@dataclass(frozen=True)
class Options:
    """How to solve; every entry has a default that suits most tests."""

    interpolation: str = "quintic"  # quintic | cubic: four times less sub-pixel bias, and images are never the cost
    lowpass_px: float = 0.6  # Gaussian blur of every image against aliasing; 0 = none
    camera_blur_px: float = 12**-0.5  # std of the camera's own blur: the area of a pixel, and of the lens what is known
    border_px: int = 0  # left out along the borders of every image, where low-pass and spline mirror it; a file has 4
    edge_margin_px: int = 3  # pixels left out along the edges of the mesh: a step in the image has no sub-pixel value
    left_out_px: tuple[tuple[float, float, float], ...] = ()  # circles (column, row, radius) of the reference image
    element_order: str = "auto"  # auto (tri3, quad4 are computed as tri6, quad8) | as_given | quadratic
    brightness: str = "frame"  # none | frame | patch
    patch_px: float = 100.0
    defocus: str = "none"  # none | frame: the variance of a blur is an unknown of every frame
    method: str = "integrated"  # integrated | two_step | two_step_unweighted (`idic.identification.free_motion`)
    dic_regularisation: str = "auto"  # of free FE-DIC: none | mechanical | gradient; auto: mechanical, two steps none
    weighting: str = "noise"  # noise | paper
    estimator: str = "auto"  # auto | ordinary | generalised least squares: see `idic.identification.step.estimator`
    alpha: float = 0.01
    step_limit: float | None = None  # relative; the paper's weighting uses 0.05
    trial_steps: int = 1  # of a damped or limited step, evaluated in parallel
    max_iterations: int = 40
    search: str = "auto"  # auto | never: better starts are looked for where a law needs it (`start_search`)
    schedule: str = "all"  # all | spectrum: weak directions locked until the strong ones stand
    tolerance: float = 0.02  # stop when the scaled step is this small a part of the standard deviations
    # FE increments per frame (before any cutting); None: 1, or chosen (`idic.identification.step.increments`)
    substeps: int | None = None
    perturbation: float = 1e-4
    locking: str = "auto"  # auto (mean dilatation where it is needed) | none | mean_dilatation


@dataclass(frozen=True)
class Stage:
    """One entry of a schedule: these names are free, the others locked.

    lowpass_px : blur of the images in this stage; until_s : end of the frames that it compares
    (`idic.identification.step.schedule`).
    """

    free: tuple[str, ...] | str  # names or "all"
    max_iterations: int | None = None
    lowpass_px: float | None = None
    until_s: float | None = None


@dataclass(frozen=True)
class Experiment:
    """All that is known of one test; docs/experiment-file.md has the file it is read from."""

    title: str
    folder: str
    kind: str  # plane_stress | plane_strain | solid
    mesh: Mesh
    thickness: float | None  # mm
    materials: tuple[Material, ...]
    parameters: ParameterSet
    prescribed: tuple[Prescribed, ...]
    loads: tuple[Load, ...]
    channels: tuple[Channel, ...]
    camera: AnyCamera
    stack: Stack | None
    labels: tuple[str, ...]  # one per frame: file names
    times: np.ndarray  # (n_frames,) s; frame numbers where no time is known
    reference: int = 0
    excluded: tuple[int, ...] = ()
    mask: np.ndarray | None = None  # (ny, nx) bool: True = correlate
    surface: str | None = None
    symmetry: str | None = None  # "x": the mesh is the half x >= 0 of a cross-section, the images show both halves
    quantity: str = "grey"  # grey | height (topography: pixel values are heights) | displacement (measured fields)
    height_unit: float = 1.0  # mm per unit of pixel value of a height image
    noise: Noise = field(default_factory=lambda: Noise(None))
    stages: tuple[Stage, ...] = ()
    options: Options = field(default_factory=Options)
    length_unit: str = "mm"  # "px" where no scale is known: then mm in every docstring reads px
    identity: str = ""  # hash of everything that decides the result
    notes: tuple[str, ...] = ()  # assumptions on reading; shown by `check` and in the report
    extras: Mapping[str, Any] = field(default_factory=dict)
    temperatures: tuple[Temperature, ...] = ()
    camera_name: str = "camera"  # of the main camera, by which frames are named
    cameras: tuple[FurtherCamera, ...] = ()
    axis_order: tuple[int, ...] = ()  # of the view of a further camera: its mesh axes in terms of the simulation's
    sees_back: bool = False  # of the view of a further camera: it sees the other side of a sheet than `surface_side`
    heterogeneities: tuple[Heterogeneity, ...] = ()
    solver: ExternalSetup | None = None  # a program that simulates in place of the built-in one
    morphs: tuple[Morph, ...] = ()  # geometric degrees of freedom of the mesh: `at_geometry`
    averaged: tuple[int, ...] = ()  # frames at rest whose mean is the reference image, `reference` the last; () = that
    points: FieldPoints | None = None  # of a measured field: then a frame of the stack is (n_points, 2), in µm
    gauges: tuple[Gauge, ...] = ()  # where the report reads fields off
    motion_error: MotionError | None = None  # what the simulation is known to lack, added to it
    log_offset: float = 0.0  # s, `time.offset` at which the columns of the log were read; linear from there

    def log_shift(self, parameters: ParameterSet) -> float:
        """How much later than they were read the columns of the log count at these parameters (s)."""
        return parameters["time.offset"].value - self.log_offset if "time.offset" in parameters else 0.0

    def at_geometry(self, parameters: ParameterSet) -> Experiment:
        """The experiment with the mesh morphed to these parameters; itself where the geometry is that of the mesh.

        Raises
        ------
        NotConverged
            If an element would be flattened.
        """
        values = {morph.name: parameters[morph.name].value for morph in self.morphs if morph.name in parameters}
        mesh = morphed(self.mesh, self.morphs, values)
        return self if mesh is self.mesh else replace(self, mesh=mesh)

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Of the prescribed displacements, then of the loads."""
        return (*(entry.drive for entry in self.prescribed), *(entry.drive for entry in self.loads))

    @property
    def views(self) -> tuple[Experiment, ...]:
        """The experiment as each camera sees it, the main camera first: images, mask, surface, noise, axes of the mesh.

        To correlate with only: what moves the simulation stays in the axes of the whole.
        """
        return (self, *(self._seen_by(camera) for camera in self.cameras))

    def _seen_by(self, entry: FurtherCamera) -> Experiment:
        mesh = self.mesh
        if entry.axis_order:
            mesh = replace(mesh, nodes=mesh.nodes[:, list(entry.axis_order)])
        extras = {key: value for key, value in self.extras.items() if key != "still_stack"}  # of the main camera
        sees_back = isinstance(entry.camera, PlacedCamera) and entry.camera.side == -self.surface_side
        return replace(self, mesh=mesh, camera=entry.camera, stack=entry.stack, labels=entry.labels,
                       noise=entry.noise, mask=entry.mask, surface=entry.surface, camera_name=entry.name,
                       axis_order=entry.axis_order, sees_back=sees_back, cameras=(), extras=extras)

    def turned(self, field: np.ndarray) -> np.ndarray:
        """A nodal vector field of the simulation in the axes of this view  # (n_nodes, dim, ...)

        A sheet that becomes thinner recedes from the cameras on both of its sides.
        """
        if self.axis_order:
            return field[:, list(self.axis_order)]
        if not self.sees_back or field.shape[1] == self.n_dim:
            return field
        field = field.copy()
        field[:, 2] *= -1.0
        return field

    @property
    def surface_side(self) -> int:
        """+1 or -1: from which side of a sheet in plane stress its change of thickness is seen, by cameras with a lens
        (the first of them, see `sees_back`) or by points of three coordinates.

        0: there is none, the thickness is not known, or nothing shows motion out of the plane.
        """
        if self.points is not None:
            depth = self.points.depth
            return 0 if depth is None else round(depth.side * normal_sign(self.camera))
        cameras = [view for view in (self.camera, *(entry.camera for entry in self.cameras))
                   if isinstance(view, PlacedCamera)]
        if self.kind != "plane_stress" or self.thickness is None or not cameras:
            return 0
        return cameras[0].side

    @property
    def n_frames(self) -> int:
        return len(self.times)

    @property
    def image_shape(self) -> tuple[int, int]:
        """(ny, nx) of the images, or of the grid of a measured field."""
        return self.stack.shape if self.points is None else self.points.shape

    @property
    def recorded(self) -> str:
        """The frames in words: ``4 images of 80 x 60 px``, ``4 stages of 300 points``."""
        if self.points is not None:
            return f"{self.n_frames} stages of {len(self.points.positions_px)} points"
        rows, columns = (0, 0) if self.stack is None else self.image_shape
        return f"{self.n_frames} images of {columns} x {rows} px"

    def picture(self, frame: int) -> np.ndarray:
        """A frame to look at: its image, or of a measured field without images the points that it holds, bright on
        black  # (ny, nx)"""
        images = getattr(self.stack, "images", None)  # in which the motion was measured
        values = np.asarray((images or self.stack).frame(frame))
        if self.points is None or images is not None:
            return values
        measured_px = self.points.positions_px[np.isfinite(values).all(axis=1)]
        column, row = np.rint(measured_px).astype(int).T
        image = np.zeros(self.points.shape, dtype=np.uint8)
        image[row, column] = 200
        return image

    @property
    def n_references(self) -> int:
        """How many images are averaged to the reference image."""
        return max(len(self.averaged), 1)

    @property
    def value_unit(self) -> str:
        """What a pixel's value is in: "grey values", or the unit of the heights."""
        if self.quantity == "grey":
            return "grey values"
        if self.quantity == "displacement":
            return "µm"
        return {1e3: "m", 1.0: "mm", 1e-3: "µm", 1e-6: "nm"}.get(self.height_unit, f"{self.height_unit:g} mm")

    @property
    def n_dim(self) -> int:
        return 3 if self.kind == "solid" else 2

    def material_of(self, element_set: str) -> Material:
        for material in self.materials:
            if material.element_set == element_set:
                return material
        raise InputError(f"no material for element set {element_set}", key="material",
                         expected=", ".join(material.element_set for material in self.materials), found=element_set,
                         remedy=f"add a table [material.{element_set}], or use one of these sets")
