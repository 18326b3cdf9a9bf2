"""Blurred and binned images: a wider basin of attraction for a start that is several pixels off.

A coarse level is an experiment of its own: binned images, `binned_camera`, and a pixel map built with it. Its
displacements in px times the factor are those of the full image.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from idic.errors import InputError
from idic.images.camera import Camera


def blur(image: np.ndarray, std_px: float) -> np.ndarray:
    """Gaussian blur with mirrored edges, float32  # (ny, nx) -> (ny, nx)"""
    return ndimage.gaussian_filter(np.asarray(image, dtype=np.float32), std_px, mode="mirror")


def bin_pixels(image: np.ndarray, factor: int) -> np.ndarray:
    """Means of factor x factor pixels; what does not fill a bin is dropped  # -> (ny//factor, nx//factor)"""
    image = np.asarray(image)
    ny, nx = image.shape[0] // factor, image.shape[1] // factor
    if min(ny, nx) < 1:
        raise InputError("the image is smaller than one bin", expected=f">= {factor} px", found=str(image.shape))
    cut = image[: ny * factor, : nx * factor].astype(np.float32, copy=False)
    return cut.reshape(ny, factor, nx, factor).mean(axis=(1, 3))


def bin_mask(mask: np.ndarray, factor: int) -> np.ndarray:
    """Bins all of whose pixels are in the mask  # bool"""
    return bin_pixels(np.asarray(mask, dtype=np.float32), factor) == 1.0


def binned_camera(camera: Camera, factor: int) -> Camera:
    """The camera of binned images: pixel (0, 0) of the bin image is centred at ((factor - 1) / 2, (factor - 1) / 2)."""
    shift = (factor - 1) / 2.0
    return replace(
        camera, matrix=camera.matrix / factor, origin_px=(camera.origin_px - shift) / factor, k1=camera.k1 * factor**2,
        centre_px=(camera.centre_px - shift) / factor, shift_px=camera.shift_px / factor,
    )
