"""Unknowns by the hundred: a step of Gauss and Newton by products, beside the direct derivatives, in forward runs."""

import numpy as np
import pytest
from jobs.bench_jobs import best_of, many_fields

from idic.fe import Direction, Linearisation, march

pytestmark = [pytest.mark.bench, pytest.mark.slow]

PRODUCTS = 40  # of a step: twenty iterations, each a product and one with the transpose; tests take 15 to 25
FEW = 20  # unknowns that are differentiated directly


@pytest.mark.parametrize("law", ["neo_hookean", "j2_linear"])
def test_five_hundred_unknowns_cost_a_few_runs(law, measured):
    model, values, times = many_fields(law, (29, 16))
    directions = [Direction(name, variation=(0, name)) for name in model.variations[0].values]
    v = np.cos(np.arange(len(directions)))
    at = Linearisation.of(model, values, times, directions)
    moved = at.tangent(v)
    plain, linear, tangent, adjoint, direct = best_of(
        [lambda: list(march(model, values, times)), lambda: Linearisation.of(model, values, times, directions),
         lambda: at.tangent(v), lambda: at.adjoint(moved.u, moved.channels),
         lambda: list(march(model, values, times, directions[:FEW]))], 3)
    step = linear + PRODUCTS // 2 * (tangent + adjoint)
    per_unknown = (direct - plain) / FEW
    measured(f"{len(directions)} unknowns, {law}, {model.n_dof} dofs, {len(times) - 1} frames: a step of {PRODUCTS} "
             f"products", f"{step / plain:.2f} runs",
             f"a run to linearise {linear / plain:.2f}, J v {tangent / plain:.1%}, J^T w {adjoint / plain:.1%}; "
             f"direct {per_unknown / plain:.1%} of a run per unknown: {len(directions) * per_unknown / plain:.0f} runs")
    assert len(directions) > 500 and step < 0.25 * len(directions) * per_unknown
