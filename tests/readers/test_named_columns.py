"""Tables of points whose columns the user names, and exports of further systems."""

import zlib

import msgpack
import numpy as np
import pytest

from experiment_file.point_plate import TOML
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.readers import FieldSeries, NamedColumns, detected

X, Y = (values.ravel() for values in np.meshgrid(np.arange(6) * 4.0 + 10.0, np.arange(5) * 4.0 + 20.0))


def motion(k):
    """Displacement of every point, to the right and down"""
    return 0.02 * k * X, -0.01 * k * Y + 0.5 * k


def write_stage(path, k, header, row, above="", separator=";"):
    """row : (x, y, u, v, number) -> cells"""
    u, v = motion(k)
    rows = [separator.join(map(str, row(*cells))) for cells in zip(X, Y, u, v, range(len(X)), strict=True)]
    path.write_text(above + header + "\n" + "\n".join(rows) + "\n", encoding="utf-8")


def moved(paths, **keys):
    """Displacements of the second stage in mm, right and up  # (n, 2)"""
    series = FieldSeries.open(paths, **keys)
    points = series.measured_points([0])
    return points.positions, points.moved(series.stage(1))


def plain(x, y, u, v, number):
    return u, v, x, y, 0.99 if number else 0.2, int(number != 1)


HEADERS = {
    "names": "du;dv;pos x;pos y;zncc;ok", "units": "du [px];dv [px];pos x [px];pos y [px];zncc [-];ok",
    "row": "du;dv;pos x;pos y;zncc;ok\n[px];[px];[px];[px];-;-", "comment": "% du;dv;pos x;pos y;zncc;ok",
}


@pytest.mark.parametrize("header", HEADERS)
def test_columns_are_found_by_name_in_any_order_with_comments_and_units(header, tmp_path):
    paths = [tmp_path / f"stage_{k}.txt" for k in (0, 1)]
    for k, path in enumerate(paths):
        write_stage(path, k, HEADERS[header], plain, above="# specimen A\n# date: 2026; 30; 11; 1; 2; 3\n\n")
    columns = NamedColumns("pos x", "pos y", "du", "dv", unit="px")
    positions, displacement = moved(paths, unit="px", pixel_size_mm=0.5, columns=columns)
    np.testing.assert_allclose(positions, 0.5 * np.column_stack([X, -Y]))
    np.testing.assert_allclose(displacement, 0.5 * np.column_stack([motion(1)[0], -motion(1)[1]]), atol=1e-12)


@pytest.mark.parametrize("axis, sign", [("up", 1.0), ("down", -1.0), (None, 1.0)])
def test_y_points_where_the_user_says(axis, sign, tmp_path):
    paths = [tmp_path / f"stage_{k}.txt" for k in (0, 1)]
    for k, path in enumerate(paths):
        write_stage(path, k, HEADERS["names"], plain)
    columns = NamedColumns("pos x", "pos y", "du", "dv", unit="mm", y_axis=axis)
    positions, displacement = moved(paths, unit="mm", columns=columns)
    np.testing.assert_allclose(positions, np.column_stack([X, sign * Y]))
    np.testing.assert_allclose(displacement, np.column_stack([motion(1)[0], sign * motion(1)[1]]), atol=1e-12)


def test_points_that_flag_or_quality_rejects_are_gaps(tmp_path):
    paths = [tmp_path / f"stage_{k}.txt" for k in (0, 1)]
    write_stage(paths[0], 0, HEADERS["names"], lambda x, y, u, v, number: (u, v, x, y, 1.0, 1))
    write_stage(paths[1], 1, HEADERS["names"], plain)
    columns = NamedColumns("pos x", "pos y", "du", "dv", flag="OK", quality="zncc", quality_min=0.9, unit="mm")
    displacement = moved(paths, unit="mm", columns=columns)[1]
    assert np.flatnonzero(np.isnan(displacement).any(axis=1)).tolist() == [0, 1]
    stage = FieldSeries.open(paths, unit="mm", columns=columns).stage(1)
    assert stage.failed == {"OK below 0.5": 1, "zncc below 0.9": 1}


def test_a_message_names_the_columns_that_there_are(tmp_path):
    write_stage(tmp_path / "a.txt", 0, HEADERS["names"], plain, above="# operator: N.N.\n")
    with pytest.raises(InputError, match="no column 'dw'") as refusal:
        FieldSeries.open([tmp_path / "a.txt"], columns=NamedColumns("pos x", "pos y", "du", "dw"))
    assert refusal.value.found == "the columns du, dv, pos x, pos y, zncc, ok"
    with pytest.raises(InputError, match="pos x") as refusal:
        detected(tmp_path / "a.txt")
    assert "[fields.columns]" in refusal.value.remedy


