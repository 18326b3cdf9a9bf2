"""One grey frame -> its equations at the nodes: M and b for any nodal displacement.

    r = f - g(x + u),      L = (F^-T grad f) . phi,      brightness columns L = (-f_centred, -1) per patch

docs/method.md, equations 1.2, 1.3, 3.2, 3.3 and 4.3. `tests/correlation/pixel_equations.py` is the same pixel by pixel.
F is the deformation gradient of each element in pixel coordinates. The convected gradient F^-T grad f is right at
finite strain and holds no noise of the frame. Brightness is not eliminated here: `system.eliminate` eliminates it
together with all other unknowns of the frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from scipy import sparse

from idic.correlation.image_equations.image_kernel import N_SUMS, image_pass
from idic.correlation.image_equations.image_motion import ImageMotion, image_motion
from idic.correlation.image_equations.reference import Brightness, ReferenceImage
from idic.correlation.pixels.blocks import element_blocks
from idic.correlation.pixels.cells import N_NODES, TRANSFORMS
from idic.images import Spline


@dataclass(frozen=True, eq=False)
class BrightnessFit:
    """Least-squares brightness ``g(x + u) = f + coefficients[2p] f_centred + coefficients[2p+1]``; rr: r^2 left."""

    coefficients: np.ndarray  # (nb,)
    rr: float


@dataclass(frozen=True, eq=False)
class NodalEquations:
    """The normal equations of one frame for a free nodal displacement and brightness; dof = 2 node + component.

    Attributes
    ----------
    q : array (2 n_nodes,)
        sum of (N^T F^-T grad f) r.
    H : csr_array (2 n_nodes, 2 n_nodes)
        sum of (N^T F^-T grad f)(N^T F^-T grad f)^T.
    hb : csr_array (2 n_nodes, nb), bb : array (nb, nb), rb : array (nb,)
        Coupling with the brightness columns, their own block, their right-hand side; nb = 0 without brightness.
    rr : float
        sum of r^2.
    n_valid, n_lost : int
        Pixels in the sums; pixels that left the image (or were excluded): they are in none of the sums.
    lost : array (n_elements,)
        Lost pixels per element of the pixel map.
    lost_pixels : array (n_lost,)
        Which: pass as `exclude` to freeze the mask, e.g. within a line search.
    element_rr : array (n_elements,)
        sum of r^2 per element.
    kappa : float
        Mean of 1/det F over the valid pixels: deformed-image noise per reference pixel in the sandwich covariance.
    squares : tuple of float, optional
        Sums of squares of f and of g(x + u) about their means, patch by patch (GV²), of grey images, whatever of their
        light is unknown.
    motion : ImageMotion, or HeightMotion, SectionMotion of heights; optional
        The motion that the frame was compared under; None of points, which are material.
    matrix : callable, optional
        Makes H anew, of volumes: there it is larger than all else of a frame.
    """

    q: np.ndarray
    H: sparse.csr_array
    hb: sparse.csr_array
    bb: np.ndarray
    rb: np.ndarray
    rr: float
    n_valid: int
    n_lost: int
    lost: np.ndarray
    lost_pixels: np.ndarray
    element_rr: np.ndarray
    kappa: float
    squares: tuple[float, float] | None = field(default=None, kw_only=True)
    motion: Any = field(default=None, kw_only=True)
    matrix: Callable[[], sparse.csr_array] | None = field(default=None, kw_only=True)

    @property
    def n_brightness(self) -> int:
        return len(self.rb)

    def gram(self, columns: np.ndarray, alike: int = 0) -> FrameGram:
        """M and b of nodal fields (docs/method.md, equations 3.4 and 3.5)  # columns (2 n_nodes, m) px per unit

        alike : how many of the last columns most frames share; H differs in every frame, so that nothing is gained
        """
        columns = np.ascontiguousarray(columns, dtype=np.float64)
        h_columns = self.H @ columns  # (2n, m)
        m, nb = columns.shape[1], self.n_brightness
        matrix = np.empty((m + nb, m + nb))
        matrix[:m, :m] = columns.T @ h_columns
        matrix[:m, m:] = (self.hb.T @ columns).T if nb else 0.0
        matrix[m:, :m] = matrix[:m, m:].T
        matrix[m:, m:] = self.bb
        return FrameGram(matrix, np.concatenate([columns.T @ self.q, self.rb]), m, h_columns)

    def brightness_fit(self) -> BrightnessFit:
        """Gain and offset of a frame where nothing else is unknown; a patch without a pixel keeps 0."""
        if self.n_brightness == 0:
            return BrightnessFit(np.zeros(0), self.rr)
        coefficients = np.linalg.pinv(self.bb, hermitian=True) @ self.rb
        return BrightnessFit(coefficients, float(self.rr - coefficients @ self.rb))


@dataclass(frozen=True, eq=False)
class FrameGram:
    """Normal equations of one frame for m given fields and brightness: ``matrix @ (fields, brightness) = rhs``.

    matrix (m + nb, m + nb); rhs (m + nb,); n_columns = m; h_columns = H @ columns (2 n_nodes, m),
    None of measured fields.
    """

    matrix: np.ndarray
    rhs: np.ndarray
    n_columns: int
    h_columns: np.ndarray | None


def nodal_equations(reference: ReferenceImage, spline: Spline, u_px: np.ndarray, brightness: str = "frame",
                    exclude: np.ndarray | None = None) -> NodalEquations:
    """Compare one frame with the reference under a nodal displacement.

    Parameters
    ----------
    spline : Spline
        Of the frame (`idic.images.interpolate.prefilter`).
    u_px : array (n_nodes, 2)
        Displacement of the nodes in the image: camera(X + u) - camera(X). Or monomial coefficients (n_elements, 2, 8)
        of the way to another image, which may have another size.
    brightness : "none" | "frame" | "patch"
    exclude : array of pixel numbers, optional
        Pixels of the map to leave out, e.g. `lost_pixels` of an earlier call.
    """
    pm, layout = reference.pixel_map, reference.layout(brightness)
    valid = pm.valid_but(exclude)
    motion = image_motion(reference, spline, u_px)  # u(x), F^-1
    sums, lost = _element_sums(reference, layout, spline, motion, valid)  # r = f - g(x + u), valid without lost pixels
    blocks = _blocks_of_valid(reference, lost, valid)  # grad f grad f^T of the elements
    q, H, hb = _nodal_sums(reference, layout, motion, sums, blocks)  # L = N^T F^-T grad f:  q = sum L r, H = sum L L^T
    bb, rb = brightness_blocks(layout, blocks.grey, _centre(reference, layout), sums[:, 17], sums[:, 18])
    rr, nb, n_lost = float(sums[:, 16].sum()), layout.n_columns, int(lost.sum())
    return NodalEquations(
        q, H, hb, bb[:nb, :nb], rb[:nb], rr, pm.n_pixels - n_lost, n_lost, lost,
        lost_pixels=np.flatnonzero(valid == 0) if n_lost else np.zeros(0, dtype=np.int64),
        element_rr=sums[:, 16].copy(),
        kappa=float((blocks.grey[:, 0] / np.maximum(np.abs(motion.det), 1e-3)).sum() / max(pm.n_pixels - n_lost, 1)),
        squares=squares_about_mean(bb, rb, rr), motion=motion)


def _element_sums(reference: ReferenceImage, layout: Brightness, spline: Spline, motion: ImageMotion,
                  valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The residual of every pixel, summed over the pixels of each element, and their lost pixels.

    valid : (n_pixels,) uint8, 0 where a pixel takes no part; pixels that leave the frame become 0

    # (n_elements, `N_SUMS`), (n_elements,)
    """
    pm = reference.pixel_map
    sums, lost = np.empty((pm.n_elements, N_SUMS)), np.empty(pm.n_elements, dtype=np.int64)
    image_pass(pm.start, pm.ix, pm.iy, pm.a, pm.b, reference.f, reference.fx, reference.fy, motion.blur_maps,
               motion.blur_weights, layout.mean[layout.patch], motion.u, spline.coefficients.ravel(),
               spline.coefficients.shape[1], spline.degree, np.int32(reference.border_px), valid, sums, lost)
    return sums, lost


