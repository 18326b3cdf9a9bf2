"""The field viewer of the report in a real browser: what it computes is what Python computes."""

import base64
import json
from dataclasses import replace

import numpy as np
import pytest
from browser import find_browser, look_at
from made_up_run import make_record

from idic.measure import FieldSeries, readings
from idic.measure.fields.series import component_of
from idic.measure.fields.surface import Surface
from idic.fe import make_mesh
from idic.model import Gauge
from idic.report.fields import viewer
from idic.report.fields.tables import gauge_tables
from idic.report.fields.viewer import viewer_data
from idic.report.page import _fields, drawn_sections
from idic.report import render_page

needs_browser = pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine (apt install chromium)")
PIXEL = 0.05  # mm
GAUGES = (Gauge("P", "probe", ((0.5, 0.3),)), Gauge("L0", "extensometer", ((-4.0, 0.5), (4.0, 0.5))),
          Gauge("cut", "line", ((0.0, -2.0), (0.0, 2.0)), samples=11), Gauge("C", "circle", ((3.0, 0.0),), 0.5))


@pytest.fixture(scope="module")
def record():
    made = make_record()
    nodes = np.array([1.0, -1.0]) * (made.nodes_px - [150.0, 100.0]) * PIXEL
    surface = Surface(make_mesh(nodes, [("quad4", made.cells[0][1])]), np.arange(len(nodes)))
    x, y = nodes.T
    share = np.linspace(0.0, 1.0, 20)[:, None]
    u = np.stack([share * 0.2 * np.tanh(x / 3.0) + 0.03 * share * y, -0.06 * share * y * np.exp(-(x / 3.0) ** 2)],
                 axis=-1)
    rng = np.random.default_rng(3)
    noise = 1e-3 * rng.standard_normal((8, len(nodes), 2))
    measured = u + 1e-3 * rng.standard_normal(u.shape)
    measured[:, 0] = np.nan
    stress = np.einsum("mnij,kl->mnij", np.ones((20, len(nodes), 2, 2)), np.ones((1, 1)))
    stress = stress * np.array([[100.0, 20.0], [20.0, -30.0]]) * share[..., None, None]
    depth = {"u_z": -0.01 * share * np.abs(x), "z": 2.0 + 0.1 * x - 0.01 * share * np.abs(x)}
    series = FieldSeries(surface, tuple(range(20)), u, measured, noise, stress, {"plastic_strain": share * np.abs(x)},
                         depth=depth, measured_depth={name: z + 2e-3 * np.cos(x) for name, z in depth.items()},
                         depth_noise=3e-3 * rng.standard_normal((8, len(nodes))))
    return make_record(series=series, gauges=GAUGES)


