"""The increments of a solution nearby, as first guesses: the last evaluated parameters of an identification.

Near its end parameters hardly move, and the last solution, carried on by its sensitivities, foretells the next one
better than any extrapolation in time. At its beginning they jump, and it does not: each increment tells which of the
two to follow in the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np


@dataclass
class Nearby:
    """Displacements of a solution nearby, frame by frame.

    frames : (n_nodes, d) mm of the reference, of the first frame, ...; guesses : the two of the increment under way,
    by extrapolation and by the increment nearby; trusted : whether the latter was the better one last time.
    """

    frames: Iterator[np.ndarray]
    before: np.ndarray | None = None
    here: np.ndarray | None = None
    guesses: tuple[np.ndarray, np.ndarray] | None = None
    trusted: bool = True

    def advance(self) -> None:
        """On to the next frame."""
        self.before = next(self.frames) if self.here is None else self.here
        self.here = next(self.frames)

    def better(self, u: np.ndarray, extrapolated: np.ndarray | None) -> np.ndarray:
        """The guess to begin with, at the end of the increment that leads from u to this frame  # (n_nodes, d)"""
        along = u + (self.here - self.before)
        if extrapolated is None:
            return along
        self.guesses = extrapolated, along
        return along if self.trusted else extrapolated

    def judge(self, u: np.ndarray) -> None:
        """Take notice of where equilibrium was found."""
        if self.guesses is not None:
            extrapolated, along = (float(np.linalg.norm(guess - u)) for guess in self.guesses)
            self.trusted, self.guesses = along <= extrapolated, None
