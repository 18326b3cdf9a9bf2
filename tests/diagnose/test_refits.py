"""Around a refit: where it begins, when a rival is given up, who is left out, and what a resumed diagnosis knows."""

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from side_twins import ANY_SIZE, TOML, Side, write_folder

from idic.diagnose import (
    Candidate, Columns, Evidence, Fit, JUDGEMENT, Misfit, Ranked, RefitJob, Round, ScoreColumn, Variant,
    residual_evidence, run_refit, screen_candidates,
)
from idic.diagnose.selection.rival import Rival
from idic.diagnose.caution_texts import place_cautions
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import (
    EarlyStop, GIVEN_UP, MAX_BODY_EVALUATIONS, MIN_BODY_EVALUATIONS, MIN_NULL_SHARE, Start, refit, refit_residual,
    residual_from_rest, warm_start,
)
from idic.diagnose.remainder import unlimited_excess
from idic.diagnose.residual.evidence import FrameEvidence
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.residual.heldout import grid_of, pooled
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import CHOICE
from idic.diagnose.selection.moves.both_copies import judged_on_both, undecided
from idic.diagnose.selection.moves.shortlist import are_opposite
from idic.diagnose.selection.rival import judge
from idic.diagnose.selection.rivals import (MAX_PARALLEL_REFITS, alternatives, most_body_evaluations, next_wave,
                                             opposite_place, refitted)
from idic.diagnose.selection.state import Setting
from idic.errors import NotConverged
from idic.experiment_file import load_experiment
from idic.identification import AcceptedPoint, LoopState, Trial, identify
from idic.run import run_refits
from idic.run.diagnosis.refits import RefitStore, job_hash
from idic.run.diagnosis.source import Source


def candidate(name, limits=(), family="elastic_form"):
    return Candidate(name, family, name, "none", {}, (), lambda situation: (), limits)


def ranked(variant, amplitude=1.0, gain=100.0, bias=None, name="one", limits=(), family="elastic_form"):
    return Ranked(candidate(name, limits, family), 0, variant, variant.label, 10.0, 1e-9, amplitude, 0.1, 0.5, gain,
                  0.1, 0.1, bias or {}, "significant")


STIFF = Variant("spot", {}, ("s",), {"s": 1.0}, {"s": 0.8})
YIELD = Variant("yields", {}, ("sy", "H"), {"sy": np.inf, "H": 0.0}, {"sy": 20.0, "H": 300.0})


def test_a_refit_begins_where_the_score_expects_the_model():
    start = warm_start(ranked(STIFF, -1.5, bias={"E": 50.0}), {"E": 1000.0, "nu": 0.3})
    assert start == {"E": pytest.approx(1050.0), "nu": 0.3, "s": pytest.approx(1.3)}


def test_a_place_that_seems_softer_is_tried_as_a_stiffer_one_elsewhere_too():
    """A stiff middle and a soft end leave nearly the same motion; noise lets the end score higher."""
    rng, n = np.random.default_rng(0), 12
    middle, side = rng.standard_normal((2, 1, n))
    fields = np.stack([-middle, middle + 0.1 * side, side], axis=-1)  # of the probes at three places, softer each
    evidence = made_evidence((-2.0 * fields[0, :, 1] + 0.1 * side[0]) / np.sqrt(2.0))  # white: less the reference
    columns = Columns(("end", "middle", "side"), fields, np.zeros((1, 1, 3)))
    trials = [ScoreColumn(candidate("spot"), replace(STIFF, label=name, place=(0.0, 0.0, z)), name)
              for name, z in zip(columns.names, (0.1, 0.4, 0.7), strict=True)]
    screening = screen_candidates(evidence, columns.pick([]), trials, columns, practical=ANY_SIZE)
    best = screening.ranked[0]
    other = opposite_place(screening, best)
    assert {best.label, other.label} == {"end", "middle"}
    starts = {r.label: warm_start(r, {})["s"] for r in (best, other)}
    assert starts["middle"] == pytest.approx(1.4, abs=0.05) and starts["end"] == pytest.approx(0.6, abs=0.05)
    lawful = replace(screening, trials=tuple(replace(t, variant=replace(t.variant, place=None)) for t in trials))
    assert opposite_place(lawful, best) is None


