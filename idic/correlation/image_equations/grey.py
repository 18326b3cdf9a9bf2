"""Grey images: a frame against the reference image, gain and offset, and focus that is lost from frame to frame.

The blur of a frame is one unknown, its variance w (px²), with one more column next to gain and offset
(docs/method.md, equation 1.4):

    g_w = g + w/2 laplace(g),      column L = -laplace(f) / 2

It is alike all over the image and eliminated with gain and offset. The noise of the reference image is in f and in
every residual: their expected product is taken off the right-hand side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from idic.correlation.image_equations.comparison import NodalBasis
from idic.correlation.image_equations.frame import NodalEquations, nodal_equations
from idic.correlation.image_equations.reference import ReferenceImage
from idic.correlation.image_equations.residual import PixelResidual, ResidualMap, pixel_residual, residual_map
from idic.correlation.pixels.pixel_map import PixelMap
from idic.images import DEGREES, Spline, blur_column, lowpass_weights, prefilter
from idic.model import Experiment, Noise

MIN_CONTRAST_RATIO = 0.1  # of a frame to the reference: less is a closed shutter, or a specimen that left the view

_couplings: WeakKeyDictionary = WeakKeyDictionary()
_blurred: WeakKeyDictionary = WeakKeyDictionary()  # splines of reference images less the column of their blur


class GreyReference(NodalBasis, ReferenceImage):
    """The reference image of grey images, as the frames of an experiment are compared with it."""

    n_components = 2

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations:
        """Nodal equations of one frame, with the blur where its focus is unknown; motion : (n_nodes, 2) px."""
        spline = frame_spline(experiment, frame)
        return self._with_blur(experiment, spline,
                               nodal_equations(self, spline, motion, experiment.options.brightness))

    def compare_with_residual(self, experiment: Experiment, frame: int,
                              motion: np.ndarray) -> tuple[NodalEquations, PixelResidual]:
        """`compare`, and the residual of every pixel with the brightness in it, from one reading of the frame."""
        spline = frame_spline(experiment, frame)
        equations = self._with_blur(experiment, spline,
                                    nodal_equations(self, spline, motion, experiment.options.brightness))
        return equations, pixel_residual(self, spline, equations.motion)

    def _with_blur(self, experiment: Experiment, spline: Spline, equations: NodalEquations) -> NodalEquations:
        """With the blur of the frame as an unknown, where its focus is one."""
        if experiment.options.defocus == "none":
            return equations
        return with_blur(self, equations, spline, experiment.options.brightness, experiment.recording.noise)

    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        """Residual of every pixel; coefficients : (nb,) gains and offsets, then the blur."""
        blurred = experiment.options.defocus != "none" and len(coefficients) > 0
        brightness = coefficients[:-1] if blurred else coefficients
        residual = residual_map(self, frame_spline(experiment, frame), motion, experiment.options.brightness,
                                brightness)
        if not blurred:
            return residual
        blur = np.where(residual.valid, np.float32(coefficients[-1]) * self.blur_column, 0)
        return replace(residual, r=residual.r - blur)

    def shows_nothing(self, equations: NodalEquations) -> bool:
        """Whether the frame has hardly any contrast on the specimen."""
        return contrast_ratio(equations) < MIN_CONTRAST_RATIO

    def synthetic_image(self, r: np.ndarray) -> tuple[np.ndarray, GreyReference]:
        """An image with the residual r (n_pixels,) at rest  # (ny, nx) float32, and this reference"""
        return np.nan_to_num(self.pixel_map.to_image(self.f - r)).astype(np.float32), self

    def pattern_maps(self) -> Mapping[str, tuple[np.ndarray, ...]]:
        """The gradient, and the grey value above its mean  # (n_pixels,) each"""
        return {"motion": (self.fx, self.fy), "gain": (self.f - self.f.mean(),)}


def grey_reference(pixel_map: PixelMap, images: np.ndarray | Sequence[np.ndarray],
                   experiment: Experiment) -> GreyReference:
    """The reference image of these images (ny, nx), with interpolation, low-pass and noise of the experiment."""
    options = experiment.options
    reference = ReferenceImage.of(pixel_map, images, DEGREES[options.interpolation], options.patch_px,
                                  options.lowpass_px, options.border_px, experiment.recording.noise.std_gv,
                                  options.camera_blur_px)
    return GreyReference(**vars(reference))


