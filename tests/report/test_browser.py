"""The report in a real browser, on a phone and on a desk: nothing sticks out, nothing is fetched, the slider slides."""

from __future__ import annotations

import pytest
from browser import find_browser, look_at
from made_up_run import make_record, make_result

from idic.report import render_page

needs_browser = pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine (apt install chromium)")


@pytest.fixture(scope="module")
def page(sections, tmp_path_factory):
    reason = "a reason of some length: no force was measured, stresses have no scale"
    result = make_result(not_identifiable=[("sheet.E", reason)])
    result["parameters"]["sheet.a_parameter_with_a_very_long_name_that_does_not_fit"] = dict(
        result["parameters"]["sheet.nu"], value=123456.789)
    file = tmp_path_factory.mktemp("page") / "report.html"
    long = "A_title_without_a_place_where_it_could_be_broken_as_file_names_are_" * 2
    file.write_text(render_page(make_record(result=result, title=long), sections), encoding="utf-8")
    return file


@needs_browser
@pytest.mark.parametrize("width", [390, 1280])
def test_the_report_fits_the_screen_and_asks_for_nothing(page, width):
    seen = look_at(page, width, whole=False)
    assert seen.overflow <= 0 and not seen.wide, seen.wide
    assert not seen.requests and not seen.errors and not seen.broken
    assert seen.slides == [False, False, True] and seen.moved == [True, False, False]
    assert "Good practice" in seen.text


@needs_browser
def test_a_page_that_sticks_out_or_fetches_something_would_be_noticed(tmp_path):
    file = tmp_path / "bad.html"
    file.write_text('<div style="width: 3000px">x</div><img src="http://127.0.0.1:9/x.png">', encoding="utf-8")
    seen = look_at(file, 390, whole=False)
    assert seen.wide and seen.requests == ["http://127.0.0.1:9/x.png"] and seen.broken == 1
