"""What was once seen wrong on the pages: overprinted labels, markers without a legend, saturated scales, odd axes."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import find_browser, look_at
from made_up_run import make_record, make_result

from idic.laws import compile, uniaxial
from idic.report.figures import charts, maps
from idic.report import Picture, filled_in, render_page

needs_browser = pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine (apt install chromium)")


@pytest.fixture
def drawn(monkeypatch):
    """The matplotlib figures that charts and maps hand over."""
    figures = []

    def keep(figure, name, title, caption, as_photo=False):
        figure.canvas.draw()
        figures.append(figure)
        return Picture(name, title, caption, b"")

    for module in (charts, maps):
        monkeypatch.setattr(module, "to_picture", keep)
    return figures


def maps_in(figure):
    """The maps of pixels of a figure, cut to the specimen; its colour bars are smaller."""
    shown = [axis.images[0] for axis in figure.axes if axis.images]
    return [image for image in shown if np.ndim(image.get_array()) == 2 and min(image.get_array().shape) > 150]


def with_left_out(frames, rms):
    result = make_result()
    for k in frames:
        result["frames"][k]["status"] = "unexplained"
    after = np.full(20, 3.38)
    after[list(frames)] = rms
    return make_record(result=result, rms_after=after)


@pytest.mark.parametrize("frames", [range(9, 17), (3, 4, 15, 16), (2, 9, 17), range(1, 20)])
def test_labels_of_left_out_frames_do_not_overprint_and_stay_on_the_axis(drawn, frames):
    charts.residual_level(with_left_out(frames, np.linspace(90.0, 1740.0, len(frames))))
    (figure,) = drawn
    axis = figure.axes[0]
    boxes = [text.get_window_extent() for text in axis.texts]
    assert boxes and all(not a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(axis.bbox.x0 <= box.x0 and box.x1 <= axis.bbox.x1 for box in boxes)
    assert "1.74e+03" in " ".join(text.get_text() for text in axis.texts)


def test_every_marker_of_left_out_frames_is_in_the_legend(drawn):
    charts.residual_level(with_left_out((4, 9), [3.5, 400.0]))
    (legend,) = drawn[0].legends
    told = {text.get_text() for text in legend.get_texts()}
    assert {"lost or unexplained", "lost or unexplained, beyond the axis"} <= told


def test_the_scale_of_the_local_chi2_ends_at_its_maximum_in_each_row(drawn):
    record = make_record()
    before = np.where(np.isfinite(record.residuals.start), 40.0 * record.residuals.start, np.nan)
    maps.local_chi2(replace(record, residuals=replace(record.residuals, start=before)))
    shown = maps_in(drawn[0])
    start, identified = shown[:3], shown[3:]
    for row in (start, identified):
        largest = max(float(np.nanmax(np.ma.filled(image.get_array(), np.nan))) for image in row)
        assert all(image.norm.vmax == pytest.approx(max(largest, 2.0)) for image in row)
        assert all(image.norm.vmin == pytest.approx(1.0 / image.norm.vmax) for image in row)
    assert start[0].norm.vmax > 1000.0 > 50.0 > identified[0].norm.vmax


def test_numbers_of_a_low_colour_bar_do_not_overprint(drawn):
    """Maps of a wide specimen are low, and a row of starting values reaches far."""
    record = make_record()
    data = record.residuals
    before, after = (np.asarray(stack)[:, 60:140] for stack in (data.start, data.identified))
    maps.local_chi2(replace(record, residuals=replace(data, start=100.0 * before, identified=after)))
    bars = [axis for axis in drawn[0].axes if axis.get_ylabel().startswith("local")]
    assert len(bars) == 2
    for bar in bars:
        boxes = [label.get_window_extent() for label in bar.get_yticklabels() if label.get_text()]
        assert len(boxes) >= 2 and all(not a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_a_parameter_that_moves_nothing_has_a_map_without_a_pattern(drawn):
    record = make_record()
    data = record.sensitivities
    maps.sensitivities(replace(record, sensitivities=replace(data, phi_px=np.concatenate(
        [1e-16 * data.phi_px[:1], data.phi_px[1:]]))))
    labels = [axis.get_xlabel() for axis in drawn[0].axes if axis.get_xlabel()]
    assert labels[0] == "no motion" and "no motion" not in labels[1:]


def test_more_curves_than_colours_are_told_apart():
    styles = [charts.curve_style(i, "p") for i in range(20)]
    assert len({(style["color"], style["marker"]) for style in styles}) == 20


def test_rows_of_the_local_chi2_that_differ_little_have_one_scale(drawn):
    record = make_record()
    maps.local_chi2(replace(record, residuals=replace(record.residuals, start=1.3 * record.residuals.identified)))
    shown = maps_in(drawn[0])
    assert len({image.norm.vmax for image in shown}) == 1 and len(shown) == 6


def test_two_frames_have_an_axis_of_two_frames(drawn):
    result = make_result()
    result["frames"] = result["frames"][:2]
    data = make_record().channels[0]
    two = replace(data, measured=data.measured[:2], simulated=data.simulated[:2], started=data.started[:2])
    record = make_record(result=result, times=np.array([0.0, 1.0]), time_label="frame",
                         rms_before=np.array([np.nan, 9.0]),
                         rms_after=np.array([np.nan, 3.4]), channels=(two,))
    charts.residual_level(record)
    charts.channel(record, two)
    for figure in drawn:
        axis = figure.axes[-1] if len(figure.axes) == 2 else figure.axes[0]
        low, high = axis.get_xlim()
        assert low < 0.0 < 1.0 < high and high - low < 1.5
        ticks = [tick for tick in axis.get_xticks() if low <= tick <= high]
        assert ticks == [0.0, 1.0]


def chip(page, label):
    """The class of a fact under the headline."""
    found = re.search(rf'<li([^>]*)><span>{re.escape(label)}</span>', page)
    return found.group(1).strip()


def test_a_bad_value_has_no_green_chip():
    result = make_result(chi2=3.4)
    result["residual"] |= {"free_dic_chi2_dof": 3.1, "channel_chi2_dof": {"force_N": 0.01}, "lost_pixels": 90_000}
    for frame in result["frames"]:
        frame["n_pixels"] = 30_000
    result["camera_floor"] = {"px": None, "bound_px": None}
    page = render_page(make_record(result=result), ())
    for label in ("χ² per pixel", "χ² of a free FE-DIC", "χ² of force_N", "pixels that left the image"):
        assert chip(page, label) == 'class="warn"', label
    for label in ("camera&#39;s floor", "noise of one image σ"):
        assert chip(page, label) == 'class="plain"', label
    few = make_result()
    few["residual"]["channel_chi2_dof"] = {"force_N": 0.07}
    few["frames"] = few["frames"][:3]
    assert chip(render_page(make_record(result=few), ()), "χ² of force_N") == ""  # three readings: chance
    wrong = make_result()
    wrong["frames"][4] |= {"status": "unexplained", "used": True}
    page = render_page(make_record(result=wrong), ())
    assert chip(page, "frames used") == 'class="warn"' and ", 1 of them unexplained" in page
    good = render_page(make_record(), ())
    assert chip(good, "χ² per pixel") == chip(good, "χ² of force_N") == chip(good, "status") == ""


@needs_browser
def test_a_table_wider_than_the_screen_says_so_and_a_chart_fits(sections, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(render_page(make_record(), sections), encoding="utf-8")
    count = """(() => { const seen = (what) => [...document.querySelectorAll(what)].filter(e => e.offsetHeight > 0);
        const wide = (what) => seen(what).filter(e => e.scrollWidth > e.clientWidth + 2).length;
        const before = [seen(".hint").length, wide(".scroll"), wide("figure > .card"),
                        seen("figure > .card > img[role=button]").length];
        const chart = document.querySelector("figure > .card > img[role=button]");
        const press = () => { chart.dispatchEvent(new KeyboardEvent("keydown", {key: "Enter"}));
                              return wide("figure > .card"); };
        return JSON.stringify([...before, ...(chart ? [press(), press()] : [])]); })()"""
    phone, desk = (look_at(file, width, whole=False, script=count) for width in (390, 1440))
    hints, tables, charts, enlarged, *after = json.loads(phone.value)
    assert hints == tables + enlarged and tables > 0 and enlarged > 1 and phone.overflow <= 0
    assert charts == 0 and after == [1, 0]  # every chart fits; one is enlarged by a key, and fits again
    assert json.loads(desk.value) == [0, 0, 0, 0]


@needs_browser
def test_the_table_of_candidates_is_whole_at_1200_px(tmp_path):
    candidate = {"title": "plastic hardening with curvature (saturation)", "name": "hardening_curvature",
                 "label": "a label",
                 "family": "plasticity", "score": "10.4", "p": "1e-12", "effect": "0.012", "visibility": "0.42",
                 "predicted": "1.23e+04", "achieved": "1.19e+04", "heldout": "4.1e+03 of 5.2e+03",
                 "standing": "significant, below the practical margin"}
    page = filled_in("diagnosis.html.j2", title="t", first="One candidate selected.", rest=[], facts=[], sure=True,
                     left_over=None, not_excluded=[], cautions=(),
                     sections=(), parameters=[], candidates=[candidate] * 5, excluded=[], cannot_tell=[], costs=[],
                     chain=[], odds=[])
    file = tmp_path / "diagnosis.html"
    file.write_text(page, encoding="utf-8")
    script = ('(() => { const t = document.querySelector("table.many"); return t.scrollWidth - '
              't.parentNode.clientWidth; })()')
    assert look_at(file, 1200, whole=False, script=script).value <= 0


def test_a_law_is_pulled_along_the_axis_that_is_asked_for():
    law = compile("orthotropic", "small")
    values = dict(zip(law.spec.parameter_names, law.spec.defaults(), strict=True)) | {"angle": 0.0}
    strain = np.linspace(0.0, 1e-3, 4)
    for axis, modulus in ((0, "E1"), (1, "E2")):
        found = uniaxial(law, list(values.values()), strain, mode=2, axis=axis)
        assert np.allclose(found.P[:, axis, axis], values[modulus] * strain, rtol=1e-9)
        assert np.allclose(found.P[:, 1 - axis, 1 - axis], 0.0, atol=1e-9 * values[modulus])
        assert np.allclose(uniaxial(law, list(values.values()), -strain, mode=2, axis=axis).P, -found.P)


@pytest.mark.parametrize("ratio, told", [(1.0, False), (0.9, True), (1.1, True)])
def test_maps_of_the_start_whose_rms_is_not_that_of_the_curve_say_why(ratio, told):
    record = make_record()
    curve = np.full(record.n_frames, np.nan)
    curve[list(record.residuals.frames)] = ratio * np.sqrt(np.nanmean(record.residuals.start**2, axis=(1, 2)))
    for figure in (maps.residuals, maps.local_chi2):
        caption = figure(replace(record, rms_before=curve)).caption
        assert ("for the curve of the start values the edges are fitted" in caption) == told
