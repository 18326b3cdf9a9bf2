"""A measured field in the place of a reference image: displacements of points against the simulated motion.

    r = v - s u(x),     L phi = s phi          at every point x and for each component   docs/method.md, equation 15.1

v is measured (µm), u simulated (distances of neighbours), s the scale between them. On the surface of a solid the
displacement along the normal makes a third row, whose weight is in v and s (equation 15.8); so it does on a sheet in
plane stress, whose bending is an unknown of every frame there. Where the whole specimen moves with the machine or
against the cameras, a rigid motion B beta of every frame is an unknown of it, in the place of the brightness of images:
r = v - s u - B beta. Points are material: the field of a frame belongs to the reference stage, so F stays out, and the
noise of a frame counts once (kappa = 1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from idic.correlation.image_equations.comparison import NodalBasis, NoiseTerms, Reference
from idic.correlation.field.equations import FieldEquations, KeptProduct
from idic.correlation.field.point_map import PointMap, build_point_map
from idic.correlation.image_equations.frame import FrameGram, NodalEquations
from idic.correlation.image_equations.residual import ResidualMap
from idic.images import Camera
from idic.model import Depth, Experiment, Model
from idic.readers import BENDING_DEGREE, powers


GAUSS_POINTS = 3  # along each side of a subset


@dataclass(frozen=True, eq=False)
class FieldReference(NodalBasis):
    """The points of a field on the mesh.

    Attributes
    ----------
    scale : float
        µm per distance of neighbours.
    n_images : int
        Stages averaged to the reference.
    averaged : csr_array (n_pixels, n_nodes), optional
        Shape functions averaged over the subset of each row; None: those at its point.
    free_rigid : bool
        Every frame has a rigid motion of its own.
    depth : Depth or None
        How rows along the normal are compared.
    """

    pixel_map: PointMap
    scale: float
    n_images: int = 1
    averaged: sparse.csr_array | None = None
    free_rigid: bool = False
    depth: Depth | None = None
    lowpass_px = 0.0
    degree = 3
    gradient_noise = 0.0

    @property
    def n_components(self) -> int:  # type: ignore[override]
        return 2 if self.depth is None else 3

    @cached_property
    def row_weight(self) -> np.ndarray:
        """1 in the plane, the weight of the depth along the normal  # (n_pixels,)"""
        return np.where(self.pixel_map.component < 2, 1.0, self.depth.weight if self.depth else 1.0)

    @cached_property
    def in_plane(self) -> FieldReference:
        """The rows of the motion in the plane alone."""
        if self.depth is None:
            return self
        averaged = None if self.averaged is None else sparse.csr_array(self.averaged[self.pixel_map.component < 2])
        return replace(self, pixel_map=self.pixel_map.in_plane(), averaged=averaged, depth=None)

    @property
    def f(self) -> np.ndarray:
        """The field of the reference stage: zero  # (n_pixels,) µm"""
        return np.zeros(self.pixel_map.n_pixels, dtype=np.float32)

    @property
    def fx(self) -> np.ndarray:
        """Derivative of the rows by a motion along the columns  # (n_pixels,) µm per distance"""
        return np.where(self.pixel_map.component == 0, self.scale, 0.0)

    @property
    def fy(self) -> np.ndarray:
        """The same along the rows."""
        return np.where(self.pixel_map.component == 1, self.scale, 0.0)

    @cached_property
    def matrix(self) -> sparse.csr_array:
        """s N: from nodal motion to the rows; N is averaged over the subset  # (n_pixels, c n_nodes)"""
        N = sparse.coo_array(self.pixel_map.shape_matrix() if self.averaged is None else self.averaged)
        c = self.n_components
        columns = c * N.col + self.pixel_map.component[N.row]
        data = self.scale * N.data * self.row_weight[N.row]
        return sparse.csr_array((data, (N.row, columns)), shape=(N.shape[0], c * N.shape[1]))

    @cached_property
    def hessian(self) -> sparse.csr_array:
        """H where all points are measured  # (c n_nodes, c n_nodes)"""
        return sparse.csr_array(self.matrix.T @ self.matrix)

    @cached_property
    def products(self) -> KeptProduct:
        """What a frame hands on to the next."""
        return KeptProduct()

    @cached_property
    def rigid(self) -> np.ndarray:
        """B: rows of a shift along the columns, along the rows, and a turn of the same size; of an offset along the
        normal and two tilts where they are free, of a sheet with its bending  # (n_pixels, 0 | 3 | 6 | 10 | 13) µm"""
        pm, columns = self.pixel_map, []
        x, y = (pm.points() - pm.points().mean(axis=0)).T
        size = max(float(np.hypot(x, y).max()), 1.0)
        x, y = x / size, y / size
        first, second, third = (pm.component == k for k in range(3))
        if self.free_rigid:
            columns += [first, second, np.where(first, -y, np.where(second, x, 0.0))]
        if self.depth is not None and (self.depth.rigid_motion or self.depth.side):
            degree = BENDING_DEGREE if self.depth.side else 1
            columns += [np.where(third, x**i * y**j, 0.0) for i, j in powers(degree)]
        rows = np.array(columns, dtype=float).reshape(len(columns), pm.n_pixels).T
        return self.scale * self.row_weight[:, None] * rows

    def measured(self, experiment: Experiment, frame: int) -> np.ndarray:
        """The measured displacement of every row with its weight, NaN where there is none  # (n_pixels,) µm"""
        values = np.asarray(experiment.recording.stack.frame(frame), dtype=float)
        return self.row_weight * values[self.pixel_map.point, self.pixel_map.component]

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> FieldEquations:
        """Nodal equations of one frame; motion : (n_nodes, c) in distances of neighbours."""
        return self.equations(self.measured(experiment, frame), motion)

    def equations(self, measured: np.ndarray, motion: np.ndarray) -> FieldEquations:
        """The same for a field (n_pixels,) µm, NaN where it is not measured."""
        pm = self.pixel_map
        valid = np.isfinite(measured)
        r = np.where(valid, measured - self.matrix @ motion.ravel(), 0.0)
        missing = self.matrix[np.flatnonzero(~valid)]
        hessian = self.hessian if valid.all() else sparse.csr_array(self.hessian - missing.T @ missing)
        lost = np.add.reduceat((~valid).astype(np.int64), pm.start[:-1])
        squares = np.add.reduceat(r**2, pm.start[:-1])
        n_lost = int(lost.sum())
        rigid = np.where(valid[:, None], self.rigid, 0.0)
        return FieldEquations(self.matrix.T @ r, hessian, sparse.csr_array(self.matrix.T @ rigid), rigid.T @ rigid,
                              rigid.T @ r,
                              float(r @ r), pm.n_pixels - n_lost, n_lost, lost, np.flatnonzero(~valid), squares, 1.0,
                              self.hessian, missing, self.products)

    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        """Residual of every row (µm); `coefficients` are those of the rigid motion."""
        measured, pm = self.measured(experiment, frame), self.pixel_map
        valid = np.isfinite(measured)
        rigid = self.rigid @ coefficients if len(coefficients) else 0.0
        r = np.where(valid, measured - self.matrix @ motion.ravel() - rigid, 0.0).astype(np.float32)
        if self.depth is None:
            return ResidualMap(r, valid, np.ones(len(r), dtype=np.float32), 1.0, self.n_images)
        g = self.depth.noise_gain
        gain = np.where(pm.component < 2, 1.0, g + (g - 1.0) / self.n_images)  # with 1/n_images: g (1 + 1/n_images)
        return ResidualMap(r, valid, gain.astype(np.float32), 1.0, self.n_images)

    def noise_terms(self, equations: NodalEquations, columns: np.ndarray, projected: FrameGram) -> NoiseTerms:
        """The columns alone: ordinary least squares. Points come and go, and their noise is correlated, which
        generalised least squares of independent pixels do not know."""
        return NoiseTerms(self.visible(equations)[:, None]
                          * self.shared_columns(equations, columns, equations.n_brightness))

    def visible(self, equations: NodalEquations) -> np.ndarray:
        """How much of the points around a node, and of all, the frame shows  # (c n_nodes + nb,)"""
        share = equations.n_valid / max(equations.n_valid + equations.n_lost, 1)
        around = np.repeat(self.visible_share(equations), self.n_components)
        return np.concatenate([around, np.full(equations.n_brightness, share)])

    def pull_back(self, equations: NodalEquations) -> np.ndarray:
        """Nothing: points are material  # (n_nodes, c, c)"""
        return np.tile(np.eye(self.n_components), (self.pixel_map.n_nodes, 1, 1))

    def shared_columns(self, equations: NodalEquations, columns: np.ndarray, n_brightness: int) -> np.ndarray:
        """The columns as they are, then the rigid motion  # (c n_nodes + nb, m + nb)"""
        return np.block([[columns, np.zeros((len(columns), n_brightness))],
                         [np.zeros((n_brightness, columns.shape[1])), np.eye(n_brightness)]])

    def synthetic_image(self, r: np.ndarray) -> tuple[np.ndarray, Reference]:
        """A frame with the residual r (n_pixels,) at rest  # (n_points, c) µm, and this reference"""
        pm = self.pixel_map
        frame = np.full((len(pm.positions), self.n_components), np.nan, dtype=np.float32)
        frame[pm.point, pm.component] = r / self.row_weight
        return frame, self

    def pattern_maps(self) -> Mapping[str, tuple[np.ndarray, ...]]:
        """The derivative by a motion along columns and rows  # (n_pixels,) each"""
        return {"motion": (self.fx, self.fy)}

    @classmethod
    def of(cls, experiment: Experiment, camera: Camera) -> FieldReference:
        """The points of an experiment's field on its mesh.

        Raises
        ------
        InputError
            If no point lies on the mesh.
        """
        model, recording = experiment.model, experiment.recording
        points = recording.points
        assert points is not None
        cells = model.mesh.surface_cells(model.surface)
        point_map = build_point_map(model.mesh.nodes, cells, camera, points.positions_px, points.shape,
                                    recording.mask, points.n_components)
        averaged = None
        if points.subset_px > 0.0:
            averaged = _over_subsets(model, camera, point_map, points.subset_px)
        return cls(point_map, points.um_per_px, recording.n_references, averaged, points.free_rigid,
                   points.depth)


