"""What a rival imitates: with a course of its own another cause, with idle unknowns the model in hand.

A cause with one amplitude per knot follows any function of time. Where the load only grows, that is any function of the
load:
a free drift of the load cell and a stress that bends over the strain leave the same record. A rival that explains
nearly as much with a course of few unknowns is then not told from it, however large the drop of chi-square by the
further knots; unless the winner explained more than that rival when its own course had as few.

Where points yield a functional has many minima, and a search of the model in hand may end in one that is not its
lowest. A rival with one more unknown leaves it. Then it gains what the model itself could have gained, and its own
unknown ends where its physics is absent: a hole 0.004 +- 0.003 mm smaller that lowered chi-square by 30. The model is
fitted again from there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.refit import Refit
from idic.diagnose.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.enrich import comes_back
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.own_course import has_own_course
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival, Round, within_noise
from idic.diagnose.selection.rivals import variant_of

MIN_IMITATED_SHARE = 0.9  # of the held-out drop of the winner: what the rival leaves would be a flaw of its description
MAX_IDLE_STD = 3.0  # of every unknown of a rival, from where its physics is absent
MIN_GAIN_OVER_UNKNOWNS = 2.0  # drop of chi-square over the sum of (unknown / standard deviation)^2


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


def gains_without_its_unknowns(rival: Rival, screening: Screening) -> bool:
    """Whether a rival explains more than its own unknowns, all near nothing, can explain."""
    null, z = variant_of(rival, screening).null, []
    for name in rival.own_unknowns:
        absent, std = null.get(name, np.nan), rival.refitted.stds[name]
        if std is None or not np.isfinite(absent):
            return False
        z.append((rival.refitted.values[name] - absent) / std)
    bar = MIN_GAIN_OVER_UNKNOWNS * float(np.square(z).sum()) + MIN_HELDOUT_DROP
    return bool(z) and float(np.abs(z).max()) < MAX_IDLE_STD and rival.achieved > bar


def nearer_null(source: ExperimentSource, null: Refit, rival: Rival, screening: Screening, refits: Refits, grid: Grid,
                seed: int) -> Refit | None:
    """The model in hand fitted from the values of such a rival; None of other rivals, and where it ends no lower.

    source, null : of the model in hand, and its fit
    """
    if not gains_without_its_unknowns(rival, screening):
        return None
    moved = {name: rival.refitted.values[name] - value for name, value in null.values.items()}
    (again,) = refits([refit_of_one(source, "null", null, grid, seed, moved)])
    lower = again.usable and again.choice.chi2 < null.choice.chi2 - MIN_HELDOUT_DROP
    return again if lower else None
