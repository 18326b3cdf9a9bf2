"""What the report is made of: one frozen record of a finished (or interrupted) run. No files, no solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class ChannelRecord:
    """A measured channel beside its simulated counterpart.

    Attributes
    ----------
    measured, simulated, started : (n_frames,) float
        Logged values, values at the identified and at the starting parameters (`started` may be None).
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
    """

    names: tuple[str, ...]
    frame: int
    phi_px: np.ndarray
    steps: tuple[str, ...]


@dataclass(frozen=True)
class ResidualMaps:
    """Residuals f - g(x + u) in the reference image at the starting and the identified parameters.

    Attributes
    ----------
    frames : tuple of int
    before, after : (n_selected, ny, nx) float, grey values, NaN outside
    """

    frames: tuple[int, ...]
    before: np.ndarray
    after: np.ndarray


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

    @property
    def noise_gv(self) -> float | None:
        return self.result.get("noise", {}).get("std_gv")

    @property
    def value_unit(self) -> str:
        """Unit of pixel values, noise and residuals: "grey values", or that of the heights."""
        return self.result.get("noise", {}).get("unit") or "grey values"

    @property
    def n_frames(self) -> int:
        return len(self.result.get("frames", ())) or (0 if self.times is None else len(self.times))

    @property
    def abscissa(self) -> np.ndarray:
        """Times where they are known, else frame numbers  # (n_frames,)"""
        return np.arange(self.n_frames) if self.times is None else np.asarray(self.times)

    @property
    def noise_level(self) -> np.ndarray | None:
        """The rms residual that camera noise alone would leave in each frame: rms / sqrt(chi² per pixel).

        It is not sigma itself: interpolation and low-pass of the images change what is left of their noise.
        (n_frames,) grey values, NaN where unknown.
        """
        frames = self.result.get("frames", ())
        pairs = [(f.get("rms_gv"), f.get("chi2_dof")) for f in frames]
        levels = np.array([r / np.sqrt(c) if r and c else np.nan for r, c in pairs], dtype=float)
        return levels if np.isfinite(levels).any() else None
