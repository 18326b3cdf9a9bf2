"""Stacks made of another one: with noise added in memory, rounded as a sensor does, or only its first frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.images.stack import Stack


@dataclass(frozen=True, eq=False)
class StackView:
    """Another stack with something done to every frame: a view defines `frame`."""

    stack: Stack

    @property
    def n_frames(self) -> int:
        return self.stack.n_frames

    @property
    def shape(self) -> tuple[int, int]:
        return self.stack.shape


@dataclass(frozen=True, eq=False)
class NoisyStack(StackView):
    """A stack with white noise on every image, the reference included.

    The noise of frame k depends on seed and k alone: any order of reading gives the same values.

    std : standard deviation, in the unit of the pixel values, which become float32.
    """

    std: float
    seed: int

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        k = range(self.n_frames)[k]
        noise = np.random.default_rng((self.seed, k)).standard_normal(self.shape, dtype=np.float32)
        noise *= np.float32(self.std)
        noise += self.stack.frame(k)
        return noise


@dataclass(frozen=True, eq=False)
class RoundedStack(StackView):
    """Grey values 0 … 256 as a sensor of so many bits records them: in steps of 2^(8 - bits), none beyond its range.

    The grey values keep their scale: of 12 bits there are sixteen to each of 8 bits.
    """

    bits: int

    @property
    def step(self) -> float:
        """The smallest difference, in grey values of 8 bits."""
        return 2.0 ** (8 - self.bits)

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        levels = np.rint(np.asarray(self.stack.frame(k), dtype=np.float32) / np.float32(self.step))
        return np.clip(levels, 0, 2**self.bits - 1) * np.float32(self.step)


@dataclass(frozen=True, eq=False)
class LitStack(StackView):
    """A stack in other light: ``gain * value + offset``, frame by frame.

    gains, offsets : (n_frames,)
    """

    gains: np.ndarray
    offsets: np.ndarray

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        return np.float32(self.gains[k]) * self.stack.frame(k).astype(np.float32) + np.float32(self.offsets[k])


@dataclass(frozen=True, eq=False)
class LeadingFrames(StackView):
    """The first `number` frames of a stack."""

    number: int

    @property
    def n_frames(self) -> int:
        return self.number

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx)"""
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} of {self.n_frames}")
        return self.stack.frame(k)
