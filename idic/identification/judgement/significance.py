"""Significance in words, to where it means something.

Beyond eight standard deviations, and below a probability of one in a million, a figure rests on the tails of the
normal distribution, which are not measured: pages print the limit instead of the figure. Files keep the figure.
"""

from __future__ import annotations

MAX_PRINTED_Z = 8.0
MIN_PRINTED_P = 1e-6


def z_text(z: float) -> str:
    """Standard deviations to one decimal: "3.2", "> 8", "< -8"."""
    if abs(z) > MAX_PRINTED_Z:
        return f"> {MAX_PRINTED_Z:g}" if z > 0 else f"< -{MAX_PRINTED_Z:g}"
    return f"{round(z, 1) + 0.0:.1f}"  # no -0.0


def p_text(p: float) -> str:
    """A probability to two digits: "0.034", "< 1e-6"."""
    return f"< {MIN_PRINTED_P:.0e}".replace("e-0", "e-") if p < MIN_PRINTED_P else f"{p:.2g}"
