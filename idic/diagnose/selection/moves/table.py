"""The selection of a diagnosis: one loop over a table of moves.

A round of the table screens the library, refits what is promising, gives the winner the form that the recording asks
for, and judges it; the cause joins the model, all causes are tested against each other, and the errors of the new
model are computed anew. The rounds end where no cause is selected, or with their limit.
"""

from __future__ import annotations

from idic.diagnose.selection.move import moved
from idic.diagnose.selection.moves.both_copies import BOTH_COPIES
from idic.diagnose.selection.moves.few_jumps import FEW_JUMPS, IDLE_JUMPS
from idic.diagnose.selection.moves.finite_strains import FINITE_STRAINS
from idic.diagnose.selection.moves.free_end import FREE_END
from idic.diagnose.selection.moves.judged_together import END_OF_ROUND, ON_BLOCKS, TOGETHER
from idic.diagnose.selection.moves.new_error import AS_JOINED, KNOWN_ERROR, NEW_ERROR
from idic.diagnose.selection.moves.own_course import EARLIER_COURSE, IMITATED, OWN_COURSE
from idic.diagnose.selection.moves.own_scale import OWN_SCALE
from idic.diagnose.selection.moves.revision import FURTHER_CAUSE, LAST_CAUSE, REVISION
from idic.diagnose.selection.moves.rivals_again import RIVALS_AGAIN
from idic.diagnose.selection.moves.screening import SCREENING
from idic.diagnose.selection.moves.shortlist import JUDGED, OTHER_STARTS, SHORTLIST
from idic.diagnose.selection.state import State

ROUND = (
    SCREENING,       # every candidate is scored
    SHORTLIST,       # those that promise most are refitted
    BOTH_COPIES,     # the other copy judges, too, where one copy shows no candidate clearly
    OTHER_STARTS,    # a law with several minima
    JUDGED,
    OWN_COURSE,      # in time, given by the data
    FEW_JUMPS,       # of a slip
    OWN_SCALE,       # of a seating
    JUDGED,
    FURTHER_CAUSE,   # explains enough beside the causes before it
    EARLIER_COURSE,  # explains as much without it
    ON_BLOCKS,       # of the recording, without a part in the fit
    END_OF_ROUND,    # the winner joins the model
    REVISION,        # every cause but the last: removed, or exchanged for a rival
    AS_JOINED,
    NEW_ERROR,       # of the mesh and of plane stress, of the new model
    KNOWN_ERROR,
    FINITE_STRAINS,
    RIVALS_AGAIN,    # beside what has joined since
    LAST_CAUSE,      # removed, beside what has joined since
    IDLE_JUMPS,
)
AFTER_THE_ROUNDS = (
    TOGETHER,        # causes that blocks do not confirm alone
    IMITATED,        # rivals that a free course could imitate
    FREE_END,        # explains more than all of them
)


def selected(state: State) -> State:
    """The state with every cause that the recording selects."""
    while state.is_open:
        state = moved(state, ROUND)
    return moved(state, AFTER_THE_ROUNDS)
