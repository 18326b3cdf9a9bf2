"""One height image -> its equations at the nodes (quasi-3D digital image correlation; docs/method.md, section 9).

    r = f + h - g(x + u),      L = F^-T (grad f + grad h) . phi_xy - phi_h

``h`` is the simulated rise in the images' unit: the deformed profile is g(x + u) = f + h. Three unknowns per node
(column, row, height), dof = 3 node + component. The slope of the motion belongs in the convected gradient: the gradient
of g at the moved point is F^-T (grad f + grad h). Source: Neggers et al. 2015, equation 22 (u_z positive upwards).

The instrument may add an offset ("frame") or an offset and two tilts ("tilt") to every image: columns -1, -x, -y with
(x, y) from -1 to 1 across the specimen. They enter as rises of the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from idic.correlation.image_equations.comparison import NodalBasis
from idic.correlation.image_equations.frame import NodalEquations
from idic.correlation.image_equations.residual import ResidualMap
from idic.correlation.height.gaps import HeightFrame, height_frame
from idic.correlation.height.surface_blocks import convection, height_blocks, scatter
from idic.correlation.height.surface_pass import N_HEIGHT_SUMS, height_pass, height_residuals
from idic.correlation.pixels.blocks import Pattern, sparsity
from idic.correlation.pixels.cells import N_NODES, TRANSFORMS
from idic.correlation.pixels.pixel_map import PixelMap, at_nodes, inverse_gradients
from idic.errors import InputError
from idic.images import lowpass, noise_gain, still_gain
from idic.model import Experiment

LEVELLING = {"none": 0, "frame": 1, "tilt": 3}  # columns of the offset and tilt of the instrument


@dataclass(frozen=True, eq=False)
class HeightReference(NodalBasis):
    """The reference height image of a surface on the pixel map.

    Attributes
    ----------
    f, fx, fy : arrays (n_pixels,), float32
        Height above `level` (unit of the images) and its spline gradient (per px).
    level : float
        Mean height of the ROI; frames are counted from it too, so that single precision holds any offset.
    blocks : array (n_elements, n_pairs, 6)
        `height_blocks` of the whole image.
    tilts : array (n_nodes, 3)
        1, x, y at the nodes: offset and tilts of the instrument as rises.
    """

    pixel_map: PixelMap
    f: np.ndarray
    fx: np.ndarray
    fy: np.ndarray
    level: float
    degree: int
    blocks: np.ndarray
    pattern: Pattern
    tilts: np.ndarray
    lowpass_px: float = 0.0
    n_images: int = 1
    n_components = 3

    @property
    def contrast(self) -> float:
        """Standard deviation of f in the ROI: the roughness (rms)."""
        return float(np.std(self.f, dtype=np.float64))

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations:
        """Nodal equations of one frame under a nodal motion (n_nodes, 3)."""
        return height_equations(self, self._heights(experiment, frame), motion, experiment.options.brightness)

    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        """Residual of every pixel; coefficients : (nb,) offset and tilts of the instrument."""
        return height_residual_map(self, self._heights(experiment, frame), motion, experiment.options.brightness,
                                   coefficients)

    def synthetic_image(self, r: np.ndarray) -> tuple[np.ndarray, HeightReference]:
        """An image with the residual r (n_pixels,) at rest  # (ny, nx), and this reference without low-pass"""
        heights = self.pixel_map.to_image(self.f - r)
        return np.where(np.isnan(heights), 0.0, heights) + self.level, replace(self, lowpass_px=0.0)

    def _heights(self, experiment: Experiment, frame: int) -> HeightFrame:
        return height_frame(experiment.recording.stack.frame(frame), self.level, self.degree, self.lowpass_px)


