"""A point whose increments had to be cut, and one near it whose increments did not: their functionals say little."""

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import TRUTH
from twin_runs import identify as identify_in_a_run

from idic.experiment_file import load_experiment
from idic.identification import Trial, evaluate_at, identify, start
from idic.identification.loop import advance
from idic.identification.step.acceptance import MAX_PHI_RATIO_WITH_FEWER_CUTS
from idic.run import SerialRunner
from idic.run.prepared.session import open_session
from idic.run.store.state_file import load_state
from idic.run.store.system_store import load_evaluation


def known_noise(experiment):
    return replace(experiment, recording=replace(experiment.recording,
                                                 noise=replace(experiment.recording.noise, std_gv=2.0)))


@pytest.fixture(scope="module")
def points(plain):
    """(state after the first point, the point, a second one that is a little worse) of an experiment."""
    experiment = known_noise(load_experiment(plain[0]))
    local = np.zeros((experiment.model.n_frames, 0))
    begin = {"BODY.E": 1.05 * TRUTH["E"], "BODY.nu": TRUTH["nu"]}
    first, weights = evaluate_at(experiment, begin, local)
    state = replace(start(experiment), trial=Trial(begin))
    state = advance(state, experiment, replace(first, number=0), None, weights.image_noise)
    worse, _ = evaluate_at(experiment, {**begin, "BODY.E": 1.055 * TRUTH["E"]}, local)
    assert first.system.phi < worse.system.phi < MAX_PHI_RATIO_WITH_FEWER_CUTS * first.system.phi
    return experiment, state, replace(first, number=0), replace(worse, number=1), weights.image_noise


def judged(points, before, after, scale=1.0):
    """Whether the second point is accepted, where the two took so many increments; its functional times `scale`."""
    experiment, state, first, worse, noise = points
    system = replace(worse.system, phi=scale * worse.system.phi, phi_image=scale * worse.system.phi_image)
    following = advance(state, experiment, replace(worse, system=system, increments=after),
                           replace(first, increments=before), noise)
    return following.has_accepted(1)


def test_a_worse_point_is_accepted_where_fewer_increments_were_cut(points):
    assert not judged(points, 0, 0) and not judged(points, 7, 7)
    assert judged(points, 8, 7)


def test_more_cuts_or_a_much_worse_point_are_a_rejected_step(points):
    assert not judged(points, 7, 8)
    assert not judged(points, 8, 7, scale=2.0 * MAX_PHI_RATIO_WITH_FEWER_CUTS)


def test_a_simulation_whose_increments_are_unknown_is_judged_by_its_functional(points):
    assert not judged(points, 8, 0)


def test_the_number_of_increments_comes_with_every_point_and_is_kept_with_a_run(plain, tmp_path):
    found = identify(known_noise(load_experiment(plain[0])))
    assert found.point.increments == len(found.steps) >= found.experiment.model.n_frames - 1
    identify_in_a_run(plain[0], tmp_path / "run")
    session = open_session(tmp_path / "run", SerialRunner(), "direct")
    kept = load_evaluation(session.context.store, load_state(tmp_path / "run").accepted.number, session.context.names)
    assert kept.increments == found.point.increments