def _nodal_sums(reference: ReferenceImage, layout: Brightness, motion: ImageMotion, sums: np.ndarray,
                blocks: ValidBlocks) -> tuple[np.ndarray, sparse.csr_array, sparse.csr_array]:
    """q, H and hb of `NodalEquations` from the sums of the elements."""
    pm = reference.pixel_map
    n_dof = 2 * pm.n_nodes
    q, data = np.zeros(n_dof), np.zeros(len(reference.pattern.indices))
    coupling = np.zeros(len(layout.pattern.indices))
    _scatter(pm.conn, pm.kind, N_NODES, TRANSFORMS, motion.inverse, sums, blocks.slot, reference.blocks.hessian,
             blocks.hessian, reference.blocks.coupling, blocks.coupling, _centre(reference, layout),
             reference.pattern.place, reference.pattern.stride, layout.pattern.place, layout.pattern.stride,
             q, data, coupling)
    H = sparse.csr_array((data, reference.pattern.indices, reference.pattern.indptr), shape=(n_dof, n_dof))
    if not layout.n_columns:
        return q, H, sparse.csr_array((n_dof, 0))
    return q, H, sparse.csr_array((coupling, layout.pattern.indices, layout.pattern.indptr),
                                  shape=(n_dof, layout.n_columns))


def _centre(reference, layout):
    """What f is centred on in each element, counted from the level of the reference  # (n_elements,)"""
    return layout.mean.astype(float)[layout.patch] - reference.level


@dataclass(frozen=True, eq=False)
class ValidBlocks:
    """Sums of f and its gradient over the valid pixels of the elements.

    slot : (n_elements,) place of an element that lost pixels in `hessian` and `coupling`; -1: the block of the
    reference holds.  hessian, coupling : of the elements that lost pixels.  grey : (n_elements, 3) of all.
    """

    slot: np.ndarray
    hessian: np.ndarray
    coupling: np.ndarray
    grey: np.ndarray


