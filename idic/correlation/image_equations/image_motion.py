"""The motion of one frame in the image: coefficients, F^-1 and det F of every element, and the blur that they bring.

docs/method.md, equations 1.10, 1.12, 3.6 and 4.1. One record per frame: the image pass, the nodal sums, the residual of
the pixels and the noise of the reference read it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idic.correlation.image_equations.reference import ReferenceImage
from idic.correlation.pixels.pixel_map import PixelMap, at_nodes, inverse_gradients
from idic.images import Spline


@dataclass(frozen=True, eq=False)
class ImageMotion:
    """The motion of one frame in the image, element by element; made once per frame.

    Attributes
    ----------
    pixel_map : PixelMap
        Of the reference.
    u : array (n_elements, 2, 8), px
        Monomial coefficients of the displacement, with the shift of a low-passed pattern.
    inverse : array (n_elements, 2, 2), det : array (n_elements,)
        F^-1 and det F, F the deformation gradient in pixel coordinates.
    blur_maps : array (8, n_pixels), blur_weights : array (n_elements, 8)
        Derivatives of f and their weights that give it the blur of the frame; both empty without a low-pass.
    """

    pixel_map: PixelMap
    u: np.ndarray
    inverse: np.ndarray
    det: np.ndarray
    blur_maps: np.ndarray
    blur_weights: np.ndarray

    @cached_property
    def gradient(self) -> np.ndarray:
        """F of every element  # (n_elements, 2, 2)"""
        return self.pixel_map.element_gradients(self.u)

    @cached_property
    def pull_back(self) -> np.ndarray:
        """F^-1 at the nodes, the mean over the elements around each  # (n_nodes, 2, 2)"""
        return at_nodes(self.pixel_map, np.linalg.inv(self.gradient))


def image_motion(reference: ReferenceImage, spline: Spline, u_px: np.ndarray) -> ImageMotion:
    """The motion of one frame in the image; u_px : as for `nodal_equations`."""
    pm = reference.pixel_map
    u = u_px if np.ndim(u_px) == 3 else _nodal_motion(reference, spline, u_px)  # (n_elements, 2, 8)
    inverse, det = inverse_gradients(pm, u)
    return ImageMotion(pm, reference.seen_motion(u, inverse), inverse, det, *reference.matching(inverse))


def _nodal_motion(reference: ReferenceImage, spline: Spline, u_px: np.ndarray) -> np.ndarray:
    """Coefficients of a nodal displacement  # (n_nodes, 2) px -> (n_elements, 2, 8) px"""
    pm = reference.pixel_map
    if spline.shape != pm.shape:
        raise ValueError(f"frame of {spline.shape} px, reference of {pm.shape} px")
    if np.shape(u_px) != (pm.n_nodes, 2):  # the kernels read two components, whatever is there
        raise ValueError(f"a nodal displacement must be ({pm.n_nodes}, 2), got {np.shape(u_px)}")
    if not np.isfinite(u_px).all():
        raise ValueError("the nodal displacement is not finite")
    return pm.element_coefficients(u_px)
