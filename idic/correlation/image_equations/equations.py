"""The equations of one frame before its local unknowns are eliminated, and the weights of images and channels.

A frame contributes three kinds of equations (docs/method.md, sections 1 and 8): its pixels, its channels, and the
priors of its frame-local unknowns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Weights:
    """Least-squares weights and the noise behind them.

    image : weight of one squared grey-value residual (1/GV²); image_noise : noise std of one image (GV).
    channels, channel_noise : the same per channel (1/N², N); cameras, camera_noise : per further camera.
    generalised : images weighted by their own noise only, for the system of generalised least squares, which takes the
    reference image's noise out by itself (`idic.correlation.shared_noise`).
    """

    image: float
    image_noise: float
    channels: np.ndarray  # (n_channels,)
    channel_noise: np.ndarray  # (n_channels,)
    cameras: tuple[float, ...] = ()
    camera_noise: tuple[float, ...] = ()
    generalised: bool = False

    def of_camera(self, number: int) -> Weights:
        """The weights with further camera `number` (from 0) in the place of the main one."""
        return replace(self, image=self.cameras[number], image_noise=self.camera_noise[number])

    def as_generalised(self) -> Weights:
        """The weights of generalised least squares: every image by its own noise alone."""
        return replace(self, image=self.image_noise**-2, cameras=tuple(n**-2 for n in self.camera_noise),
                       generalised=True)


@dataclass(frozen=True)
class ChannelEquations:
    """Channel residuals of one frame (measured minus simulated) and their derivatives of the simulated value."""

    residual: np.ndarray  # (n_channels,)
    d_global: np.ndarray  # (n_channels, n)
    d_local: np.ndarray  # (n_channels, m)


@dataclass(frozen=True, eq=False)
class SeenColumns:
    """Columns of a frame, those that most frames share apart, and its rigid motion, times what it shows of them.

    distinct : (c n_nodes, k); alike : (c n_nodes, m - k); visible : (c n_nodes + nb,)
    """

    distinct: np.ndarray
    alike: np.ndarray
    visible: np.ndarray

    def projected(self, slope: np.ndarray) -> np.ndarray | ColumnSum:
        """The own columns less `slope` times all others  # slope (m - k + nb, k) -> (c n_nodes + nb, k)"""
        m = self.alike.shape[1]
        if (self.visible == 1.0).all():
            return ColumnSum(np.vstack([self.distinct, -slope[m:]]), self.alike, -slope[:m])
        return self.visible[:, None] * np.vstack([self.distinct - self.alike @ slope[:m], -slope[m:]])


@dataclass(frozen=True, eq=False)
class ColumnSum:
    """A sum of columns over frames, distinct + alike @ coefficients; what frames share is multiplied after the sum.

    distinct : (n_shared, n); alike : (c n_nodes, q); coefficients : (q, n)
    """

    distinct: np.ndarray
    alike: np.ndarray
    coefficients: np.ndarray

    def mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> ColumnSum:
        """The sum in other unknowns; change : (rows, n) -> (rows, n_new), linear"""
        return ColumnSum(change(self.distinct), self.alike, change(self.coefficients))


def dense(columns: np.ndarray | ColumnSum) -> np.ndarray:
    """The sum itself  # (n_shared, n)"""
    if not isinstance(columns, ColumnSum):
        return columns
    total = columns.distinct.copy()
    total[:len(columns.alike)] += columns.alike @ columns.coefficients
    return total


def added(first: np.ndarray | ColumnSum, second: np.ndarray | ColumnSum) -> np.ndarray | ColumnSum:
    """The sum of two sums of columns; an array may be changed in place."""
    if isinstance(first, ColumnSum) and isinstance(second, ColumnSum):
        if first.alike is not second.alike:
            return added(dense(first), second)
        return ColumnSum(first.distinct + second.distinct, first.alike, first.coefficients + second.coefficients)
    if isinstance(second, ColumnSum):
        first, second = second, first
    if isinstance(first, ColumnSum):
        return replace(first, distinct=first.distinct + second)
    first += second
    return first


@dataclass(frozen=True)
class FrameEquations:
    """All equations of one frame before elimination.

    gram : (n+m+nb, n+m+nb) image Gram matrix in the order global, local, brightness; rhs : (n+m+nb,);
    rr : sum of squared residuals; shared : (n_shared, n+m+nb) coefficients of the columns in the reference frame's
    nodal (and brightness) basis; kappa : noise variance of a deformed frame per pixel of the reference, about 1/J;
    local_precision, local_gap : prior of the local unknowns, (m, m) and prior mean minus present value (m,);
    noise_gram : kappa x gram, where that is a sum over several cameras; basis : the frame against the basis of
    `shared`, None where the kind of view has none; scatter : (m, m) the part of local_precision that is the scatter of
    a record, None: all of it; the rest keeps a measured edge smooth and is no noise; few : so few rows that the
    unknowns of the frame take a visible part of their squares.
    """

    gram: np.ndarray
    rhs: np.ndarray
    rr: float
    shared: np.ndarray | SeenColumns
    kappa: float
    channels: ChannelEquations
    local_precision: np.ndarray
    local_gap: np.ndarray
    noise_gram: np.ndarray | None = None
    basis: BasisEquations | None = None
    scatter: np.ndarray | None = None
    few: bool = False


@dataclass(frozen=True)
class BasisEquations:
    """Residual and columns of one frame against the reference's nodal (and brightness) basis, visible pixels only.

    rhs : (n_shared,); product : (n_shared, n+m+nb); visible : (n_shared,) share of the pixels around a node that the
    frame shows; kappa : (n_shared,) `FrameEquations.kappa` of the camera that the row belongs to.
    """

    rhs: np.ndarray
    product: np.ndarray
    visible: np.ndarray
    kappa: np.ndarray