@dataclass(frozen=True, eq=False)
class HeightMotion:
    """The motion of one frame, element by element; made once per frame.

    coefficients : (n_elements, 3, 8) of displacement (px) and rise; G : (n_elements, 3, 3) of docs/method.md, equation
    9.3; det : (n_elements,) det F
    """

    pixel_map: PixelMap
    coefficients: np.ndarray
    G: np.ndarray
    det: np.ndarray

    @cached_property
    def pull_back(self) -> np.ndarray:
        """G at the nodes  # (n_nodes, 3, 3)"""
        return at_nodes(self.pixel_map, self.G)


def build_height_reference(pixel_map: PixelMap, image: np.ndarray, degree: int = 5,
                           lowpass_px: float = 0.0) -> HeightReference:
    """Attach the reference height image; the pixel map must leave out its gaps (`idic.correlation.height.gaps`).

    Raises
    ------
    InputError
        Where the surface is perfectly flat.
    """
    at_pixels = np.asarray(image, dtype=np.float64)[pixel_map.iy, pixel_map.ix]
    level = float(at_pixels.mean())
    if np.ptp(at_pixels) == 0:
        raise InputError("the reference image is flat on the mesh", expected="a rough surface",
                         found=f"height {level:g} everywhere",
                         remedy="check the order of the images and the camera table")
    frame = height_frame(image, level, degree, lowpass_px)
    if lowpass_px > 0:
        filled = np.nan_to_num(np.asarray(image, dtype=np.float64) - level)
        at_pixels = lowpass(filled, lowpass_px)[pixel_map.iy, pixel_map.ix] + level
    fx, fy = frame.spline.gradient_at_pixels(pixel_map.ix, pixel_map.iy)
    middle = np.array([pixel_map.ix.mean(), pixel_map.iy.mean()])
    half = max(np.ptp(pixel_map.ix), np.ptp(pixel_map.iy), 1) / 2.0
    tilts = np.column_stack([np.ones(pixel_map.n_nodes), (pixel_map.nodes_px - middle) / half])
    return HeightReference(pixel_map, (at_pixels - level).astype(np.float32), fx, fy, level, degree,
                           height_blocks(pixel_map, fx, fy), sparsity(pixel_map, 3), tilts, lowpass_px)


def height_equations(reference: HeightReference, frame: HeightFrame, motion: np.ndarray, levelling: str = "none",
                 exclude: np.ndarray | None = None) -> NodalEquations:
    """Compare one height image with the reference under a nodal motion.

    Parameters
    ----------
    frame : HeightFrame
        `idic.correlation.height.gaps.height_frame` of the image with the level of the reference.
    motion : array (n_nodes, 3)
        Displacement in the image (px, px) and rise (unit of the images).
    levelling : "none" | "frame" | "tilt"
    exclude : array of pixel numbers, optional
        Pixels of the map to leave out.
    """
    pm, moved = reference.pixel_map, height_motion(reference, frame, motion)
    valid = pm.valid_but(exclude)
    sums, lost = np.empty((pm.n_elements, N_HEIGHT_SUMS)), np.empty(pm.n_elements, dtype=np.int64)
    c = frame.spline.coefficients
    height_pass(pm.start, pm.ix, pm.iy, pm.a, pm.b, reference.f, reference.fx, reference.fy, moved.coefficients,
                c.ravel(), c.shape[1], frame.spline.degree, frame.gap_windows.ravel(), valid, sums, lost)
    concerned = np.flatnonzero(lost)
    slot = np.full(pm.n_elements, -1, dtype=np.int64)
    slot[concerned] = np.arange(len(concerned))
    q, data = np.zeros(3 * pm.n_nodes), np.zeros(len(reference.pattern.indices))
    scatter(pm.conn, pm.kind, N_NODES, TRANSFORMS, moved.G, sums, slot, reference.blocks,
            height_blocks(pm, reference.fx, reference.fy, concerned, valid), reference.pattern.place,
            reference.pattern.stride, q, data)
    H = sparse.csr_array((data, reference.pattern.indices, reference.pattern.indptr), shape=(len(q), len(q)))
    rises = level_rises(reference, levelling)
    hb = H @ rises  # (3 n_nodes, nb)
    pixels = pm.pixels_per_element - lost
    n_lost, rr = int(lost.sum()), sums[:, -1]
    kappa = float((pixels / np.maximum(np.abs(moved.det), 1e-3)).sum() / max(pixels.sum(), 1))
    lost_pixels = np.flatnonzero(valid == 0) if n_lost else np.zeros(0, dtype=np.int64)
    return NodalEquations(q, H, sparse.csr_array(hb), rises.T @ hb, rises.T @ q, float(rr.sum()), pm.n_pixels - n_lost,
                      n_lost, lost, lost_pixels, rr.copy(), kappa, motion=moved)