def _over_subsets(model: Model, camera: Camera, point_map: PointMap, width: float) -> sparse.csr_array:
    """Shape functions averaged over the subset around every point, as far as it lies on the mesh  # (n_pixels, n_nodes)

    The displacement that an affine subset finds in a smooth field is its best affine field at the middle, the mean over
    a whole subset (docs/method.md, equation 15.6). Gauss points integrate fields up to degree five.
    """
    at, along_one = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    across, along = np.meshgrid(0.5 * width * at, 0.5 * width * at)
    offsets = np.column_stack([across.ravel(), along.ravel()])
    weights = np.outer(along_one, along_one).ravel()
    points, number = np.unique(point_map.point, return_inverse=True)
    samples = (point_map.positions[points][:, None] + offsets).reshape(-1, 2)
    cells = model.mesh.surface_cells(model.surface)
    sample_map = build_point_map(model.mesh.nodes, cells, camera, samples, point_map.shape)
    first = sample_map.component == 0
    sample = sample_map.point[first]
    values = sparse.csr_array(sample_map.shape_matrix()[np.flatnonzero(first)])
    owner, offset = np.divmod(sample, len(offsets))
    weight = _at_the_middle(offsets[offset], weights[offset], owner, len(points))
    gather = sparse.csr_array((weight, (owner, np.arange(len(sample)))), shape=(len(points), len(sample)))
    return sparse.csr_array(sparse.csr_array(gather @ values)[number])


def _at_the_middle(place: np.ndarray, weight: np.ndarray, owner: np.ndarray, n: int) -> np.ndarray:
    """Weights of the samples of n subsets that give the best affine field of each at its middle  # (n_samples,)

    place : (n_samples, 2) from the middle; owner : (n_samples,) subset. Of a whole subset they are `weight` over its
    sum; of one that reaches beyond the mesh they carry its mean to the middle. Samples on a line have no slope across.
    """
    total = np.bincount(owner, weight, n)
    mean = np.column_stack([np.bincount(owner, weight * place[:, k], n) / total for k in (0, 1)])
    off = place - mean[owner]
    spread = np.empty((n, 2, 2))
    for i, j in np.ndindex(2, 2):
        spread[:, i, j] = np.bincount(owner, weight * off[:, i] * off[:, j], n) / total
    slope = np.einsum("nij,nj->ni", np.linalg.pinv(spread, rcond=1e-9, hermitian=True), -mean)
    return weight / total[owner] * (1.0 + (off * slope[owner]).sum(axis=1))
