"""A simulated motion against a measured one: the second step of a two-step identification, frame by frame.

A free FE-DIC has left of a frame its nodal displacement v (px), whose Hessian there is H, gain and offset taken out.
The residual is v - u at the nodes, weighted by a matrix W:

    weighted     W = H         the inverse covariance of v / [sigma^2 (1/N + kappa)]: the "DIC matrix"
    unweighted   W = h I       every measured node alike; h = 1 / mean of the diagonal of H^-1, so that beside a force
                               displacements weigh by their mean variance

in grey values squared per px^2, so that everything after it (weights, frame-local unknowns, sums) is that of images:
M = sum phi^T W phi, b = sum phi^T W (v - u). Image noise reaches v through A^-1, A = H + P with the penalty P of the
FE-DIC's regularisation, and b through the fields c = A^-1 W phi: where images would have phi, the covariance has c.
Nodes without a measurement take no part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.correlation.frame import FrameGram, FrameShare, solve_brightness
from idic.correlation.pixel_map import PixelMap
from idic.correlation.reference import ReferenceImage

UNSEEN = 1e-12  # of the largest diagonal entry: keeps nodes that nothing holds where they are


@dataclass(frozen=True, eq=False)
class MeasuredReference:
    """A motion that was measured against a reference image.

    Attributes
    ----------
    image : ReferenceImage
    motion_px : array (n_frames, n_nodes, 2)
        NaN where nothing was measured.
    information : float or None
        h of every node, GV^2/px^2; None: weighted by H.
    penalty : csc_array (2 n_nodes, 2 n_nodes)
        P.
    """

    image: ReferenceImage
    motion_px: np.ndarray
    information: float | None
    penalty: sparse.csc_array

    @property
    def pixel_map(self) -> PixelMap:
        """Where the reference image is seen."""
        return self.image.pixel_map

    @property
    def n_images(self) -> int:
        """Images averaged to the reference."""
        return self.image.n_images

    def measured(self, frame: int) -> np.ndarray:
        """Which nodes are measured in a frame  # (n_nodes,) bool"""
        return np.isfinite(self.motion_px[frame]).all(axis=1)

    def filled(self, frame: int) -> np.ndarray:
        """The motion of a frame, 0 where it is not measured  # (n_nodes, 2) px"""
        return np.where(self.measured(frame)[:, None], self.motion_px[frame], 0.0)


