"""The first guess of an increment: extrapolation in time, or the same increment of a known solution (warm start).

Near the end of an identification the parameters hardly move, and the last solution, corrected at first order by its
sensitivities, predicts the next one better than any extrapolation in time. At the beginning the parameters change much,
and extrapolation is better. Each increment compares both guesses and decides which one the next increment takes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from idic.fe.body.boundary import Drives
from idic.fe.equilibrium import Converged

MAX_TURN = 0.1  # part of a drive increment across the last one, up to which u is extrapolated
MAX_STRETCH = 4.0  # largest ratio of a drive increment to the last one for extrapolation


def extrapolated(current: Converged, earlier: Converged | None, drives: Drives) -> np.ndarray | None:
    """u + s (u - u_before), s = drive increment over the last one; None where the drives change direction.

    (n_nodes, d) mm.
    """
    if earlier is None or current.drives.prescribed.size + current.drives.dead.size + current.drives.pressure.size == 0:
        return None
    last_change = current.drives.as_vector() - earlier.drives.as_vector()
    change = drives.as_vector() - current.drives.as_vector()
    size = float(last_change @ last_change)
    s = float(change @ last_change) / size if size > 0 else 0.0
    if np.linalg.norm(change - s * last_change) > MAX_TURN * np.linalg.norm(change) or not 0.0 <= s <= MAX_STRETCH:
        return None
    return current.u + s * (current.u - earlier.u)


@dataclass
class WarmStart:
    """Displacements of a known solution, frame by frame.

    Attributes
    ----------
    frames : (n_nodes, d) mm of the reference, of the first frame, ...
    previous_u, current_u : of the known solution, at the last and at the present frame
    guesses : of the present increment: by extrapolation, and by the known solution
    trusted : the guess by the known solution was the better one in the last increment that had both
    """

    frames: Iterator[np.ndarray]
    previous_u: np.ndarray | None = None
    current_u: np.ndarray | None = None
    guesses: tuple[np.ndarray, np.ndarray] | None = None
    trusted: bool = True

    def advance(self) -> None:
        """Go on to the next frame."""
        self.previous_u = next(self.frames) if self.current_u is None else self.current_u
        self.current_u = next(self.frames)

    def better(self, u: np.ndarray, extrapolation: np.ndarray | None) -> np.ndarray:
        """The first guess at the end of the increment that leads from u to this frame  # (n_nodes, d)"""
        warm_guess = u + (self.current_u - self.previous_u)
        if extrapolation is None:
            return warm_guess
        self.guesses = extrapolation, warm_guess
        return warm_guess if self.trusted else extrapolation

    def judge(self, u: np.ndarray) -> None:
        """Compare both guesses with the equilibrium u."""
        if self.guesses is not None:
            extrapolation_error, warm_error = (float(np.linalg.norm(guess - u)) for guess in self.guesses)
            self.trusted, self.guesses = warm_error <= extrapolation_error, None
