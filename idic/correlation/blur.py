"""Focus that is lost from frame to frame: one unknown per frame, the variance w (px²) of a blur.

    g_w = g + w/2 laplace(g),      column L = -laplace(f) / 2

It is one more column beside gain and offset, alike all over the image, and eliminated with them. The noise of the
reference image is in f and in every residual: their expected product is taken off the right-hand side.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse

from idic.correlation.frame import FrameShare, frame_share, residual_map
from idic.correlation.reference import ReferenceImage
from idic.images.interpolate import Spline, prefilter
from idic.images.quality.lowpass import blur_column, lowpass_weights

_couplings: WeakKeyDictionary = WeakKeyDictionary()


def blur_of_noise(lowpass_px: float) -> float:
    """Expected product of low-passed noise and its own `blur_column`, per pixel and variance of one pixel."""
    weights = np.array(lowpass_weights(lowpass_px))
    kernel = np.pad(np.outer(weights, weights), 4)
    return float((kernel * blur_column(kernel)).sum())


def with_blur(reference: ReferenceImage, share: FrameShare, spline: Spline, u_px: np.ndarray, brightness: str,
              pull_back: np.ndarray, noise_std: float | None) -> FrameShare:
    """The share of a frame with the column of its blur after those of its brightness.

    Parameters
    ----------
    pull_back : (n_nodes, 2, 2) F^-1 at the nodes
    noise_std : of one image (GV), None where it is not known yet
    """
    column = reference.blur_column.astype(float)
    found = residual_map(reference, spline, u_px, exclude=share.lost_pixels if share.n_lost else None)
    still_q, still_rb = _coupling(reference, brightness)
    q = np.einsum("nij,ni->nj", pull_back, still_q.reshape(-1, 2)).ravel()
    seen = found.valid
    rhs = float(column[seen] @ found.r[seen].astype(float))
    if noise_std is not None:
        rhs -= noise_std**2 / reference.n_images * blur_of_noise(reference.lowpass_px) * int(seen.sum())
    n = share.n_brightness
    bb = np.zeros((n + 1, n + 1))
    bb[:n, :n], bb[n, n] = share.bb, float(column[seen] @ column[seen])
    bb[n, :n] = bb[:n, n] = still_rb
    hb = sparse.csr_array(sparse.hstack([share.hb, sparse.csr_array(q[:, None])]))
    return replace(share, hb=hb, bb=bb, rb=np.append(share.rb, rhs))


def _coupling(reference: ReferenceImage, brightness: str) -> tuple[np.ndarray, np.ndarray]:
    """Sums of the column against the gradient at the nodes and against the brightness columns, undeformed."""
    known = _couplings.setdefault(reference, {})
    if brightness not in known:
        pm = reference.pixel_map
        image = np.nan_to_num(pm.to_image(reference.f - reference.blur_column)).astype(np.float32)
        share = frame_share(reference, prefilter(image, reference.degree), np.zeros((pm.n_nodes, 2)), brightness)
        known[brightness] = share.q, share.rb
    return known[brightness]