def height_residual_map(reference: HeightReference, frame: HeightFrame, motion: np.ndarray, levelling: str = "none",
                        coefficients: np.ndarray | None = None, exclude: np.ndarray | None = None) -> ResidualMap:
    """Residual pixel by pixel in the unit of the images; offset and tilts `coefficients` (nb,) are removed."""
    pm = reference.pixel_map
    if coefficients is not None and len(coefficients):
        rise = reference.tilts[:, :LEVELLING[levelling]] @ coefficients
        motion = np.column_stack([motion[:, :2], motion[:, 2] + rise])
    valid = pm.valid_but(exclude)
    r, tx, ty = (np.empty(pm.n_pixels, dtype=np.float32) for _ in range(3))
    c = frame.spline.coefficients
    height_residuals(pm.start, pm.ix, pm.iy, pm.a, pm.b, reference.f, _coefficients(reference, frame, motion),
                     c.ravel(), c.shape[1], frame.spline.degree, frame.gap_windows.ravel(), valid, r, tx, ty)
    return ResidualMap(r, valid.astype(bool),
                       noise_gain(tx, ty, degree=frame.spline.degree, lowpass_px=frame.spline.lowpass_px),
                       still_gain(reference.lowpass_px))


def level_rises(reference: HeightReference, levelling: str) -> np.ndarray:
    """Offset and tilts of the instrument as nodal fields  # (3 n_nodes, nb)

    Raises
    ------
    InputError
        For an unknown kind.
    """
    if levelling not in LEVELLING:
        raise InputError("no such correction of height images", key="brightness", found=levelling,
                         expected=", ".join(LEVELLING), remedy="write one of these names")
    number = LEVELLING[levelling]
    rises = np.zeros((3 * reference.pixel_map.n_nodes, number))
    rises[2::3] = reference.tilts[:, :number]
    return rises


def height_motion(reference: HeightReference, frame: HeightFrame, motion: np.ndarray) -> HeightMotion:
    """The motion of one frame in the image; motion : (n_nodes, 3) as for `height_equations`."""
    pm, coefficients = reference.pixel_map, _coefficients(reference, frame, motion)
    inverse, det = inverse_gradients(pm, np.ascontiguousarray(coefficients[:, :2]))
    G = np.empty((pm.n_elements, 3, 3))
    convection(coefficients, pm.centre, pm.inverse_jacobian, inverse, G)
    return HeightMotion(pm, coefficients, G, det)


def _coefficients(reference: HeightReference, frame: HeightFrame, motion: np.ndarray) -> np.ndarray:
    """Coefficients of a nodal motion  # (n_nodes, 3) -> (n_elements, 3, 8)"""
    if frame.spline.shape != reference.pixel_map.shape:
        raise ValueError(f"frame of {frame.spline.shape} px, reference of {reference.pixel_map.shape} px")
    if np.shape(motion) != (reference.pixel_map.n_nodes, 3):
        raise ValueError(f"a nodal motion must be ({reference.pixel_map.n_nodes}, 3), got {np.shape(motion)}")
    if not np.isfinite(motion).all():
        raise ValueError("the nodal motion is not finite")
    return reference.pixel_map.element_coefficients(motion)
