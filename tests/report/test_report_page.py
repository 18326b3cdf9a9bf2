"""The report from a made-up run: the right sentences first, every figure drawn, nothing fetched from outside."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from made_up_run import NAMES, make_curve, make_record, make_result

from idic.report import draw_sections, number_text, render_page, tables, with_std
from idic.report.design.page import short
from idic.report.result.words import two_digits
from idic.report.design.words import percent
from idic.report.figures import charts, maps, matrices
from idic.report.page import _derived_rows
from idic.report.result.words import relative_std

BARE = dict(history=(), M=None, reference=None, nodes_px=None, cells=(), times=None, rms_before=None, rms_after=None,
            channels=(), fields=None, sensitivities=None, residuals=None, notes=(), views=(), free_fields=None,
            curves=(), practice=None)


@pytest.fixture
def record():
    return make_record()


class Checker(HTMLParser):
    """Collects outside references and unbalanced tags."""

    void = {"meta", "img", "br", "hr", "link", "input"}

    def __init__(self):
        super().__init__()
        self.open, self.references, self.images = [], [], 0

    def handle_starttag(self, tag, attrs):
        if tag not in self.void:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href"):
                self.references.append(value)
        self.images += tag == "img"

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_one_self_contained_well_formed_file(record, sections):
    page = render_page(record, sections)
    checker = Checker()
    checker.feed(page)
    assert not checker.open
    assert all(r.startswith(("data:image/webp;base64,", "#")) for r in checker.references)
    assert not re.search(r"https?://|@import|url\(", page)
    slides = [picture for section in sections for slide in section.slides for picture in slide.pictures]
    assert len(slides) == 6 and all(picture.png.startswith(b"\xff\xd8") for picture in slides)
    assert checker.images == sum(len(s.pictures) for s in sections) + len(slides) == 12 + 6
    assert len(page) < 3e6  # to be sent by mail


def test_a_parameter_that_the_test_cannot_see_has_that_status_in_the_tables():
    lost = [(NAMES[0], "no force was measured: stresses have no scale")]
    record = make_record(result=make_result(not_identifiable=lost))
    assert tables.parameter_status(record, "sheet.E") == "not determined"
    assert "not determined" in render_page(record, ())


def test_a_ratio_that_moves_between_treatments_is_not_given_as_found():
    result = make_result(not_identifiable=[("G", "moves by 62 % between treatments of boundary and camera")])
    result["derived"]["G"]["systematic_std"] = 9e3
    row = next(row for row in _derived_rows(make_record(result=result)))
    assert row["value"] == "–" and row["status"] == "not determined" and row["systematic"] == "9000"


def test_a_run_that_did_not_converge_is_marked():
    assert 'class="warn"' in render_page(make_record(result=make_result(status="stalled")), ())


def test_a_ratio_has_its_whole_name_as_title():
    result = make_result()
    result["derived"] = {"sheet.E/yield_stress": {"value": 350.2, "std": 0.5, "ci95": [349.2, 351.2]}}
    page = render_page(make_record(result=result), ())
    assert '<td title="sheet.E/yield_stress">E/yield_stress</td>' in page


def test_a_frame_that_is_left_out_does_not_set_the_scale():
    rms = np.full(20, 3.4)
    rms[7] = 400.0
    result = make_result()
    result["frames"][7] |= {"status": "unexplained", "rms_gv": 400.0}
    plain, marked = (charts.residual_level(make_record(result=r, rms_after=rms)) for r in (make_result(), result))
    assert plain.png != marked.png


def test_the_local_chi2_is_one_where_there_is_nothing_but_noise():
    rng = np.random.default_rng(3)
    noise = np.where(np.arange(200)[:, None] < 190, rng.standard_normal((1, 200, 300)), np.nan)
    found = maps._window_mean(noise**2, 11)
    assert np.isnan(found[0, 195]).all()
    brute = np.nanmean(noise[0, 45:56, 65:76] ** 2)
    assert found[0, 50, 70] == pytest.approx(brute, rel=1e-12)
    # the mean of 121 squares scatters by sqrt(2 / 121) = 13 %, the mean over the map by less than 1 %
    assert np.nanmean(found) == pytest.approx(1.0, abs=0.02)
    assert maps.local_chi2(make_record()).png.startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "value, std, unit, text",
    [
        (70012.3, 55.1, "MPa", "70.012 ± 0.055 GPa"),
        (199.84, 0.24, "MPa", "199.84 ± 0.24 MPa"),
        (0.30041, 0.0011, "-", "0.3004 ± 0.0011"),
        (1234.5, 250.0, "N", "1234 ± 250 N"),
        (1.2342e-6, 2.1e-8, "1/px^2", "(1.234 ± 0.021)·10⁻⁶ 1/px^2"),
        (5e-4, 2e-3, "mm", "0.0005 ± 0.0020 mm"),  # a value near zero has the digits of its error
        (0.0, 1e-5, "mm", "(0.0 ± 1.0)·10⁻⁵ mm"),
        (3.0, None, "mm", "3 mm"),
        (0.0, 0.012, "deg", "0.000 ± 0.012 deg"),
        (1.47e11, 3e9, "MPa s", "(1.470 ± 0.030)·10¹¹ MPa s"),
    ],
)
def test_numbers_show_two_digits_of_their_standard_deviation(value, std, unit, text):
    assert with_std(value, std, unit) == text


@pytest.mark.parametrize(("std", "text"), [
    (99.4, "99"), (99.5, "100"), (99.96, "100"), (100.0, "100"), (123.0, "120"), (9.96e6, "10000000"), (2e7, "2.0e+07"),
    (0.0, "0"), (-99.7, "-100"), (float("nan"), "nan"), (float("inf"), "inf"), (2.5e-6, "2.5e-06")])
def test_an_error_has_no_exponent_where_it_can_be_written_out(std, text):
    assert two_digits(std) == short(std) == text


def test_a_share_that_is_rounded_to_the_whole_has_no_exponent():
    assert relative_std(1.0, 0.997) == percent(0.997) == "100 %" and percent(1.52) == "150 %"


@pytest.mark.parametrize("changes, level", [({}, "good"), ({"chi2": 1.4}, "look"), ({"status": "stalled"}, "bad")])
def test_the_verdict_stands_at_the_top(changes, level):
    page = render_page(make_record(result=make_result(**changes)), ())
    assert page.index(f'class="verdict {level}"') < page.index('class="first')


def test_still_images_below_the_bound_have_not_moved():
    floor = {"px": 0.02, "bound_px": 0.03, "length_px": 50.0, "frames": [1, 2], "labels": ["a.tif", "b.tif"],
             "drift_px": [0.01, 0.02], "source": "declared"}
    assert "has moved by" not in render_page(make_record(result={**make_result(), "camera_floor": floor}), ())


def test_the_curve_of_a_law_with_an_open_parameter_is_not_drawn():
    curves = (make_curve(missing=("sheet.E",)),)
    law = next(s for s in draw_sections(make_record(**BARE | {"curves": curves})) if s.anchor == "law")
    assert not law.pictures and "does not determine sheet.E" in law.text
    curves = make_record().curves
    drawn = next(s for s in draw_sections(make_record(**BARE | {"curves": curves})) if s.anchor == "law")
    assert "± 0.51 MPa" in drawn.pictures[0].caption  # 1.96 * 0.001 * (200 + 2000 * 0.03)


def test_every_optional_part_may_be_missing():
    page = render_page(make_record(**BARE))
    assert "E = 70.012" in page
    images_only = make_record(channels=(), rms_before=None, reference=None, views=(), free_fields=None, curves=())
    assert len(render_page(images_only)) > 100_000  # still with maps in it


def test_a_single_parameter_and_a_singular_matrix_are_drawn():
    one = make_record(names=NAMES[:1], M=np.array([[4.0]]))
    assert matrices.spectrum(one).png.startswith(b"\x89PNG")
    singular = make_record(M=np.diag([1e6, 1e3, 0.0, 0.0]))
    assert matrices.spectrum(singular).png.startswith(b"\x89PNG")


def test_failed_and_missing_frames_do_not_break_the_charts():
    rms = np.full(20, 3.4)
    rms[[0, 7]] = np.nan
    result = make_result()
    result["frames"][7] |= {"status": "lost", "rms_gv": None, "chi2_dof": None}
    result["frames"][9]["status"] = "unexplained"
    record = make_record(result=result, rms_after=rms)
    assert charts.residual_level(record) is not None
    history = [dict(h) for h in record.history]
    history[2]["phi"] = None  # a trial whose simulation failed
    assert charts.convergence(make_record(history=tuple(history))) is not None
    assert "–" in render_page(record, ())


def test_triangles_for_drawing_cover_each_cell_once():
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [1.0, 0.0], [2.0, 1.0], [1.0, 2.0], [0.0, 1.0]])
    for cell, nodes, area in (("quad4", 4, 4.0), ("quad8", 8, 4.0)):
        record = make_record(nodes_px=corners, cells=((cell, np.arange(nodes)[None, :]),))
        t = maps.triangulate(record)
        x = corners[t.triangles]
        cross = (x[:, 1, 0] - x[:, 0, 0]) * (x[:, 2, 1] - x[:, 0, 1]) - (x[:, 1, 1] - x[:, 0, 1]) * (
            x[:, 2, 0] - x[:, 0, 0]
        )
        assert (cross > 0).all() and cross.sum() / 2 == pytest.approx(area)


def test_the_tables_hold_the_same_numbers(record):
    found = tables.all_tables(record)
    assert set(found) == {"parameters.csv", "frames.csv", "iterations.csv", "correlation.csv"}
    rows = found["parameters.csv"].splitlines()
    assert rows[0].startswith("name,unit,start,value,std") and rows[1].startswith("sheet.E,MPa,60000,70012.3,55.1")
    assert len(found["frames.csv"].splitlines()) == 21
    # frame numbers stand once
    for record_of, second in ((record, "time_[s]"), (replace(record, time_label="frame"), "label")):
        header = tables.frames(record_of).splitlines()[0].split(",")
        assert header[:2] == ["frame", second] and len(set(header)) == len(header)
    assert len(found["iterations.csv"].splitlines()) == 1 + len(record.history)


@pytest.mark.parametrize(("value", "std", "shown", "share"), [
    (69695.2, 166.0, "69695", "0.24 %"), (-5.061e-5, 1.3e-4, "-5e-05", "> 100 %"),
    (1.7e-7, 1.7e-7, "1.7e-07", "> 100 %"), (1.4702e11, 2.1e9, "1.470e+11", "1.4 %"),
    (0.0020, 0.0050, "0.0020", "> 100 %"), (0.0, 0.1, "0.00", "–")])
def test_a_value_has_the_digits_that_its_standard_deviation_supports(value, std, shown, share):
    assert number_text(value, std) == shown and relative_std(value, std) == share


def test_the_figure_of_correlations_does_not_say_that_all_parameters_are_separated_where_one_is_open():
    record = make_record()
    table = {"names": ["A.E", "A.nu"], "matrix": [[1.0, 0.3], [0.3, 1.0]]}
    whole = replace(record, result=record.result | {"correlation": table, "not_identifiable": []})
    part = replace(whole, result=whole.result | {"not_identifiable": [
        {"name": "A.hardening", "reason": "no yielding", "together_with": [], "correlation": None}]})
    assert matrices.correlation(whole).caption.endswith("The test separates all parameters.")
    assert matrices.correlation(part).caption.endswith(
        "The test separates these parameters. Those that it does not determine are not shown.")
    loose = {"value": 900.0, "std": 600.0, "std_noise": 20.0, "ci95": [-276.0, 2076.0], "unit": "MPa", "free": True}
    hardly = replace(whole, result=whole.result | {"parameters": whole.result["parameters"] | {"A.hardening": loose}})
    assert "all parameters" not in matrices.correlation(hardly).caption
    assert "reaches zero all the same" in matrices.correlation(hardly).caption
