"""A course that the data give is screened as one: its knots count together, and it stands for a candidate where no
screened course of any candidate comes near it.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from side_twins import TIMES, Side, write_folder
from test_evidence import N_NODES, T, made
from test_revision import ranked

from idic.diagnose import Columns, Variant, candidate_library, null_model, residual_evidence, score, screen_candidates
from idic.diagnose.residual.grey_value_effects import LIGHT, columns_of_kind
from idic.diagnose.screen.significance import significances
from idic.diagnose.screen.effect_sizes import effect_sizes
from idic.diagnose.screen.free_courses import fewest_knots, with_free_courses, with_knots
from idic.diagnose.screen.score_columns import score_columns
from idic.diagnose.screen.select import proposed
from idic.diagnose.screen.situation import situation
from idic.experiment_file import load_experiment, read_toml
from idic.identification import identify

KNOTS = (1, 2, 3)  # columns of a course; 0 is a column of its own


def scored(seed):
    rng = np.random.default_rng(seed)
    evidence = made(rng)
    columns = Columns(("one", "a", "b", "c"), rng.standard_normal((T, 2 * N_NODES, 4)), rng.standard_normal((T, 1, 4)))
    return columns, score(evidence, null_model(evidence, columns.pick([])), columns).with_sums(("course",), [KNOTS])


def test_the_sum_of_knots_promises_what_they_promise_together_at_amplitude_one():
    columns, scores = scored(3)
    assert scores.gain([4]) == pytest.approx(scores.gain(KNOTS), rel=1e-9)
    assert scores.expected_change[4] == pytest.approx(1.0) and scores.z[4] ** 2 == pytest.approx(scores.gain(KNOTS))
    together = scores.together(KNOTS)
    summed = Columns(("course",), columns.fields[..., 1:] @ together[:, None],
                     columns.channels[..., 1:] @ together[:, None])
    evidence, nothing = made(np.random.default_rng(3)), columns.pick([])
    ways = np.append(0.0, together)[:, None]
    (size,) = effect_sizes(evidence, nothing, columns, ways, np.zeros((0, 1)))
    (alone,) = effect_sizes(evidence, nothing, summed, np.ones((1, 1)), np.zeros((0, 1)))
    for name in ("px", "local_px", "channel_std"):
        assert getattr(size, name) == pytest.approx(getattr(alone, name))


def test_under_noise_a_course_is_as_significant_as_chance_makes_it():
    """Three knots promise 3 of chi-square on the mean; their statistic is unit normal all the same."""
    groups, signs = {"alone": [0], "course": [4]}, np.zeros(5)
    found = [significances(scored(seed)[1], groups, signs, np.random.default_rng(1), {4: KNOTS},
                           draws=200)["course"].statistic
             for seed in range(150)]
    assert abs(np.mean(found)) < 0.25 and abs(np.std(found) - 1.0) < 0.2


def test_rounding_of_the_scores_does_not_draw_other_noise():
    """Scores that are independent leave the eigenvectors of their correlation open, and so it is with nearly all of a
    library: a p-value that followed them would change by its error of 4000 draws, a sixth, with any last digit."""
    scores, rng, n = scored(3)[1], np.random.default_rng(5), 30
    p_values = []
    for _ in range(2):
        last_digits = 1e-14 * rng.standard_normal((n, n))
        independent = replace(scores, names=tuple(map(str, range(n))), U=np.full(n, 3.5), gross=np.eye(n),
                              information=np.eye(n) + last_digits + last_digits.T)
        p_values.append(significances(independent, {"all": range(n)}, np.zeros(n), np.random.default_rng(1))["all"])
    assert p_values[1].p_familywise == pytest.approx(p_values[0].p_familywise, rel=1e-6)
    assert p_values[0].p_familywise == pytest.approx(n * stats.norm.sf(p_values[0].statistic), rel=0.4)


def test_of_many_scans_those_stay_that_explain_something():
    """Each has a knot of its own: all sets of twenty would be a million."""
    n, shown = 20, [3, 4, 11]
    U = np.where(np.isin(np.arange(n), shown), 12.0, 0.5)
    scans = replace(scored(3)[1], names=tuple(map(str, range(n))), U=U, gross=np.eye(n), information=np.eye(n))
    assert fewest_knots(scans, range(n)) == shown == fewest_knots(scans, range(8)) + [11]


def test_a_knot_that_is_left_out_is_locked_once():
    knots = tuple(f"scanner.magnification_knot[{k}]" for k in (2, 3))
    variant = Variant("scans", {"dof": [{"name": name} for name in knots]}, knots, {}, {}, free_course=True)
    assert with_knots(variant, knots[:1]).edits["dof"] == [
        {"name": knots[0]}, {"name": knots[1], "value": 0.0, "identify": False}]


def test_of_two_courses_that_explain_as_much_the_one_with_fewer_knots_is_taken():
    """The last two knots together imitate a parameter: with all three free, the course is open."""
    columns, scores = scored(3)
    near = columns.fields[..., [2]] + columns.fields[..., [3]]
    evidence, parameter = made(np.random.default_rng(3)), Columns(("E",), near + 1e-4, columns.channels[..., [0]])
    found = score(evidence, null_model(evidence, parameter), columns)
    # as by the first knot alone
    pushed = replace(found, U=60.0 * found.information[:, 1] / np.sqrt(found.information[1, 1]))
    assert fewest_knots(pushed, KNOTS) == [1]
    one = Variant("drift", {"dof": [{"name": "camera.k1"}]}, ("a", "b", "c"), dict.fromkeys("abc", 0.0),
                  free_course=True)
    kept = with_knots(one, ["a"])
    assert kept.new == ("a",) and [entry.get("identify", True) for entry in kept.edits["dof"]] == [True, False, False]
    assert with_knots(one, ["a", "b", "c"]) is one


def free(name, gain, standing="significant"):
    one = ranked(name)
    return replace(one, gain=gain, standing=standing, variant=replace(one.variant, free_course=True))


def test_a_free_course_is_proposed_only_where_no_screened_course_promises_half_as_much():
    plain = [replace(ranked("force_drift"), gain=100.0), replace(ranked("thermal_expansion"), gain=300.0)]
    assert proposed([*plain, free("force_drift", 590.0)]) == plain
    wandering = free("force_drift", 650.0)
    assert set(map(id, proposed([*plain, wandering]))) == {id(plain[1]), id(wandering)}
    assert proposed([*plain, free("force_drift", 650.0, "small")]) == plain
    unseen = [replace(one, standing="excluded") for one in plain]
    assert wandering in proposed([*unseen, wandering])


@pytest.fixture(scope="module")
def wandering(tmp_path_factory):
    """A record whose load cell goes off and back, identified  # path, Identification, residual, situation"""
    bump = np.exp(-((TIMES - 6.0) / 1.5) ** 2) - np.exp(-16.0)
    path = write_folder(tmp_path_factory.mktemp("wandering") / "twin", Side(force=lambda F: F + 30.0 * bump))
    found = identify(load_experiment(path))
    residual = residual_evidence(found)
    return path, found, residual, situation(found, residual, read_toml(path))


