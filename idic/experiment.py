"""What the laboratory recorded and how it is to be modelled: stack, times, channels, mesh, camera, ROI, noise, drives.

Every array is in internal units (mm, s, MPa, N; pixels for images). Records only: reading files is `idic.edge`,
simulating is `idic.forward`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from idic.errors import InputError
from idic.fe.mesh import Mesh
from idic.images.camera import Camera
from idic.images.stack import Stack
from idic.parameters import ParameterSet


@dataclass(frozen=True)
class Material:
    """The law of one element set; its parameters are ``SET.name`` in the experiment's ParameterSet."""

    element_set: str
    law: str
    kinematics: str  # "small" | "finite"


@dataclass(frozen=True)
class Constant:
    """A value that does not change with time."""

    value: float


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


@dataclass(frozen=True)
class Measured:
    """The motion is measured from the images and co-estimated with the parameters, frame by frame."""

    smoothing: float = 1.0


@dataclass(frozen=True)
class Parametrised:
    """A motion given by degrees of freedom ``boundary.SET.COMPONENT.name``: B-splines along the edge and in time."""

    kind: str  # "bspline" | "polynomial"
    modes: int
    time_modes: int


Drive = Constant | Column | Measured | Parametrised


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
    ``component``; kind "force": N in total along ``component``, spread evenly over the edge set.
    """

    edges: str
    kind: str
    drive: Constant | Column
    component: str | None = None
    follower: bool = False


@dataclass(frozen=True)
class Channel:
    """A measured channel and its simulated counterpart (N): factor x sum of the reactions of a node set."""

    column: str
    values: np.ndarray  # (n_frames,)
    noise_std: float | None
    nodes: str
    component: str
    factor: float = 1.0
    rates: np.ndarray | None = None
    unit: str = "N"


@dataclass(frozen=True)
class Noise:
    """Grey-value noise of one image (standard deviation) and where the figure comes from."""

    std_gv: float | None
    source: str = "given"  # given | still_frames | residual_of_free_dic


@dataclass(frozen=True)
class Options:
    """How to solve; every entry has a default that suits most tests."""

    interpolation: str = "quintic"  # quintic | cubic: four times less sub-pixel bias, and images are never the cost
    lowpass_px: float = 0.6  # Gaussian blur of every image against aliasing; 0 = none
    edge_margin_px: int = 3  # pixels left out along the edges of the mesh: a step in the image has no sub-pixel value
    element_order: str = "auto"  # auto (tri3, quad4 are computed as tri6, quad8) | as_given | quadratic
    brightness: str = "frame"  # none | frame | patch
    patch_px: float = 100.0
    weighting: str = "noise"  # noise | paper
    alpha: float = 0.01
    step_limit: float | None = None  # relative; the paper's weighting uses 0.05
    max_iterations: int = 40
    tolerance: float = 0.02  # stop when the scaled step is this small a part of the standard deviations
    substeps: int = 1  # FE increments per frame (before any cutting)
    perturbation: float = 1e-4
    locking: str = "auto"  # auto (mean dilatation where it is needed) | none | mean_dilatation


@dataclass(frozen=True)
class Stage:
    """One entry of a schedule: these names are free, the others locked."""

    free: tuple[str, ...] | str  # names or "all"
    max_iterations: int | None = None


@dataclass(frozen=True)
class Experiment:
    """All that is known of one test. See `contract.md` section 1 for the file it is read from."""

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
    camera: Camera
    stack: Stack | None
    labels: tuple[str, ...]  # one per frame: file names
    times: np.ndarray  # (n_frames,) s; frame numbers where no time is known
    reference: int = 0
    excluded: tuple[int, ...] = ()
    mask: np.ndarray | None = None  # (ny, nx) bool: True = correlate
    surface: str | None = None
    quantity: str = "grey"
    noise: Noise = field(default_factory=lambda: Noise(None))
    stages: tuple[Stage, ...] = ()
    options: Options = field(default_factory=Options)
    length_unit: str = "mm"  # "px" where no scale is known: then mm in every docstring reads px
    identity: str = ""  # hash of everything that decides the result
    notes: tuple[str, ...] = ()  # what was assumed on reading; shown by `check` and in the report
    extras: Mapping[str, object] = field(default_factory=dict)

    @property
    def n_frames(self) -> int:
        return len(self.times)

    @property
    def n_dim(self) -> int:
        return 3 if self.kind == "solid" else 2

    def material_of(self, element_set: str) -> Material:
        for material in self.materials:
            if material.element_set == element_set:
                return material
        raise InputError(f"no material for element set {element_set}")
