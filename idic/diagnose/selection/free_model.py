"""A refitted model that describes the recording without the name of a cause: a free law, a free end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from idic.diagnose.refits.refit import Refit
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.residual.heldout import share_recovered
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP
from idic.diagnose.selection.verdict import MIN_RECOVERED_SHARE


@dataclass(frozen=True, eq=False)
class FreeModel:
    """left : excess of the identified model and of this one on the copy that had no part in the fits."""

    refitted: Refit
    left: ExcessLeft

    @property
    def unknowns(self) -> Sequence[str]:
        """Names of the parameters that the model adds."""
        raise NotImplementedError

    @property
    def share(self) -> float:
        """Of the explainable residual, held out."""
        return share_recovered(self.left.before, self.left.after)

    @property
    def heldout(self) -> float:
        """Drop of chi-square, held out."""
        return self.left.before.chi2 - self.left.after.chi2

    @property
    def describes(self) -> bool:
        """Whether it describes the recording by the bars that a named cause has to pass."""
        return (self.heldout > MIN_HELDOUT_DROP + len(self.unknowns) and self.share >= MIN_RECOVERED_SHARE
                and not self.left.matters)
