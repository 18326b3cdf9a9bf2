"""The data of the report: one frozen record of a finished (or interrupted) run. No files, no solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from idic.laws import ClassicalFit, Smoothness
from idic.measure import FieldSeries
from idic.model import Gauge

EDGE = "edge"  # the cells of a record that is a cross-section


@dataclass(frozen=True)
class ChannelRecord:
    """A measured channel and its simulated counterpart.

    Attributes
    ----------
    measured, simulated, started : (n_frames,) float
        Logged values, values at the identified and at the starting parameters (`started` may be None), in `unit`, that
        of the column.
    std : float or None
        Standard deviation of the measurement.
    """

    name: str
    unit: str
    measured: np.ndarray
    simulated: np.ndarray
    std: float | None = None
    started: np.ndarray | None = None


@dataclass(frozen=True)
class FieldFrames:
    """Displacements and further nodal fields of some frames.

    Attributes
    ----------
    frames : tuple of int
    u_px : (n_selected, n_nodes, 2) float, px
        Column and row displacement.
    extra : mapping of name to (n_selected, n_nodes)
        For instance the equivalent plastic strain.
    """

    frames: tuple[int, ...]
    u_px: np.ndarray
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Sensitivities:
    """Sensitivity fields of one frame: motion for one stated step of each parameter.

    Attributes
    ----------
    names : tuple of str
    frame : int
    phi_px : (n, n_nodes, 2 or 3) float, px
        Change of the pixel position for a change of the parameter by its step; of height images also that of the
        height, over the size of a pixel.
    steps : tuple of str
        The step as it is shown, for instance "1 %" or "0.1 deg".
    sizes : tuple of float
        The same as numbers in the units of the parameters as they are shown; () where they are not needed.
    """

    names: tuple[str, ...]
    frame: int
    phi_px: np.ndarray
    steps: tuple[str, ...]
    sizes: tuple[float, ...] = ()


@dataclass(frozen=True)
class ResidualMaps:
    """Residuals f - g(x + u) in the reference image at the starting and the identified parameters.

    Attributes
    ----------
    frames : tuple of int
    start, identified : (n_selected, ny, nx) float, grey values, NaN outside
    """

    frames: tuple[int, ...]
    start: np.ndarray
    identified: np.ndarray


@dataclass(frozen=True)
class SectionProfile:
    """Heights of a cross-section in one frame, mean over the image rows, NaN where nothing was compared.

    Attributes
    ----------
    column : (m,) float, px
        Where the columns of the reference image have gone in this image, by the simulation; from left to right.
    measured, misfit : (m,) float
        Mean height there, and mean residual: simulated less measured.
    rows : (m,) int
        Number of pixels of each mean.
    """

    column: np.ndarray
    measured: np.ndarray
    misfit: np.ndarray
    rows: np.ndarray


@dataclass(frozen=True)
class PointMaps:
    """Measured fields and the residual of the model, point by point, in some frames.

    Attributes
    ----------
    frames : tuple of int
    positions_mm : (n, 2) float, mm
        In the axes of the mesh.
    measured, residual : (n_selected, n, 2 | 3) float, µm, along x, y and z; NaN where not measured
    pitch_mm : float
        Distance of neighbours.
    depth_noise_um : float
        Noise along z; 0 where it is not compared.
    """

    frames: tuple[int, ...]
    positions_mm: np.ndarray
    measured: np.ndarray
    residual: np.ndarray
    pitch_mm: float
    depth_noise_um: float = 0.0


@dataclass(frozen=True)
class FrameView:
    """One frame as it was seen, with the simulated mesh on it, and the residual in the reference image.

    Attributes
    ----------
    image : (ny, nx)
    nodes_px : (n_nodes, 2) float, px
        Where the simulation puts the visible nodes in this image.
    residual : (ny, nx) float or None, NaN outside
    profile : SectionProfile or None
        Of a cross-section, which moves alike in all rows.
    """

    frame: int
    image: np.ndarray
    nodes_px: np.ndarray
    residual: np.ndarray | None
    profile: SectionProfile | None = None


@dataclass(frozen=True)
class FreeFields:
    """A free FE-DIC on the same mesh, started from the simulated motion: no law, no force.

    Attributes
    ----------
    frames : tuple of int
    difference_px : (n_selected, n_nodes, 2) float, px
        Its displacement less the simulated one, NaN at nodes that it does not see.
    residuals : (n_selected, ny, nx) float, NaN outside
    chi2_dof : (n_selected,) float
        Squared residual over noise, per degree of freedom that is left.
    length_px : float
        Length below which its displacement is smoothed.
    rise : (n_selected, n_nodes) float or None
        Of height images: its height less the simulated one.
    """

    frames: tuple[int, ...]
    difference_px: np.ndarray
    residuals: np.ndarray
    chi2_dof: np.ndarray
    length_px: float
    rise: np.ndarray | None = None


@dataclass(frozen=True)
class LawCurve:
    """An identified law at one point under uniaxial stress, up to the strain that the specimen has seen.

    Attributes
    ----------
    strain, stress, std : (m,) float
        Nominal strain, nominal stress (MPa) and its standard deviation from the covariance of the parameters.
    started : (m,) float
        Stress with the starting values.
    seconds : float
        Duration of the path; it matters to laws that know time.
    missing : tuple of str
        Parameters of the law that the test leaves open: the arrays are empty then.
    axis : "x" | "y" | "z"
        Along which it is pulled, or pushed where the strain is negative: as the test does on the whole.
    """

    name: str
    law: str
    strain: np.ndarray
    stress: np.ndarray
    std: np.ndarray
    started: np.ndarray
    seconds: float
    missing: tuple[str, ...] = ()
    axis: str = "x"


@dataclass(frozen=True, eq=False)
class HardeningCurve:
    """An identified free hardening curve.

    Attributes
    ----------
    name : element set
    plastic_strain, stress, std : (m,) -, MPa, MPa
        Flow stress up to the plastic strain that the specimen has reached, std from the covariance of the parameters.
    knots : (n,) plastic strain of the knots
    reached : float
        Plastic strain that 99 % of the seen nodes stay within; the last knot where no state is known.
    fits : tuple of ClassicalFit
        The classical forms, the nearest first.
    smoothness : as stated, or as the evidence has it
    """

    name: str
    plastic_strain: np.ndarray
    stress: np.ndarray
    std: np.ndarray
    knots: np.ndarray
    reached: float
    fits: tuple[ClassicalFit, ...]
    smoothness: Smoothness = field(default_factory=Smoothness)


@dataclass(frozen=True, eq=False)
class YieldSurface:
    """An identified free yield surface, initial yield; stresses are 11, 22, 12 in material axes.

    Attributes
    ----------
    name : element set
    section, radius, std : (m, 3) directions without shear, (m,) MPa factors on them at yield, (m,) MPa
        The standard deviation counts the error of the family, too.
    visited, visited_radius, visited_std : (k, 3), (k,) MPa, (k,) MPa
        The same of the directions in which the test has flowed.
    fits : tuple of ClassicalFit
        The classical forms along the visited directions, the nearest first.
    smoothness : std of the difference of neighbouring weights, as stated
    """

    name: str
    section: np.ndarray
    radius: np.ndarray
    std: np.ndarray
    visited: np.ndarray
    visited_radius: np.ndarray
    visited_std: np.ndarray
    fits: tuple[ClassicalFit, ...]
    smoothness: float


@dataclass(frozen=True)
class RubberMode:
    """Nominal stress over stretch of an incompressible body in one mode: stretch, stress, std (m,) -, MPa, MPa."""

    mode: str
    stretch: np.ndarray
    stress: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class RubberSlope:
    """Derivative of an energy by an invariant (less 3): invariant, value, std (m,) -, MPa, MPa; knots (n,) -."""

    name: str
    invariant: np.ndarray
    value: np.ndarray
    std: np.ndarray
    knots: np.ndarray

    def value_at(self, invariant: np.ndarray) -> np.ndarray:
        return np.interp(invariant, self.invariant, self.value)


@dataclass(frozen=True)
class RubberCurve:
    """An identified free rubber energy.

    Attributes
    ----------
    name : element set
    modes, slopes : up to the invariants that the specimen has reached
    reached : (float, float)
        I1 - 3 and I2 - 3 that 99 % of the nodes stay within.
    fits : tuple of ClassicalFit
        The classical forms, the nearest first.
    strengths : of the smoothness priors of dW/dI1 and dW/dI2
    """

    name: str
    modes: tuple[RubberMode, ...]
    slopes: tuple[RubberSlope, ...]
    reached: tuple[float, float]
    fits: tuple[ClassicalFit, ...]
    strengths: tuple[float, ...] = (1.0, 1.0)


@dataclass(frozen=True, eq=False)
class RelaxationCurve:
    """An identified free relaxation spectrum.

    Attributes
    ----------
    name : element set
    time, modulus, std : (m,) s, MPa, MPa
        Shear modulus after a jump, over the times that the frames show.
    taus, weights, weight_std : (n,) s, -, -
        The spectrum; std nan where nothing was identified.
    fits : tuple of ClassicalFit
        The classical forms, the nearest first.
    strength : of the smoothness prior
    """

    name: str
    time: np.ndarray
    modulus: np.ndarray
    std: np.ndarray
    taus: np.ndarray
    weights: np.ndarray
    weight_std: np.ndarray
    fits: tuple[ClassicalFit, ...]
    strength: float = 1.0


@dataclass(frozen=True)
class TemperatureFactor:
    """An identified factor of the temperature on parameters of a law.

    Attributes
    ----------
    name : element set
    kind : as in experiment.toml; targets : the parameters that it multiplies; values : its own parameters
    reference : °C
    temperature, factor, std : (m,) °C, -, -
        Over the temperatures of the test, std from the covariance of the parameters.
    """

    name: str
    kind: str
    targets: tuple[str, ...]
    values: Mapping[str, float]
    reference: float
    temperature: np.ndarray
    factor: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class NoiseFloor:
    """Standard deviation of displacement (px) and strain by noise alone: free FE-DIC of a still image, and the
    identified model.

    None: not known. model_frame : the frame of the figures of the model, which grow with the motion. free_rise : of
    height images, in their unit.
    """

    free_px: float | None = None
    free_strain: float | None = None
    model_px: float | None = None
    model_strain: float | None = None
    model_frame: int | None = None
    free_rise: float | None = None


@dataclass(frozen=True)
class Practice:
    """What a reader needs to judge a correlation, after the good-practice guide of the iDICs.

    Attributes
    ----------
    setup : mapping
        What the user has stated under [setup]; nothing of it can be measured from images.
    n_elements, cell, element_px, smallest_px
        Elements that were correlated: number, kind, mean and smallest side.
    speckle_px : float or None
        Full width at half maximum of the autocorrelation.
    channel_noise : tuple of (name, unit, std, source)
    compressed : bool
        Whether the reference image shows blocks of JPEG.
    """

    version: str
    setup: Mapping[str, str]
    columns: int
    rows: int
    depth: str
    frame_s: float | None
    reference: str
    n_references: int
    n_pixels: int
    speckle_px: float | None
    contrast: float
    grey_range: tuple[float, float]
    saturated: float | None
    lowpass_px: float
    interpolation: str
    brightness: str
    edge_margin_px: int
    n_elements: int
    cell: str
    element_px: float
    smallest_px: float
    kind: str
    estimator: str
    floor: NoiseFloor
    channel_noise: tuple[tuple[str, str, float, str], ...] = ()
    compressed: bool = False


@dataclass(frozen=True)
class RunRecord:
    """All that the report shows; every optional part may be missing and its section is then left out.

    Attributes
    ----------
    title : str
    result : mapping
        ``result.json`` of the contract.
    history : tuple of mappings
        One per evaluated point: evaluation (number), stage, accepted, phi (None where the simulation failed), damping,
        values {name: value in the shown unit}.
    names : tuple of str
        The free parameters, in the order of `M`.
    M : (n, n) float or None
        Noise-weighted correlation matrix in scaled unknowns (ln value, or value / scale).
    reference : (ny, nx) or None
        Reference image.
    nodes_px : (n_nodes, 2) float, px
        Visible nodes in the reference image; other nodes may be there as long as no cell uses them.
    cells : tuple of (cell name, (nel, nn) int)
    times : (n_frames,) float
    time_label : str
        What `times` is, with its unit: "time [s]", or "frame".
    rms_before, rms_after : (n_frames,) float, grey values, NaN where a frame took no part
    cameras : tuple of (name, RunRecord)
        The further cameras: the same run as each of them saw it.
    temperature : (n_frames, 3) float, K
        Lowest, mean and highest change of temperature of the nodes since the reference frame.
    views : tuple of FrameView
        Frames to look at one by one.
    series : FieldSeries
        Displacement, strain, stress and state over the frames, simulated and measured.
    gauges : tuple of Gauge
        Where the fields are read off.
    camera_floor_px : (n_nodes,) float, px
        Motion that the camera shows in frames at rest, rms by region; None where no frame is at rest.
    points : PointMaps
        Of measured fields.
    """

    title: str
    result: Mapping
    history: tuple[Mapping, ...] = ()
    names: tuple[str, ...] = ()
    M: np.ndarray | None = None
    reference: np.ndarray | None = None
    nodes_px: np.ndarray | None = None
    cells: tuple[tuple[str, np.ndarray], ...] = ()
    times: np.ndarray | None = None
    time_label: str = "frame"
    rms_before: np.ndarray | None = None
    rms_after: np.ndarray | None = None
    channels: tuple[ChannelRecord, ...] = ()
    fields: FieldFrames | None = None
    sensitivities: Sensitivities | None = None
    residuals: ResidualMaps | None = None
    notes: tuple[str, ...] = ()
    pixel_size_mm: float | None = None
    cameras: tuple[tuple[str, RunRecord], ...] = ()
    temperature: np.ndarray | None = None
    views: tuple[FrameView, ...] = ()
    free_fields: FreeFields | None = None
    curves: tuple[LawCurve, ...] = ()
    hardening: tuple[HardeningCurve, ...] = ()
    temperature_factors: tuple[TemperatureFactor, ...] = ()
    rubber: tuple[RubberCurve, ...] = ()
    relaxation: tuple[RelaxationCurve, ...] = ()
    surfaces: tuple[YieldSurface, ...] = ()
    practice: Practice | None = None
    camera_floor_px: np.ndarray | None = None
    points: PointMaps | None = None
    series: FieldSeries | None = None
    gauges: tuple[Gauge, ...] = ()

    @property
    def noise_gv(self) -> float | None:
        """Standard deviation of the noise of one image, in the unit of its values; None where it is not known."""
        return self.result.get("noise", {}).get("std_gv")

    @property
    def value_unit(self) -> str:
        """Unit of pixel values, noise and residuals: "grey values", or that of the heights."""
        return self.result.get("noise", {}).get("unit") or "grey values"

    @property
    def motion_unit(self) -> tuple[float, str]:
        """What a motion in px is multiplied by to be shown, and its unit: µm of measured fields, whose px is their
        pitch."""
        if self.result.get("quantity") == "displacement" and self.pixel_size_mm is not None:
            return 1e3 * self.pixel_size_mm, "µm"
        return 1.0, "px"

    @property
    def time_label_unit(self) -> str:
        """"s" where times are known, else "frames"."""
        return "s" if "[s]" in self.time_label else "frames"

    @property
    def n_frames(self) -> int:
        """Number of frames, the reference included."""
        return len(self.result.get("frames", ())) or (0 if self.times is None else len(self.times))

    @property
    def abscissa(self) -> np.ndarray:
        """Times where they are known, else frame numbers  # (n_frames,)"""
        return np.arange(self.n_frames) if self.times is None else np.asarray(self.times)

    @property
    def noise_level(self) -> np.ndarray | None:
        """The rms residual that camera noise alone would leave in each frame: rms / sqrt(chi² per pixel).

        It is not sigma itself: interpolation and low-pass of the images change their noise.
        (n_frames,) grey values, NaN where unknown.
        """
        frames = self.result.get("frames", ())
        pairs = [(f.get("rms_gv"), f.get("chi2_dof")) for f in frames]
        levels = np.array([r / np.sqrt(c) if r and c else np.nan for r, c in pairs], dtype=float)
        return levels if np.isfinite(levels).any() else None
