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


def extrapolated(now: Converged, earlier: Converged | None, drives: Drives) -> np.ndarray | None:
    """u + s (u - u_before), s = drive increment over the last one; None where the drives change direction.

    (n_nodes, d) mm.
    """
    if earlier is None or now.drives.prescribed.size + now.drives.dead.size + now.drives.pressure.size == 0:
        return None
    last = now.drives.as_vector() - earlier.drives.as_vector()
    new = drives.as_vector() - now.drives.as_vector()
    size = float(last @ last)
    s = float(new @ last) / size if size > 0 else 0.0
    if np.linalg.norm(new - s * last) > MAX_TURN * np.linalg.norm(new) or not 0.0 <= s <= MAX_STRETCH:
        return None
    return now.u + s * (now.u - earlier.u)


@dataclass
class WarmStart:
    """Displacements of a known solution, frame by frame.

    Attributes
    ----------
    frames : (n_nodes, d) mm of the reference, of the first frame, ...
    before, here : of the known solution, at the last and at the present frame
    guesses : of the present increment: by extrapolation, and by the known solution
    trusted : the guess by the known solution was the better one in the last increment that had both
    """

    frames: Iterator[np.ndarray]
    before: np.ndarray | None = None
    here: np.ndarray | None = None
    guesses: tuple[np.ndarray, np.ndarray] | None = None
    trusted: bool = True

    def advance(self) -> None:
        """Go on to the next frame."""
        self.before = next(self.frames) if self.here is None else self.here
        self.here = next(self.frames)

    def better(self, u: np.ndarray, extrapolation: np.ndarray | None) -> np.ndarray:
        """The first guess at the end of the increment that leads from u to this frame  # (n_nodes, d)"""
        known = u + (self.here - self.before)
        if extrapolation is None:
            return known
        self.guesses = extrapolation, known
        return known if self.trusted else extrapolation

    def judge(self, u: np.ndarray) -> None:
        """Compare both guesses with the equilibrium u."""
        if self.guesses is not None:
            extrapolation, known = (float(np.linalg.norm(guess - u)) for guess in self.guesses)
            self.trusted, self.guesses = known <= extrapolation, None