def frame_spline(experiment: Experiment, frame: int) -> Spline:
    """The spline of one grey frame, with the experiment's low-pass and interpolation."""
    options = experiment.options
    return prefilter(experiment.recording.stack.frame(frame), DEGREES[options.interpolation], options.lowpass_px)


def contrast_ratio(equations: NodalEquations) -> float:
    """Standard deviation of g(x + u) over that of f on the specimen, from the sums of a frame.

    Free of the match between the two: a far start scrambles the pattern, a black frame has none.
    """
    still, moved = equations.squares or (0.0, 0.0)
    return float(np.sqrt(max(moved, 0.0) / still)) if still > 0.0 else 1.0


def blur_of_noise(lowpass_px: float, correlation: np.ndarray | None = None) -> float:
    """Expected product of low-passed noise and its own `blur_column`, per pixel and variance of one pixel.

    correlation : (2 L + 1, 2 L + 1) of pixels so many rows and columns apart, before the low-pass; None: independent
    """
    weights = np.array(lowpass_weights(lowpass_px))
    twice = np.correlate(weights, weights, "full")
    reach = 0 if correlation is None else len(correlation) // 2
    kernel = np.pad(np.outer(twice, twice), 4 + reach)
    column, middle = blur_column(kernel), len(kernel) // 2
    if correlation is None:
        return float(column[middle, middle])
    window = slice(middle - reach, middle + reach + 1)
    return float((np.asarray(correlation) * column[window, window]).sum())


def blur_bias(noise: Noise, reference: ReferenceImage) -> float:
    """Expected product of the noise in the reference image and the part of its blur's column that is noise, per pixel
    (GV²); 0 where the noise is not known."""
    if noise.std_gv is None:
        return 0.0
    correlated_noise = noise.correlated
    if correlated_noise is None:
        product = noise.std_gv**2 * blur_of_noise(reference.lowpass_px)
    else:
        product = correlated_noise.recorded_gv**2 * blur_of_noise(reference.lowpass_px,
                                                                  np.array(correlated_noise.correlation))
    return product / reference.n_images


def with_blur(reference: ReferenceImage, equations: NodalEquations, spline: Spline, brightness: str,
              noise: Noise) -> NodalEquations:
    """The equations of a frame with the column of its blur after those of its brightness."""
    column = reference.blur_column.astype(float)
    lost = equations.lost_pixels if equations.n_lost else None
    residual = pixel_residual(reference, spline, equations.motion, lost)
    still_q, still_rb = _coupling(reference, brightness) if lost is None else _sums_of_blur(reference, brightness, lost)
    q = np.einsum("nij,ni->nj", equations.motion.pull_back, still_q.reshape(-1, 2)).ravel()
    valid = residual.valid
    rhs = float(column[valid] @ residual.r[valid].astype(float)) - blur_bias(noise, reference) * int(valid.sum())
    n = equations.n_brightness
    bb = np.zeros((n + 1, n + 1))
    bb[:n, :n], bb[n, n] = equations.bb, float(column[valid] @ column[valid])
    bb[n, :n] = bb[:n, n] = still_rb
    hb = sparse.csr_array(sparse.hstack([equations.hb, sparse.csr_array(q[:, None])]))
    return replace(equations, hb=hb, bb=bb, rb=np.append(equations.rb, rhs))


def _coupling(reference: ReferenceImage, brightness: str) -> tuple[np.ndarray, np.ndarray]:
    """Sums of the blur's column over all pixels, computed once."""
    couplings = _couplings.setdefault(reference, {})
    if brightness not in couplings:
        couplings[brightness] = _sums_of_blur(reference, brightness)
    return couplings[brightness]


def _sums_of_blur(reference: ReferenceImage, brightness: str,
                  lost: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Sums of the blur's column against the gradient at the nodes and against the brightness columns, undeformed.

    lost : numbers of pixels that a frame does not show: what it shows must be summed in every product
    """
    pm, spline = reference.pixel_map, _blurred.get(reference)
    if spline is None:
        image = np.nan_to_num(pm.to_image(reference.f - reference.blur_column)).astype(np.float32)
        spline = _blurred[reference] = prefilter(image, reference.degree)
    still = nodal_equations(reference, spline, np.zeros((pm.n_nodes, 2)), brightness, lost)
    return still.q, still.rb