def spot(name, z, stiffness, achieved):
    """A refit of an inclusion at a height z that explains as much on both copies."""
    fit, stem = leaving(50.0), "BODY.inclusion"
    values = {"s": stiffness, f"{stem}.stiffness": stiffness, f"{stem}.radius": 0.2, f"{stem}.x": 0.1, f"{stem}.y": 0.3,
              f"{stem}.z": z}
    refitted_spot = made(name="spot", label=name, choice=fit, judgement=fit, values=values,
                         stds=dict.fromkeys(values, 0.01))
    variant = replace(STIFF, label=name, place=(0.1, 0.3, z))
    return Rival(ranked(variant, name="spot"), refitted_spot, achieved, achieved, achieved, practical=ANY_SIZE)


@pytest.mark.parametrize(("achieved", "share"), [(100.0, 50), (108.0, 98)])
def test_two_places_that_the_recording_does_not_tell_apart_are_told_with_their_odds(achieved, share):
    """16 of chi-square on both copies: the sign of the difference is kept in 98 % of repeated noise."""
    winner = replace(spot("middle", 0.4, 2.0, achieved), rival_place=spot("end", 0.1, 0.5, 100.0))
    entry = Round(SimpleNamespace(), made(name="null"), (winner,), winner, source=Source("nowhere", {}))
    (text,) = place_cautions([entry], "mm")
    assert f"softer (0.5) within 0.2 mm of (0.1, 0.3, 0.1) mm. Odds {share}:{100 - share}" in text
    assert place_cautions([replace(entry, winner=replace(winner, rival_place=None))], "mm") == []
    assert are_opposite(winner, winner.rival_place)
    assert not are_opposite(winner, spot("middle again", 0.41, 1.9, 100.0))


