"""The two-step study: every method sees the same draws, and its page counts them right."""

import numpy as np
import pytest

from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.two_step_page import METHODS, PLAIN, draw_two_step, spread_of
from idic_studies.cases.registry import make_study
from idic_studies.cases.two_step import OVERRIDES


def test_every_method_sees_the_same_noise_from_the_same_start():
    study = make_study("two-step", "reduced")
    assert set(OVERRIDES) == set(METHODS) and len({case.key for case in study.cases}) == len(study.cases)
    draws = {}
    for case in study.cases:
        start = {name: case.overrides[name] for name in PLAIN}
        draws.setdefault((case.images, case.noise, case.key.partition("/")[2]), []).append((case.seed, start))
    assert all(len(own) == len(METHODS) and all(one == own[0] for one in own) for own in draws.values())
    assert len(draws) == 4 * 30


def record(key, error, std=0.02, status="converged"):
    names = list(PLAIN)
    arrays = {"value": 1.0 + error * np.ones(4), "std": std * np.ones(4), "truth": np.ones(4)}
    return CaseRecord(key, {"names": names, "status": status, "cpu_s": 2.0, "case": {"noise": 1.0}}, arrays)


def test_scatter_and_bias_are_those_of_the_draws_that_converged():
    records = [record("coarse-low-two_step/000", 0.01), record("coarse-low-two_step/001", 0.03),
               record("coarse-low-two_step/002", 9.0, status="stalled")]
    found = spread_of(records)
    assert found.bias == pytest.approx(0.02) and found.stated == pytest.approx(0.02)
    assert found.scatter == pytest.approx(np.std([0.01, 0.03], ddof=1))
    assert (found.converged, found.asked, found.cpu_s) == (2, 3, 2.0)
    assert spread_of(records[1:]) is None
    page = draw_two_step({r.key: r for r in [*records, record("coarse-low-unweighted/000", 0.0)]})
    rows = {row[0]: row for row in page.sections[0].tables[0].rows}
    assert rows["two steps, weighted"][1] == "+2 ± 1.4 (2)" and rows["two steps, weighted"][-2] == "2 of 3"
    assert rows["two steps, unweighted"][1] == "–"
