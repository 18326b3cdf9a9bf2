"""Where a long increment finds no equilibrium it is halved, and the functional jumps: finer ones lead across.

One parameter with a functional that is written down; the loop itself walks on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import FORCE, GRIPS, Twin, write_folder

from idic.correlation import CorrelationSystem
from idic.experiment_file import load_experiment
from idic.identification.loop import advance
from idic.identification import Evaluation, start

STD, ROOT, EDGE = 0.01, 12.0, 9.0  # scaled; of the functional, and where an increment is cut, standard deviations
BODY = """
[material.BODY]
law = "j2_linear"
E = { value = 1200, unit = "MPa", identify = true }
nu = { value = 0.25 }
yield_stress = { value = 10, unit = "MPa" }
hardening_modulus = { value = 10, unit = "MPa" }
"""


@pytest.fixture(scope="module")
def experiment(clean, tmp_path_factory):
    return load_experiment(write_folder(tmp_path_factory.mktemp("cut") / "test", Twin(), BODY + GRIPS + FORCE, clean))


def walk(experiment, rise):
    """The loop from x = 0; `rise` (x) is added to (x - ROOT)^2 behind EDGE, where one increment per frame is cut and
    shows a root far beyond."""
    begin, state, accepted, tried = experiment.model.parameters["BODY.E"], start(experiment), None, []
    while state.running:
        per_frame = state.increments.per_frame or 1
        value = replace(begin, value=state.trial.values["BODY.E"])
        x = (value.to_scaled() - begin.to_scaled()) / STD
        slope, M, cut = value.slope(), STD**-2, x > EDGE and per_frame == 1
        phi, root = 1000.0 + (x - ROOT) ** 2 + (rise(x) if cut else 0.0), ROOT + (30.0 if cut else 0.0)
        unscaled = np.array([[M / slope**2]])
        system = CorrelationSystem(("BODY.E",), unscaled, np.array([M * STD * (root - x) / slope]), phi, phi, unscaled,
                                   np.zeros((0, 1)), (), generalised=False)
        point = Evaluation(len(tried), system, np.zeros((1, 1)), increments=5 * per_frame + cut)
        tried.append((x, per_frame))
        state = advance(state, experiment, point, accepted, 1.0)
        if state.has_accepted(point.number):
            accepted = point
    end = replace(begin, value=state.accepted.values["BODY.E"])
    return state, (end.to_scaled() - begin.to_scaled()) / STD, tried


def test_finer_increments_lead_across_a_jump_where_increments_are_cut(experiment):
    state, end, _ = walk(experiment, lambda x: 400.0)
    assert state.status == "converged" and abs(end - ROOT) < 0.1
    assert state.increments.per_frame > 1


def test_given_increments_stay_and_the_search_ends_before_the_jump(experiment):
    given = replace(experiment, options=replace(experiment.options, substeps=1))
    state, end, tried = walk(given, lambda x: 400.0)
    assert {per_frame for _, per_frame in tried} == {1}
    assert state.status == "stalled" and end < EDGE