def made_evidence(q):
    """One frame of unit weights with this right-hand side, one silent channel."""
    part = FrameEvidence(sparse.csr_array(sparse.eye_array(len(q))), q, np.zeros(1), np.zeros((len(q) + 1, 0)),
                         np.zeros((0, 0)), np.zeros(0))
    return Evidence(np.array([1]), np.arange(len(q)), np.ones(1), np.tile(np.eye(2), (1, len(q) // 2, 1, 1)),
                    np.ones(1), 1.0, 100, (part,))


def test_a_promise_beyond_first_order_is_cut():
    start = warm_start(ranked(STIFF, 30.0, bias={"E": -9000.0}), {"E": 1000.0})
    assert start["s"] == MIN_NULL_SHARE  # 1 - 30 * 0.2 would be a stiffness below zero
    assert start["E"] == pytest.approx(600.0)


def test_where_the_null_is_infinite_the_probe_is_the_start_and_the_others_go_along():
    start = warm_start(ranked(YIELD, 4.0, bias={"E": 80.0}), {"E": 1000.0})
    assert (start["sy"], start["H"]) == (20.0, 300.0)
    assert start["E"] == pytest.approx(1020.0)  # 80 belongs to an amplitude of 4, the probe is one


@pytest.mark.parametrize(("phis", "lost"), [((100.0, 60.0), False), ((100.0, 60.0, 58.0), True),
                                            ((100.0, 60.0, 30.0), False), ((100.0, 12.0, 10.5), False)])
def test_a_rival_is_given_up_if_three_times_its_last_gain_cannot_match_the_best(phis, lost):
    assert EarlyStop(null=100.0, best=10.0).cannot_win(phis) is lost


def test_a_larger_model_waits_for_its_limit_unless_it_promises_more():
    small, large = ranked(YIELD, gain=100.0, name="flow"), ranked(YIELD, gain=105.0, name="rate", limits=("flow",))
    assert alternatives((small, large)) == [small]
    assert alternatives((small, replace(large, gain=200.0))) == [small, replace(large, gain=200.0)]
    assert alternatives((large,)) == [large]


GRID = Grid(np.zeros((4, 2)), np.zeros(2), np.ones(2), np.array([3, 2]))


def job(**changes):
    given = {"name": "one", "source": Source("nowhere", {}), "labels": ("a",), "edits": ({"x": 1.0},),
             "values": ({"E": 1.0},),
                 "local": np.zeros((3, 1)), "grid": GRID, "target": 5.0, "seed": 3}
    return RefitJob(**given | changes)


def made(**changes):
    rng = np.random.default_rng(0)
    one = Misfit(np.arange(1, 4), rng.random(3), np.array([7, 8, 9]), rng.random((3, 2)), 0.4)
    given = {"name": "one", "label": "a", "status": "converged", "values": {"E": 1.1, "sy": float("inf")},
                 "stds": {"E": 0.1, "sy": None}, "local": rng.random((3, 1)), "steps": np.array([1.0, 2.0]),
                 "choice": one,
                 "judgement": None, "evaluations": 4, "problem": "", "phi": 3.5}
    return Fit(**given | changes)


def test_a_stored_refit_comes_back_as_it_was(tmp_path):
    store, refit = RefitStore(tmp_path, resume=False), made()
    store.put(job(), refit)
    again = RefitStore(tmp_path, resume=True).get(job())
    for name in ("name", "label", "status", "values", "stds", "evaluations", "problem", "judgement", "phi"):
        assert getattr(again, name) == getattr(refit, name)
    np.testing.assert_array_equal(again.local, refit.local)
    np.testing.assert_array_equal(again.steps, refit.steps)
    for name in ("frames", "gain", "rank", "channels", "pixels"):
        np.testing.assert_array_equal(getattr(again.choice, name), getattr(refit.choice, name))


@pytest.mark.parametrize("change", [{"values": ({"E": 1.0 + 1e-15},)}, {"edits": ({"x": 2.0},)}, {"seed": 4},
                                    {"local": np.ones((3, 1))}, {"labels": ("b",)}, {"copies": False},
                                    {"early_stop": EarlyStop(2.0, 1.0)}, {"most_evaluations": 12}, {"swapped": True},
                                    {"borrowed": "a"},
                                    {"grid": replace(GRID, cells=np.array([3, 3]))},
                                    {"source": Source("nowhere", {"y": 1})}])
def test_another_job_is_not_taken_for_a_stored_one(change, tmp_path):
    store = RefitStore(tmp_path, resume=False)
    store.put(job(), made())
    assert store.get(job(**change)) is None and store.get(job()) is not None


def test_a_refit_of_another_version_is_made_again(tmp_path, monkeypatch):
    store = RefitStore(tmp_path, resume=False)
    store.put(job(), made())
    known = job_hash(job())
    monkeypatch.setattr("idic.__version__", "9.9.9")
    assert job_hash(job()) != known and RefitStore(tmp_path, resume=True).get(job()) is None


@pytest.mark.parametrize("damage", ["cut", "empty", "flipped", "other"])
def test_a_refit_whose_file_cannot_be_read_is_made_again(damage, tmp_path):
    store = RefitStore(tmp_path, resume=False)
    store.put(job(), made())
    (file,) = store.run.rglob("*.npz")
    content = file.read_bytes()
    flipped = bytes(byte ^ (k % 7 == 0) for k, byte in enumerate(content))
    file.write_bytes({"cut": content[:len(content) // 2], "empty": b"", "flipped": flipped, "other": b"text"}[damage])
    assert store.get(job()) is None
    store.put(job(), made())
    assert store.get(job()) is not None


@pytest.mark.parametrize("change", [{"values": ["E"]}, {"values": {"E": "1"}}, {"problem": None}, {"more": 1},
                                    {"choice": "much"}, {"local": np.array(["a"])}, {"choice.gain": np.ones(7)}])
def test_a_refit_of_other_types_is_made_again(change, tmp_path):
    store = RefitStore(tmp_path, resume=False)
    store.put(job(), made())
    (file,) = store.run.rglob("*.npz")
    with np.load(file) as stored:
        arrays = dict(stored)
    arrays |= {name: value for name, value in change.items() if isinstance(value, np.ndarray)}
    plain = json.loads(str(arrays["plain"]))
    plain |= {name: value for name, value in change.items() if not isinstance(value, np.ndarray)}
    np.savez(file, **arrays | {"plain": np.array(json.dumps(plain))})
    assert store.get(job()) is None


def test_a_new_diagnosis_forgets_the_refits_of_the_last_one(tmp_path):
    RefitStore(tmp_path, resume=False).put(job(), made())
    assert RefitStore(tmp_path, resume=False).get(job()) is None


class Counting:
    """Makes refits without computing, and dies at one of them."""

    workers = 1

    def __init__(self, dies_at=None):
        self.dies_at, self.done = dies_at, []

    def stream(self, function, jobs, names, retries=0, copies=False):
        for one in jobs:
            if one.name == self.dies_at:
                raise KeyboardInterrupt
            self.done.append(one.name)
            yield made(name=one.name)


def test_a_resumed_diagnosis_computes_only_unfinished_refits(tmp_path):
    jobs = [job(name=name) for name in ("one", "two", "three")]
    with pytest.raises(KeyboardInterrupt):
        run_refits(Counting("two"), RefitStore(tmp_path, resume=False), jobs)
    runner = Counting()
    found = run_refits(runner, RefitStore(tmp_path, resume=True), jobs)
    assert runner.done == ["two", "three"] and [refit.name for refit in found] == ["one", "two", "three"]


def test_the_first_refit_runs_alone_and_damage_is_judged_by_the_drops_of_the_others():
    others = [ranked(YIELD, gain=100.0 - k, name=str(k)) for k in range(4)]
    torn = ranked(YIELD, gain=95.0, name="torn")
    torn = replace(torn, candidate=replace(torn.candidate, slow=True))
    waiting, found = [*others, torn], []
    while waiting:
        wave = next_wave(waiting, not found)
        found.append([r.candidate.name for r in wave])
        waiting = waiting[len(wave):]
    assert found == [["0"], ["1", "2"], ["3"], ["torn"]] and MAX_PARALLEL_REFITS == 2


class Answering:
    """A runner of so many workers that answers every refit with numbers made of its job alone, race included."""

    def __init__(self, workers):
        self.workers, self.asked = workers, []

    def stream(self, function, jobs, names, retries=0, copies=False):
        for one in jobs:
            self.asked.append((one.name, one.early_stop))
            rng = np.random.default_rng([len(one.name), *map(ord, one.name)])
            fit = Misfit(np.arange(1, 4), 100.0 * rng.random(3), np.array([7, 8, 9]), np.zeros((3, 1)), 0.4)
            yield made(name=one.name, choice=fit, judgement=fit, phi=float(fit.gain.sum()))


def test_the_number_of_workers_does_not_change_the_refits():
    variants = [ranked(YIELD, gain=300.0 - k, name=f"candidate {k}") for k in range(5)]
    asked = []
    for workers in (1, 2, 4):
        runner = Answering(workers)
        source = Source("nowhere", {})
        worst = Misfit(np.arange(1, 4), np.full(3, 100.0), np.array([7, 8, 9]), np.zeros((3, 1)), 0.4)
        null = made(name="null", choice=worst, judgement=worst, phi=300.0)
        screening = SimpleNamespace(ranked=(), shortlist=tuple(variants), reserve=(), trials=(),
                                    scores=SimpleNamespace(z=np.zeros(0)), practical=ANY_SIZE)
        refitted(source, null, screening, partial(run_refits, runner, None), GRID, 3)
        asked.append(runner.asked)
    assert asked[0] == asked[1] == asked[2] and len(asked[0]) >= 3


def leaving(chi2):
    """A fit that leaves so much beyond noise."""
    return Misfit(np.arange(1, 4), np.full(3, 100.0 + chi2 / 3.0), np.full(3, 100), np.zeros((3, 1)), 0.4)


def asked_for(shortlist, reserve, achieved, left):
    """Who is refitted where every refit explains so much, `left` apart."""
    found = []

    class Even(Answering):
        def stream(self, function, jobs, names, retries=0, copies=False):
            for one in jobs:
                found.append(one.name)
                yield made(name=one.name, choice=leaving(left), judgement=leaving(left), phi=1.0)

    null = made(name="null", choice=leaving(left + achieved), judgement=leaving(left + achieved), phi=2.0)
    screening = SimpleNamespace(ranked=(), shortlist=tuple(shortlist), reserve=tuple(reserve), trials=(),
                                scores=SimpleNamespace(z=np.zeros(0)), practical=ANY_SIZE)
    refitted(Source("nowhere", {}), null, screening, partial(run_refits, Even(1), None), GRID, 3)
    return found


def test_a_candidate_that_promises_nearly_as_much_is_refitted_though_five_others_promise_more():
    """First order is off by a fifth for a large effect: the sixth may be the cause."""
    first = [ranked(YIELD, gain=1e5 - k, name=f"candidate {k}") for k in range(5)]
    sixth, seventh = ranked(YIELD, gain=0.85e5, name="sixth"), ranked(YIELD, gain=0.7e5, name="seventh")
    assert asked_for(first, [sixth, seventh], 1e5, 100.0) == [*(r.candidate.name for r in first), "sixth"]
    # the best leaves a fifth: more may be wrong with promises
    everything = asked_for(first, [sixth, seventh], 1e5, 2e4)
    assert everything[5:] == ["sixth", "seventh"]
    assert asked_for(first, [replace(sixth, gain=0.4e5)], 1e5, 2e4)[5:] == []


def test_what_yields_is_refitted_whatever_first_order_promises_of_it():
    """A solid that yields, identified as elastic, was told as creep: that explained all, and plasticity promised less.
    """
    first = [ranked(YIELD, gain=1e5 - k, name=f"candidate {k}") for k in range(2)]
    rest = [ranked(YIELD, gain=0.4e5, name=name, family=name) for name in ("elastic_form", "plasticity", "camera")]
    assert asked_for(first, rest, 1e5, 100.0) == [*(r.candidate.name for r in first), "plasticity"]


def test_a_lucky_refit_of_a_faint_cause_keeps_no_rival_from_its_own():
    """A drift at 5 standard deviations brought 31 on its copy where 14 were promised; the offset, the truth, promised
    13.5, less than half of 31."""
    drift, offset, other = (ranked(YIELD, gain=gain, name=name)
                            for gain, name in ((14.4, "drift"), (13.5, "offset"), (7.0, "other")))
    assert asked_for([drift, offset, other], [], 31.2, 20.0) == ["drift", "offset"]
    # what is clear is no luck: half of 300 is asked for
    law, half = ranked(YIELD, gain=100.0, name="law"), ranked(YIELD, gain=95.0, name="half")
    assert asked_for([law, half], [], 300.0, 100.0) == ["law"]


# both copies judge --------------------------------------------------------------------------------
def rival(name, achieved, heldout, usable=True):
    fit = leaving(50.0 - heldout) if usable else None
    return Rival(ranked(YIELD, name=name), made(name=name, label=YIELD.label, choice=fit, judgement=fit), achieved,
                 achieved, heldout, practical=ANY_SIZE)


@pytest.mark.parametrize(("rivals", "names"), [
    ([rival("a", 37.0, 6.0), rival("b", 5.0, -1.0)], ["a", "b"]),  # nobody passes, one would have where it was fitted
    ([rival("a", 37.0, 14.0), rival("b", 30.0, 8.0), rival("c", -4.0, 0.0)], ["a", "b"]),  # a passes, and is not clear
    ([rival("a", 90.0, 40.0), rival("b", 37.0, 6.0)], []),  # clear on one copy
    ([rival("a", 9.0, 4.0), rival("b", 90.0, 4.0, usable=False)], [])])  # nobody shows where it was fitted
def test_both_copies_judge_where_one_leaves_it_open(rivals, names):
    assert [r.name for r in undecided(rivals)] == names


def swapped(rivals, drops, null_usable=True):
    """What both copies say where refits to the second one explain `drops` of what its null leaves, and what was
    asked."""
    asked = []

    def refits(jobs):
        asked.extend(jobs)
        return [made(name=one.name, label=one.labels[0], choice=None if one.name not in drops else leaving(9.0),
                     judgement=leaving(50.0 - drops.get(one.name, 0.0)), values={"E": 2.0}) for one in jobs]

    trials = tuple(SimpleNamespace(candidate=r.ranked.candidate, variant=YIELD) for r in rivals)
    null = made(name="null", choice=leaving(50.0), judgement=leaving(50.0), values={"E": 1.0})
    drops = drops | ({"null": 0.0} if null_usable else {})
    found = judged_on_both(FittedModel(Source("nowhere", {}), null), rivals, SimpleNamespace(trials=trials), refits,
                           GRID, 3)
    return *found, null, asked


def test_the_second_copy_adds_its_drop():
    rivals = (rival("a", 37.0, 6.0), rival("b", 30.0, 5.0))
    (a, b), there, null, asked = swapped(rivals, {"a": 20.0})
    assert [(one.name, one.swapped) for one in asked] == [("null", True), ("a", True), ("b", True)]
    assert a.heldout == pytest.approx(26.0) and a.crossed_judgement is not None
    before, after = Round(None, null, (a, b), a, (), there, source=Source("nowhere", {})).heldout_fits(a)
    assert before.chi2 - after.chi2 == pytest.approx(a.heldout)
    assert before.excess == pytest.approx(100.0 / 600.0)  # 50 on each of two copies with 300 free motions


def test_a_refit_to_the_second_copy_starts_at_its_probe_and_where_the_first_one_ended():
    (a,), _, _, asked = swapped((rival("a", 37.0, 6.0),), {"a": 20.0})
    assert dict(asked[1].values[1]) == {"E": 2.0, **YIELD.probe}  # its own null, its probe
    assert asked[1].values[0] == a.refitted.values and asked[1].borrowed == asked[1].labels[0] != asked[1].labels[1]


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A test that the model explains, and its identification."""
    experiment = load_experiment(write_folder(tmp_path_factory.mktemp("clean") / "test", Side()))
    return experiment, identify(experiment)


@pytest.mark.parametrize(("status", "steps", "counts"), [("converged", 0, True), ("stalled", 0, False),
                                                         ("max_iterations", 1, False), ("max_iterations", 2, True)])
def test_values_of_the_copy_that_judges_count_only_where_a_search_has_left_them(status, steps, counts, clean,
                                                                                monkeypatch):
    """A search that stalls where it starts would be judged on the copy that it was fitted to."""
    experiment, found = clean

    def search(*given, progress, estimator, control, **more):
        for k in range(steps + 1):
            progress(LoopState(Trial({}), AcceptedPoint({}, k, phi=10.0 - k)))
        return replace(found, state=replace(found.state, status=status))

    monkeypatch.setattr("idic.diagnose.refits.refit.identify", search)
    starts = [Start("a", experiment, found.parameters.as_values(), borrowed=True)]
    grid = grid_of(residual_evidence(found))
    assert refit("a", starts, {"a": experiment}, found.local, grid).usable is counts
    assert refit("a", [replace(starts[0], borrowed=False)], {"a": experiment}, found.local, grid).usable


@pytest.fixture(scope="module")
def torn(clean, tmp_path_factory):
    """The same test, whose model loses its stiffness at once beyond a strain: increments fail again and again."""
    law = 'law = "elastic_damage"\nthreshold = 0.006\nsoftening = { value = 400.0, identify = true }'
    path = write_folder(tmp_path_factory.mktemp("torn") / "test", Side(), toml=TOML.replace('law = "elastic"', law))
    return load_experiment(path)


def test_a_refit_that_finds_no_equilibrium_is_given_up_after_as_much_work_every_time(torn, clean):
    """Without a limit a simulation goes on to fail 30 times between two frames."""
    def given_up():
        return refit("damage", [Start("a", torn, {})], {"a": torn}, clean[1].local, GRID, most_evaluations=12)

    first, again = given_up(), given_up()
    assert first.given_up and not first.usable and first.problem == again.problem
    assert GIVEN_UP in first.problem and "evaluations of the body" in first.problem


@pytest.mark.parametrize(("failures", "limit", "told"), [(2, 12, False), (3, 12, True), (3, None, False)])
def test_a_search_is_given_up_when_three_of_its_simulations_failed(failures, limit, told, clean, monkeypatch):
    """A step that fails is halved and often answers then: two failures are a part of a good search."""
    experiment, found = clean

    def search(*given, progress, estimator, control, **more):
        phis = [None if k < failures else 1.0 for k in range(9)]
        history = tuple({"phi": phi, "message": "no equilibrium beyond 3 s"} for phi in phis)
        progress(replace(found.state, history=history))
        return found

    monkeypatch.setattr("idic.diagnose.refits.refit.identify", search)
    start = Start("a", experiment, found.parameters.as_values())
    made = refit("damage", [start], {}, found.local, grid_of(residual_evidence(found)), most_evaluations=limit)
    assert made.usable is not told and made.given_up is told
    assert not told or "3 of " in made.problem and "no equilibrium beyond 3 s" in made.problem


def test_a_rival_may_work_harder_where_the_identified_model_does_and_where_frames_are_few():
    def limit(intervals, increments):
        return most_body_evaluations(made(local=np.zeros((intervals + 1, 1)), steps=np.arange(1.0, increments + 1)))

    assert limit(50, 50) == MAX_BODY_EVALUATIONS and limit(50, 150) == 3 * MAX_BODY_EVALUATIONS
    assert limit(10, 10) == MIN_BODY_EVALUATIONS / 10


def test_a_model_that_is_compared_has_the_error_by_noise_and_the_selected_one_the_whole(clean):
    """The discrepancy costs one more pass over the images, and no comparison of models asks for it."""
    experiment, found = clean
    wrong = experiment.model.parameters.with_values({"BODY.nu": 0.1}).with_free(["BODY.E"])
    at = [Start("a", replace(experiment, model=replace(experiment.model, parameters=wrong)), {})]
    grid = grid_of(residual_evidence(found))
    compared, selected = (refit("a", at, {}, found.local, grid, whole_std=whole) for whole in (False, True))
    own = identify(at[0].experiment, found.local).result["parameters"]["BODY.E"]
    assert compared.stds["BODY.E"] == pytest.approx(own["std_noise"], rel=0.01)  # the last steps differ
    assert selected.stds["BODY.E"] == pytest.approx(own["std"], rel=0.01)
    assert selected.stds["BODY.E"] > 2.0 * compared.stds["BODY.E"]


@pytest.mark.parametrize("answers", [True, False])
def test_the_residual_of_a_fit_that_was_stopped_early_is_measured_at_its_end(answers):
    asked, cut = [], ExcessLeft(leaving(3000.0), leaving(900.0), 1e5)
    null = made(status="max_iterations", judgement=leaving(900.0))

    def refits(jobs):
        asked.extend(jobs)
        return [made(judgement=leaving(1.0), choice=leaving(1.0) if answers else None)]

    found = unlimited_excess(cut, FittedModel(Source("nowhere", {}), null), Setting(refits, None, GRID, 3))
    assert asked[0].unlimited and asked[0].copies and asked[0].values == (null.values,)
    assert found.after.chi2 == pytest.approx(1.0 if answers else 900.0) and found.before is cut.before
    assert cut.matters and found.matters is not answers


def test_a_model_without_equilibrium_from_rest_has_no_residual_and_ends_nothing(tmp_path):
    """Stress that falls behind the yield stress as fast as it rose."""
    law = {"law": "j2_linear", "E": 2000.0, "nu": 0.35, "yield_stress": {"value": 10.0, "identify": True},
           "hardening_modulus": -1900.0}
    experiment = load_experiment(write_folder(tmp_path / "test", Side()), {"material.BODY": law})
    local = np.zeros((experiment.model.n_frames, 1))
    fitted = Fit("softening", "", "converged", experiment.model.parameters.as_values(), {}, local, None, None, None)
    with pytest.raises(NotConverged):
        refit_residual(experiment, fitted)
    assert residual_from_rest(experiment, fitted) is None


def test_a_sum_over_two_copies_has_to_pass_twice():
    (a,), _, _, _ = swapped((rival("a", 37.0, 6.0),), {"a": 20.0})
    assert rival("a", 37.0, 12.0).passes and not rival("a", 37.0, 10.0).passes  # 9 and two unknowns
    assert a.passes and not replace(a, heldout=21.0).passes


def test_a_rival_without_an_answer_on_one_copy_decides_nothing():
    (a, b), _, _, _ = swapped((rival("a", 37.0, 6.0), rival("b", 37.0, 13.0)), {"a": 20.0})
    assert b.failed_on_one_copy and not b.passes and b.refit_failed and not a.failed_on_one_copy


def test_without_a_null_on_the_second_copy_the_first_one_judges_alone():
    rivals = (rival("a", 37.0, 6.0),)
    found, there, _, asked = swapped(rivals, {"a": 20.0}, null_usable=False)
    assert found == rivals and there is None and len(asked) == 1


def test_two_judgements_make_one_without_channels_too():
    one = replace(leaving(30.0), channels=np.zeros((3, 0)))
    assert pooled(one, one).chi2 == pytest.approx(60.0)
    assert pooled(leaving(30.0), leaving(10.0)).channels.shape == (6, 1)


def test_a_swapped_refit_is_fitted_to_the_copy_that_judges_otherwise(tmp_path, monkeypatch):
    experiment = load_experiment(write_folder(tmp_path / "clean", Side()))
    monkeypatch.setattr(Source, "load", lambda self, edits=None: experiment)
    seen = []
    monkeypatch.setattr("idic.diagnose.refits.refit_job.refit", lambda name, starts, other, *rest: seen.append(
        (starts[0].experiment.recording.stack.sign, other["a"].recording.stack.sign)))
    run_refit(job())
    run_refit(job(swapped=True))
    assert seen == [(CHOICE, JUDGEMENT), (JUDGEMENT, CHOICE)]


def test_equals_on_both_copies_differ_by_less_than_nine_on_each():
    def twice(name, achieved, heldout):
        return replace(rival(name, achieved, 0.0), heldout=heldout, crossed_judgement=leaving(0.0),
                       achieved_on_other=achieved)

    screening = SimpleNamespace(separation_chi2=lambda one, other: 1e3)
    assert judge([twice("a", 30.0, 50.0), twice("b", 25.0, 34.0)], screening)[1] == ("b",)
    assert judge([twice("a", 30.0, 60.0), twice("b", 20.0, 24.0)], screening)[1] == ()
    assert judge([rival("a", 30.0, 50.0), rival("b", 20.0, 34.0)], screening)[1] == ()  # on one copy
