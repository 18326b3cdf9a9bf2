"""The parts of a study: windows of frames, noise in memory, cases by name, and what the figures count as right."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.images import ArrayStack, LeadingFrames, NoisyStack
from idic.model import build_forward, leading_frames
from idic_studies.pages.bulge_page import ended_right
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_charts import chance
from idic_studies.cases.bulge import SKETCH_SIZE, elastic_strip, reference_form, scaled
from idic_studies.cases.registry import make_study
from idic_studies.examples.bulge import write_bulge_model


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A function of overrides: the small bulge test, its images rendered once."""
    folder = tmp_path_factory.mktemp("bulge")
    clean = write_bulge_model(folder, SKETCH_SIZE)
    stack = ArrayStack(np.stack([clean.frame(k) for k in range(clean.n_frames)]))
    return lambda overrides=None: load_experiment(folder, overrides, stack=stack)


def test_a_window_is_the_test_with_its_later_frames_left_out(rendered):
    from dataclasses import replace

    whole = rendered(elastic_strip(1.1))
    window = leading_frames(whole, 4)
    assert window.model.n_frames == len(window.recording.labels) == window.recording.stack.n_frames == 4
    excluded = replace(whole, recording=replace(whole.recording, excluded=tuple(range(4, whole.model.n_frames))))
    first, second = identify(window), identify(excluded)
    for name in whole.model.parameters.free:  # the same sums in the same order: what comes later has no influence
        assert first.parameters[name].value == second.parameters[name].value
        assert first.result["parameters"][name]["std"] == second.result["parameters"][name]["std"]


@pytest.mark.parametrize("n", [1, 10])
def test_a_window_outside_the_test_is_refused(rendered, n):
    with pytest.raises(InputError, match="window"):
        leading_frames(rendered(), n)


def test_the_noise_of_a_frame_depends_on_seed_and_frame_alone():
    clean = ArrayStack(np.zeros((3, 200, 300), dtype=np.float32))
    noisy = NoisyStack(clean, 0.5, 7)
    later = noisy.frame(2)
    assert np.array_equal(NoisyStack(clean, 0.5, 7).frame(2), later) and later.dtype == np.float32
    assert np.std(later) == pytest.approx(0.5, rel=0.01)  # 60000 values: 0.3 %
    for other in (noisy.frame(0), NoisyStack(clean, 0.5, 8).frame(2)):
        assert abs(np.corrcoef(later.ravel(), other.ravel())[0, 1]) < 0.02


def test_only_the_first_frames_of_a_stack_are_there():
    stack = LeadingFrames(ArrayStack(np.arange(24.0).reshape(4, 2, 3)), 2)
    assert stack.shape == (2, 3) and stack.frame(1)[0, 0] == 6.0
    with pytest.raises(IndexError):
        stack.frame(2)


def test_both_forms_of_the_law_start_with_the_same_strip(rendered):
    overrides, truth = reference_form(1.3)
    by_k, by_k0 = rendered(scaled(1.3)), rendered(overrides)
    last = [list(build_forward(e).march(e.model.parameters))[-1].u for e in (by_k, by_k0)]
    np.testing.assert_allclose(last[0], last[1], atol=1e-9)  # mm; start values are written with six digits
    assert truth["strip.K0"] == pytest.approx(338.0 * 2e-3**0.83)


def test_a_strip_that_never_yields_has_two_unknowns(rendered):
    experiment = rendered(elastic_strip())
    assert experiment.model.parameters.free == ("elastomer.C10", "strip.E")


def test_cases_are_chosen_by_group_or_name():
    study = make_study("bulge", "reduced")
    assert len({case.key for case in study.cases}) == len(study.cases)
    assert len(study.select(["starts"])) == 20 and [c.key for c in study.select(["guess/13?"])] == ["guess/130"]
    assert study.select(None) == study.cases
    with pytest.raises(InputError, match="no such case"):
        study.select(["start"])
    with pytest.raises(InputError, match="no study"):
        make_study("bulges", "full")


def record(error, std, noise=0.0, status="converged", noise_units=1.0):
    arrays = {"value": np.array([1.0 + error]), "truth": np.ones(1), "std": np.array([std])}
    return CaseRecord("starts/00", {"names": ["a.E"], "case": {"noise": noise}, "status": status,
                                    "noise_units": noise_units}, arrays)


def test_an_end_is_right_within_its_error_bars_or_without_noise_within_a_thousandth():
    assert ended_right(record(2e-3, 1e-3)) and not ended_right(record(4e-3, 1e-3))
    assert ended_right(record(9e-4, 1e-5)) and not ended_right(record(9e-4, 1e-5, noise=0.1))


def test_an_identification_that_leaves_the_images_unexplained_says_so():
    assert record(0.0, 1.0).explained
    assert not record(0.0, 1.0, noise_units=20.0).explained and "20" in record(0.0, 1.0, noise_units=20.0).outcome
    assert not record(0.0, 1.0, status="max_iterations").explained
    nothing = record(0.0, 1.0, status="forward_failed")
    del nothing.facts["noise_units"]  # no simulation, no residual
    assert nothing.outcome == "forward failed" and not nothing.explained


def test_the_band_of_chance_holds_as_many_standard_deviations_as_it_says():
    low, high = chance(20)
    found = np.random.default_rng(0).normal(size=(4000, 20)).std(axis=1, ddof=1)
    assert np.mean((found > low) & (found < high)) == pytest.approx(0.99, abs=0.005)  # 4000 draws: std 0.0016
