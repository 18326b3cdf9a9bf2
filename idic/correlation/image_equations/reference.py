"""The reference image on the pixel map: grey value, gradient, element sums, brightness patches. Made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idic.correlation.pixels.blocks import (
    ElementBlocks, Pattern, block_pattern, element_blocks, element_nodes, sparsity,
)
from idic.correlation.pixels.pixel_map import PixelMap
from idic.errors import InputError
from idic.images import (
    PIXEL_BLUR_PX, blur_column, derivative_maps, fineness_of, gradient_noise_share, lowpass, matching_weights,
    mean_shift, prefilter, without_noise,
)

BRIGHTNESS = ("none", "frame", "patch")
# of noise to pattern (docs/method.md, equation 4.5): error bars 5 % too small, scatter 5 % too large
MAX_GRADIENT_NOISE = 0.1


@dataclass(frozen=True, eq=False)
class Brightness:
    """Gain and offset: one pair for every group ("patch") of elements (docs/method.md, equation 1.3).

    The columns of patch p are ``2 p`` (gain, L = -(f - mean of the patch)) and ``2 p + 1`` (offset, L = -1).

    Attributes
    ----------
    mode : "none" | "frame" | "patch"
    patch : array (n_elements,)
        Patch of each element of the pixel map.
    mean : array (n_patches,), float32
        Mean of f in the patch.
    pattern : Pattern
        Of the coupling with the nodes (2 n_nodes, 2 n_patches); ``place`` (n_elements, n_max).
    """

    mode: str
    patch: np.ndarray
    mean: np.ndarray
    pattern: Pattern

    @property
    def n_patches(self) -> int:
        return len(self.mean) if self.mode != "none" else 0

    @property
    def n_columns(self) -> int:
        return 2 * self.n_patches


@dataclass(frozen=True, eq=False)
class ReferenceImage:
    """A grey reference image on the pixels of the mesh.

    Attributes
    ----------
    f, fx, fy : arrays (n_pixels,), float32
        Grey value, and the spline gradient (GV/px) that the sums weigh by: of the image, or where noise is much of
        that, of the image without it (`idic.images.quality.gradient_noise`).
    level : float
        Mean grey value of the ROI; the blocks count f from it.
    degree : {3, 5}
    n_images : int
        Images averaged into the reference (its noise variance is 1/n_images of one image's).
    lowpass_px : float
        Blur of the reference; the frames must have the same.
    blur_column : array (n_pixels,)
        Minus half the Laplacian of the reference (GV/px²), see `idic.correlation.image_equations.grey`.
    border_px : int
        Pixels that come closer than this to a border of the image count as outside: splines mirror the image there.
    gradient_noise : float
        Mean square of the noise in the gradient of the image over that of the pattern; above
        `MAX_GRADIENT_NOISE`, (fx, fy) are without it. 0 where the noise is not known.
    camera_blur_px : float
        Standard deviation of the camera's own blur; with a low-pass, stretch changes both (`matching`).
    image_gv : array (ny, nx), float32, optional
        The low-passed reference less `level`; None without a low-pass.
    """

    pixel_map: PixelMap
    f: np.ndarray
    fx: np.ndarray
    fy: np.ndarray
    level: float
    degree: int
    n_images: int
    blocks: ElementBlocks
    pattern: Pattern
    layouts: tuple[Brightness, Brightness, Brightness]
    lowpass_px: float = 0.0
    blur_column: np.ndarray | None = None
    border_px: int = 0
    gradient_noise: float = 0.0
    camera_blur_px: float = PIXEL_BLUR_PX
    image_gv: np.ndarray | None = None

    def matching(self, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Maps (8, n_pixels) and their weights (n_elements, 8), float32, that give f the blur of a frame; or both
        empty.

        inverse : (n_elements, 2, 2) F^-1 in pixel coordinates. docs/method.md, equation 1.10; nothing without a
        low-pass.
        """
        if self.image_gv is not None:
            weights = matching_weights(inverse, self.lowpass_px, self.camera_blur_px).astype(np.float32)
            if weights.any():
                return self.derivatives, weights
        return np.empty((8, 0), dtype=np.float32), np.empty((0, 8), dtype=np.float32)

    def seen_motion(self, motion: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Where a low-passed frame shows the pattern of the reference, under this motion  # (n_elements, 2, 8) px

        inverse : (n_elements, 2, 2) its F^-1. docs/method.md, equation 1.12; without a low-pass the motion itself.
        """
        if self.image_gv is None:
            return motion
        pattern_motion = motion.copy()
        pattern_motion[:, :, 0] += mean_shift(self.pixel_map.element_curvature(motion, inverse), self.fineness,
                                              self.lowpass_px, self.camera_blur_px)
        return pattern_motion

    @cached_property
    def fineness(self) -> float:
        """Of the low-passed pattern on the mesh, px^-2 (`idic.images.matched_blur.fineness_of`)."""
        if self.image_gv is None:
            return 0.0
        return fineness_of(self.image_gv, self.pixel_map.ix, self.pixel_map.iy)

    @cached_property
    def derivatives(self) -> np.ndarray:
        """Second and fourth derivatives of the reference, made where a frame first needs them  # (8, n_pixels)"""
        return derivative_maps(self.image_gv, self.pixel_map.ix, self.pixel_map.iy)

    def layout(self, brightness: str) -> Brightness:
        if brightness not in BRIGHTNESS:
            raise InputError("no such brightness correction", key="brightness", found=brightness,
                             expected=", ".join(BRIGHTNESS), remedy="write one of these names")
        return self.layouts[BRIGHTNESS.index(brightness)]

    @property
    def contrast(self) -> float:
        """Standard deviation of f in the ROI."""
        return float(np.std(self.f, dtype=np.float64))

    @classmethod
    def of(cls, pixel_map: PixelMap, images: np.ndarray | Sequence[np.ndarray], degree: int = 3,
           patch_px: float = 100.0, lowpass_px: float = 0.0, border_px: int = 0,
           noise_std: float | None = None, camera_blur_px: float = PIXEL_BLUR_PX) -> ReferenceImage:
        """Attach the reference image to the pixel map.

        Parameters
        ----------
        images : array (ny, nx) or sequence of such
            One reference image, or several of the unmoved specimen: their mean is the reference.
        degree : {3, 5}
            Spline degree of the gradient (and the one to use for the frames).
        patch_px : float
            Size of a brightness patch; below 90 px it costs information.
        lowpass_px : float
            Standard deviation of a Gaussian against aliasing (`idic.images.gaussian_lowpass`); 0: none.
        border_px : int
            Along the borders of the image, left out of every frame; to be left out of the pixel map as well.
        noise_std : float, optional
            Of one image (GV). Where it is much of the gradient, the gradient is taken without it.
        camera_blur_px : float
            Standard deviation of the camera's own blur (px): the area of a pixel, and of the lens what is known.

        Raises
        ------
        InputError
            Where the images have another size than the pixel map, or show no contrast in the ROI.
        """
        images = [images] if isinstance(images, np.ndarray) and images.ndim == 2 else list(images)
        for image in images:
            if np.shape(image) != pixel_map.shape:
                raise InputError("the reference image differs in size from the images the mesh was placed on",
                                 expected=str(pixel_map.shape), found=str(np.shape(image)),
                                 remedy="take the reference from the same recording as the other images")
        image = lowpass(np.mean([np.asarray(image, dtype=np.float64) for image in images], axis=0), lowpass_px)
        at_pixels = image[pixel_map.iy, pixel_map.ix]
        level = float(at_pixels.mean())
        if np.ptp(at_pixels) == 0:
            raise InputError("the reference image shows no contrast on the mesh", expected="a speckle pattern",
                             found=f"grey value {level:g} everywhere",
                             remedy="check the order of the images and the camera table")
        fx, fy, share = _gradient(pixel_map, image - level, degree, lowpass_px,
                                  (noise_std or 0.0) / np.sqrt(len(images)))
        blocks = element_blocks(pixel_map, (at_pixels - level).astype(np.float32), fx, fy)
        layouts = (
            _layout("none", np.zeros(pixel_map.n_elements, dtype=np.int64), pixel_map, blocks, level),
            _layout("frame", np.zeros(pixel_map.n_elements, dtype=np.int64), pixel_map, blocks, level),
            _layout("patch", group_elements(pixel_map, patch_px), pixel_map, blocks, level),
        )
        return cls(pixel_map, at_pixels.astype(np.float32), fx, fy, level, degree, len(images), blocks,
                   sparsity(pixel_map), layouts, lowpass_px,
                   blur_column(image)[pixel_map.iy, pixel_map.ix].astype(np.float32), border_px, share,
                   camera_blur_px, (image - level).astype(np.float32) if lowpass_px > 0 else None)



def _gradient(pixel_map: PixelMap, image: np.ndarray, degree: int, lowpass_px: float,
              noise_std: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Gradient at the pixels, without its noise where that is large, and the ratio of noise to pattern."""
    def gradient(image):
        return prefilter(image.astype(np.float32), degree).gradient_at_pixels(pixel_map.ix, pixel_map.iy)

    fx, fy = gradient(image)
    share = gradient_noise_share(fx, fy, noise_std, degree, lowpass_px) if noise_std else 0.0
    if share <= MAX_GRADIENT_NOISE:
        return fx, fy, share
    roi = np.zeros(image.shape, dtype=bool)
    roi[pixel_map.iy, pixel_map.ix] = True
    pattern, noise_std = without_noise(image, roi, noise_std, lowpass_px)
    share = gradient_noise_share(fx, fy, noise_std, degree, lowpass_px)
    return (*gradient(pattern), share) if MAX_GRADIENT_NOISE < share < np.inf else (fx, fy, share)


def group_elements(pixel_map: PixelMap, patch_px: float) -> np.ndarray:
    """Group the elements into patches of about `patch_px` squared by where their pixels are  # (n_elements,)

    Cells of a regular grid; one with fewer than a quarter of the pixels of a full patch joins its nearest neighbour.
    """
    counts = pixel_map.pixels_per_element
    positions = (pixel_map.ix.astype(float), pixel_map.iy.astype(float))
    centre = np.column_stack([np.add.reduceat(x, pixel_map.start[:-1]) for x in positions])
    centre /= counts[:, None]
    low = np.array([pixel_map.ix.min(), pixel_map.iy.min()])
    extent = np.array([pixel_map.ix.max(), pixel_map.iy.max()]) + 1 - low
    n = np.maximum(1, np.rint(extent / patch_px)).astype(int)
    cell = np.minimum((centre - low) / extent * n, n - 1).astype(int)
    used, patch = np.unique(cell[:, 1] * n[0] + cell[:, 0], return_inverse=True)
    size = np.bincount(patch, counts)
    middle = np.column_stack([np.bincount(patch, counts * centre[:, k]) / size for k in range(2)])
    large = np.flatnonzero(size >= 0.25 * patch_px**2)
    if len(large) == 0:
        return np.zeros(pixel_map.n_elements, dtype=np.int64)
    nearest = large[np.argmin(((middle[:, None] - middle[large]) ** 2).sum(axis=2), axis=1)]
    target = np.where(size >= 0.25 * patch_px**2, np.arange(len(used)), nearest)
    return np.unique(target[patch], return_inverse=True)[1]


def _layout(mode, patch, pixel_map, blocks, level):
    n_patches = int(patch.max()) + 1
    mean = level + np.bincount(patch, blocks.grey[:, 1]) / np.bincount(patch, blocks.grey[:, 0])
    conn, used = element_nodes(pixel_map)
    pattern = block_pattern(conn, np.broadcast_to(patch[:, None], conn.shape), used, pixel_map.n_nodes, n_patches)
    return Brightness(mode, patch.astype(np.int64), mean.astype(np.float32), pattern)
