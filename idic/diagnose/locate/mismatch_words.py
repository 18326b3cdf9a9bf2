"""The mismatch in sentences that agree with the verdict.

    located   cause   unexplained   first sentence
    no        no      nothing       No mismatch beyond noise and the practical margin.
    no        no      channel       No mismatch of motions beyond noise and the margin. Not explained: force_N.
    no        yes     nothing       No mismatch of free motions ... Grip slip shows by its own pattern alone.
    no        yes     any           the same, and what is not explained
    yes       no      any           Side: bulk. Unexplained motion: 0.02 px. Not explained: motion.
    yes       yes     nothing       Side of the mismatch of the identified model: bulk. Its size: 0.02 px.
    yes       yes     any           the same, and what is not explained
    unknown   any     any           Side, onset and place are not known: a law finds no equilibrium along the path.

Located: free motions, or channels, show more than noise and the practical margin (`Mismatch.is_significant`). A cause
is found by its own pattern, which is fewer unknowns and sees less.
"""

from __future__ import annotations

from collections.abc import Sequence

from idic.diagnose.locate.mismatch import MAX_MISMATCH_P, Mismatch, SelectedEffect
from idic.diagnose.locate.place import in_words

MOTION = "motion"  # what is unexplained beside the columns of channels


def mismatch_words(mismatch: Mismatch | None, selected: SelectedEffect | None, shown_by: str | None,
                   unexplained: Sequence[str], unit: str) -> tuple[str, ...]:
    """One sentence each on side, onset with course, place, and what is unexplained.

    Parameters
    ----------
    mismatch : None where a law finds no equilibrium along the path
    selected : the selected candidate, None without one
    shown_by : cause and what shows it, where free motions show none: "grip slip shows by its own pattern"
    unexplained : `MOTION` and columns of channels that the last model does not explain
    unit : of lengths
    """
    remainders = _left(unexplained)
    if mismatch is None:
        return "Side, onset and place are not known: a law finds no equilibrium along the identified path.", *remainders
    if not mismatch.is_significant:
        kind = " of free motions" if selected else " of motions" if unexplained else ""
        cause = (f"{shown_by[:1].upper()}{shown_by[1:]} alone.",) if shown_by else ()
        return f"No mismatch{kind} beyond noise and the practical margin: {_why_none(mismatch)}.", *cause, *remainders
    words = [_side(mismatch, selected), _onset(mismatch, selected)]
    place = place_words(mismatch, unit) if mismatch.has_place(selected) else None
    return *(text for text in (*words, place) if text), *remainders


def place_words(mismatch: Mismatch, unit: str) -> str | None:
    """Number and centre of the source elements, or the region over which they are spread; None without one."""
    place = mismatch.place
    if place is None:
        return None
    if not place.has_centre:
        size = " × ".join(f"{length:.3g}" for length in place.extent)
        return f"Place: {len(place.elements)} source elements over {size} {unit}."
    at = in_words(place.centroid, place.centroid_std, float(place.extent.max()))
    return f"Place: {len(place.elements)} source elements, centred at {at} {unit}."


def _why_none(mismatch: Mismatch) -> str:
    if not mismatch.nested_tests.side:
        return mismatch.nested_tests.reason
    return f"the probability under noise, {mismatch.p_value:.2g}, is not below {MAX_MISMATCH_P}"


def _side(mismatch: Mismatch, selected: SelectedEffect | None) -> str:
    size = f"{mismatch.effect_px_rms:.3g} px (rms)"
    if selected is None:
        return f"Side: {mismatch.side}; {mismatch.nested_tests.reason}. Unexplained motion: {size}."
    addition = ("" if selected.side == mismatch.side else f" The selected candidate acts on another side "
                f"({selected.side}): free motions cannot attribute such a field, refits can.")
    return (f"Side of the mismatch of the identified model: {mismatch.side}; {mismatch.nested_tests.reason}. Its size: "
            f"{size}.{addition}")


def _onset(mismatch: Mismatch, selected: SelectedEffect | None) -> str | None:
    first, interval = mismatch.reported_onset(selected)
    if first is None:
        return None
    if first == 0:
        visible = "" if mismatch.visible_frame is None else f"; more than noise from frame {mismatch.visible_frame} on"
        limit = "" if selected else ", as far as the recording shows"
        return f"Onset: present from the start{limit}{visible}. {mismatch.course.words}"
    between = f" (95 %: {interval[0]} to {interval[1]})" if interval else ""
    return f"Onset: frame {first}{between}. {mismatch.course.words}"


def _left(unexplained: Sequence[str]) -> tuple[str, ...]:
    return (f"Not explained: {' and '.join(unexplained)}.",) if unexplained else ()
