"""When a fit is doubtful, and stresses without a force; what is said of both is in test_approved_words.py."""

from __future__ import annotations

import re

import pytest
from made_up_run import make_record, make_result

from idic.report import joint_page, render_page, result_headline, result_verdict, stress_unit
from idic.report.result.fit_words import against_free
from idic.report.result.stress_scale import held_stresses, in_ratios
from idic.report.result.words import parts_of_std
from idic.report.result.words import convergence, discrepancy_text, explained
from idic.run.joint_result import result_of_part

CLUSTER = {"is_cluster": True, "chi2": 1.62, "typical_chi2": 1.0, "z": 31.0, "p_value": 0.0, "column": 412.3,
           "row": 88.0, "elements": 14, "share": 0.03, "part": None}


def judged(chi2=1.004, free=None, shown=None, local=None):
    result = make_result(chi2=chi2)
    if free is not None:
        result["residual"]["free_dic_chi2_dof"] = free
    if shown is not None:
        result["residual"]["free_dic_shown"] = {"frames": [5, 9], "chi2_dof": shown[1], "model_chi2_dof": shown[0]}
    result["residual"]["local"] = local
    return result


def test_chi2_of_fields_is_some_percent_below_one_where_their_noise_is_correlated():
    result = judged(0.87, free=0.3)
    assert "estimated noise is larger" in result_verdict(result)[1]  # by still frames
    stated = result | {"noise": result["noise"] | {"source": "given"}}
    assert "stated noise is larger" in result_verdict(stated)[1]
    of_fields = result | {"quantity": "displacement", "noise": result["noise"] | {"source": "stage_differences"}}
    assert result_verdict(of_fields)[0] == "good"
    of_fields["noise"]["source"] = "given"
    assert result_verdict(of_fields)[0] == "look"


def test_the_free_measurement_of_the_shown_frames_counts_where_there_is_no_other():
    few = judged(1.02, shown=(1.2, 1.0))
    assert against_free(few).model_chi2 == 1.2 and result_verdict(few)[0] == "look"
    assert "in the frames shown" in explained(few)
    assert result_verdict(judged(1.02, shown=(1.01, 1.0)))[0] == "good"


def test_a_free_fit_of_fields_that_follows_their_correlated_noise_says_nothing_against_the_model():
    of_fields = {"quantity": "displacement"}
    assert result_verdict(judged(0.95, free=0.24) | of_fields)[0] == "good"
    assert result_verdict(judged(1.3, free=0.24) | of_fields)[0] == "look"


@pytest.mark.parametrize("chi2", [0.95, 1.0, 1.09])
def test_a_cluster_is_never_only_noise(chi2):
    result = judged(chi2, free=chi2, local=CLUSTER)
    assert result_verdict(result)[0] == "look"
    assert result_verdict(judged(chi2, free=chi2, local=CLUSTER | {"is_cluster": False}))[0] == "good"


@pytest.mark.parametrize("typical, mark", [(1.02, ""), (14.2, ' class="warn"')])
def test_a_local_chi2_that_is_raised_everywhere_is_not_marked_as_right(typical, mark):
    local = CLUSTER | {"is_cluster": False, "typical_chi2": typical}
    assert f"<li{mark}><span>largest local χ²" in render_page(make_record(result=judged(local=local)), ())


def test_values_of_a_doubtful_fit_are_not_set_in_bold():
    good, doubtful = (render_page(make_record(result=judged(chi2)), ()) for chi2 in (1.0, 1.4))
    assert '<p class="first">' in good and '<td class="value">' in good
    assert '<p class="first doubtful">' in doubtful and '<td class="value">' not in doubtful


# stresses without a force ---------------------------------------------------------------------------------------------
def held_modulus():
    result = make_result()
    result["has_force"] = False
    result["parameters"]["sheet.E"] |= {"free": False, "std": None, "ci95": None, "value": 70.0, "unit": "GPa"}
    return result