@dataclass(frozen=True, eq=False)
class MeasuredShare:
    """One frame's share, in the place of a `FrameShare`.

    Attributes
    ----------
    image : FrameShare
        Of the frame under the measured motion: H, brightness, pixels.
    q : array (2 n_nodes,)
        W (v - u).
    rr : float
        The residual that v leaves, and (v - u)^T W (v - u): GV^2.
    rb : array (nb,)
        Gain and offset stay those of the measurement: nothing couples them with the motion.
    """

    image: FrameShare
    reference: MeasuredReference
    known: np.ndarray  # (2 n_nodes,) bool
    q: np.ndarray
    rr: float
    rb: np.ndarray

    @property
    def n_brightness(self) -> int:
        return len(self.rb)

    @property
    def bb(self) -> np.ndarray:
        return self.image.bb

    @property
    def n_valid(self) -> int:
        return self.image.n_valid

    @property
    def n_lost(self) -> int:
        return self.image.n_lost

    @property
    def kappa(self) -> float:
        return self.image.kappa

    def gram(self, columns: np.ndarray) -> FrameGram:
        """Project on nodal fields  # columns (2 n_nodes, m) px per unit"""
        weighted = self._weighted(columns)
        m, nb = columns.shape[1], self.n_brightness
        matrix = np.zeros((m + nb, m + nb))
        matrix[:m, :m] = columns.T @ weighted
        matrix[m:, m:] = self.bb
        return FrameGram(matrix, np.concatenate([columns.T @ self.q, self.rb]), m, weighted)

    def noise(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How image noise enters the sums against `columns`.

        Returns
        -------
        c : (2 n_nodes, m) fields that noise is summed against; brightness : (nb, m) what goes with them;
        gram : (m, m) of both under the frame's own pixels
        """
        share, weighted = self.image, self._weighted(columns)
        matrix = sparse.csc_matrix(share.H + self.reference.penalty)
        diagonal = matrix.diagonal()
        idle = np.where(diagonal <= UNSEEN * diagonal.max(initial=0.0), max(diagonal.max(initial=0.0), 1.0), 0.0)
        factor = splu(sparse.csc_matrix(matrix + sparse.diags_array(idle)), permc_spec="MMD_AT_PLUS_A",
                      diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        fields = factor.solve(np.ascontiguousarray(weighted))
        bright = np.zeros((self.n_brightness, columns.shape[1]))
        if self.n_brightness:
            coupling = share.hb.toarray()
            moved = factor.solve(coupling)  # (2 n_nodes, nb)
            schur = share.bb - coupling.T @ moved
            bright = -np.linalg.pinv(schur, rcond=1e-12, hermitian=True) @ (coupling.T @ fields)
            fields = fields - moved @ bright
        coupled = fields.T @ (share.hb @ bright)
        gram = fields.T @ (share.H @ fields) + coupled + coupled.T + bright.T @ share.bb @ bright
        return fields, bright, gram

    def _weighted(self, columns: np.ndarray) -> np.ndarray:
        """W times fields  # (2 n_nodes, m)"""
        return _weighted(self.reference, self.image, self.known, columns)


def measured_share(reference: MeasuredReference, frame: int, u_px: np.ndarray,
                   compare: Callable[[np.ndarray], FrameShare]) -> MeasuredShare:
    """One frame's share for a simulated nodal motion.

    Parameters
    ----------
    u_px : (n_nodes, 2) simulated displacement of the nodes in the image
    compare : the image pass of this frame for a nodal motion
    """
    share = compare(reference.filled(frame))
    known = np.repeat(reference.measured(frame), 2)
    gap = np.where(known, (reference.filled(frame) - u_px).ravel(), 0.0)
    light = solve_brightness(share)
    q = _weighted(reference, share, known, gap[:, None])[:, 0]
    rb = share.bb @ light.coefficients if len(light.coefficients) else share.rb
    return MeasuredShare(share, reference, known, q, float(light.rr + gap @ q + light.coefficients @ rb), rb)


def _weighted(reference: MeasuredReference, share: FrameShare, known: np.ndarray, columns: np.ndarray) -> np.ndarray:
    columns = np.where(known[:, None], columns, 0.0)
    if reference.information is not None:
        return reference.information * columns
    product = share.H @ columns
    if share.n_brightness:
        product = product - share.hb @ (np.linalg.pinv(share.bb, hermitian=True) @ (share.hb.T @ columns))
    return np.where(known[:, None], product, 0.0)


def mean_information(share: FrameShare, penalty: sparse.csc_array, nodes: np.ndarray) -> float:
    """One over the mean variance of the measured displacement of `nodes` per unit of pixel noise, GV^2/px^2.

    share : of the reference image against itself. The variance is the diagonal of A^-1 H A^-1.
    """
    dofs = (2 * nodes[:, None] + [0, 1]).ravel()
    matrix = sparse.csc_matrix(share.H + penalty)
    top = matrix.diagonal().max(initial=1e-300)
    factor = splu(sparse.csc_matrix(matrix + sparse.diags_array(np.where(matrix.diagonal() <= UNSEEN * top, top, 0.0))))
    unit = np.zeros((matrix.shape[0], len(dofs)))
    unit[dofs, np.arange(len(dofs))] = 1.0
    solved = factor.solve(unit)
    return float(1.0 / np.mean(np.einsum("ij,ij->j", solved, share.H @ solved)))