@pytest.fixture(scope="module")
def page(record, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "report.html"
    file.write_text(render_page(record, drawn_sections((_fields(record),))), encoding="utf-8")  # without the figures
    return file


ASKED = [("strain.xx", "green_lagrange", 0.0), ("strain.xy", "hencky", 30.0), ("strain.1", "hencky", 0.0),
         ("strain.max_shear", "small", 0.0), ("stress.yy", "green_lagrange", 30.0),
         ("stress.von_mises", "green_lagrange", 0.0)]


def test_the_motion_out_of_the_plane_and_the_shape_are_on_the_page(record):
    data = json.loads(viewer_data(record))
    assert [name for name, _ in data["depth"]] == ["u_z", "z"]
    corners = record.series.surface.corners
    for name, exact in record.series.depth.items():
        packed = data["arrays"][f"depth.{name}"]
        raw = np.frombuffer(base64.b64decode(packed["data"]), "<i2").reshape(packed["shape"])
        values = packed["middle"][0] + packed["step"][0] * raw[..., 0]
        assert np.allclose(values, exact[data["frames"]][:, corners], atol=packed["step"][0])


def test_a_free_measurement_that_failed_is_told_beside_its_field(record):
    assert json.loads(viewer_data(record))["failed"] == ""
    result = record.result | {"residual": record.result["residual"] | {"free_dic_chi2_dof": 193.0}}
    assert "its field is no measurement" in json.loads(viewer_data(replace(record, result=result)))["failed"]


@needs_browser
def test_the_browser_computes_strain_stress_and_noise_as_python_does(page, record):
    calls = [f'idicFields.field("{q}", "{s}", 19, "{m}", {a})' for q, m, a in ASKED for s in ("simulated", "measured")]
    calls += ['idicFields.noise("strain.xx", 19, "hencky", 0)', 'idicFields.noise("depth.z", 19, "small", 0)',
              'idicFields.field("depth.z", "measured", 19, "small", 0)']
    seen = look_at(page, 1280, whole=False, script=f"JSON.stringify([{', '.join(calls)}])")
    assert not seen.errors and not seen.requests and seen.overflow <= 0
    *found, noise, depth_noise, z = ([np.nan if v is None else v for v in one] for one in json.loads(seen.value))
    series = record.series
    for number, values in enumerate(found):
        (quantity, measure, angle), source = ASKED[number // 2], ("simulated", "measured")[number % 2]
        kind, component = quantity.split(".")
        if kind == "stress":
            turn = np.radians(angle)
            R = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
            exact = component_of(R @ series.stress[19] @ R.T, component)
        else:
            exact = component_of(series.strain(measure, angle, source)[19], component)
        reach = np.nanmax(np.abs(exact))
        # 16 bits over the range of each component of all frames: a step of 1/64000 of it, and four of them add up
        assert np.allclose(values, exact, atol=4e-5 * max(reach, 0.05), equal_nan=True), quantity
    assert np.allclose(noise, series.strain_std("xx", "hencky")[19], rtol=2e-3)
    assert np.allclose(depth_noise, np.sqrt(np.mean(series.depth_noise**2, axis=0)), rtol=2e-3)
    assert np.allclose(z, series.measured_depth["z"][19], atol=1e-4)  # 64 000th of a range of 3 mm


@needs_browser
def test_declared_gauges_read_in_the_page_what_the_tables_hold_and_picked_ones_read_the_same_field(page, record):
    script = """idicFields.add("extensometer", [[-4.0, 0.5], [4.0, 0.5]]);
      JSON.stringify([1, 4].map(i => ["measured", "simulated", "std"].map(s => idicFields.read(i, s, 19))))"""
    seen = look_at(page, 390, whole=False, script=script)
    assert not seen.errors and seen.overflow <= 0 and not seen.wide, seen.wide
    declared, picked = json.loads(seen.value)
    own = next(one for one in readings(record.series, GAUGES[1]) if one.quantity == "strain")
    exact = [own.measured[19], own.simulated[19], own.std[19]]
    assert np.allclose(declared, exact, rtol=1e-6)
    # the page interpolates in triangles, the table in quadrilaterals: they differ within an element
    assert np.allclose(picked[:2], exact[:2], atol=2.0 * own.std[19]) and picked[2] == pytest.approx(exact[2], rel=0.5)
    assert "L0" in seen.text and "half of γ" in seen.text


@needs_browser
def test_a_click_sets_a_point_and_gives_the_lines_for_experiment_toml(page):
    script = """document.querySelector('[data-tool="probe"]').click();
      (() => { const c = document.querySelector('[data-panel="simulated"] canvas'), b = c.getBoundingClientRect();
      c.dispatchEvent(new MouseEvent("click", {clientX: b.x + 0.3 * b.width, clientY: b.y + 0.5 * b.height}));
      return document.querySelector('[data-is="numbers"]').value; })()"""
    seen = look_at(page, 1280, whole=False, script=script)
    assert "[[probe]]" in seen.value and "at_mm = [" in seen.value and "probe 2" in seen.value
    head, *rows = seen.value.split("\n\n", maxsplit=1)[0].splitlines()
    assert head.startswith("frame\ttime_s\t") and [int(row.split("\t")[0]) for row in rows] == list(range(20))


def test_a_page_of_a_large_mesh_keeps_fewer_frames_and_says_nothing_where_it_has_no_room(record, monkeypatch):
    monkeypatch.setattr(viewer, "MAX_VALUES", 60_000)
    kept = json.loads(viewer_data(record))
    assert kept["frames"][0] == 0 and kept["frames"][-1] == 19 and 3 <= len(kept["frames"]) < 20
    monkeypatch.setattr(viewer, "MAX_VALUES", 20_000)
    assert viewer_data(record) == ""
    assert viewer_data(make_record()) == ""


def test_the_tables_hold_every_gauge_over_the_frames(record):
    tables = gauge_tables(record)
    header, rows = tables["gauges.csv"]
    assert len(rows) == 20 and header[:2] == ["frame", "time_s"]
    column = header.index("L0.strain_measured")
    own = next(one for one in readings(record.series, GAUGES[1]) if one.quantity == "strain")
    assert [row[column] for row in rows] == list(own.measured)
    header, rows = tables["line_cut.csv"]
    assert len(rows) == 20 * 11 and {"s_mm", "strain_1_simulated", "stress_xx_MPa_simulated"} <= set(header)


def test_a_name_cannot_leave_the_script(record):
    gauge = Gauge("</script><script>alert(1)</script>", "probe", ((0.5, 0.3),))
    named = replace(record, gauges=(gauge,))
    text = render_page(named, drawn_sections((_fields(named),)))
    assert "alert(1)" in text
    assert "<script>alert(1)" not in text


@needs_browser
def test_white_stands_for_zero_also_on_a_scale_of_the_user(page):
    script = """(() => { const of = (name) => document.querySelector('[data-is="' + name + '"]');
      of("quantity").value = "u_x"; of("quantity").dispatchEvent(new Event("input"));
      return JSON.stringify([1, 4].map((high) => { of("low").value = "-1"; of("high").value = high;
        of("high").dispatchEvent(new Event("input"));
        const bar = document.querySelectorAll('[data-panel="simulated"] canvas')[1];
        const middle = bar.getContext("2d").getImageData(bar.width / 2, 6, 1, 1).data;
        return Math.min(...middle) > 220; })); })()"""
    # from -1 to 4 white would stand for 1.5: the map of one hue is taken
    assert json.loads(look_at(page, 1280, whole=False, script=script).value) == [True, False]
