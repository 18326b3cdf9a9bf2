"""A function that is linear between its values at knots, and beyond the last: free curves in compiled code.

n knots at last ((k - 1) / (n - 1))^2, k = 1 ... n, dense at the beginning. Places in ``params``: ``last`` of the last
knot, ``start`` of the first value, ``levels`` of the second (the others follow). ``rising``: a value below the one
before it counts as that one; of two equal values each may rise.
"""

from __future__ import annotations

from idic.laws.core.inner import inner

TIE = 1e-9  # relative difference below which two values are equal


@inner
def on_knots(n, range_place, start, levels, rising, x, params):
    """(value, slope) at x; real or complex."""
    low, previous_knot, steepness = params[start] + 0.0 * x, 0.0 * params[range_place], 0.0 * (params[range_place] + x)
    for k in range(1, n):
        knot = params[range_place] * (k / (n - 1.0)) ** 2
        high = params[levels + k - 1]
        if rising and high.real < (1.0 - TIE) * low.real:
            high = low
        steepness = (high - low) / (knot - previous_knot)
        if x.real < knot.real or k == n - 1:
            break
        low, previous_knot = high + 0.0 * x, knot
    return low + steepness * (x - previous_knot), steepness


@inner
def on_knots_change(n, range_place, start, levels, rising, x, params, d):
    """Change of the value with the parameters at fixed x; real."""
    low, dlow, previous_knot, dprevious_knot, steepness, change = params[start], d[start], 0.0, 0.0, 0.0, 0.0
    for k in range(1, n):
        share = (k / (n - 1.0)) ** 2
        knot, dknot = params[range_place] * share, d[range_place] * share
        high, dhigh = params[levels + k - 1], d[levels + k - 1]
        if rising and high < (1.0 - TIE) * low:
            high, dhigh = low, dlow
        steepness = (high - low) / (knot - previous_knot)
        change = (dhigh - dlow - steepness * (dknot - dprevious_knot)) / (knot - previous_knot)
        if x < knot or k == n - 1:
            break
        low, dlow, previous_knot, dprevious_knot = high, dhigh, knot, dknot
    return dlow + change * (x - previous_knot) - steepness * dprevious_knot
