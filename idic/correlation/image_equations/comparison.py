"""The reference image by its kinds: their common protocol, and the nodal basis of grey and height images.

    GreyReference      grey images                                `idic.correlation.image_equations.grey`
    HeightReference    height images of the surface of a solid    `idic.correlation.height.surface`
    SectionReference   height images of a cross-section           `idic.correlation.height.cross_section`
    MeasuredReference  nodal motion of a free FE-DIC              `idic.correlation.measured`
    FieldReference     displacements that another DIC exported    `idic.correlation.field.reference`

`idic.correlation.experiment_reference.build_experiment_reference` makes the kind that the experiment has.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from idic.correlation.image_equations.equations import BasisEquations, SeenColumns
from idic.correlation.image_equations.frame import FrameGram, NodalEquations
from idic.correlation.image_equations.residual import ResidualMap
from idic.correlation.pixels.pixel_map import PixelMap, at_nodes
from idic.correlation.pixels.section_map import SectionMap
from idic.model import Experiment


@dataclass(frozen=True, eq=False)
class NoiseTerms:
    """How image noise enters the equations of a frame (docs/method.md, section 7).

    shared : (n_shared, k) columns of the frame in the basis of the reference, which are added over the frames;
    basis : the frame against that basis, None where the kind has none; gram : (k, k) Gram matrix of the columns that
    the noise of the frame is summed against, None: kappa times that of the frame.
    """

    shared: np.ndarray | SeenColumns
    basis: BasisEquations | None = None
    gram: np.ndarray | None = None


class Reference(Protocol):
    """A reference image on the pixels that the mesh covers.

    `motion` is the nodal motion as `View.motion` gives it, (n_nodes, n_components): px, px and, for heights, the rise.
    Degrees of freedom of nodal sums are ``n_components * node + component``.
    """

    @property
    def n_images(self) -> int:
        """Images averaged to the reference."""

    @property
    def n_components(self) -> int:
        """Of the motion of a node: 2 for grey images, 3 for heights."""

    @property
    def is_section(self) -> bool:
        """Whether a cross-section is seen from above: its pixel map has columns and edges."""

    @property
    def pixel_map(self) -> PixelMap | SectionMap:
        """Where the pixels lie in the elements."""

    @property
    def image(self) -> Reference:
        """The reference image; itself, unless the kind compares with a motion that was measured against an image."""

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations:
        """Nodal equations of one frame under a nodal motion (docs/method.md, equations 3.2, 3.3 and 4.3)."""

    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        """Residual of every pixel in the order of `pixel_map`, brightness `coefficients` (nb,) removed."""

    def shows_nothing(self, equations: NodalEquations) -> bool:
        """Whether the frame has no contrast: a closed shutter, or a specimen out of view."""

    def noise_terms(self, equations: NodalEquations, columns: np.ndarray, projected: FrameGram) -> NoiseTerms:
        """How noise enters the equations; columns : (c n_nodes, m), projected : ``equations.gram(columns)``."""

    def shared_columns(self, equations: NodalEquations, columns: np.ndarray, n_brightness: int) -> np.ndarray:
        """Columns (c n_nodes, m) of a frame and its brightness in the basis of the reference  # (n_shared, m +
        n_brightness)"""

    def shared_gram(self, experiment: Experiment, shared: np.ndarray) -> tuple[np.ndarray, int]:
        """S^T S of summed `shared_columns`, the first rows of `shared`; the Gram matrix and the number of those
        rows."""

    def pull_back(self, equations: NodalEquations) -> np.ndarray:
        """What takes nodal fields of a frame to the reference, F^-1 or its like for heights  # (n_nodes, c, c)"""

    def synthetic_image(self, r: np.ndarray) -> tuple[np.ndarray, Reference]:
        """An image with the residual r (n_pixels,) at rest, and the reference to `compare` it with.

        That reference has no low-pass: the low-pass is in r already.
        """

    def pattern_maps(self) -> Mapping[str, tuple[np.ndarray, ...]]:
        """Maps (n_pixels,) that a residual of "motion" and of "gain" is a multiple of; empty for heights."""


