"""One grey frame -> its residual pixel by pixel, and the brightness that is taken from it.

docs/method.md, equations 1.2, 1.3, 11.1 and 11.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation.image_equations.image_kernel import residual_pass
from idic.correlation.image_equations.image_motion import ImageMotion, image_motion
from idic.correlation.image_equations.reference import ReferenceImage
from idic.images import Spline, matched_gain, noise_gain, still_gain


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """Residual of every pixel of the map, brightness removed.

    r : (n_pixels,) float32 GV; 0 where not valid.  valid : (n_pixels,) bool.
    noise_gain : (n_pixels,) w^2 of the interpolator: the variance of r under pure noise is sigma^2 (1 + w^2);
    still_gain : with a low-pass, the variance of the reference's blurred noise / sigma^2 takes the place of the 1;
    n_images : averaged to the reference; matched_gain : (n_pixels,) still_gain where the blur of the reference is
    matched to that of the frame (`idic.images.matched_blur`), None where nowhere.
    """

    r: np.ndarray
    valid: np.ndarray
    noise_gain: np.ndarray
    still_gain: float = 1.0
    n_images: int = 1
    matched_gain: np.ndarray | None = None

    @property
    def reference_gain(self) -> np.ndarray | float:
        """Variance of the reference in r / sigma^2, of one image  # (n_pixels,), or one number for all"""
        return self.still_gain if self.matched_gain is None else self.matched_gain

    def chi2_dof(self, noise_std: float) -> float:
        """Mean over valid pixels of r^2 / [sigma^2 (still_gain / n_images + w^2)]: 1 for noise alone; nan: no pixel.

        docs/method.md, equations 11.1 and 11.2.
        """
        if not self.valid.any():
            return float("nan")
        variance = self.reference_gain / self.n_images + self.noise_gain
        return float(np.mean(self.r[self.valid].astype(float)**2 / variance[self.valid]) / noise_std**2)


@dataclass(frozen=True, eq=False)
class PixelResidual:
    """Residual of every pixel of the map, brightness in it.

    r : (n_pixels,) float32 GV, 0 where not valid; valid : (n_pixels,) bool; tx, ty : (n_pixels,) place between the
    pixels of the frame; weights : of the matched blur (`ReferenceImage.matching`).
    """

    r: np.ndarray
    valid: np.ndarray
    tx: np.ndarray
    ty: np.ndarray
    weights: np.ndarray


def pixel_residual(reference: ReferenceImage, spline: Spline, motion: ImageMotion,
                   exclude: np.ndarray | None = None) -> PixelResidual:
    """Residual pixel by pixel as it is; exclude : as for `nodal_equations`."""
    pm = reference.pixel_map
    valid = pm.valid_but(exclude)
    r, tx, ty = (np.empty(pm.n_pixels, dtype=np.float32) for _ in range(3))
    residual_pass(pm.start, pm.ix, pm.iy, pm.a, pm.b, reference.f, motion.blur_maps, motion.blur_weights, motion.u,
                  spline.coefficients.ravel(), spline.coefficients.shape[1], spline.degree,
                  np.int32(reference.border_px), valid, r, tx, ty)
    return PixelResidual(r, valid.astype(bool), tx, ty, motion.blur_weights)


def residual_map(reference: ReferenceImage, spline: Spline, u_px: np.ndarray | ImageMotion, brightness: str = "none",
                 coefficients: np.ndarray | None = None, exclude: np.ndarray | None = None) -> ResidualMap:
    """Residual pixel by pixel; brightness `coefficients` (nb,) of `NodalEquations.brightness_fit` are removed.

    u_px : as for `nodal_equations`, or the `motion` of the equations of this frame
    """
    pm = reference.pixel_map
    motion = u_px if isinstance(u_px, ImageMotion) else image_motion(reference, spline, u_px)
    residual = pixel_residual(reference, spline, motion, exclude)
    r, valid, weights = residual.r, residual.valid, residual.weights
    if coefficients is not None and len(coefficients):
        layout = reference.layout(brightness)
        patch = np.repeat(layout.patch, pm.pixels_per_element)
        gain, offset = np.asarray(coefficients, dtype=np.float32).reshape(-1, 2).T
        r += np.where(valid, gain[patch] * (reference.f - layout.mean[patch]) + offset[patch], np.float32(0))
    gain = np.repeat(matched_gain(weights, reference.lowpass_px), pm.pixels_per_element) if len(weights) else None
    noise = noise_gain(residual.tx, residual.ty, degree=spline.degree, lowpass_px=spline.lowpass_px)
    return ResidualMap(r, valid, noise, still_gain(reference.lowpass_px), reference.n_images, gain)
