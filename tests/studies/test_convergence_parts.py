"""The convergence study: its starts, and what its page counts as a success."""

import numpy as np
import pytest

from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.convergence_page import reached_truth, draw_convergence, success
from idic_studies.cases.convergence import LARGEST_START, starts, virtual_tests
from idic_studies.cases.registry import make_study


def test_every_schedule_begins_at_the_same_starts_at_the_stated_distance():
    study = make_study("convergence", "reduced")
    assert len({case.key for case in study.cases}) == len(study.cases)
    truth = virtual_tests()["metal"].truth
    by_place = {}
    for case in study.cases:
        if case.images == "metal":
            start = {name: case.overrides[name] for name in truth}
            by_place.setdefault(case.key.partition("/")[2], []).append(start)
    assert all(len(own) == 5 and all(start == own[0] for start in own) for own in by_place.values())
    for distance in (1.5, 6.0):
        for start in starts(virtual_tests()["metal"], distance, 5):
            factors = [start[name] / value for name, value in truth.items() if name != "sheet.nu"]
            assert max(np.abs(np.log(factors))) <= np.log(distance) * (1 + 1e-5)
            assert start["sheet.nu"] <= LARGEST_START["sheet.nu"]


def record(key, value, status="converged", std=0.01):
    arrays = {"value": np.array([value]), "std": np.array([std]), "truth": np.array([1.0])}
    return CaseRecord(key, {"status": status, "cpu_s": 2.0, "rounds": 6}, arrays)


@pytest.mark.parametrize("value, status, std, expected", [
    (1.04, "converged", 0.01, True), (1.06, "converged", 0.01, False), (1.0, "stalled", 0.01, False),
    (1.009, "converged", np.nan, True), (1.02, "converged", np.nan, False)])
def test_a_start_counts_as_successful_if_it_converges_to_the_truth(value, status, std, expected):
    assert reached_truth(record("metal-all/150-00", value, status, std)) is expected


def test_the_page_counts_starts_that_reached_the_truth():
    records = [record("metal-all/150-00", 1.0), record("metal-all/150-01", 2.0), record("metal-coarse/300-00", 1.0)]
    counts = success(records)
    assert counts["metal", "all", 1.5] == (1, 2, 2.0, 6.0) and counts["metal", "coarse", 3.0] == (1, 1, 2.0, 6.0)
    page = draw_convergence({r.key: r for r in records})
    assert "all at once 1 of 2" in page.first
    assert page.sections[0].tables[0].rows[0] == ("all at once", "1 of 2", "–", "2.0", "6.0")