def test_a_load_cell_that_wanders_off_and_back_is_proposed_with_its_course(wandering):
    path, found, residual, here = wandering

    def load(edits):
        return load_experiment(path, edits)

    names = ("force_drift", "force_offset", "grip_slip", "magnification", "machine_compliance")
    trials = [(c, v) for c in candidate_library() if c.name in names for v in c.variants(here)]
    trials += with_free_courses(trials, here.document, found.parameters.free, load)
    labels, columns = score_columns(found, residual, trials, load)
    first = max(screen_candidates(residual.evidence, residual.null, labels, columns).ranked, key=lambda r: r.gain)
    assert first.candidate.name == "force_drift" and first.variant.free_course and first.standing == "significant"
    course = np.interp(TIMES, [0, *(int(name[name.index("[") + 1:-1]) for name in first.start)],
                       [0, *first.start.values()])
    # of its size E takes a part: the load peaks there, too
    assert np.argmax(course) == 6 and course[-1] < 0.2 * course.max()


def test_a_pattern_times_its_course_is_the_response_of_the_whole_model_to_it(wandering):
    """Without `exact` the same variant is answered by a model of its own, less that of its null, which is no change."""
    path, found, residual, here = wandering
    chosen = {"grip_slip": "slips slowly along x from 4.4", "grip_rotation": "turns (ux)"}
    trials = [(c,
    v) for c in candidate_library() if c.name in chosen for v in c.variants(here) if chosen[c.name] in v.label]
    assert {c.name for c, _ in trials} == set(chosen)
    answers = [score_columns(found, residual, [(c, replace(v, exact=exact)) for c, v in trials],
                             lambda edits: load_experiment(path, edits))
               for exact in (True, False)]
    for one, other in zip(answers[0][0], answers[1][0], strict=True):
        assert one.name == other.name
    timed, whole = (columns.expanded().fields for _, columns in answers)
    assert np.allclose(timed, whole, atol=1e-9 * np.abs(whole).max())
    assert np.allclose(answers[0][1].channels, answers[1][1].channels, atol=1e-9 * np.abs(answers[1][1].channels).max())


def test_one_free_course_per_pattern_whatever_its_screened_courses():
    variants = [Variant(f"drift from {k}", {"dof": [{"name": "channel.F.drift"}]}, ("channel.F.drift",), {}, {})
                for k in range(3)]
    free = ("E", "channel.F.drift_knot[3]", "channel.F.drift_knot[6]")
    loaded = SimpleNamespace(model=SimpleNamespace(parameters=SimpleNamespace(free=free)))
    made_of = with_free_courses([(candidate_library()[0], v) for v in variants], {"channel": [{"column": "F"}]}, ("E",),
                                lambda edits: loaded)
    ((_, one),) = made_of
    assert one.free_course and one.new == ("channel.F.drift_knot[3]", "channel.F.drift_knot[6]")


def test_a_lamp_changes_contrast_and_offset_together():
    names = (("gain", 0), ("gain", 2), ("offset", 0), ("offset", 2), ("blur", 0))
    assert np.array_equal(columns_of_kind(names, LIGHT, 90.0), [[1, 0], [0, 1], [90, 0], [0, 90], [0, 0]])
    assert np.array_equal(columns_of_kind(names, "blur", 90.0), [[0], [0], [0], [0], [1]])
