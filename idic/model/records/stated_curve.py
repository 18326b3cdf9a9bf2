"""A free curve of a law as its tables state it."""

from __future__ import annotations

from dataclasses import dataclass

from idic.laws import Smoothness


@dataclass(frozen=True)
class StatedCurve:
    """A free curve of a material.

    key : in ``smoothness``; names : of its values at the knots; last_knot : name of its last knot; size : of its
    starting curve, MPa; over : what it may be smooth over; rising : whether it never falls; by_evidence : whether
    knots and smoothness are still to be chosen
    """

    key: str
    names: tuple[str, ...]
    last_knot: str
    size: float
    smoothness: Smoothness
    over: tuple[str, ...]
    rising: bool = False
    by_evidence: bool = False
