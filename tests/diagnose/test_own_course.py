"""The course of a selected cause that is no material: where a ramp leaves something, the data give it, knot by knot."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from experiment_file.small_experiment import load_experiment, write_experiment
from side_twins import ANY_SIZE
from test_revision import Folder, fit, ranked, refit, screening

from idic.diagnose import Round, SUPPOSED_EXPANSION_PER_K, ScoreColumn, Variant, candidate_library
from idic.diagnose.selection.rival import Rival
from idic.diagnose.screen.courses import Course, courses_of
from idic.diagnose.screen.free_courses import free_edits
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.selection.move import moved
from idic.diagnose.selection.moves.own_course import (
    EARLIER_COURSE, MIN_IMITATED_SHARE, OWN_COURSE, has_own_course, with_imitated,
)
from idic.diagnose.selection.rival import leaves_something
from idic.diagnose.selection.state import Setting, State, improvable
from idic.experiment_file import read_toml
from idic.model import KNOTS, nodal_temperature

BOUNDARY = [{"nodes": "TOP", "uy": {"column": "grip_mm", "corrections": [
    {"kind": "compliance", "column": "F"}, {"kind": "rotation", "start_s": 3.0, "course": "ramp"}]}}]


def variant(name, **edits):
    return Variant(name, edits, (name,), {name: 0.0}, {name: 1.0})


def test_a_correction_gets_knots_in_the_place_of_its_course_and_its_neighbours_stay():
    edits = free_edits({}, {"boundary": BOUNDARY}, variant("boundary.TOP.y.rotation"))
    first, second = edits["boundary"][0]["uy"]["corrections"]
    assert first == {"kind": "compliance", "column": "F"}
    assert second == {"kind": "rotation", "course": "free", "knots": KNOTS}
    assert BOUNDARY[0]["uy"]["corrections"][1]["start_s"] == 3.0


def test_a_drift_loses_its_start_and_its_own_degree_of_freedom():
    document = {"channel": [{"column": "F", "drift_from_s": 4.0}, {"column": "G"}]}
    edits = free_edits(document, {"dof": [{"name": "channel.F.drift"}, {"name": "camera.k1"}]},
                       variant("channel.F.drift"))
    assert edits["channel"] == [{"column": "F", "drift_knots": KNOTS}, {"column": "G"}]
    assert edits["dof"] == [{"name": "camera.k1"}]


@pytest.mark.parametrize("name", ["boundary.TOP.y.compliance", "BODY.alpha", "channel.F.scale", "camera.k1"])
def test_what_has_no_course_keeps_none(name):
    assert free_edits({"channel": []}, {"boundary": BOUNDARY, "dof": []}, variant(name)) is None


def under_way(source, winner, seen, refits):
    """A round with a winner, on top of a model that leaves 300 of chi-square."""
    model = FittedModel(source, refit((), 300.0))
    entry = Round(seen, model.fit, (winner,), winner, source=source)
    return State(Setting(refits, None, None, 1), None, model, model, round=entry)


def test_a_fit_that_leaves_only_noise_keeps_its_course():
    quiet = fit(0.0)
    loud = replace(quiet, channels=np.full((10, 1), 3.0))
    assert not leaves_something(quiet) and leaves_something(fit(200.0)) and leaves_something(loud)
    one = ranked("magnification")
    winner = Rival(one, refit(("magnification",), 0.0), 100.0, 300.0, 300.0, practical=ANY_SIZE)

    def no_refits(jobs):
        raise AssertionError("nothing is to be refitted")

    state = under_way(Folder(), winner, screening(), no_refits)
    assert moved(state, [OWN_COURSE]) is state
    assert not has_own_course(winner)


@pytest.mark.parametrize("value, std, onset", [
    ((0.0, 0.1, 0.2, 5.0, 6.0), 1.0, (2, 3)), ((0.0, 4.0, 4.0, 4.0, 4.0), 1.0, (0, 1)),
    ((0.0, 0.1, 2.0, 2.0, 1.0), 1.0, None)])
def test_a_course_begins_between_its_last_frame_at_zero_and_its_first_beyond_noise(value, std, onset):
    assert Course("grip_slip", "x", "mm", np.array(value), np.full(5, std), True).onset == onset


@pytest.mark.parametrize("way, channels, tested",
                         [((0.0, 1.0, 2.0), (), False), ((0.0, 2.0, 0.2), (), True), ((0.0, 1.0, 2.0), ("F",), True)])
def test_damage_is_tested_only_where_a_force_or_a_way_back_tells_it_from_plastic_flow(way, channels, tested):
    damage = next(c for c in candidate_library() if c.name == "damage")
    u = np.array(way)[:, None, None] * np.ones((3, 4, 2))
    here = SimpleNamespace(experiment=SimpleNamespace(model=SimpleNamespace(channels=channels, loads=())), u=u)
    assert (damage.reason_against(here) == "") is tested


@pytest.mark.parametrize("way, share, told",
                         [((0.0, 1.0, 2.0), 1.01, ("nonlinear_elasticity",)), ((0.0, 1.0, 2.0), 0.99, ()),
                                              ((0.0, 2.0, 0.2), 1.01, ())])
def test_where_the_load_only_grows_a_free_drift_is_not_told_from_a_rival_that_explains_nearly_as_much(way, share, told):
    """As of a woven laminate that stiffens: a drift of 9 % of the largest force, along the square of the load."""
    knots = tuple(f"channel.F.drift_knot[{k}]" for k in (2, 4, 6))
    one = ranked("force_drift")
    free = replace(one, variant=replace(one.variant, new=knots))
    drift = Rival(free, replace(refit(("force_drift",), 10.0), stds=dict.fromkeys(knots, 0.1)), 1e4, 1e4, 1e4,
                  practical=ANY_SIZE)
    drop = share * MIN_IMITATED_SHARE * 1e4
    rival = Rival(ranked("nonlinear_elasticity"), refit(("nonlinear_elasticity",), 1e4 - drop), drop, drop, drop,
                  practical=ANY_SIZE)
    u = np.array(way)[:, None, None] * np.ones((3, 4, 2))
    one = Round(screening(), refit((), 1e4), (drift, rival), drift, source=Folder())
    found = with_imitated(one, u)
    assert found.winner is drift and found.equals == told
    # before the course was freed: less than the rival, and more by more than it left
    for factor, equals in ((0.98, told), (1.2, ())):
        before = replace(drift, ranked=ranked("force_drift"), refitted=refit(("force_drift",), 1e4 - factor * drop),
                         heldout=factor * drop, achieved=factor * drop)
        assert with_imitated(replace(one, plain=before), u).equals == equals


ALPHA = "SPECIMEN.alpha"


@dataclass(frozen=True)
class SmallTest:
    """The small experiment as a source: its file with edits."""

    folder: Path
    edits: dict = field(default_factory=dict)

    def load(self, edits=None):
        return load_experiment(self.folder, {**self.edits, **(edits or {})})


def warming(document, course):
    """The variant by which the specimen expands under a course, and its edits with knots."""
    edits = {f"material.{ALPHA}": {"value": 1e-4, "unit": "1/K", "identify": True},
             "boundary": [*document["boundary"], {"temperature": {"course": course}}]}
    plain = Variant("SPECIMEN expands", edits, (ALPHA,), {ALPHA: 0.0}, {ALPHA: 1e-4}, exact=True)
    return plain, free_edits(document, edits, plain)


def test_a_warmth_that_gets_its_own_course_begins_with_the_strain_it_had(tmp_path):
    """Expansion is locked then, at the one in which courses are told in K."""
    source = SmallTest(write_experiment(tmp_path / "test"))
    plain, edits = warming(read_toml(source.folder / "experiment.toml"), [[0.0, 0.0], [3.0, 1.0]])
    knots = tuple(name for name in source.load(edits).model.parameters.free if name.startswith("temperature_knot"))
    free = Variant("temperature", edits, knots, dict.fromkeys(knots, 0.0), dict.fromkeys(knots, 0.0), free_course=True)
    one = replace(ranked("thermal_expansion"), variant=plain)
    values = source.load(plain.edits).model.parameters.as_values() | {ALPHA: 2e-4}
    winner = Rival(one, replace(refit((), 200.0), label=plain.label, values=values), 9.0, 9.0, 9.0, practical=ANY_SIZE)
    seen = replace(screening(("thermal_expansion",)), trials=(ScoreColumn(one.candidate, free, free.label),))
    asked = []

    def refits(jobs):
        asked.extend(jobs)
        return [replace(winner.refitted, choice=None)]

    state = under_way(source, winner, seen, refits)
    assert moved(state, [OWN_COURSE]) is state
    started = source.load(asked[0].edits[0])
    parameters = started.model.parameters
    parameters = parameters.with_starts(parameters.own_of(asked[0].values[0]))  # as `refit` does
    assert parameters[ALPHA].value == SUPPOSED_EXPANSION_PER_K and not parameters[ALPHA].free
    strain = SUPPOSED_EXPANSION_PER_K * nodal_temperature(started.model).at(0.0, parameters)[:, 0]
    assert strain == pytest.approx(2e-4 * started.model.times / 3.0)
    assert parameters["SPECIMEN.E"].value == values["SPECIMEN.E"]
    assert started.model.parameters.own_of({ALPHA: 2e-4, "SPECIMEN.E": 1.0, "elsewhere": 2.0}) == {"SPECIMEN.E": 1.0}


def warm_round(tmp_path, left):
    """A warmth under a ramp that leaves 10 of chi-square in 300, its knots among the trials, and a refit with these."""
    source = SmallTest(write_experiment(tmp_path / "test"))
    plain, edits = warming(read_toml(source.folder / "experiment.toml"), [[0.0, 0.0], [3.0, 1.0]])
    knots = tuple(name for name in source.load(edits).model.parameters.free if name.startswith("temperature_knot"))
    free = Variant("temperature", edits, knots, dict.fromkeys(knots, 0.0), dict.fromkeys(knots, 0.0), free_course=True)
    one, values = replace(ranked("thermal_expansion"), variant=plain), source.load(plain.edits).model.parameters
    fitted = replace(refit(("thermal_expansion",), 60.0), label=plain.label, values=values.as_values())
    cause = Rival(one, fitted, 240.0, 240.0, 240.0, practical=ANY_SIZE)
    seen = replace(screening(("thermal_expansion",)), trials=(ScoreColumn(one.candidate, plain, plain.label),
                                                              ScoreColumn(one.candidate, free, free.label)))
    own = replace(fitted, stds=dict.fromkeys(knots, 0.1), choice=fit(left), judgement=fit(left))
    return Round(seen, refit((), 300.0), (cause,), cause, source=source), lambda jobs: [own for _ in jobs]


@pytest.mark.parametrize("left, is_alone", [(12.0, True), (35.0, False), (55.0, False)])
def test_a_further_cause_gives_way_to_the_course_of_the_last_one_that_explains_as_much(tmp_path, left, is_alone):
    """A sheet that bulges late was told as two shapes, with time each."""
    entry, refits = warm_round(tmp_path, left)
    further = Rival(ranked("grip_slip"), refit(("grip_slip", "thermal_expansion"), 10.0), 50.0, 50.0, 50.0,
                    practical=ANY_SIZE)
    later = Round(entry.screening, entry.winner.refitted, (further,), further, source=entry.source)
    model = FittedModel(entry.source, entry.winner.refitted)
    state = State(Setting(refits, None, None, 1), None, model, model, rounds=(entry,), number=2, round=later)
    selected = improvable(state)
    assert EARLIER_COURSE.applies(selected)
    tried = EARLIER_COURSE.edit(selected)
    assert EARLIER_COURSE.accept(selected, tried) is is_alone
    assert not tried.rounds and has_own_course(tried.winner) and tried.round.plain is entry.winner
    assert tried.model.fit is entry.null and tried.is_open


def test_the_free_warmth_of_one_material_is_not_that_of_another():
    def made(name):
        edits = {f"material.{name}": 1e-4, "boundary": [{"temperature": {"course": [[0.0, 0.0], [3.0, 1.0]]}}]}
        return replace(variant(name, **edits), label=f"{name} expands")

    edits = free_edits({}, made("A.alpha").edits, made("A.alpha"))
    free = Variant("temperature", edits, ("temperature_knot[3]",), {}, {}, free_course=True)
    seen = screening(("thermal_expansion",))
    seen = replace(seen, trials=(*seen.trials, ScoreColumn(seen.ranked[0].candidate, free, free.label)))
    assert seen.free_course_of(made("A.alpha")) is free and seen.free_course_of(made("B.alpha")) is None


def test_an_expansion_under_a_temperature_of_the_file_is_not_told_as_another_warmth(tmp_path):
    folder = write_experiment(tmp_path / "test")
    document = read_toml(folder / "experiment.toml")
    for course, given in (([[0.0, 20.0], [3.0, 70.0]], True), ([[0.0, 0.0], [3.0, 1.0]], False)):
        plain, _ = warming(document, course)
        null = load_experiment(folder, {"boundary": plain.edits["boundary"]} if given else {})
        shown = courses_of("thermal_expansion", load_experiment(folder, plain.edits), null, plain.new, {ALPHA: 2.3e-5},
                           {ALPHA: 1e-6})
        assert [one.unit for one in shown] == ([] if given else ["K"])
    assert shown[0].value[-1] == pytest.approx(2.3)
