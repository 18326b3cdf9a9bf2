"""What was measured: images or measured fields of a test, their noise, the frames that count.

Grey values and pixels; mm, s, MPa and N elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from idic.images import AnyCamera, Stabiliser, Stack, VolumeStack, picture, picture_shape


ReadMask = Callable[[slice, slice, slice], np.ndarray]  # a block of a mask: slices, rows, columns
VoxelMasks = Callable[[VolumeStack, Sequence[int]], ReadMask]
CAMERA_TIME = "time_offset"  # last word of the degree of freedom of a camera


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

    @property
    def time_offset(self) -> str:
        """The name of the degree of freedom: how much later it takes its images than the main camera."""
        return f"{self.name}.{CAMERA_TIME}"


@dataclass(frozen=True)
class Recording:
    """What the main camera saw, or another system measured; `FurtherCamera` holds what further cameras saw.

    No parameter changes it. Frames are numbered as the times of the model.
    """

    stack: Stack | None
    labels: tuple[str, ...]  # one per frame: file names
    excluded: tuple[int, ...] = ()
    mask: np.ndarray | None = None  # (ny, nx) bool: True = correlate
    voxel_mask: VoxelMasks | None = None  # of volumes, by their stack and the scans of the reference
    # grey | height (topography: pixel values are heights) | displacement (measured fields) | volume (scans of a solid)
    quantity: str = "grey"
    height_unit: float = 1.0  # mm per unit of pixel value of a height image
    noise: Noise = field(default_factory=lambda: Noise(None))
    camera_name: str = "camera"  # of the main camera, by which frames are named
    averaged: tuple[int,
                    ...] = ()  # frames at rest whose mean is the reference image, the reference the last; () = that
    points: FieldPoints | None = None  # of a measured field: then a frame of the stack is (n_points, 2), in µm
    still_frames: tuple[int, ...] = ()  # that were declared to be taken at rest
    still_stack: Stack | None = None  # separate images at rest, of the main camera
    still_labels: tuple[str, ...] = ()  # their file names
    is_log_interpolated: bool = False  # the log has rows at times of its own
    column_units: Mapping[str, str | None] = field(default_factory=dict)  # of the columns of the log, None: not stated
    stated_order: str = ""  # of the images, by the user; "": by their names, to be confirmed
    identity: str = ""  # hash of everything that decides the result
    main_labels: tuple[str, ...] = ()  # of the view of a further camera: the labels of the main one

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The frames as experiment.toml names them: by the images of the main camera."""
        return self.main_labels or self.labels

    @property
    def volumes(self) -> VolumeStack:
        """The scans, where `quantity` is "volume"."""
        return cast(VolumeStack, self.stack)

    @property
    def image_shape(self) -> tuple[int, int]:
        """(ny, nx) of the images, of the grid of a measured field, or of the picture of three sections of a volume."""
        if self.quantity == "volume":
            return picture_shape(self.volumes.shape)
        return self.stack.shape if self.points is None else self.points.shape

    @property
    def n_references(self) -> int:
        """How many images are averaged to the reference image."""
        return max(len(self.averaged), 1)

    @property
    def value_unit(self) -> str:
        """What a pixel's value is in: "grey values", or the unit of the heights."""
        if self.quantity in ("grey", "volume"):
            return "grey values"
        if self.quantity == "displacement":
            return "µm"
        return {1e3: "m", 1.0: "mm", 1e-3: "µm", 1e-6: "nm"}.get(self.height_unit, f"{self.height_unit:g} mm")

    def in_words(self) -> str:
        """The frames in words: ``4 images of 80 x 60 px``, ``4 stages of 300 points``."""
        n_frames = len(self.labels)
        if self.points is not None:
            return f"{n_frames} stages of {len(self.points.positions_px)} points"
        if self.quantity == "volume":
            nz, ny, nx = self.volumes.shape
            return f"{n_frames} volumes of {nx} x {ny} x {nz} voxels"
        rows, columns = (0, 0) if self.stack is None else self.image_shape
        return f"{n_frames} images of {columns} x {rows} px"

    def picture(self, frame: int) -> np.ndarray:
        """A frame to look at: its image, or of a measured field without images the points that it holds, bright on
        black; of a volume three sections through its middle  # (ny, nx)"""
        if self.quantity == "volume":
            scans = self.volumes
            nz, ny, nx = scans.shape
            return picture(lambda *at: scans.block(frame, *at), scans.shape, (nx // 2, ny // 2, nz // 2))
        images = getattr(self.stack, "images", None)  # in which the motion was measured
        values = np.asarray((images or self.stack).frame(frame))
        if self.points is None or images is not None:
            return values
        measured_px = self.points.positions_px[np.isfinite(values).all(axis=1)]
        column, row = np.rint(measured_px).astype(int).T
        image = np.zeros(self.points.shape, dtype=np.uint8)
        image[row, column] = 200
        return image
