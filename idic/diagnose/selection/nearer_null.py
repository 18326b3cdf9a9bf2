"""The model in hand fitted again from the end of a rival that adds nothing to it.

Where points yield a functional has many minima, and a search of the model in hand may end in one that is not its
lowest. A rival with one more unknown leaves it. Then it gains what the model itself could have gained, and its own
unknown ends where its physics is absent: a hole 0.004 +- 0.003 mm smaller that lowers chi-square by 30.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.refit import Refit
from idic.diagnose.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival
from idic.diagnose.selection.rivals import variant_of

MAX_IDLE_STD = 3.0  # of every unknown of a rival, from where its physics is absent
MIN_GAIN_OVER_UNKNOWNS = 2.0  # drop of chi-square over the sum of (unknown / standard deviation)^2


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
