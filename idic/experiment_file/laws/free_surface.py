"""A free yield surface of experiment.toml as flat parameters, and its stated prior.

    yield_surface = { kind = "free_surface", knots = 6, smoothness = 0.5, angle = 30.0 }

becomes ``free_surface6`` with the weights yield_surface_u1 ... yield_surface_u18, identified, starting at Mises's
surface (1) with the prior 1 ± `SPREAD`. The surface knows only their ratios: their mean is held at 1 by the prior of
`idic.experiment_file.laws.free_curves`. u3 = ... gives one its own value. ``smoothness`` is the std of the difference
of neighbouring weights, 1. ``knots = "evidence"``: as of free curves.
"""

from __future__ import annotations

from collections.abc import Mapping

from idic.errors import InputError
from idic.experiment_file.laws.free_curves import BY_EVIDENCE, is_number
from idic.laws import DEFAULT_RING, RINGS, RING_KNOTS

KIND = "free_surface"
SPREAD = 0.9  # of every weight
KEYS = ("knots", "smoothness")


def free_surface(entry: Mapping, file: str, key: str) -> tuple[str, dict, dict]:
    """A free yield surface as the kind with its number of knots, a start value of every weight, and its smoothness.

    Raises
    ------
    InputError
        A number of knots or a smoothness that is none.
    """
    n = entry.get("knots", DEFAULT_RING)
    smoothness_table: dict[str, object] = {"by_evidence": True} if n == BY_EVIDENCE else {}
    n = RING_KNOTS[1] if smoothness_table else n
    if not isinstance(n, int) or isinstance(n, bool) or not RING_KNOTS[0] <= n <= RING_KNOTS[1]:
        raise InputError("a free yield surface needs its number of knots on a ring", file=file, key=f"{key}.knots",
                         expected=f'a whole number, {RING_KNOTS[0]} to {RING_KNOTS[1]}, or "{BY_EVIDENCE}"',
                         found=repr(n)[:80],
                         remedy=f"{DEFAULT_RING} suit most sheets; the smoothness prior decides where the test shows "
                                "nothing")
    smoothness = entry.get("smoothness")
    if smoothness is not None and (not is_number(smoothness) or not smoothness > 0):
        raise InputError("a smoothness is a size of differences", file=file, key=f"{key}.smoothness",
                         expected="a number above zero; 1: neighbouring weights differ by 0 with std 1",
                         found=repr(smoothness)[:80], remedy="smaller is smoother; leave it out for 1")
    weights = {f"u{k}": {"value": 1.0, "identify": True, "prior": {"mean": 1.0, "std": SPREAD}}
               for k in range(1, RINGS * n + 1)}
    entries = {name: value for name, value in entry.items() if name not in KEYS}
    smoothness_table |= {} if smoothness is None else {"strength": float(smoothness)}
    return f"{KIND}{n}", weights | entries, smoothness_table
