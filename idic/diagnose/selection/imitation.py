"""What a course of its own imitates.

A cause with one amplitude per knot follows any function of time. Where the load only grows, that is any function of the
load:
a free drift of the load cell and a stress that bends over the strain leave the same record. A rival that explains
nearly as much with a course of few unknowns is then not told from it, however large the drop of chi-square by the
further knots; unless the winner explained more than that rival when its own course had as few.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.screen.enrich import comes_back
from idic.diagnose.selection.own_course import has_own_course
from idic.diagnose.selection.rival import Rival, Round, within_noise

MIN_IMITATED_SHARE = 0.9  # of the held-out drop of the winner: what the rival leaves would be a flaw of its description


def with_imitated(one: Round, u: np.ndarray) -> Round:
    """The round with the rivals that the free course of its winner imitates among the indistinguishable ones.

    u : (n_frames, n_nodes, dim) simulated motion of the recording, whose way back tells a course from the load
    """
    winner = one.winner
    if winner is None or not has_own_course(winner) or comes_back(u):
        return one
    alike = [rival.name for rival in one.rivals
             if rival.name not in (winner.name, *one.equals) and rival.passes and rival.copies == winner.copies
             and len(rival.own_unknowns) < len(winner.own_unknowns) and not _is_behind(rival, one.plain)
             and rival.heldout > MIN_IMITATED_SHARE * winner.heldout]
    return replace(one, equals=(*one.equals, *dict.fromkeys(alike)))


def _is_behind(rival: Rival, plain: Rival | None) -> bool:
    """Whether the winner was better than this rival with as few unknowns, before its course was freed."""
    return (plain is not None and plain.copies == rival.copies and plain.evidence > rival.evidence
            and len(plain.own_unknowns) <= len(rival.own_unknowns) and not within_noise(rival, plain))
