"""The trace of an ablation changes no number, and counts what decides."""

from __future__ import annotations

import ast
import json
from dataclasses import dataclass

import numpy as np
import pytest

from idic_studies.ablation.__main__ import omitted
from idic_studies.ablation.inventory import constants
from idic_studies.ablation.table import (
    DECIDES, NOT_READ, ONE_OUTCOME, VALUE, Asked, asked_of, largest_share_unseen, table_text,
)
from idic_studies.ablation.trace import Ledger, Omission, Rewriting, constants_of, traced_loop

FILE = "idic/diagnose/module.py"
MODULE = """
LIMIT, STEP = 0.25, 2


def larger(values, bar=LIMIT):
    '''Values above the bar.'''
    if not len(values):
        return []
    return [value for value in values if value > bar]


def cut(values):
    return values.clip(0.0, LIMIT * STEP)


def every(values):
    return values[::STEP]
"""


def rewritten(ledger: Ledger) -> dict:
    """The module under a trace."""
    tree = ast.parse(MODULE)
    tree = Rewriting(FILE, "idic.diagnose.module", constants_of(tree, "idic.diagnose.module")).visit(tree)
    namespace = {"ledger__": ledger}
    exec(compile(tree, FILE, "exec"), namespace)  # noqa: S102  (this is what an import does)
    return namespace


@pytest.mark.parametrize("value", [0.25, -3.0, 7])
def test_a_traced_number_gives_the_bits_of_the_plain_one(value):
    traced, array = Ledger().read("A", "here", value), np.array([-1.0, 0.25, 8.0])
    for operation in (lambda x: x + 1, lambda x: 2.5 - x, lambda x: x * np.float64(0.1), lambda x: np.float64(3) / x,
                      lambda x: x**2, lambda x: -x, abs, lambda x: array * x, lambda x: np.maximum(array, x),
                      lambda x: np.where(array > x, x, 0.0), lambda x: array >= x, lambda x: np.float64(0.25) == x,
                      lambda x: min(x, 1.0), lambda x: np.sqrt(x * x), lambda x: f"{x:.3g}"):
        assert np.array_equal(operation(traced), operation(value))


def test_a_comparison_is_counted_for_every_constant_behind_it():
    ledger = Ledger()
    module = rewritten(ledger)
    assert module["larger"]([0.1, 0.3, 0.5]) == [0.3, 0.5]
    assert module["cut"](np.array([0.1, 0.4, 0.9])).tolist() == [0.1, 0.4, 0.5]
    assert module["every"]([1, 2, 3]) == [1, 3]
    asked = asked_of({"world": ledger.content})
    compared = {place.rpartition(":")[2]: n for place, n in asked["module.LIMIT"].places.items()}
    assert compared == {"9": (2, 1), "13": (1, 2)}  # the loop over values; of the clipped ones one is cut
    assert asked["module.STEP"].compared == 3  # it stands behind the upper limit
    assert ledger.content["calls"] == {"module.larger": 1, "module.cut": 1, "module.every": 1}
    assert ledger.content["conditions"][f"{FILE}:7:7 False"] == 1


def test_an_omission_answers_a_comparison_and_gives_another_value():
    place = f"{FILE}:9"
    forced = rewritten(Ledger(Omission({("module.LIMIT", place): True})))
    assert forced["larger"]([0.1, 0.3]) == [0.1, 0.3]
    assert rewritten(Ledger(Omission(values={"module.LIMIT": 0.2})))["larger"]([0.1, 0.22]) == [0.22]


def test_a_constant_decides_where_one_place_has_both_outcomes():
    worlds = {"one": {"reads": {"A idic/diagnose/m:1": 1, "B idic/diagnose/m:2": 1, "C idic/diagnose/m:3": 4},
                      "outcomes": {"A idic/diagnose/m:1 True": 3, "B idic/diagnose/m:2 True": 1,
                                   "B idic/diagnose/m:5 False": 1}},
              "two": {"reads": {"A idic/diagnose/m:1": 1}, "outcomes": {"A idic/diagnose/m:1 False": 1}},
              "three": {"reads": {"A idic/diagnose/m:1": 1}, "outcomes": {"A idic/diagnose/m:1 True": 1}}}
    asked = asked_of(worlds)
    assert [asked[name].status for name in "ABC"] == [DECIDES, ONE_OUTCOME, VALUE]
    assert asked["A"].minority == ("two",)
    assert Asked().status == NOT_READ


