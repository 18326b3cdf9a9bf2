"""Direct differentiation: what n exact sensitivities cost, in forward runs of the same model."""

import pytest
from jobs.bench_jobs import best_of, brick, directions, stretched

from idic.experiment_file import load_experiment
from idic.fe import march
from idic.model import build_forward

pytestmark = [pytest.mark.bench, pytest.mark.slow]


def report(measured, body, plain, direct, n):
    runs = direct / plain
    measured(f"{n} exact sensitivities, {body}", f"{direct:.2f} s",
             f"one forward run {plain:.2f} s: {runs:.2f} runs, {(runs - 1) / n:.2f} more per parameter "
             "(perturbed runs: 1.00)")  # fmt: skip


def test_sensitivities_of_solid_elements_cost_a_fraction_of_a_run(measured):
    model, values, times = stretched(brick(16, 8, 4), "solid", 16.0, 8)
    few = directions(4)
    plain, direct = best_of(
        [lambda: list(march(model, values, times)), lambda: list(march(model, values, times, few))], 3)
    report(measured, "512 hex8, elastoplastic, 8 frames", plain, direct, len(few))
    assert (direct / plain - 1) / len(few) < 0.5


def test_sensitivities_of_the_open_case_cost_a_fraction_of_a_run(measured, shared_data):
    forward = build_forward(load_experiment(shared_data("open-case-1-plate-with-hole-elastoplastic")))
    parameters = forward.model.parameters
    names = [name for name in parameters.free if forward.moves(name)]

    def run(names):
        return lambda: [None for _ in forward.march(parameters, names)]

    plain, direct = best_of([run(()), run(names)], 2)
    mesh = forward.body.mesh
    body = f"open case 1, {sum(b.n_elements for b in mesh.blocks)} {mesh.blocks[0].cell}, {len(forward.frames)} frames"
    report(measured, body, plain, direct, len(names))
    assert (direct / plain - 1) / len(names) < 0.5
