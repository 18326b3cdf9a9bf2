"""A simulated motion against a measured one: the second step of a two-step identification, frame by frame.

A free FE-DIC has left of a frame its nodal displacement v (px), whose Hessian there is H, gain and offset taken out.
The residual is v - u at the nodes, weighted by a matrix W:

    weighted     W = H         the inverse covariance of v / [sigma^2 (1/N + kappa)]: the "DIC matrix"
    unweighted   W = h I       every measured node alike; h = 1 / mean of the diagonal of H^-1, so that next to a force
                               displacements weigh by their mean variance

in grey values squared per px^2, so that weights, frame-local unknowns and sums are those of images:
M = sum phi^T W phi, b = sum phi^T W (v - u) (docs/method.md, equations 13.2 to 13.4). Image noise reaches v through
A^-1, A = H + P with the penalty P of the FE-DIC's regularisation, and b through the fields c = A^-1 W phi: the
covariance has c where that of images has phi. Nodes without a measurement take no part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.correlation.image_equations.comparison import NoiseTerms, Reference
from idic.correlation.image_equations.frame import FrameGram, NodalEquations
from idic.correlation.image_equations.grey import GreyReference
from idic.correlation.image_equations.residual import ResidualMap
from idic.correlation.pixels.pixel_map import PixelMap
from idic.model import Experiment

MIN_DIAGONAL_SHARE = 1e-12  # of the largest diagonal entry: less is a node that nothing holds; it stays where it is


@dataclass(frozen=True, eq=False)
class MeasuredReference:
    """A motion that was measured against a reference image.

    Attributes
    ----------
    image : GreyReference
    motion_px : array (n_frames, n_nodes, 2)
        NaN where nothing was measured.
    information : float or None
        h of every node, GV^2/px^2; None: weighted by H.
    penalty : csc_array (2 n_nodes, 2 n_nodes)
        P.
    """

    image: GreyReference
    motion_px: np.ndarray
    information: float | None
    penalty: sparse.csc_array
    n_components = 2
    is_section = False

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

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations | MeasuredEquations:
        """Equations of one frame for a simulated motion (n_nodes, 2) px; of the reference frame, those of its image."""
        if frame == experiment.model.reference:
            return self.image.compare(experiment, frame, motion)
        return self.equations(self.image.compare(experiment, frame, self.filled(frame)), frame, motion)

    def equations(self, image: NodalEquations, frame: int, motion: np.ndarray) -> MeasuredEquations:
        """The same; image : nodal equations of the frame under the measured motion, `filled`."""
        covered = np.repeat(self.measured(frame), 2)
        gap = np.where(covered, (self.filled(frame) - motion).ravel(), 0.0)
        light = image.brightness_fit()
        q = _weighted(self, image, covered, gap[:, None])[:, 0]
        rb = image.bb @ light.coefficients if len(light.coefficients) else image.rb
        return MeasuredEquations(image, self, covered, q, float(light.rr + gap @ q + light.coefficients @ rb), rb)

    def noise_terms(self, equations: MeasuredEquations, columns: np.ndarray, projected: FrameGram) -> NoiseTerms:
        """Noise enters by the fields of `MeasuredEquations.noise` in the place of the columns."""
        m, nb, image = columns.shape[1], equations.n_brightness, equations.image
        fields, bright, gram = equations.noise(columns)
        noise, shared = np.zeros((m + nb, m + nb)), np.zeros((len(fields) + nb, m + nb))
        noise[:m, :m] = equations.kappa * gram
        shared[:len(fields), :m] = self.image.shared_columns(image, fields, 0)
        shared[len(fields):, :m] = bright
        around = np.repeat(self.image.visible_share(image), 2)
        share = equations.n_valid / max(equations.n_valid + equations.n_lost, 1)
        visible = np.concatenate([around, np.full(nb, share)])
        return NoiseTerms(visible[:, None] * shared, gram=noise)

    def shows_nothing(self, equations: MeasuredEquations) -> bool:
        """A measured motion needs no contrast."""
        return False

    # quantities of the pixels alone are taken from the image
    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        return self.image.compare_pixels(experiment, frame, motion, coefficients)

    def shared_columns(self, equations: MeasuredEquations, columns: np.ndarray, n_brightness: int) -> np.ndarray:
        return self.image.shared_columns(equations.image, columns, n_brightness)

    def shared_gram(self, experiment: Experiment, shared: np.ndarray) -> tuple[np.ndarray, int]:
        return self.image.shared_gram(experiment, shared)

    def pull_back(self, equations: MeasuredEquations) -> np.ndarray:
        return self.image.pull_back(equations.image)

    def synthetic_image(self, r: np.ndarray) -> tuple[np.ndarray, Reference]:
        return self.image.synthetic_image(r)

    def pattern_maps(self) -> Mapping[str, tuple[np.ndarray, ...]]:
        return self.image.pattern_maps()


@dataclass(frozen=True, eq=False)
class MeasuredEquations:
    """The equations of one frame, in the place of `NodalEquations`.

    Attributes
    ----------
    image : NodalEquations
        Of the frame under the measured motion: H, brightness, pixels.
    q : array (2 n_nodes,)
        W (v - u).
    rr : float
        The residual that v leaves, and (v - u)^T W (v - u): GV^2.
    rb : array (nb,)
        Gain and offset stay those of the measurement: nothing couples them with the motion.
    """

    image: NodalEquations
    reference: MeasuredReference
    covered: np.ndarray  # (2 n_nodes,) bool
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

    def gram(self, columns: np.ndarray, alike: int = 0) -> FrameGram:
        """Project on nodal fields  # columns (2 n_nodes, m) px per unit; alike : as of `NodalEquations`"""
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
        image, weighted = self.image, self._weighted(columns)
        matrix = sparse.csc_matrix(image.H + self.reference.penalty)
        diagonal = matrix.diagonal()
        top = diagonal.max(initial=0.0)
        idle = np.where(diagonal <= MIN_DIAGONAL_SHARE * top, max(top, 1.0), 0.0)
        factor = splu(sparse.csc_matrix(matrix + sparse.diags_array(idle)), permc_spec="MMD_AT_PLUS_A",
                      diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        fields = factor.solve(np.ascontiguousarray(weighted))
        bright = np.zeros((self.n_brightness, columns.shape[1]))
        if self.n_brightness:
            coupling = image.hb.toarray()
            moved = factor.solve(coupling)  # (2 n_nodes, nb)
            schur = image.bb - coupling.T @ moved
            bright = -np.linalg.pinv(schur, rcond=1e-12, hermitian=True) @ (coupling.T @ fields)
            fields = fields - moved @ bright
        coupled = fields.T @ (image.hb @ bright)
        gram = fields.T @ (image.H @ fields) + coupled + coupled.T + bright.T @ image.bb @ bright
        return fields, bright, gram

    def _weighted(self, columns: np.ndarray) -> np.ndarray:
        """W times fields  # (2 n_nodes, m)"""
        return _weighted(self.reference, self.image, self.covered, columns)


def _weighted(reference: MeasuredReference, equations: NodalEquations, covered: np.ndarray,
              columns: np.ndarray) -> np.ndarray:
    columns = np.where(covered[:, None], columns, 0.0)
    if reference.information is not None:
        return reference.information * columns
    product = equations.H @ columns
    if equations.n_brightness:
        product = product - equations.hb @ (np.linalg.pinv(equations.bb, hermitian=True) @ (equations.hb.T @ columns))
    return np.where(covered[:, None], product, 0.0)


def mean_information(equations: NodalEquations, penalty: sparse.csc_array, nodes: np.ndarray) -> float:
    """One over the mean variance of the measured displacement of `nodes` per unit of pixel noise, GV^2/px^2.

    equations : of the reference image against itself. The variance is the diagonal of A^-1 H A^-1.
    """
    dofs = (2 * nodes[:, None] + [0, 1]).ravel()
    matrix = sparse.csc_matrix(equations.H + penalty)
    top = matrix.diagonal().max(initial=1e-300)
    idle = np.where(matrix.diagonal() <= MIN_DIAGONAL_SHARE * top, top, 0.0)
    factor = splu(sparse.csc_matrix(matrix + sparse.diags_array(idle)))
    unit = np.zeros((matrix.shape[0], len(dofs)))
    unit[dofs, np.arange(len(dofs))] = 1.0
    solved = factor.solve(unit)
    return float(1.0 / np.mean(np.einsum("ij,ij->j", solved, equations.H @ solved)))