def test_a_name_that_two_columns_share_needs_its_unit(tmp_path):
    for k in (0, 1):
        write_stage(tmp_path / f"{k}.csv", k, "x [px];x [mm];y [px];y [mm];u [mm];v [mm]",
                    lambda x, y, u, v, number: (20 * x, x, 20 * y, y, u, v))
    paths = [tmp_path / f"{k}.csv" for k in (0, 1)]
    with pytest.raises(InputError, match="no column 'x', 'y'"):
        FieldSeries.open(paths, columns=NamedColumns("x", "y", "u", "v"))
    positions, displacement = moved(paths, columns=NamedColumns("x [mm]", "y [mm]", "u", "v"))
    np.testing.assert_allclose(positions, np.column_stack([X, Y]))
    np.testing.assert_allclose(displacement, np.column_stack(motion(1)), atol=1e-12)


KEYS = '[fields.columns]\nx = "pos x"\ny = "pos y"\nux = "du"\nuy = "dv"\n'


def plate(folder, keys, has_stages=False):
    for k in range(0 if has_stages else 5):
        write_stage(folder / f"stage_{k}.txt", 0.1 * k, HEADERS["names"], plain)
    (folder / "log.csv").write_text("force_N\n" + "\n".join(str(900 * k) for k in range(5)))
    text = TOML.replace("FIELDS", "stage_*.txt").replace("DISTANCE", "2.0").replace("SIZE", "12")
    text = text.replace("kind =", "fields_noise_um = 5.0\nkind =")
    (folder / "experiment.toml").write_text(text + keys)
    return load_experiment(folder)


def test_the_table_of_an_experiment_names_the_columns(tmp_path):
    experiment = plate(tmp_path, KEYS + 'unit = "mm"\nquality = "zncc"\nquality_min = 0.9\n')
    assert experiment.recording.stack.n_frames == 5


@pytest.mark.parametrize("first", [0, 1])
def test_a_first_stage_that_is_strained_already_is_told(first, tmp_path):
    """As VIC-3D exports where the reference stage is left out."""
    for k in range(5):
        write_stage(tmp_path / f"stage_{k}.txt", 0.01 * (k + first), HEADERS["names"], plain)
    notes = plate(tmp_path, KEYS + 'unit = "mm"\n', has_stages=True).notes
    assert any("is strained by" in note for note in notes) == (first == 1)


@pytest.mark.parametrize("keys, words", [
    (KEYS + 'quality = "zncc"\n', "a column and a bound"), (KEYS + 'z = "h"\n', "third coordinate"),
    (KEYS.replace('"dv"', '"du"'), "twice"), (KEYS + 'w = "h"\n', "w"), (KEYS.replace('y = "pos y"\n', ""), "y"),
])
def test_a_table_of_columns_that_is_not_complete_is_refused(keys, words, tmp_path):
    with pytest.raises(InputError, match=words):
        plate(tmp_path, keys)


# further systems --------------------------------------------------------------------------------------
def test_a_node_map_has_its_signals_and_its_time(tmp_path):
    head = ("# stage data:\n# current_stage_index : {k}\n" + "#" * 40 + "\n# SIGNALS:\n"
            "# force : value_element : {force}\n# time : value_element : {time}\n"
            "# Kraft : analog_input : {force}\n" + "#" * 40 + "\n")
    for k in (0, 1):
        write_stage(tmp_path / f"map_{k}.txt", k,
                    "#ID; x_undef [mm]; y_undef [mm]; z_undef [mm]; u [mm]; v [mm]; w [mm]",
                    lambda x, y, u, v, number: (number + 1, x, y, 0.1, u, v, 0.0),
                    above=head.format(k=k, force=1000.5 * k, time=98.0 + 10 * k))
    paths = [tmp_path / f"map_{k}.txt" for k in (0, 1)]
    series = FieldSeries.open(paths)
    log = series.log()
    assert series.format == "nodemap" and log.names == ("time_s", "force", "Kraft")
    np.testing.assert_allclose(log.column("force"), [0.0, 1000.5])
    np.testing.assert_allclose(log.times(), [98.0, 108.0])
    np.testing.assert_allclose(moved(paths)[1], np.column_stack([*motion(1), np.zeros_like(X)]), atol=1e-12)


