"""The blown-up membrane at full size: what 200 frames and five exact sensitivities cost."""

import numpy as np
import pytest
from jobs.bench_jobs import best_of

from idic.fe import march
from idic_studies.examples.bulge_model import FIXED, TRUTH, bulge_model, bulge_test, directions, law_values

pytestmark = [pytest.mark.bench, pytest.mark.slow]


def test_five_sensitivities_of_the_membrane_cost_less_than_a_run(measured):
    test = bulge_test()
    model = bulge_model(test)
    values, all_five = law_values(FIXED | TRUTH, model), directions(model, tuple(TRUTH))
    plain, direct = best_of([lambda: list(march(model, values, test.times)),
                             lambda: list(march(model, values, test.times, all_five))], 2)  # fmt: skip
    measured("bulge, 643 quad8, 200 frames, 5 exact sensitivities", f"{direct:.2f} s",
             f"one forward run {plain:.2f} s: {direct / plain:.2f} runs (perturbed runs: 6)")  # fmt: skip
    assert direct / plain < 2.0


def test_a_warm_start_saves_iterations(measured):
    """As near the end of an identification: parameters that moved by 0.1 %, on the increments of the solution
    before."""
    test = bulge_test()
    model, names = bulge_model(test), tuple(TRUTH)
    states = list(march(model, law_values(FIXED | TRUTH, model), test.times, directions(model, names)))
    change = 1e-3 * np.array([TRUTH[name] for name in names])
    values = law_values(FIXED | {name: 1.001 * TRUTH[name] for name in names}, model)
    predicted = [state.u + state.du @ change for state in states]
    iterations = {}

    def run(kind, start):
        frames = march(model, values, test.times, steps=states[-1].steps, warm_start=start)
        iterations[kind] = sum(state.n_newton for state in frames)

    warm_s, cold_s = best_of([lambda: run("led", predicted), lambda: run("alone", None)], 1)
    measured("bulge, a run that begins with the increments of the last one", f"{warm_s:.2f} s",
             f"by extrapolation {cold_s:.2f} s; iterations {iterations['led']} and {iterations['alone']}")  # fmt: skip
    assert iterations["led"] < 0.8 * iterations["alone"]
