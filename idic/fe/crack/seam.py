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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from idic.fe.crack.cut import Cut

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



# of the stiffness of the two nodes of a pair alone, in series: the nodes around them give way, too
NODE_SHARE = 0.15
# of an edge: a crack whose tip is on a node of elements with mid-side nodes opens the body as one that is so much
# shorter; measured on the edge crack of a closed form (tests/fe/test_crack_tip.py). Without mid-side nodes it is 0.02
SHORTER_QUADRATIC = 0.07


def seam_of(cut: Cut, middle: Sequence[np.ndarray], stiffness_at: Callable[[np.ndarray], np.ndarray],
            tips: np.ndarray) -> Seam:
    """The seam of a cut.

    Parameters
    ----------
    middle : pairs of nodes in the middle of its edges (`idic.fe.crack.cut.side_pairs`), per edge
    stiffness_at : stiffness of the body at some nodes, all others held  # (n,) -> (n, d, d) N/mm
    tips : (n_frames,) mm
    """
    places, pairs, begin, end = _tip_places(cut, any(map(len, middle))), [], [], []
    for k, (start, stop) in enumerate(pairwise(places)):
        of_edge = middle[k].tolist()
        if cut.left[k] != cut.right[k]:
            of_edge.append([int(cut.left[k]), int(cut.right[k])])
        pairs += of_edge
        begin += [start] * len(of_edge)
        end += [stop] * len(of_edge)
    nodes = np.array(pairs, dtype=np.int64)
    left, right = (np.linalg.inv(stiffness_at(side)) for side in nodes.T)
    return Seam(nodes, np.array(begin), np.array(end), NODE_SHARE * np.linalg.inv(left + right), tips)


def _tip_places(cut: Cut, is_quadratic: bool) -> np.ndarray:
    """Lengths of the crack whose tip is on each node of the cut  # (n + 1,) mm"""
    edges = np.diff(cut.place)
    around = 0.5 * (np.append(edges, edges[-1]) + np.append(edges[0], edges))
    places = cut.place - (SHORTER_QUADRATIC * around if is_quadratic else 0.0)
    places[0] = 0.0
    return places