def expected_px():
    return np.column_stack([motion(1)[0], -motion(1)[1]])


def test_results_of_py3dic_are_positions_in_every_image(tmp_path):
    lines = ["10.0\t30.0\t6\t20", "20.0\t36.0\t5\t20"]
    for k in (0, 1):
        u, v = motion(k)
        lines.append(f"image_{k}.png\t" + "\t".join(f"{x},{y}" for x, y in zip(X + u, Y + v, strict=True)) + "\t")
    (tmp_path / "result.dic").write_text("\n".join(lines) + "\n\n")
    np.testing.assert_allclose(moved([tmp_path / "result.dic"], pixel_size_mm=1.0)[1], expected_px(), atol=1e-9)
    (tmp_path / "result.dic").write_text("\n".join(lines)[:-40])
    with pytest.raises(InputError, match=": .*py3dic"):
        FieldSeries.open([tmp_path / "result.dic"], pixel_size_mm=1.0)


def sundic_array(values):
    return msgpack.packb({b"nd": True, b"type": values.dtype.str, b"kind": b"", b"shape": values.shape,
                          b"data": values.tobytes()})


@pytest.mark.parametrize("n_values, compressed", [(17, True), (17, False), (7, True)])
def test_the_container_of_sundic_has_its_reference_and_its_pairs(n_values, compressed, tmp_path):
    parts = [msgpack.packb("0.0.36"), msgpack.packb("30/11/2026 10:00:00"), msgpack.packb({"StepSize": 4})]
    for k in (0, 1):
        values = np.full((5, 6, n_values), 0.3)
        u, v = motion(k + 1)
        for place, column in ((0, X), (1, Y), (5, u), (11 if n_values == 17 else 6, v)):
            values[:, :, place] = column.reshape(5, 6)
        values[0, 0, 5:] = np.nan if k else values[0, 0, 5:]
        payload = sundic_array(values.ravel())
        parts += [msgpack.packb(k), msgpack.packb(values.shape),
                  msgpack.packb(zlib.compress(payload)) if compressed else payload]
    (tmp_path / "run.sdic").write_bytes(b"".join(parts))
    series = FieldSeries.open([tmp_path / "run.sdic"], pixel_size_mm=1.0)
    assert len(series.entries) == 3
    np.testing.assert_allclose(moved([tmp_path / "run.sdic"], pixel_size_mm=1.0)[1], expected_px(), atol=1e-9)
    assert np.isnan(series.stage(2).displacement[0]).all()


def test_a_container_with_objects_in_the_place_of_numbers_is_refused(tmp_path):
    entry = msgpack.packb({b"nd": True, b"type": "|O", b"kind": b"O", b"shape": (1,), b"data": b"cos\nsystem\n"})
    (tmp_path / "run.sdic").write_bytes(b"".join(map(msgpack.packb, ("0", "now", {}, 0, (1, 1, 7)))) + entry)
    with pytest.raises(InputError, match="sun-dic"):
        detected(tmp_path / "run.sdic")


def test_the_csv_of_sundic_counts_downwards(tmp_path):
    for k in (0, 1):
        write_stage(tmp_path / f"{k}.csv", k, "X Coord,Y Coord,Z Coord,X Disp,Y Disp,Z Disp,Disp Magnitude",
                    lambda x, y, u, v, number: (x, y, 0.0, u, v, 0.0, 1.0), separator=",")
    paths = [tmp_path / f"{k}.csv" for k in (0, 1)]
    assert detected(paths[0]) == "sun-dic"
    np.testing.assert_allclose(moved(paths, pixel_size_mm=1.0)[1], expected_px(), atol=1e-9)


def test_stages_in_workbooks_are_those_of_the_same_text(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="idic[instruments] is not installed")
    for k in (0, 1):
        workbook = openpyxl.Workbook()
        workbook.active.append(["X", "Y", "Z", "U", "V", "W", "sigma"])
        for x, y, u, v in zip(X, Y, *motion(k), strict=True):
            workbook.active.append([x, y, 0.0, u, v, 0.0, 0.01])
        workbook.save(tmp_path / f"{k}.xlsx")
    paths = [tmp_path / f"{k}.xlsx" for k in (0, 1)]
    assert detected(paths[0]) == "vic"
    np.testing.assert_allclose(moved(paths)[1], np.column_stack([*motion(1), np.zeros_like(X)]), atol=1e-9)