def test_what_decided_in_none_of_twenty_worlds_may_decide_in_one_of_seven():
    assert largest_share_unseen(20) == pytest.approx(1.0 - 0.05**0.05)
    assert 1 / 8 < largest_share_unseen(20) < 1 / 7


def test_moves_report_and_are_left_out():
    @dataclass(frozen=True)
    class Step:
        name: str
        applies: object = lambda state: state < 3
        edit: object = lambda state: state + 1
        accept: object = lambda state, tried: tried != 2

    def moved(state, moves):
        for move in moves:
            if move.applies(state) and move.accept(state, tried := move.edit(state)):
                state = tried
        return state

    ledger = Ledger(Omission(moves=("idle",)))
    assert traced_loop(moved, ledger)(0, [Step("first"), Step("idle"), Step("second")]) == 1
    assert ledger.moves["first"] == {"asked": 1, "applied": 1, "accepted": 1, "failed": 0, "without effect": 0}
    assert ledger.moves["idle"] == {"asked": 1}
    assert ledger.moves["second"]["refused"] == 1


def test_the_inventory_lists_numbers_and_what_they_bound(tmp_path):
    room = tmp_path / "idic" / "diagnose"
    room.mkdir(parents=True)
    (room / "part.py").write_text('NAME = "word"\nMIN_SHARE = 0.5  # of the motion\n# of a fit\nMOST, LEAST = 3, 1e-3\n'
                                  "TWICE = 2 * MIN_SHARE\nTABLE = (MIN_SHARE, TWICE)\nGRID = (1, 2)\n")
    assert [(c.name, c.value, c.bounds) for c in constants(tmp_path / "idic")] == [
        ("part.MIN_SHARE", "0.5", "of the motion"), ("part.MOST", "3", "of a fit"), ("part.LEAST", "0.001", "of a fit"),
        ("part.TWICE", "2 * MIN_SHARE", ""), ("part.GRID", "(1, 2)", "")]


def test_the_table_tells_what_decided_and_which_answers_changed(tmp_path):
    name, place = "selection.rival.MIN_HELDOUT_DROP", "idic/diagnose/selection/rival.py:53"
    record = {"verdict": "single", "reported": ["creep"], "alarm": True, "false_physics": False, "inside": True,
              "side_right": True, "onset_error": 0.0, "intervals": [2, 2], "probability": 0.9}
    ledger = {"reads": {f"{name} {place}": 2}, "outcomes": {f"{name} {place} True": 1, f"{name} {place} False": 1},
              "moves": {"free end": {"asked": 1, "applied": 1, "accepted": 1}}}
    for path, content in ((tmp_path / "world" / "trace.json", {"record": record, "ledger": ledger}),
                          (tmp_path / "without" / "free end" / "world.json", {"record": record}),
                          (tmp_path / "without" / name / "world.json", {"record": record | {"verdict": "none"}})):
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(content))
    lines = table_text(tmp_path).splitlines()
    assert "| world | single | creep | yes | – | yes |" in lines
    (row,) = (line for line in lines if line.startswith(f"| {name} |"))
    assert "| decides | 2 | 1, 1 |" in row and "1 of 1 answers change (world: verdict)" in row
    assert any(line.startswith("| free end | 1 | 1 | 1 | 1, 1 | 0 of 1 answers change |") for line in lines)
    omission, worlds = omitted(tmp_path, name)
    assert (omission.outcomes, worlds) == ({(name, place): False}, ["world"])
    assert omitted(tmp_path, "free end") == (Omission(moves=("free end",)), ["world"])
    assert omitted(tmp_path, f"{name}=4.0") == (Omission(values={name: 4.0}), ["world"])
