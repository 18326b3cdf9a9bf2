"""A rubber law as a card of Abaqus or CalculiX: *HYPERELASTIC, a free energy as the nearest polynomial of order 3.

Both programs have kappa (J - 1)^2 / 2 as (J - 1)^2 / D1.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.laws.free_forms.free_curve import basis
from idic.laws.composed.free_rubber import INVARIANTS, knots_of_rubber, rubber_level_names
from idic.laws.free_forms.rubber_forms import RUBBER_TESTS, invariants, stress_matrix, weights

FITTED = 60  # points of a curve
SMALLEST_STRETCH, LARGEST_STRETCH = 1.02, 10.0  # where stresses are compared


def rubber_card(law: str, values: Mapping[str, float]) -> tuple[list[str], list[str]] | None:
    """(lines, what they do not say) of a rubber law; None of another law. values : MPa, -"""
    if law == "neo_hookean":
        return ["*HYPERELASTIC, NEO HOOKE", _row(values["C10"], 2.0 / values["kappa"])], []
    if law == "mooney_rivlin":
        return ["*HYPERELASTIC, MOONEY-RIVLIN", _row(values["C10"], values["C01"], 2.0 / values["kappa"])], []
    counts = knots_of_rubber(law)
    if not counts[0]:
        return None
    (a10, a20, a30), (a01, a02,
                      a03) = (_quadratic(invariant, n, values) for invariant, n in zip(INVARIANTS, counts, strict=True))
    lines = ["*HYPERELASTIC, POLYNOMIAL, N=3", _row(a10, a01, a20, 0.0, a02, a30, 0.0, 0.0),
             _row(a03, 2.0 / values["kappa"], 0.0, 0.0)]
    worst = _largest_difference(counts, values, (a10, a20, a30), (a01, a02, a03))
    reach = ", ".join(f"{name} - 3 = {values[f'{name}_range']:g}" for name, n in zip(INVARIANTS, counts, strict=True)
                      if n)
    return lines, [f"free energy: replaced by a polynomial of order 3, fitted up to {reach}; there nominal stresses "
                   f"of tension, pure shear and equibiaxial tension differ by {100.0 * worst:.2g} % of the largest at "
                   f"most"]


def _row(*numbers: float) -> str:
    return ", ".join(f"{number:.8g}" for number in numbers)


def _quadratic(invariant: str, n: int, values: Mapping[str, float]) -> tuple[float, float, float]:
    """(C1, C2, C3) of the polynomial C1 x + C2 x^2 + C3 x^3 whose derivative is nearest to that at the knots, evenly in
    stretch"""
    if n == 0:
        return 0.0, 0.0, 0.0
    end = values[f"{invariant}_range"]
    x = end * np.linspace(0.0, 1.0, FITTED) ** 2
    g = basis(x, end, n) @ [values[name] for name in rubber_level_names(invariant, n)]
    coefficients = np.linalg.lstsq(np.column_stack([np.ones_like(x), 2.0 * x, 3.0 * x * x]), g, rcond=None)[0]
    return float(coefficients[0]), float(coefficients[1]), float(coefficients[2])


def _largest_difference(counts: tuple[int, int], values: Mapping[str, float], first: tuple[float, ...],
                        second: tuple[float, ...]) -> float:
    """Of the polynomial's nominal stresses from those of the free energy, over the largest stress of the mode."""
    curves = [(invariant, n) for invariant, n in zip(INVARIANTS, counts, strict=True) if n]
    ends = tuple(values[f"{invariant}_range"] for invariant, _ in curves)
    levels = np.concatenate([[values[name] for name in rubber_level_names(*curve)] for curve in curves])
    worst = 0.0
    for mode in RUBBER_TESTS:
        stretch = np.linspace(SMALLEST_STRETCH, LARGEST_STRETCH, 2000)
        inside = np.all([x <= end for x, end in zip(invariants(mode, stretch), ends, strict=False)], axis=0)
        stretch = stretch[inside]
        if not len(stretch):
            continue
        exact = stress_matrix(mode, stretch, ends, tuple(n for _, n in curves)) @ levels
        (x, y), (w1, w2) = invariants(mode, stretch), weights(mode, stretch)
        card = w1 * (first[0] + 2.0 * first[1] * x + 3.0 * first[2] * x * x) \
            + w2 * (second[0] + 2.0 * second[1] * y + 3.0 * second[2] * y * y)
        worst = max(worst, float(np.abs(card - exact).max() / np.abs(exact).max()))
    return worst
