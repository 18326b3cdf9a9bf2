"""What a result is told as, whole: its sentences at the top, in the terminal, and the page of a run.

Each case is one made-up result; ``approved/CASE.txt`` holds all that is said of it.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from approved import assert_approved
from made_up_run import NAMES, make_practice, make_record, make_result

from idic.report import remarks
from idic.report import render_page, result_headline, result_verdict, tables
from idic.report import undetermined
from idic.report.result.words import advice
from idic.report.result.words import discrepancy_text, explained, left_out, not_explained, result_cautions
from idic_studies.equality.normal_text import page_paragraphs

APPROVED = Path(__file__).parent / "approved"
CLUSTER = {"is_cluster": True, "chi2": 1.62, "typical_chi2": 1.0, "z": 31.0, "p_value": 0.0, "column": 412.3,
           "row": 88.0, "elements": 14, "share": 0.03, "part": None}
BRIGHTNESS = {"setting": 'brightness = "patch", patch_px = 100', "chi2_before": 1.31, "chi2_after": 1.05}
LOWPASS = {"setting": "lowpass_px = 1", "chi2_before": 1.31, "chi2_after": 1.30}
FLOOR = {"px": 0.02, "bound_px": 0.03, "length_px": 50.0, "frames": [1, 2], "labels": ["a.tif", "b.tif"],
         "drift_px": [0.01, 0.17], "source": "declared"}
DISCREPANCY = {
    "significant": True, "likelihood_ratio": 1749.2, "motion_px": {"a.motion": 0.0, "b.motion": 0.0077},
    "std": {"a.motion": 0.0, "b.motion": 0.005, "a.stress": 0.0046, "a.channel": 0.0, "rough": 2.955}}
NO_FORCE = "no force: only ratios of moduli can be determined"


def judged(chi2=1.004, free=None, shown=None, local=None, remedies=(), **changes):
    """A result with a free measurement, a local test and remedies."""
    result = make_result(chi2=chi2)
    if free is not None:
        result["residual"]["free_dic_chi2_dof"] = free
    if shown is not None:
        result["residual"]["free_dic_shown"] = {"frames": [5, 9], "chi2_dof": shown[1], "model_chi2_dof": shown[0]}
    return result | {"remedies": list(remedies)} | changes | {"residual": result["residual"] | {"local": local}}


def channel_missed():
    result = make_result()
    result["residual"]["channel_chi2_dof"]["force_N"] = 9.0
    return result


def correlated_and_biased():
    result = make_result()
    result["correlation"]["matrix"][2][3] = result["correlation"]["matrix"][3][2] = -0.97
    result["parameters"]["sheet.nu"]["discretisation_bias"] = 0.005
    return result


def ratio_that_moves():
    result = make_result(not_identifiable=[("G", "moves by 62 % between treatments of boundary and camera")])
    result["derived"]["G"]["systematic_std"] = 9e3
    return result


def without_a_force():
    result = make_result(not_identifiable=[(n, NO_FORCE) for n in NAMES if n != "sheet.nu"])
    result["derived"] = {"sheet.E/yield_stress": {"value": 350.2, "std": 0.5, "ci95": [349.2, 351.2]}}
    result["residual"]["free_dic_chi2_dof"] = 1.12
    result["frames"][7] |= {"status": "unexplained", "label": "zoom-0078.tif"}
    return result


def held_modulus(**changes):
    result = make_result() | {"has_force": False}
    result["parameters"]["sheet.E"] |= {"free": False, "std": None, "ci95": None, "value": 70.0, "unit": "GPa"}
    return result | changes


def nothing_determined():
    return make_result(not_identifiable=[(n, "why") for n in NAMES]) | {"derived": {}}


def imitations():
    names = ("s.E", "s.H", "t")

    def entry(name, *others):
        together = " together" if others[1:] else ""
        return {"name": name, "together_with": list(others), "correlation": 0.99996,
                "reason": f"cannot be told apart from {', '.join(others)}{together}: correlation 1.000"}

    listed = [entry(name, *(n for n in names if n != name)) for name in names] + [entry("c.tilt", "s.E")]
    return {**make_result(), "parameters": {n: {"value": 1.0, "std": None, "free": True, "unit": "-", "start": 1.0}
                                            for n in (*names, "c.tilt")},
            "not_identifiable": listed, "derived": {}}


def interval_that_reaches_zero():
    result = make_result()
    result["parameters"]["sheet.E"].update(value=17.0, std=16.5, std_noise=6.0, std_model=15.4, ci95=[-15.0, 49.0])
    return result


CASES = {
    "good": make_result,
    "stalled": lambda: make_result(status="stalled"),
    "max_iterations": lambda: make_result(status="max_iterations"),
    "at_bound": lambda: make_result(status="at_bound"),
    "forward_failed": lambda: make_result(status="forward_failed"),
    "interrupted": lambda: make_result(status="interrupted"),
    "residual_above_noise": lambda: make_result(chi2=1.4),
    "residual_below_noise": lambda: make_result(chi2=0.7),
    "free_measurement": lambda: judged(free=0.99),
    "free_measurement_failed": lambda: judged(free=78.8),
    "free_measurement_better": lambda: judged(1.79, free=1.14),
    "free_measurement_a_little_better": lambda: judged(1.08, free=1.0),
    "free_measurement_of_shown_frames": lambda: judged(1.02, shown=(1.2, 1.0)),
    "as_good_as_a_free_motion": lambda: judged(1.31, free=1.29, remedies=(BRIGHTNESS, LOWPASS)),
    "remedies_without_effect": lambda: judged(1.31, free=1.30, remedies=(LOWPASS,)),
    "cluster": lambda: judged(1.0, free=1.0, local=CLUSTER),
    "cluster_in_error_bars": lambda: judged(1.0, free=1.0, local=CLUSTER, discrepancy=DISCREPANCY),
    "no_cluster": lambda: judged(1.0, free=1.0, local=CLUSTER | {"is_cluster": False}),
    "misfit_in_error_bars": lambda: judged(1.79, free=1.14, discrepancy=DISCREPANCY),
    "discrepancy_of_fields": lambda: CASES["fields"]() | {"discrepancy": DISCREPANCY},
    "channel_missed": channel_missed,
    "correlated_and_biased": correlated_and_biased,
    "parameter_without_scale": lambda: make_result(
        not_identifiable=[(NAMES[0], "no force was measured: stresses have no scale")]),
    "edge_not_determined": lambda: make_result(not_identifiable=[("geometry.outline.EDGE2", "why")]),
    "nothing_determined": nothing_determined,
    "imitations": imitations,
    "interval_that_reaches_zero": interval_that_reaches_zero,
    "ratio_that_moves": ratio_that_moves,
    "without_a_force": without_a_force,
    "held_modulus": held_modulus,
    "held_modulus_at_bound": lambda: held_modulus(
        status="at_bound", at_bound={"sheet.yield_stress": 210.0, "sheet.hardening_modulus": 2100.0}),
    "fields": lambda: make_result() | {"quantity": "displacement", "noise": {
        "std_gv": 0.4, "unit": "µm", "source": "stage_differences"}},
}


def all_that_is_said(result) -> str:
    """A line per sentence, below the name of what says it."""
    level, verdict = result_verdict(result)
    said = {f"verdict ({level})": [verdict], "headline": result_headline(result), "fit": [explained(result)],
            "discrepancy": [discrepancy_text(result)], "cautions": result_cautions(result), "advice": advice(result),
            "not determined": [undetermined(result)], "not explained": [not_explained(result)],
            "left out": [left_out(result)], "terminal": remarks(result)}
    return "\n".join(line for name, lines in said.items() if any(lines)
                     for line in (f"{name}:", *(f"    {text}" for text in lines if text)))


@pytest.mark.parametrize("case", CASES)
def test_what_is_said_of_a_result_is_approved(case):
    assert_approved(all_that_is_said(CASES[case]()), APPROVED / f"{case}.txt")


PAGES = {
    "page": make_record,
    "page_of_a_doubtful_fit": lambda: make_record(result=judged(1.31, free=1.29, local=CLUSTER,
                                                               remedies=(BRIGHTNESS, LOWPASS))),
    "page_without_a_force": lambda: make_record(result=held_modulus()),
    "page_that_states_little": lambda: make_record(
        pixel_size_mm=None, practice=make_practice(setup={}, speckle_px=None, channel_noise=())),
    "page_of_images_that_moved": lambda: make_record(result=make_result() | {"camera_floor": FLOOR}),
    "page_of_a_test_that_determines_little": lambda: make_record(result=without_a_force()),
    "page_of_fields": lambda: make_record(result=CASES["fields"]()),
}


@pytest.mark.parametrize("case", PAGES)
def test_the_words_of_a_page_are_approved(case):
    page = re.sub(r"<(/?)(?:td|th)\b", r"<\1span", render_page(PAGES[case](), ()))  # a row of a table is a line
    assert_approved("\n".join(page_paragraphs(page)), APPROVED / f"{case}.txt")


def test_the_table_of_the_parameters_is_approved():
    assert_approved(tables.parameters(make_record()), APPROVED / "parameters.txt")


def test_no_case_is_left_over():
    assert {file.stem for file in APPROVED.iterdir()} == {*CASES, *PAGES, "parameters"}