class NodalBasis(ABC):
    """The basis of the reference of grey and height images: fields at its nodes, and brightness.

    (F^-T grad f) . phi = grad f . (F^-1 phi) (docs/method.md, equation 4.2), and for heights d . G phi (equation 9.3),
    with F^-1 or G averaged over the elements around each node by `pull_back`.
    """

    pixel_map: PixelMap
    n_components: int
    is_section = False

    @abstractmethod
    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations:
        """Nodal equations of one frame under a nodal motion (n_nodes, n_components)."""

    def pull_back(self, equations: NodalEquations) -> np.ndarray:
        """What takes nodal fields of a frame to the reference  # (n_nodes, c, c)"""
        return equations.motion.pull_back

    @property
    def image(self) -> Self:
        """Itself."""
        return self

    def shows_nothing(self, equations: NodalEquations) -> bool:
        """No: heights have no brightness."""
        return False

    def pattern_maps(self) -> Mapping[str, tuple[np.ndarray, ...]]:
        """None of heights."""
        return {}

    def shared_columns(self, equations: NodalEquations, columns: np.ndarray, n_brightness: int) -> np.ndarray:
        """The columns at the nodes of the reference, then the brightness  # (c n_nodes + nb, m + nb)"""
        mean, nb = self.pull_back(equations), n_brightness
        fields = np.einsum("nij,njm->nim", mean, columns.reshape(*mean.shape[:2], -1)).reshape(len(columns), -1)
        shared = np.zeros((len(columns) + nb, columns.shape[1] + nb))
        shared[:len(columns), :columns.shape[1]] = fields
        shared[len(columns):, columns.shape[1]:] = np.eye(nb)
        return shared

    def shared_gram(self, experiment: Experiment, shared: np.ndarray) -> tuple[np.ndarray, int]:
        """S^T H S with H and the brightness blocks of the reference image at rest, and the number of rows of S."""
        still = self.compare(experiment, experiment.model.reference,
                             np.zeros((len(experiment.model.mesh.nodes), self.n_components)))
        n_dof = still.H.shape[0]
        fields, brightness = shared[:n_dof], shared[n_dof:n_dof + still.n_brightness]
        product = np.concatenate([still.H @ fields + still.hb @ brightness,
                                  still.hb.T @ fields + still.bb @ brightness])
        return shared[:len(product)].T @ product, len(product)

    def noise_terms(self, equations: NodalEquations, columns: np.ndarray, projected: FrameGram) -> NoiseTerms:
        """The columns in the basis of the reference, and the frame against it."""
        n, m = len(equations.q), projected.n_columns
        nodal = self.against_basis(equations, np.column_stack([equations.q, projected.h_columns,
                                                               equations.hb.toarray()]))
        product = np.vstack([nodal[:, 1:], np.hstack([projected.matrix[m:, :m], equations.bb])])
        around = np.repeat(self.visible_share(equations), self.n_components)
        share = equations.n_valid / max(equations.n_valid + equations.n_lost, 1)
        visible = np.concatenate([around, np.full(equations.n_brightness, share)])
        rhs = np.concatenate([nodal[:, 0], equations.rb])
        shared = self.shared_columns(equations, columns, equations.n_brightness)
        return NoiseTerms(visible[:, None] * shared,
                          BasisEquations(rhs, product, visible, np.full(n + len(equations.rb), equations.kappa)))

    def against_basis(self, equations: NodalEquations, nodal: np.ndarray) -> np.ndarray:
        """Sums of (N^T grad f) times something, from the same sums with the convected gradient.

        The convected gradient is undone by the mean at the nodes that `shared_columns` uses.

        nodal : (c n_nodes, ...)
        """
        undone = np.linalg.inv(self.pull_back(equations))  # (n_nodes, c, c)
        return np.einsum("nji,njk->nik", undone, nodal.reshape(*undone.shape[:2], -1)).reshape(nodal.shape)

    def visible_share(self, equations: NodalEquations) -> np.ndarray:
        """How much of the pixels around a node the frame shows, 0 … 1  # (n_nodes,)"""
        share = 1.0 - equations.lost / np.maximum(self.pixel_map.pixels_per_element, 1)
        return at_nodes(self.pixel_map, share[:, None, None])[:, 0, 0]