def test_without_a_force_a_stress_is_a_ratio_to_the_held_one():
    result = held_modulus()
    entry = in_ratios(result)["parameters"]["sheet.yield_stress/E"]
    assert entry["unit"] == "" and entry["ci95"][0] < entry["value"] < entry["ci95"][1]
    assert "sheet.yield_stress/E" in in_ratios(result)["correlation"]["names"]
    page = render_page(make_record(result=result), ())
    rows = [row for row in re.findall(r"<tr.*?</tr>", page) if "yield_stress" in row]
    assert rows and all("MPa" not in row for row in rows)
    assert stress_unit(result, "sheet") == ("E", 70e3)


def test_without_a_force_the_page_of_several_experiments_shows_ratios_too():
    result = held_modulus()
    own = {"value": 200.0, "std": 0.7}
    specimens = {"unit": "MPa", "values": {"a": own, "b": own}, "between_std": 7.0, "between_ci95": [0.7, 14.0],
                 "p_value": 1e-4, "mean": 200.0, "mean_std": 0.7}
    result["noise"] = result["noise"] | {"unit": "GV"}
    part = {"title": "a", "noise": {"std_gv": 2.0, "unit": "GV"}, "report": "",
            "residual": {"channel_chi2_dof": {}, "image_chi2_dof": 1.0}}
    result |= {"title": "a + b", "experiments": {"a": part, "b": part}, "frames": [],
               "specimens": {"sheet.yield_stress": specimens}}
    page = joint_page(result)
    assert "by 0.00010 (mean of the material 0.002857 ± 0.000010)" in page
    assert "sheet.yield_stress/E" in page and "MPa" not in "".join(
        row for row in re.findall(r"<tr.*?</tr>|<p.*?</p>", page, re.DOTALL) if "yield_stress" in row)


def test_a_part_of_several_experiments_has_a_stress_where_one_of_them_has_a_force():
    whole = {"parameters": {}, "experiments": {"a": {}, "b": {}}, "has_force": True, "derived": {},
             "not_identifiable": []}
    own = {"parameters": {}, "notes": [], "has_force": False}
    result_of_part(own, whole, "b", {})
    assert own["has_force"] is True


def test_without_a_force_a_bound_is_a_ratio_too():
    result = held_modulus() | {"status": "at_bound", "at_bound": {"sheet.yield_stress": 210.0, "sheet.nu": 0.49}}
    result["parameters"]["sheet.nu"] = {"value": 0.49, "std": 0.01, "unit": "", "start": 0.3, "free": True,
                                        "ci95": [0.47, 0.51]}
    assert in_ratios(result)["at_bound"] == pytest.approx({"sheet.yield_stress/E": 0.003, "sheet.nu": 0.49})
    sentence = convergence(in_ratios(result))
    assert "yield_stress/E (0.003)" in sentence and "nu (0.49)" in sentence
    assert sentence in result_headline(result)
    assert 'class="verdict' in render_page(make_record(result=result), ())


def test_with_a_force_or_in_earlier_files_stresses_stay_as_they_are():
    for told in ({}, {"has_force": True}):
        result = make_result() | told
        assert in_ratios(result) is result and held_stresses(result) == ""
        assert stress_unit(result, "sheet") == ("MPa", 1.0)




def test_a_search_that_has_not_ended_says_nothing_of_the_model():
    ended, stopped = make_result(chi2=1.4), make_result(chi2=1.4) | {"status": "max_iterations"}
    assert "The model lacks an effect" in explained(ended)
    assert "lacks" not in explained(stopped) and "The search has not ended" in explained(stopped)


def test_an_error_that_is_no_part_of_a_std_is_zero():
    entry = {"std": 250.0, "std_noise": 250.0, "std_model": 9.8e-8}
    assert parts_of_std(entry) == "250, 0"
    assert parts_of_std(entry | {"std_model": None}) == "250, –"


def test_an_error_of_the_simulation_that_widens_the_intervals_is_not_denied():
    result = make_result() | {"discrepancy": {"significant": False}}
    assert discrepancy_text(result) == "No error beyond noise widens the intervals."
    name, entry = next((name, entry) for name, entry in result["parameters"].items() if entry.get("std"))
    result["parameters"] = result["parameters"] | {name: entry | {"std_model": 0.9 * entry["std"]}}
    assert "the error of the simulation itself" in discrepancy_text(result)
