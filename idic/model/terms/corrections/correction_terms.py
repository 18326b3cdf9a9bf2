"""The corrections of a logged or fixed motion, in the order in which the file and messages name them."""

from __future__ import annotations

from idic.model.records.free_course import without_knot
from idic.model.terms.corrections.compliance import COMPLIANCE
from idic.model.terms.corrections.correction_term import CorrectionTerm
from idic.model.terms.corrections.misalignment import MISALIGNMENT
from idic.model.terms.corrections.rotation import ROTATION
from idic.model.terms.corrections.seating import SEATING
from idic.model.terms.corrections.shape import SHAPE
from idic.model.terms.corrections.slip import SLIP

CORRECTION_TERMS: dict[str, CorrectionTerm] = {
    term.kind: term for term in (SLIP, ROTATION, COMPLIANCE, MISALIGNMENT, SEATING, SHAPE)}


def term_of_motion(name: str) -> CorrectionTerm | None:
    """The term of a degree of freedom ``boundary.SET.COMPONENT.KIND``, with a knot or not; None of another one."""
    stem, _, word = without_knot(name).rpartition(".")
    return CORRECTION_TERMS.get(word.rstrip("0123456789")) if stem.startswith("boundary.") else None
