"""What several experiments are as one: the course of a channel, the options and the increments of the common loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder

from idic.correlation import CorrelationSystem
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import Analysis, Evaluation, Joint, start
from idic.identification.step.state import TrustRegion
from idic.identification.noise.channel_noise import weighted_std
from idic.identification.result import joint_record_notes
from idic.identification.step.increments import MAX_COARSE_REJECTIONS, meets_a_jump
from idic.model import Column
from idic.run import identify_run
from idic.run.joint_result import derived_of_part

OWN_STRENGTH = """
[material.BODY]
law = "j2_power_reference"
E = 2000.0
nu = 0.35
yield_stress = 20.0
K0 = { value = 100.0, unit = "MPa", identify = true, shared = false }
n = { value = 0.2, identify = true }
ep0 = 0.01
"""


@pytest.fixture(scope="module")
def experiment(clean, tmp_path_factory):
    """The standard twin of six frames as it is read."""
    return load_experiment(write_folder(tmp_path_factory.mktemp("joint") / "test", Twin(), ELASTIC + GRIPS + FORCE,
                                        clean))


def logged(experiment, times, noise_std=None):
    """The experiment with a force over other times: a ramp with noise of 1 N."""
    rng, times = np.random.default_rng(1), np.asarray(times, dtype=float)
    force = 1e3 * times / times[-1] + rng.standard_normal(len(times))
    channels = tuple(replace(channel, values=force, noise_std=noise_std) for channel in experiment.model.channels)
    return replace(experiment, model=replace(experiment.model, times=times, channels=channels))


def driven(experiment, course):
    """The experiment with another motion of its grip."""
    return replace(experiment, model=replace(experiment.model, prescribed=tuple(
        replace(one, drive=replace(one.drive, values=np.asarray(course))) if isinstance(one.drive, Column) else one
        for one in experiment.model.prescribed)))


def test_the_noise_of_a_channel_is_that_of_its_own_experiment(experiment):
    """Logs of 24 and 30 readings, the second over uneven times: by the times of the first its ramp is noise."""
    uneven = np.cumsum(np.random.default_rng(2).uniform(0.2, 1.8, 30))
    parts = {"even": logged(experiment, np.arange(24.0)), "uneven": logged(experiment, uneven),
             "stated": logged(experiment, np.arange(9.0), noise_std=2.5)}
    whole = Joint.of(parts).whole
    found = [weighted_std(whole.model, number) for number in range(3)]
    assert found == [weighted_std(part.model, 0) for part in parts.values()]
    assert found[2] == 2.5 and max(found[:2]) < 2.0
    assert [channel.noise_std for channel in whole.model.channels] == [None, None, 2.5]  # no file states it: estimated


def test_a_log_is_judged_by_the_grip_of_its_own_experiment(experiment):
    """Of 24 and 20 frames: by the grip of the other one, a force that was held would be a log that is late."""
    times = np.arange(24.0)
    slow, held = logged(experiment, times), logged(experiment, times[:20])
    stairs = np.repeat(np.arange(8.0), 3)
    slow = driven(replace(slow, model=replace(slow.model, channels=tuple(replace(one, values=stairs)
                                                                         for one in slow.model.channels))), times)
    held = driven(replace(held, model=replace(held.model, channels=tuple(replace(one, values=stairs[:20])
                                                                         for one in held.model.channels))),
                  stairs[:20])
    for parts, of in (({"slow": slow, "held": held}, "slow"), ({"held": held, "slow": slow}, "slow")):
        whole = Joint.of(parts)
        (note,) = joint_record_notes(whole, whole.whole.model.parameters)
        assert note.startswith(f"{of}: force_N: in 16 of the 23 steps in which grip_mm changes")


@pytest.mark.slow  # 10 s of CPU time
def test_a_shorter_experiment_after_a_longer_one_is_identified_with_it(clean, tmp_path):
    images, force = clean
    short = Twin(seed=1, grip=Twin.grip[:5], times=Twin.times[:5])
    paths = [write_folder(tmp_path / "long", Twin(), ELASTIC + GRIPS + FORCE, clean),
             write_folder(tmp_path / "short", short, ELASTIC + GRIPS + FORCE, (images[:5], force[:5]))]
    result = identify_run(paths, tmp_path / "run")
    assert result["status"] == "converged" and result["parameters"]["BODY.E"]["std"] > 0.0


def test_increments_are_halved_where_they_are_more_than_the_intervals_of_all_experiments(experiment):
    joint = Joint.of({"first": experiment, "second": experiment})
    state = replace(start(joint.whole), trust=TrustRegion(rejections=MAX_COARSE_REJECTIONS))
    intervals = experiment.model.n_frames - 1

    def evaluated(*increments):
        n, nothing = len(experiment.model.parameters.free), np.zeros((0, len(experiment.model.parameters.free)))
        system = CorrelationSystem(experiment.model.parameters.free, np.eye(n), np.zeros(n), 1.0, 1.0, np.eye(n),
                                   nothing, (),
                                   generalised=False)
        parts = {name: Evaluation(0, system, np.eye(n), increments=own)
                 for name, own in zip(joint.experiments, increments, strict=True)}
        return joint.combine(parts, dict.fromkeys(parts, 1.0))

    whole, cut = evaluated(intervals, intervals), evaluated(intervals, intervals + 1)
    assert not meets_a_jump(state, joint.whole.model, whole, whole)
    assert meets_a_jump(state, joint.whole.model, cut, whole) and meets_a_jump(state, joint.whole.model, whole, cut)


def test_experiments_of_one_loop_have_the_same_increments_per_frame(experiment):
    finer = replace(experiment, options=replace(experiment.options, substeps=4))
    with pytest.raises(InputError, match="share one schedule") as refused:
        Joint.of({"first": experiment, "second": finer})
    assert all(text in str(refused.value) for text in ("[options] substeps", "none given, as in first", "4 in second"))
    assert Joint.of({"first": finer, "second": finer}).whole.options.substeps == 4


def test_a_constant_of_a_law_belongs_to_the_experiment_whose_parameter_it_follows_from(clean, tmp_path):
    """K = K0 ep0^-n with a strength of each specimen and one exponent."""
    own = load_experiment(write_folder(tmp_path / "own", Twin(), OWN_STRENGTH + GRIPS + FORCE, clean))
    joint = Joint.of({"short": own, "long": own})
    free = joint.whole.model.parameters.free
    assert set(free) == {"short.BODY.K0", "long.BODY.K0", "BODY.n"}
    parameters = joint.whole.model.parameters.with_values({"short.BODY.K0": 100.0, "long.BODY.K0": 110.0})
    system = CorrelationSystem(free, np.diag([1e6 / parameters[name].slope() ** 2 for name in free]), np.zeros(3), 1.0,
                               1.0, np.zeros((3, 3)), np.zeros((0, 3)), (), generalised=False)
    analysis = Analysis(joint.whole, parameters, Evaluation(0, system, np.zeros((3, 3))), 1.0, joint_names=joint.names)
    derived = analysis.summary()["derived"]
    K = 0.01**-0.2
    assert {label: entry["value"] for label, entry in derived.items()} == pytest.approx(
        {"short.BODY.K": 100.0 * K, "long.BODY.K": 110.0 * K})
    # of one of them: its own, and what belongs to all
    ratios = {"BODY.C/Q": {"of": "all"}, "short.BODY.E1/E2": {"of": "short"}, "short.BODY.E1/long.BODY.E1": {}}
    assert derived_of_part(derived | ratios, "short", joint.experiments) == {
        "BODY.K": derived["short.BODY.K"], "BODY.C/Q": {"of": "all"}, "BODY.E1/E2": {"of": "short"}}
