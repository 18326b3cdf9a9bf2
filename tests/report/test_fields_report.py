"""The report of measured fields: its words, its maps on the points, and moduli that only a misfit moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up_run import make_record, make_result

from idic.report import comparison_tables, render_page, result_headline
from idic.report.result.fit_words import in_words_of
from idic.report import undetermined
from idic.report.figures.point_maps import point_maps, rms
from idic.report.result.record import PointMaps
from idic.report.result.words import hardly_determined
from idic.report import comparison_headlines
from idic.run.reporting.compare import _parameter


@pytest.fixture
def fields():
    """A record of measured fields: 300 points, two frames, noise alone in the residual."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(12) * 1.5, np.arange(25) * 1.5)
    positions = np.column_stack([x.ravel(), y.ravel()])
    result = make_result() | {"quantity": "displacement"}
    result["noise"] = {"std_gv": 0.4, "unit": "µm", "source": "stage_differences"}
    measured = np.array([k * positions * [0.3, 1.0] for k in (1, 2)])
    points = PointMaps((3, 6), positions, measured, rng.normal(0.0, 0.4, measured.shape), 1.5)
    return replace(make_record(result=result), points=points, pixel_size_mm=1.5)


def test_the_maps_show_every_point_and_are_absent_of_images(fields):
    picture = point_maps(fields)
    assert picture is not None and picture.name == "point_maps" and "σ = 0.4 µm" in picture.caption
    assert point_maps(replace(fields, points=None)) is None
    assert rms(np.array([3.0, np.nan, 4.0])) == pytest.approx(np.sqrt(12.5))


def test_the_page_of_fields_does_not_speak_of_cameras_and_that_of_images_does(fields):
    page = render_page(fields, ())
    assert "The residual of the fields is their noise" in page and "from the differences of stages" in page
    for word in ("camera noise", "image residual", "free FE-DIC", "per pixel"):
        assert word not in page, word
    assert "The image residual is camera noise" in render_page(make_record(), ())
    assert in_words_of(make_result(), "camera noise") == "camera noise"
    caption = in_words_of(fields.result, "f + h − g(x + u) in the reference image; σ is the residual")
    assert caption.startswith("The compared components of a point, rms. ")  # two, or three with the normal


def test_motion_is_in_micrometres_where_a_pixel_is_the_distance_of_points(fields):
    assert fields.motion_unit == (1500.0, "µm") and make_record().motion_unit == (1.0, "px")


def test_a_modulus_that_only_the_misfit_moves_is_not_determined():
    result = make_result()
    entry = result["parameters"]["sheet.E"]
    entry.update(value=17.0, std=16.5, std_noise=6.0, std_model=15.4, ci95=[-15.0, 49.0], unit="MPa")
    assert "E = " not in result_headline(result)[0]
    assert "E (the 95 % interval reaches zero" in undetermined(result)
    assert '<td class="text warn-text">interval reaches 0</td>' in render_page(make_record(result=result), ())
    entry.update(std_noise=16.0, std_model=4.0)  # noise alone: it is found, badly
    assert hardly_determined(result) == [] and "E = 17 ± 16" in result_headline(result)[0]


def compared(*quantities: str) -> dict:
    """Content of compare.json of runs on the same data."""
    run = {"status": "converged", "models": {}, "method": "integrated", "n_free": 1, "image_chi2_dof": 1.0,
           "image_rms": 0.5, "image_unit": "µm", "channel_chi2_dof": {}, "iterations": 3, "wall_s": 1.0,
           "same_data": True, "parameters": {}}
    return {"parameters": [], "runs": [run | {"name": f"run {k}", "quantity": quantity}
                                       for k, quantity in enumerate(quantities)]}


def test_a_comparison_says_what_was_measured():
    def names(content: dict) -> list[str]:
        return [row[0].text for row in comparison_tables(content)[1].rows]

    fields, images, both = (compared(*of) for of in (["displacement"] * 2, ["grey"] * 2, ["grey", "displacement"]))
    assert "fields: χ² per component" in names(fields) and "per component" in comparison_headlines(fields)[0]
    assert "images: χ² per pixel" in names(images) and "per pixel" in comparison_headlines(images)[0]
    assert not any("image" in name or "pixel" in name for name in names(fields))
    measured = comparison_tables(both)[1].rows[0]
    assert [cell.text for cell in measured] == ["measured", "images", "fields"]
    assert "χ² per pixel, of fields per component" in names(both)


def test_values_of_two_units_are_compared_in_the_first_and_those_of_two_dimensions_not():
    def given(value, std, unit):
        return {"value": value, "std": std, "systematic_std": None, "unit": unit, "start": value, "free": True}

    entries = (_parameter("s.E", [None, given(69.748, 0.16, "GPa"), given(69748.0, 160.0, "MPa")]),
               _parameter("s.E", [given(69.748, 0.16, "GPa"), given(70e3, 120.0, "MPa"), given(3.0, 1.0, "px")]))
    assert entries[0]["differences"] == [None, None, None]  # nothing in the first run
    assert entries[1]["differences"] == [0.0, pytest.approx(0.252 / 0.2), None]
    assert [own["unit"] for own in entries[1]["values"]] == ["GPa", "GPa", "px"]
    assert entries[1]["values"][1] == given(pytest.approx(70.0), pytest.approx(0.12), "GPa")
    content = compared("grey", "grey", "grey") | {"parameters": entries[1:]}
    first, *_ = comparison_tables(content)[0].rows
    assert [cell.text for cell in first[1:4]] == ["69.75 ± 0.16 GPa", "70.00 ± 0.12 GPa", "3.0 ± 1.0 px"]
    assert first[4].text == "+1.3 std" and first[5].text == "–"
