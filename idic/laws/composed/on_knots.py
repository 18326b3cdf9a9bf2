"""A function that is linear between its values at knots, and beyond the last: free curves in compiled code.

n knots at last ((k - 1) / (n - 1))^2, k = 1 ... n, dense at the beginning. Places in ``params``: ``last`` of the last
knot, ``start`` of the first value, ``levels`` of the second (the others follow). ``rising``: a value below the one
before it counts as that one; of two equal values each may rise.
"""

from __future__ import annotations

from idic.laws.core.inner import inner

TIE = 1e-9  # relative difference below which two values are equal


@inner
def on_knots(n, last, start, levels, rising, x, params):
    """(value, slope) at x; real or complex."""
    low, before, steepness = params[start] + 0.0 * x, 0.0 * params[last], 0.0 * (params[last] + x)
    for k in range(1, n):
        knot = params[last] * (k / (n - 1.0)) ** 2
        high = params[levels + k - 1]
        if rising and high.real < (1.0 - TIE) * low.real:
            high = low
        steepness = (high - low) / (knot - before)
        if x.real < knot.real or k == n - 1:
            break
        low, before = high + 0.0 * x, knot
    return low + steepness * (x - before), steepness


@inner
def on_knots_change(n, last, start, levels, rising, x, params, d):
    """Change of the value with the parameters at fixed x; real."""
    low, dlow, before, dbefore, steepness, change = params[start], d[start], 0.0, 0.0, 0.0, 0.0
    for k in range(1, n):
        share = (k / (n - 1.0)) ** 2
        knot, dknot = params[last] * share, d[last] * share
        high, dhigh = params[levels + k - 1], d[levels + k - 1]
        if rising and high < (1.0 - TIE) * low:
            high, dhigh = low, dlow
        steepness = (high - low) / (knot - before)
        change = (dhigh - dlow - steepness * (dknot - dbefore)) / (knot - before)
        if x < knot or k == n - 1:
            break
        low, dlow, before, dbefore = high, dhigh, knot, dknot
    return dlow + change * (x - before) - steepness * dbefore