def _blocks_of_valid(reference: ReferenceImage, lost: np.ndarray, valid: np.ndarray) -> ValidBlocks:
    """Blocks of the elements that lost pixels, from the other pixels."""
    concerned = np.flatnonzero(lost)
    slot = np.full(len(lost), -1, dtype=np.int64)
    slot[concerned] = np.arange(len(concerned))
    relative = reference.f - np.float32(reference.level) if len(concerned) else reference.f
    blocks = element_blocks(reference.pixel_map, relative, reference.fx, reference.fy, concerned, valid)
    grey = reference.blocks.grey.copy()
    grey[concerned] = blocks.grey
    return ValidBlocks(slot, blocks.hessian, blocks.coupling, grey)


def brightness_blocks(layout: Brightness, grey: np.ndarray, centre: np.ndarray, r_sum: np.ndarray,
                      rf_sum: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Block and right-hand side of gain and offset of every patch  # (2 n_patches, 2 n_patches), (2 n_patches,)

    grey : (n_elements, 3) pixels, sum of f, sum of f^2; centre : (n_elements,) that f is centred on; r_sum, rf_sum :
    (n_elements,) sums of r and r f_centred
    """
    number, first, second = grey.T
    per_element = np.column_stack([
        second - 2.0 * centre * first + centre**2 * number, first - centre * number, number, -rf_sum, -r_sum,
    ])  # (n_elements, 5): f f, f 1, 1 1 with f centred; gain and offset right-hand sides
    total = np.column_stack([np.bincount(layout.patch, column) for column in per_element.T])  # (n_patches, 5)
    size = 2 * len(total)
    bb, rb = np.zeros((size, size)), np.empty(size)
    gain, offset = np.arange(0, size, 2), np.arange(1, size, 2)
    bb[gain, gain], bb[offset, offset] = total[:, 0], total[:, 2]
    bb[gain, offset] = bb[offset, gain] = total[:, 1]
    rb[gain], rb[offset] = total[:, 3], total[:, 4]
    return bb, rb


def squares_about_mean(bb: np.ndarray, rb: np.ndarray, rr: float) -> tuple[float, float]:
    """Sums of squares of f and of g(x + u) = f - r about their means, patch by patch (GV²)."""
    gain, offset = slice(0, None, 2), slice(1, None, 2)
    patches = np.diagonal(bb)[offset] > 0
    numbers, sums = np.diagonal(bb)[offset][patches], np.diagonal(bb[gain, offset])[patches]  # of f centred
    squares = np.diagonal(bb)[gain][patches].sum()
    still = squares - (sums**2 / numbers).sum()
    moved = squares + 2.0 * rb[gain].sum() + rr - ((sums + rb[offset][patches]) ** 2 / numbers).sum()
    return float(still), float(moved)


@njit(cache=True, nogil=True)
def _scatter(conn, kind, n_nodes, transforms, inverse, sums, slot, hessian, hessian_lost, coupling, coupling_lost,
             centre, place, stride, place_b, stride_b, q, data, data_b):
    """Element sums -> nodes, with the convected gradient: d_new[c] = sum_k inverse[k, c] d[k] (F^-T d)."""
    for e in range(conn.shape[0]):
        n = n_nodes[kind[e]]
        t = transforms[kind[e]]
        xx, xy, yx, yy = inverse[e, 0, 0], inverse[e, 0, 1], inverse[e, 1, 0], inverse[e, 1, 1]
        blocks = hessian[e] if slot[e] < 0 else hessian_lost[slot[e]]
        pairs = coupling[e] if slot[e] < 0 else coupling_lost[slot[e]]
        for i in range(n):
            node = conn[e, i]
            x, y = 0.0, 0.0
            for k in range(n):
                x += t[k, i] * sums[e, k]
                y += t[k, i] * sums[e, 8 + k]
            q[2 * node] += xx * x + yx * y
            q[2 * node + 1] += xy * x + yy * y
            for m in range(2):  # columns -f_centred, -1
                x = pairs[i, 0, m] - (centre[e] * pairs[i, 0, 1] if m == 0 else 0.0)
                y = pairs[i, 1, m] - (centre[e] * pairs[i, 1, 1] if m == 0 else 0.0)
                data_b[place_b[e, i] + m] -= xx * x + yx * y
                data_b[place_b[e, i] + stride_b[node] + m] -= xy * x + yy * y
            for j in range(i + 1):
                a, b, d = blocks[i * (i + 1) // 2 + j]
                ax, bx, ay, by = a * xx + b * yx, b * xx + d * yx, a * xy + b * yy, b * xy + d * yy
                cxx, cxy, cyy = xx * ax + yx * bx, xy * ax + yy * bx, xy * ay + yy * by
                p, row = place[e, i, j], stride[node]
                data[p] += cxx
                data[p + 1] += cxy
                data[p + row] += cxy
                data[p + row + 1] += cyy
                if j < i:
                    p, row = place[e, j, i], stride[conn[e, j]]
                    data[p] += cxx
                    data[p + 1] += cxy
                    data[p + row] += cxy
                    data[p + row + 1] += cyy
