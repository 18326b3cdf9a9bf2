"""The misfit study: what stands for parameters that have no counterpart in the truth."""

import numpy as np
import pytest

from idic.laws import compile as compile_law
from idic_studies.examples.misfit_worlds import _sections, _truth_of, draw, flow_stress
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.misfit_page import FLOW_STRESS, PLASTIC_STRAIN, draw_misfit, outcome_of

NAMES = ["sheet.E", "sheet.nu", "sheet.yield_stress", "sheet.hardening_modulus"]
STD = np.array([100.0, 0.01, 2.0, 50.0])
CORRELATION = -0.5


def record(number, off):
    """A recording whose flow stress is `off` of its standard deviations above the truth."""
    matrix = np.eye(4)
    matrix[2, 3] = matrix[3, 2] = CORRELATION
    spread = np.sqrt(STD[2]**2 + (PLASTIC_STRAIN * STD[3])**2 + 2.0 * CORRELATION * STD[2] * PLASTIC_STRAIN * STD[3])
    stress = flow_stress(draw("hardening", number), PLASTIC_STRAIN) + off * spread
    value = np.array([70.01e3, 0.301, stress - 1200.0 * PLASTIC_STRAIN, 1200.0])
    facts = {"names": NAMES, "status": "converged", "correlation": {"names": NAMES, "matrix": matrix.tolist()},
             "discrepancy": {"significant": True}}
    return CaseRecord(f"hardening/{number:02d}-00", facts, {
        "value": value, "std": STD, "std_noise": 0.5 * STD, "truth": np.array([70e3, 0.3, 200.0, 1500.0])})


def test_the_flow_stress_stands_for_a_hardening_line_without_a_counterpart_in_the_truth():
    found = outcome_of("hardening", [record(k, off) for k, off in enumerate((0.0, 1.5, -2.5))])
    assert found.names == ("E", "ν", FLOW_STRESS)
    assert found.both[:, 2] == pytest.approx([0.0, 1.5, -2.5], abs=1e-9)
    assert found.coverage == pytest.approx(8.0 / 9.0)
    assert found.noise_coverage == 1.0  # of E and nu: that of the flow stress is not known


def test_the_page_marks_what_is_not_known():
    page = draw_misfit({(r := record(k, 0.1 * k - 1.05)).key: r for k in range(20)})
    row = page.sections[0].tables[0].rows[2]
    assert row[1] == FLOW_STRESS and row[2] == "–" and row[3] == "100 %"
    assert page.goals[0].met


def test_the_true_flow_stress_saturates():
    drawn = draw("hardening", 1)
    early, late = flow_stress(drawn, 0.0), flow_stress(drawn, 0.2)
    assert early == 200.0 and late == pytest.approx(200.0 + 300.0 + 25.0 * drawn.size, abs=1e-4)


def test_the_spot_of_the_metal_lies_beside_the_hole_and_scales_every_stress():
    for seed in range(4):
        drawn = draw("spot", seed)
        assert 3.0 <= np.hypot(*drawn.place) <= 8.0
        truth, law = _truth_of(drawn), compile_law("j2_linear", "finite")
        (body, spot), values = _sections(truth, law)
        assert 0 < len(spot.elements) < 0.2 * len(body.elements)
        ratio = dict(zip(law.spec.parameter_names, values["spot"] / values["sheet"], strict=True))
        assert ratio["nu"] == 1.0
        stresses = [ratio[name] for name in ("E", "yield_stress", "hardening_modulus")]
        np.testing.assert_allclose(stresses, 1.0 + 0.2 * drawn.size, rtol=1e-12)


def test_the_rim_of_the_off_axis_composite_is_softer_or_stiffer_in_all_moduli():
    drawn = draw("off_axis", 0)
    truth, law = _truth_of(drawn), compile_law("orthotropic", "finite")
    (body, rim), values = _sections(truth, law)
    assert len(np.intersect1d(body.elements, rim.elements)) == 0
    assert len(body.elements) + len(rim.elements) == len(truth.mesh.element_sets["sheet"])
    ratio = dict(zip(law.spec.parameter_names, values["spot"] / values["sheet"], strict=True))
    assert ratio["nu12"] == ratio["angle"] == 1.0
    assert ratio["E1"] == ratio["E2"] == ratio["G12"] == pytest.approx(1.0 + 0.2 * drawn.size)
    free = {name for name, entry in drawn.overrides["material"]["sheet"].items() if isinstance(entry, dict)
            and "identify" in entry}
    assert free == {"E1", "E2", "nu12", "G12"}
