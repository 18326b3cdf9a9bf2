"""The faces of a cut: tied ahead of the tip, free behind it.

A pair of nodes that lie on each other is tied by a stiffness that the passing tip takes away,

    k(theta) = k_0 (1 - theta) / (theta + TIED),      theta = (tip - begin) / (end - begin) in 0 … 1

from begin, where the tip stands on the pair, to end, where it stands on the next one. With k_0 the stiffness that the
body itself has against opening the pair, the energy released is proportional to theta: between two positions on nodes
the potential energy is interpolated, so that its slope, the energy release rate, is that of the virtual crack closure
over one element (Rybicki & Kanninen, Eng. Fract. Mech. 9 (1977) 931, doi:10.1016/0013-7944(77)90013-3). Motion and
forces are continuous in the position of the tip and have a derivative by it.

Faces may overlap: contact of closing faces is not modelled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TIED = 1e-4  # 1/TIED: stiffness of a tied pair, in that of the body around it; its opening is lost in the rounding of u


@dataclass(frozen=True)
class Seam:
    """A cut whose tip moves.

    Attributes
    ----------
    pairs : (n, 2) node indices on the left and on the right
    begin, end : (n,) mm along the path: positions of the tip at which the pair begins to open, and is free
    stiffness : (n, d, d) N/mm, of the body against opening the pair
    tips : (n_frames,) mm, position of the tip; linear in time in between
    """

    pairs: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    stiffness: np.ndarray
    tips: np.ndarray

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom of the pairs, left node first  # (n, 2 d)"""
        d = self.stiffness.shape[1]
        return (self.pairs[:, :, None] * d + np.arange(d)).reshape(len(self.pairs), -1)

    def matrices(self, tip: float) -> np.ndarray:
        """Stiffness of the pairs  # (n, 2 d, 2 d) N/mm"""
        theta = self._opened(tip)
        return _of_pairs(((1.0 - theta) / (theta + TIED))[:, None, None] * self.stiffness)

    def slopes(self, tip: float) -> np.ndarray:
        """Derivative of `matrices` by the position of the tip  # (n, 2 d, 2 d) N/mm²"""
        theta, span = self._opened(tip), self.end - self.begin
        passing = (tip >= self.begin) & (tip < self.end)
        slope = np.where(passing, -(1.0 + TIED) / (theta + TIED)**2 / span, 0.0)
        return _of_pairs(slope[:, None, None] * self.stiffness)

    def _opened(self, tip: float) -> np.ndarray:
        return np.clip((tip - self.begin) / (self.end - self.begin), 0.0, 1.0)


def _of_pairs(blocks: np.ndarray) -> np.ndarray:
    return np.block([[blocks, -blocks], [-blocks, blocks]])
