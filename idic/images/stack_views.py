"""Stacks made of another one: with noise added in memory, or only its first frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.images.stack import Stack


@dataclass(frozen=True, eq=False)
class NoisyStack:
    """A stack with white noise on every image, the reference included.

    The noise of frame k depends on seed and k alone: whoever reads it, whenever and in whatever order, sees the same.

    std : standard deviation, in the unit of the pixel values, which become float32.
    """

    stack: Stack
    std: float
    seed: int

    @property
    def n_frames(self) -> int:
        return self.stack.n_frames

    @property
    def shape(self) -> tuple[int, int]:
        return self.stack.shape

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        k = range(self.n_frames)[k]
        noise = np.random.default_rng((self.seed, k)).standard_normal(self.shape, dtype=np.float32)
        noise *= np.float32(self.std)
        noise += self.stack.frame(k)
        return noise


@dataclass(frozen=True, eq=False)
class LeadingFrames:
    """The first `n_frames` frames of a stack."""

    stack: Stack
    n_frames: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.stack.shape

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx)"""
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} of {self.n_frames}")
        return self.stack.frame(k)
