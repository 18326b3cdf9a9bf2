"""The words on a fit: against the free FE-DIC, by the local test, with remedies; stresses without a force."""

from __future__ import annotations

import re

import pytest
from made_up_run import make_record, make_result

from idic.cli.tables import remarks
from idic.report import (
    advice, against_free, held_stresses, in_ratios, joint_page, render_page, result_headline, result_verdict,
    stress_unit, undetermined,
)
from idic.report.result.words import convergence, discrepancy_text, explained
from idic.run import read_result
from idic.run.joint_result import result_of_part

CLUSTER = {"is_cluster": True, "chi2": 1.62, "typical_chi2": 1.0, "z": 31.0, "p_value": 0.0, "column": 412.3,
           "row": 88.0,
           "elements": 14, "share": 0.03, "part": None}
PATCH = {"setting": 'brightness = "patch", patch_px = 100', "chi2_before": 1.31, "chi2_after": 1.05}
LOWPASS = {"setting": "lowpass_px = 1", "chi2_before": 1.31, "chi2_after": 1.30}


def judged(chi2=1.004, free=None, shown=None, local=None, remedies=()):
    result = make_result(chi2=chi2)
    if free is not None:
        result["residual"]["free_dic_chi2_dof"] = free
    if shown is not None:
        result["residual"]["free_dic_shown"] = {"frames": [5, 9], "chi2_dof": shown[1], "model_chi2_dof": shown[0]}
    result["residual"]["local"] = local
    result["remedies"] = list(remedies)
    return result


def test_a_model_that_follows_as_well_as_a_free_motion_is_not_said_to_lack_an_effect():
    result = judged(1.31, free=1.29, remedies=(PATCH, LOWPASS))
    level, text = result_verdict(result)
    assert level == "look" and "as well as any motion can; light or aliasing is left" in text
    said = explained(result)
    assert "lacks an effect" not in said and "falls from χ² = 1.31 to 1.05" in said and 'brightness = "patch"' in said
    page = render_page(make_record(result=result), ())
    assert "Remedies for light and aliasing" in page and "<td>1.050</td>" in page


def test_chi2_of_fields_is_some_percent_below_one_where_their_noise_is_correlated():
    result = judged(0.87, free=0.3)
    assert "stated noise is larger" in result_verdict(result)[1]
    of_fields = result | {"quantity": "displacement", "noise": result["noise"] | {"source": "stage_differences"}}
    assert result_verdict(of_fields)[0] == "good"
    of_fields["noise"]["source"] = "given"
    assert result_verdict(of_fields)[0] == "look"


def test_an_edge_that_is_not_determined_is_told_to_decide_the_moduli():
    result = make_result()
    assert "margin" not in undetermined(result)
    result["not_identifiable"] = [{"name": "geometry.outline.EDGE2", "reason": "why", "together_with": []}]
    assert "stay where the margin puts them" in undetermined(result)


def test_remedies_without_effect_are_named_as_such():
    said = explained(judged(1.31, free=1.30, remedies=(LOWPASS,)))
    assert "None of the remedies tried" in said and "lowpass_px = 1" in said


def test_a_free_motion_that_fits_better_speaks_against_the_model_whatever_the_mean():
    level, text = result_verdict(judged(1.08, free=1.0))
    assert level == "look" and "a free motion explains the images better" in text
    assert result_verdict(judged(1.79, free=1.14))[0] == "look"
    assert "lacks an effect" in explained(judged(1.79, free=1.14))


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
    level, text = result_verdict(result)
    assert level == "look" and "not everywhere" in text
    said = explained(result)
    assert "column 412, row 88" in said and "> 8 standard deviations" in said
    assert any("column 412" in remark for remark in remarks(result))
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
    first, second, *_ = result_headline(result)
    assert "yield_stress/E = 0.0028543 ± 0.0000034" in first and "MPa" not in first
    assert second == "No force was recorded. Stresses are ratios to E = 70 GPa, given and not measured."
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
    assert "by 0.0001 (mean of the material 0.002857 ± 0.000010)" in page
    assert "sheet.yield_stress/E" in page and "MPa" not in "".join(
        row for row in re.findall(r"<tr.*?</tr>|<p.*?</p>", page, re.DOTALL) if "yield_stress" in row)


def test_a_part_of_several_experiments_has_a_stress_where_one_of_them_has_a_force(tmp_path):
    whole = {"parameters": {}, "experiments": {"a": {}, "b": {}}, "has_force": True, "derived": {},
             "not_identifiable": []}
    own = {"parameters": {}, "notes": [], "has_force": False}
    result_of_part(tmp_path, own, whole, "b", {})
    assert read_result(tmp_path)["has_force"] is True


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


def test_error_bars_that_count_the_model_are_not_said_to_leave_it_out():
    local = judged(1.0, free=1.0, local=CLUSTER)
    free = judged(1.79, free=1.14)
    for result in (local, free):
        assert "error bars do not include that" in " ".join([*advice(result), explained(result)])
        result["discrepancy"] = {"significant": True}
        said = " ".join([*advice(result), explained(result)])
        assert "do not include" not in said and "count it as a smooth error" in said


def test_the_parts_of_a_discrepancy_are_named_where_they_are_not_zero():
    found = {"significant": True, "likelihood_ratio": 1749.2, "motion_px": {"a.motion": 0.0, "b.motion": 0.0077},
             "std": {"a.motion": 0.0, "b.motion": 0.005, "a.stress": 0.0046, "a.channel": 0.0, "rough": 2.955}}
    text = discrepancy_text({"discrepancy": found})
    assert "log-likelihood: 1749; smooth motion of about 0.0077 px, smooth stress of about 0.46 %, finer" in text
    assert "finer motion 3 times the noise)" in text and "channel" not in text
    of_points = discrepancy_text({"discrepancy": found, "noise": {"unit": "µm"}})
    assert "0.0077 distances of the points, smooth stress" in of_points


def test_parameters_that_imitate_each_other_are_named_once():
    def reason(*others):
        return f"cannot be told apart from {', '.join(others)}{' together' if others[1:] else ''}: correlation 1.000"

    names = ("s.E", "s.H", "t")
    listed = [{"name": name, "reason": reason(*(n for n in names if n != name)),
               "together_with": [n for n in names if n != name], "correlation": 0.99996} for name in names]
    listed.append({"name": "c.tilt", "reason": reason("s.E"), "together_with": ["s.E"],  # s.E does not name it
                   "correlation": 0.99996})
    result = {"parameters": {n: {"value": 1.0, "std": None} for n in (*names, "c.tilt")}, "not_identifiable": listed}
    said = undetermined(result)
    assert said.count("cannot be told apart from each other: correlation 1.000") == 1
    assert said.count("cannot be told apart from s.E: correlation 1.000") == 1
