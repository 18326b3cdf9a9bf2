"""Exports of other DIC systems: points and displacements come back, and damaged stages are refused."""

from __future__ import annotations

import time
from types import SimpleNamespace

import meshio
import h5py
import numpy as np
import pytest
from scipy.io import savemat

from idic.errors import InputError
from idic.experiment_file.measured_fields.stages import field_notes
from idic.readers.fields.plane import mean_plane
from idic.readers import FieldSeries, FieldStack, check_stages, out_of_plane

GRID = np.stack(np.meshgrid(np.arange(6) * 1.5, np.arange(8) * 1.5), axis=-1).reshape(-1, 2) + [3.0, -2.0]  # (48, 2) mm
F = np.array([[1.002, 0.001], [0.0005, 0.996]])


def displaced(k: int) -> np.ndarray:
    """Displacement of the points in stage k  # (48, 2) mm"""
    return k * (GRID @ (F - np.eye(2)).T + [0.02, -0.01])


def moved_in_um(stack: FieldStack, k: int) -> np.ndarray:
    return stack.frame(k).astype(float) * [1.0, -1.0] / 1e3


def aramis(folder, k: int, force: float | None = 10.0, comma: bool = False, ids=None, rise=None, beside=0.0) -> None:
    ids = np.arange(len(GRID)) if ids is None else ids
    points = (GRID + displaced(k) + beside)[ids]
    z = np.zeros(len(ids)) if rise is None else rise[ids]
    lines = ["# Units: length:mm angle:deg time:s force:N ", f"# Stage: Stufe {k}", "stage;index;relative_time;date",
             f'"Stufe {k}";{k};{0.5 * k:.4f};"2024-02-28T13:59:36.414"']
    if force is not None:
        lines += ["# Name : Analogeingang 0", "force;untransformed;transformed", f"{force * k};0.0021;{force * k}"]
    lines += ["# Name : Flächenkomponente 1", "id;x;y;z",
              *(f"{i};{x:.6f};{y:.6f};{h:.6f}" for i, (x, y), h in zip(ids, points, z, strict=True))]
    text = "\n".join(lines)
    (folder / f"Flächenkomponente 1_{k:04d}.csv").write_text(text.replace(".", ",") if comma else text,
                                                             encoding="utf-8")


def opened(folder, pattern: str = "*", **how) -> FieldStack:
    series = FieldSeries.open(sorted(folder.glob(pattern)), **how)
    return FieldStack(series, series.measured_points([0]))


@pytest.mark.parametrize("comma", [False, True])
def test_an_aramis_export_gives_displacements_by_id_time_and_force(tmp_path, comma):
    for k in range(3):
        aramis(tmp_path, k, comma=comma)
    stack = opened(tmp_path)
    log = stack.series.log()
    np.testing.assert_allclose(log.times(), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(log.column("force"), [0.0, 10.0, 20.0])
    assert log.unit("force") == "N" and stack.series.format == "aramis"
    for k in range(3):
        np.testing.assert_allclose(moved_in_um(stack, k), displaced(k), atol=2e-6)


def test_points_come_and_go(tmp_path):
    aramis(tmp_path, 0)
    kept = np.flatnonzero(np.arange(len(GRID)) % 7 != 3)
    aramis(tmp_path, 1, ids=kept[::-1])  # in another order, too
    found = moved_in_um(opened(tmp_path), 1)
    assert np.isnan(found).all(axis=1).nonzero()[0].tolist() == [i for i in range(len(GRID)) if i not in kept]
    np.testing.assert_allclose(found[kept], displaced(1)[kept], atol=2e-6)


def columns(header: str, k: int, order=("x", "y", "u", "v"), separator: str = ",", more=lambda i: ()) -> str:
    u = displaced(k)
    rows = [separator.join(f"{value:.7f}" for value in [
        *({"x": GRID[i, 0], "y": GRID[i, 1], "u": u[i, 0], "v": u[i, 1], "0": 0.0}[name] for name in order), *more(i)])
        for i in range(len(GRID))]
    return "\n".join([header, *rows])


@pytest.mark.parametrize("name, suffix, header, how", [
    ("vic", ".csv", '"X", "Y", "Z", "U", "V", "W", "sigma", "x", "y"',
     {"order": "xy0uv0", "more": lambda i: (0.01, 7, 8)}),
    ("vic", ".csv", '"x", "y", "u", "v", "exx", "eyy", "exy", "sigma"', {"more": lambda i: (0, 0, 0, 0.01)}),
    ("matchid", ".csv", "coor.X [mm];coor.Y [mm];disp.Horizontal Displacement U [mm];disp.Vertical Displacement V [mm]",
     {"separator": ";"}),
    ("dice", ".txt", "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA", None),
    ("pyvale", ".csv", "ss_x,ss_y,displacement_u,displacement_v,converged", {"more": lambda i: (1,)}),
    ("table", ".csv", "x_mm,y_mm,ux_mm,uy_mm", {}),
    ("table", ".csv", "# exported by hand\nx [mm]\ty [mm]\tu [mm]\tv [mm]", {"separator": "\t"}),
])
def test_a_dialect_gives_the_same_displacements(tmp_path, name, suffix, header, how):
    for k in range(3):
        if how is None:
            text = "\n".join([header, *(f"{i},{x:.7f},{y:.7f},{u:.7f},{v:.7f},0.01" for i, ((x, y), (u, v)) in
                                        enumerate(zip(GRID, displaced(k), strict=True)))])
        else:
            text = columns(header, k, **how)
        (tmp_path / f"stage_{k}{suffix}").write_text(text)
    stack = opened(tmp_path, pixel_size_mm=1.0)
    assert stack.series.format == name
    px = name in ("dice", "pyvale") or '"x", "y", "u"' in str(header)
    upwards = [1.0, -1.0] if px else [1.0, 1.0]  # px: rows count downwards in the file
    np.testing.assert_allclose(stack.points.positions, GRID * upwards, atol=1e-6)
    for k in range(3):
        np.testing.assert_allclose(moved_in_um(stack, k), displaced(k) * upwards, atol=2e-6)


def test_points_that_vic_2d_did_not_correlate_are_gaps_and_its_pixels_need_a_scale(tmp_path):
    for k in range(2):
        (tmp_path / f"img_{k}.csv").write_text(columns('"x", "y", "u", "v", "sigma"', k,
                                                       more=lambda i, k=k: (-1 if k and i == 5 else 0.01,)))
    found = moved_in_um(opened(tmp_path, pixel_size_mm=1.0), 1)
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [5]
    with pytest.raises(InputError, match="px without a scale"):
        opened(tmp_path)


@pytest.mark.parametrize("header, unit, assumed", [
    ("x,y,u,v", None, True), ("x,y,u,v", "um", False), ("x_mm,y_mm,u_mm,v_mm", None, False)])
def test_a_table_without_units_is_read_as_mm_with_a_note(tmp_path, header, unit, assumed):
    (tmp_path / "a.csv").write_text(columns(header, 0))
    stack = opened(tmp_path, unit=unit)
    notes = field_notes(stack, SimpleNamespace(pitch_mm=1.5), [0], None)
    assert any("names no unit of length; they are read as mm" in note for note in notes) == assumed


def test_a_vtu_file_is_read_as_mm_with_a_note(tmp_path):
    points = np.column_stack([GRID, np.zeros(len(GRID))])
    meshio.Mesh(points, [("vertex", np.arange(len(GRID))[:, None])], point_data={"U": 0.0 * points}).write(
        tmp_path / "s.vtu")
    notes = field_notes(opened(tmp_path), SimpleNamespace(pitch_mm=1.5), [0], None)
    assert any("names no unit of length; they are read as mm" in note for note in notes)


def test_one_table_holds_all_stages_with_their_times(tmp_path):
    rows = [f"{k},{0.25 * k},{x:.6f},{y:.6f},{u:.7f},{v:.7f}" for k in range(3)
            for (x, y), (u, v) in zip(GRID, displaced(k), strict=True)]
    (tmp_path / "all.csv").write_text("\n".join(["stage,time_s,x_mm,y_mm,ux_mm,uy_mm", *rows]))
    stack = opened(tmp_path)
    assert stack.labels == ("all.csv[0]", "all.csv[1]", "all.csv[2]")
    np.testing.assert_allclose(stack.series.log().times(), [0.0, 0.25, 0.5])
    np.testing.assert_allclose(moved_in_um(stack, 2), displaced(2), atol=2e-6)


def long_table(order, time_name: str = "time_s", time=lambda k: 0.5 * k, lost=()) -> str:
    """All stages in one table, its rows in this order; lost : (stage, point) without a row."""
    rows = sorted(((k, i) for k in range(4) for i in range(len(GRID)) if (k, i) not in lost), key=order)
    return "\n".join([f"stage,id,x_mm,y_mm,ux_mm,uy_mm,{time_name}",
                      *(f"{k},{i},{GRID[i][0]},{GRID[i][1]},{displaced(k)[i][0]},{displaced(k)[i][1]},{time(k)}"
                        for k, i in rows)])


@pytest.mark.parametrize("order", [lambda row: row[::-1], lambda row: (-row[0], row[1])])
def test_the_stages_of_a_table_are_in_the_order_of_their_numbers_however_it_is_sorted(tmp_path, order):
    (tmp_path / "all.csv").write_text(long_table(order, lost=[(1, 0)]))  # the first point is lost in stage 1
    stack = opened(tmp_path)
    assert [label[-3:] for label in stack.labels] == ["[0]", "[1]", "[2]", "[3]"]
    for k in range(4):
        np.testing.assert_allclose(moved_in_um(stack, k)[1:], displaced(k)[1:], atol=2e-5)


def test_a_table_of_all_stages_may_have_capital_letters(tmp_path):
    text = long_table(None)
    head, _, rows = text.partition("\n")
    (tmp_path / "all.csv").write_text("Frame,Id,X [mm],Y [mm],U [mm],V [mm],Time [s]\n" + rows)
    stack = opened(tmp_path)
    assert stack.n_frames == 4 and stack.series.format == "table"
    np.testing.assert_allclose(moved_in_um(stack, 3), displaced(3), atol=2e-5)


@pytest.mark.parametrize("name, time, seconds", [
    ("time_ms", lambda k: 500 * k, 0.5), ("Time [min]", lambda k: 2.0 * k, 120.0), ("T_C", lambda k: 20.0 + k, None)])
def test_times_of_a_table_are_in_the_unit_of_their_name_and_a_temperature_is_none(tmp_path, name, time, seconds):
    (tmp_path / "all.csv").write_text(long_table(None, name, time))
    log = opened(tmp_path).series.log()
    if seconds is None:
        assert log is None
    else:
        np.testing.assert_allclose(log.times(), seconds * np.arange(4))


def test_the_time_of_an_aramis_stage_is_in_the_unit_of_the_file(tmp_path):
    for k in range(3):
        aramis(tmp_path, k)
    for path in tmp_path.iterdir():
        path.write_text(path.read_text(encoding="utf-8").replace("time:s", "time:min"), encoding="utf-8")
    np.testing.assert_allclose(opened(tmp_path).series.log().times(), [0.0, 30.0, 60.0])


def test_a_table_that_the_user_says_is_in_pixels_counts_rows_downwards(tmp_path):
    for k in range(2):
        (tmp_path / f"{k}.csv").write_text("\n".join(["x,y,u,v", *(
            f"{20 * x},{-20 * y},{20 * u},{-20 * v}" for (x, y), (u, v) in zip(GRID, displaced(k), strict=True))]))
    stack = opened(tmp_path, unit="px", pixel_size_mm=0.05)
    np.testing.assert_allclose(stack.points.positions, GRID, atol=1e-9)
    np.testing.assert_allclose(moved_in_um(stack, 1), displaced(1), atol=2e-5)


def test_thousands_separators_in_a_stage_are_refused(tmp_path):
    (tmp_path / "0.csv").write_text("\n".join(["x [mm];y [mm];ux [mm];uy [mm]", *(
        f"1,{100 + int(x):03d};{y};0.0;0.0" for x, y in GRID)]))
    with pytest.raises(InputError, match="decimal commas and decimal points") as caught:
        opened(tmp_path)
    assert "line 2" in str(caught.value)


def test_vtu_point_data(tmp_path):
    for k in range(2):
        points = np.column_stack([GRID, np.zeros(len(GRID))])
        meshio.Mesh(points, [("vertex", np.arange(len(GRID))[:, None])],
                    point_data={"displacement": np.column_stack([displaced(k), np.zeros(len(GRID))])}).write(
            tmp_path / f"s{k}.vtu")
    np.testing.assert_allclose(moved_in_um(opened(tmp_path), 1), displaced(1), atol=2e-6)


def on_image(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the grid of an image in stage k, rows downwards  # (6, 5) px each: right, down"""
    column, row = np.meshgrid(np.arange(5), np.arange(6))
    return k * (0.01 * column + 0.1), k * (0.02 * row - 0.03)


def ncorr_file(path, n: int = 2, **how) -> None:
    displacements = np.zeros(n, dtype=[("plot_u_dic", object), ("plot_v_dic", object)])
    for k in range(n):
        u, v = (part.copy() for part in on_image(k + 1))
        u[0, :2] = v[0, :2] = 0.0  # outside the region
        displacements[k] = u, v
    info = {"spacing": 3.0, "pixtounits": 0.05, "units": "mm"} | how
    savemat(path, {"data_dic_save": {"displacements": displacements, "dispinfo": info}})


def test_ncorr_gives_the_grid_of_its_points_upwards_with_the_reference_image(tmp_path):
    ncorr_file(tmp_path / "run.mat")
    stack = opened(tmp_path)
    assert stack.labels == ("run.mat[0]", "run.mat[1]", "run.mat[2]") and stack.series.format == "ncorr"
    assert stack.points.pitch == pytest.approx(0.05 * 4)  # a point on every fourth pixel
    kept = np.ones((6, 5), bool)
    kept[0, :2] = False
    row, column = np.nonzero(kept)
    np.testing.assert_allclose(stack.points.positions, 0.2 * np.column_stack([column, -row]), atol=1e-9)
    u, v = on_image(2)
    np.testing.assert_allclose(moved_in_um(stack, 2), 0.05 * np.column_stack([u[kept], -v[kept]]), atol=1e-7)


def ncorr_hdf5(path, n: int = 2, formatted: bool = True, kind: str = "regular", steps: int = 1) -> None:
    """As Ncorr saves it: MATLAB 7.3, arrays transposed, arrays of structures as references; plot_u_dic is in px."""
    with h5py.File(path, "w", userblock_size=512) as file:
        refs, info = file.create_group("#refs#"), file.create_group("data_dic_save/dispinfo")
        shown = file.create_group("data_dic_save/displacements")

        def stored(group, name, value, **attributes):
            group.create_dataset(name, data=value)
            group[name].attrs.update(attributes)
            return group[name].ref

        empty = np.zeros(2, dtype=np.uint64)
        stored(info, "spacing", np.array([[3.0]]))
        text = {"type": kind, "units": "mm"} if formatted else {"type": kind}
        for name, word in text.items():
            stored(info, name, np.array([[ord(letter)] for letter in word], dtype=np.uint16),
                   MATLAB_class=np.bytes_("char"))
        stored(info, "pixtounits", *([np.array([[0.05]])] if formatted else [empty]),
               **({} if formatted else {"MATLAB_empty": 1}))
        info.create_dataset("imgcorr/idx_ref",
                            data=np.array([[stored(refs, f"s{k}", np.array([[0.0]]))] for k in range(steps)],
                                                             dtype=h5py.ref_dtype))
        for component, letter in enumerate("uv"):
            for field, factor in (("dic", 1.0), ("ref_formatted", 0.05)):
                made = []
                for k in range(n):
                    part = on_image(k + 1)[component].copy()
                    part[0, :2] = 0.0
                    if field == "dic" and steps == 1 and kind == "regular":
                        made.append(stored(refs, f"{letter}{field}{k}", part.T))
                    elif field == "ref_formatted" and formatted:
                        made.append(stored(refs, f"{letter}{field}{k}", factor * part.T))
                    else:
                        made.append(stored(refs, f"{letter}{field}{k}", empty, MATLAB_empty=1))
                shown.create_dataset(f"plot_{letter}_{field}", data=np.array([made], dtype=h5py.ref_dtype).T)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


@pytest.mark.parametrize("formatted", [True, False])
def test_ncorr_files_of_version_7_3_give_the_same_points(tmp_path, formatted):
    ncorr_hdf5(tmp_path / "run.mat", formatted=formatted)
    stack = opened(tmp_path, pixel_size_mm=0.05)
    assert stack.labels == ("run.mat[0]", "run.mat[1]", "run.mat[2]")
    kept = np.ones((6, 5), bool)
    kept[0, :2] = False
    row, column = np.nonzero(kept)
    np.testing.assert_allclose(stack.points.positions, 0.2 * np.column_stack([column, -row]), atol=1e-9)
    u, v = on_image(2)
    np.testing.assert_allclose(moved_in_um(stack, 2), 0.05 * np.column_stack([u[kept], -v[kept]]), rtol=1e-6)


def test_ncorr_files_that_cannot_be_read_say_what_to_do(tmp_path):
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    with pytest.raises(InputError, match="not a readable file of Ncorr"):
        FieldSeries.open([tmp_path / "new.mat"])
    for what in ({"kind": "backward"}, {"steps": 2}):  # against the present shape, or the reference of a step
        ncorr_hdf5(tmp_path / "open.mat", formatted=False, **what)
        with pytest.raises(InputError, match="not against the reference image"):
            FieldSeries.open([tmp_path / "open.mat"])
    savemat(tmp_path / "other.mat", {"data_dic_save": {"displacements": 1.0}})
    with pytest.raises(InputError, match="not a readable file of Ncorr"):
        FieldSeries.open([tmp_path / "other.mat"])


def test_mudic_gives_the_positions_of_every_image(tmp_path):
    column, row = np.meshgrid(np.arange(5.0), np.arange(6.0))
    at = np.stack([np.stack([column + on_image(k)[0], row + on_image(k)[1]]) for k in range(3)], axis=-1)
    np.save(tmp_path / "fields.npy", at[None])
    stack = opened(tmp_path, pixel_size_mm=0.1)
    assert stack.series.format == "mudic" and stack.n_frames == 3
    u, v = on_image(2)
    np.testing.assert_allclose(moved_in_um(stack, 2), 0.1 * np.column_stack([u.ravel(), -v.ravel()]), atol=1e-7)
    np.save(tmp_path / "fields.npy", at)
    with pytest.raises(InputError, match="not the positions"):
        FieldSeries.open([tmp_path / "fields.npy"])


def test_invalid_points_are_missing_and_pixels_take_their_size(tmp_path):
    for k in range(2):
        text = columns("ss_x,ss_y,displacement_u,displacement_v,converged", k, more=lambda i: (float(i != 5),))
        (tmp_path / f"stage_{k}.csv").write_text(text)
    stack = opened(tmp_path, pixel_size_mm=0.05)  # point 5 is not in the reference either: it does not count
    keep = np.arange(len(GRID)) != 5
    np.testing.assert_allclose(moved_in_um(stack, 1), 0.05 * displaced(1)[keep] * [1.0, -1.0], atol=1e-7)
    with pytest.raises(InputError, match="without a scale"):
        FieldSeries.open(sorted(tmp_path.glob("*")))


def test_the_reference_need_not_be_the_one_of_the_system(tmp_path):
    for k in (1, 2):
        (tmp_path / f"stage_{k}.csv").write_text(columns("x_mm,y_mm,ux_mm,uy_mm", k))
    stack = opened(tmp_path)  # the first stage has moved already
    np.testing.assert_allclose(stack.points.positions, GRID + displaced(1), atol=1e-6)
    np.testing.assert_allclose(moved_in_um(stack, 1), displaced(2) - displaced(1), atol=2e-6)


def test_a_tilted_surface_is_laid_into_its_plane(tmp_path):
    """Stages of a plate that stands 20 degrees askew in the system of the cameras."""
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    for k in range(2):
        here = np.column_stack([GRID + displaced(k), np.zeros(len(GRID))]) @ turn.T
        rows = [f"{i};{x:.7f};{y:.7f};{z:.7f}" for i, (x, y, z) in enumerate(here)]
        head = ["# Units: length:mm time:s", "# Stage: 1", "stage;index;relative_time;date", f'"1";1;{k};"now"',
                "# Name : A"]
        (tmp_path / f"{k}.csv").write_text("\n".join([*head, "id;x;y;z", *rows]))
    stack = opened(tmp_path)
    np.testing.assert_allclose(np.ptp(stack.points.positions, axis=0), np.ptp(GRID, axis=0), rtol=1e-6)
    np.testing.assert_allclose(moved_in_um(stack, 1), displaced(1), atol=3e-6)


def test_a_tilted_sheet_far_from_the_origin_of_the_cameras_stays_where_it_was(tmp_path):
    """Its points turn into their plane about their middle: a drawn outline, in the axes of the export, still fits."""
    z = 120.0 + 0.01 * GRID[:, 0] - 0.004 * GRID[:, 1]
    for k in range(2):
        here = np.column_stack([GRID + displaced(k), z])
        rows = [f"{i};{x:.7f};{y:.7f};{h:.7f}" for i, (x, y, h) in enumerate(here)]
        head = ["# Units: length:mm time:s", "# Stage: 1", "stage;index;relative_time;date", f'"1";1;{k};"now"',
                "# Name : A"]
        (tmp_path / f"{k}.csv").write_text("\n".join([*head, "id;x;y;z", *rows]))
    np.testing.assert_allclose(opened(tmp_path).points.positions, GRID, atol=2e-4 * np.ptp(GRID))  # the tilt itself


def test_curvature_out_of_the_plane_is_measured():
    rise = 1e-4 * GRID[:, 1] ** 2 + 0.01 * GRID[:, 0]
    found = out_of_plane(GRID, rise)
    assert found.curvature == pytest.approx(2e-4, rel=1e-6)
    plane = mean_plane(np.column_stack([GRID, np.zeros(len(GRID))]))
    np.testing.assert_allclose(plane.axes, np.eye(3), atol=1e-12)


# refused ------------------------------------------------------------------------------------------------
def _half_written(folder):
    path = folder / "Flächenkomponente 1_0001.csv"
    text = path.read_text(encoding="utf-8")
    path.write_text(text[:len(text) - 12], encoding="utf-8")


def _twice(folder):
    path = folder / "Flächenkomponente 1_0001.csv"
    path.write_text(path.read_text(encoding="utf-8") + "\n7;1.0;2.0;0.0", encoding="utf-8")


def _without_force(folder):
    aramis(folder, 1, force=None)


def _another_specimen(folder):
    aramis(folder, 1)
    path = folder / "Flächenkomponente 1_0001.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(line if not line[:1].isdigit() or line.count(";") != 3
                              else f"{int(line.split(';')[0]) + 500};"
                              + line.split(";", 1)[1] for line in lines), encoding="utf-8")


def _far_away(folder):
    path = folder / "Flächenkomponente 1_0001.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    first = lines.index("id;x;y;z") + 1
    shifted = [";".join([cells[0], str(float(cells[1]) + 500.0), *cells[2:]]) for cells in
               (line.split(";") for line in lines[first:])]
    path.write_text("\n".join([*lines[:first], *shifted]), encoding="utf-8")


def _other_unit(folder):
    path = folder / "Flächenkomponente 1_0001.csv"
    path.write_text(path.read_text(encoding="utf-8").replace("length:mm", "length:m"), encoding="utf-8")


def _other_unit_of_force(folder):
    path = folder / "Flächenkomponente 1_0001.csv"
    path.write_text(path.read_text(encoding="utf-8").replace("force:N", "force:kN"), encoding="utf-8")


def _more_columns(folder):
    path = folder / "Flächenkomponente 1_0001.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    first = lines.index("id;x;y;z") + 1
    path.write_text("\n".join([*lines[:first], *(f"{line};0.0" for line in lines[first:])]), encoding="utf-8")


def _a_further_column(folder):
    _more_columns(folder)
    path = folder / "Flächenkomponente 1_0001.csv"
    path.write_text(path.read_text(encoding="utf-8").replace("id;x;y;z", "id;x;y;z;quality"), encoding="utf-8")


def _half_written_at_the_end_of_a_row(folder):
    aramis(folder, 1, ids=np.arange(24))


def _another_specimen_of_the_same_numbers(folder):
    kept = np.flatnonzero(np.arange(len(GRID)) % 6 > 0)  # one column less: the numbers run on
    aramis(folder, 1, ids=kept)
    path = folder / "Flächenkomponente 1_0001.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    first = lines.index("id;x;y;z") + 1
    path.write_text("\n".join([*lines[:first],
                               *(f"{i};{line.split(';', 1)[1]}" for i, line in enumerate(lines[first:]))]),
                    encoding="utf-8")


def _empty(folder):
    (folder / "Flächenkomponente 1_0001.csv").write_text("")


def _no_points(folder):
    (folder
     / "Flächenkomponente 1_0001.csv").write_text("# Units: length:mm\n# Stage: 1\nstage;index;relative_time;date\n")


@pytest.mark.parametrize("spoil, message", [
    (_half_written, "another number of cells"), (_twice, "a point occurs twice"),
    (_without_force, "missing in some stages"), (_another_specimen, "other points than the reference"),
    (_other_unit, "another unit"), (_other_unit_of_force, "changes its unit"),
    (_more_columns, "another number of cells"),
    (_far_away, "far from those of the reference"), (_no_points, "without points"), (_empty, "a stage is empty"),
    (_a_further_column, "other columns than the first"),
    (_half_written_at_the_end_of_a_row, "ends before its last points"),
    (_another_specimen_of_the_same_numbers, "of another specimen"),
])
def test_a_bad_stage_is_refused_with_its_name(tmp_path, spoil, message):
    for k in range(3):
        aramis(tmp_path, k)
    spoil(tmp_path)
    with pytest.raises(InputError, match=message) as refused:
        stack = opened(tmp_path)
        check_stages(stack, range(3))
        stack.series.log()
    assert "0001" in str(refused.value.file)


def _last_half_written(folder):
    """At the end of a row."""
    path = folder / "stage_9.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:40]) + "\n")


def _last_stretched(folder):
    """Another specimen with the numbers of the same grid, 1.3 times as large."""
    path = folder / "stage_9.csv"
    head, *rows = path.read_text().splitlines()
    scaled = np.array([row.split(",") for row in rows], dtype=float) * [1.0, 1.3, 1.3, 1.3, 1.3]
    path.write_text("\n".join([head, *(",".join(f"{value:.7g}" for value in row) for row in scaled)]))


def _of_another_grid(folder):
    """Without ids: points at places of their own."""
    for path in folder.glob("*.csv"):
        head, *rows = path.read_text().splitlines()
        path.write_text("\n".join([head.removeprefix("id,"), *(row.split(",", 1)[1] for row in rows)]))
    path = folder / "stage_9.csv"
    head, *rows = path.read_text().splitlines()
    moved = np.array([row.split(",") for row in rows], dtype=float) * [1.2, 1.0, 1.0, 1.0]  # every fifth column remains
    path.write_text("\n".join([head, *(",".join(f"{value:.7g}" for value in row) for row in moved)]))


@pytest.mark.parametrize("spoil, message", [
    (_last_half_written, "ends before its last points"), (_last_stretched, "of another specimen"),
    (_of_another_grid, "of another specimen|other points than the reference")])
def test_a_bad_last_stage_is_refused_with_its_name(tmp_path, spoil, message):
    for k in range(10):
        rows = [f"{i},{x:.6f},{y:.6f},{u:.7f},{v:.7f}" for i, ((x, y), (u, v))
                in enumerate(zip(GRID, displaced(k), strict=True))]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["id,x_mm,y_mm,ux_mm,uy_mm", *rows]))
    check_stages(opened(tmp_path), range(10))
    spoil(tmp_path)
    with pytest.raises(InputError, match=message) as refused:
        check_stages(opened(tmp_path), range(10))
    assert refused.value.file.name == "stage_9.csv"


def test_another_specimen_of_the_same_grid_is_seen_by_its_strain(tmp_path):
    """ARAMIS files hold positions alone: a specimen 1.3 times as large is a strain of 0.3 in one stage."""
    for k in range(10):
        aramis(tmp_path, k)
    path = tmp_path / "Flächenkomponente 1_0006.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    first = lines.index("id;x;y;z") + 1
    larger = [";".join([i, str(1.3 * float(x)), str(1.3 * float(y)), z])
              for i, x, y, z in (line.split(";") for line in lines[first:])]
    path.write_text("\n".join([*lines[:first], *larger]), encoding="utf-8")
    with pytest.raises(InputError, match="off by 0.4") as refused:  # sqrt 2 of 0.3
        check_stages(opened(tmp_path), range(10))
    assert "0006" in str(refused.value.file)


@pytest.mark.parametrize("others, first", [(range(6, 10), "0006"), ([4], "0004"), ([9], "0009"),
                                           (range(1, 10, 2), "0001")])
def test_another_specimen_on_the_same_grid_is_seen_by_its_pattern(tmp_path, others, first):
    """Points of another pattern lie 8 µm beside those of the first one, each in its own way; noise is 0.2 µm."""
    rng = np.random.default_rng(4)
    pattern = rng.normal(0.0, 8e-3, GRID.shape)
    for k in range(10):
        aramis(tmp_path, k, beside=rng.normal(0.0, 2e-4, GRID.shape))
    check_stages(opened(tmp_path), range(10))
    for k in others:
        aramis(tmp_path, k, beside=pattern + rng.normal(0.0, 2e-4, GRID.shape))
    with pytest.raises(InputError, match="all over the field") as refused:
        check_stages(opened(tmp_path), range(10))
    assert first in str(refused.value.file)


def test_a_noisy_stage_and_one_after_a_large_step_are_no_other_specimen(tmp_path):
    rng = np.random.default_rng(5)
    curved = 2e-4 * (GRID - GRID.mean(axis=0)) ** 2
    for k in range(10):
        noise = rng.normal(0.0, 2e-3 if k == 3 else 2e-4, GRID.shape)
        aramis(tmp_path, k if k < 5 else k + 20, beside=noise + (k > 4) * curved)
    check_stages(opened(tmp_path), range(10))


def test_reference_coordinates_of_another_specimen_are_refused(tmp_path):
    """Of the same numbers and nearly the same places: one test has them the same to the digit."""
    for k in range(4):
        other = 0.05 if k == 2 else 0.0
        rows = [f"{i},{x + other:.6f},{y:.6f},{u:.7f},{v:.7f}" for i, ((x, y), (u, v))
                in enumerate(zip(GRID, displaced(k), strict=True))]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["id,x_mm,y_mm,ux_mm,uy_mm", *rows]))
    with pytest.raises(InputError, match="reference coordinates") as refused:
        check_stages(opened(tmp_path), range(4))
    assert "stage_2" in str(refused.value.file)


def test_a_test_that_is_loaded_in_few_stages_is_no_fault(tmp_path):
    for k, share in enumerate([0, 0, 0, 80, 0]):  # 0.3 of strain and back
        rows = [f"{i},{x:.6f},{y:.6f},{u:.7f},{v:.7f}" for i, ((x, y), (u, v))
                in enumerate(zip(GRID, displaced(share), strict=True))]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["id,x_mm,y_mm,ux_mm,uy_mm", *rows]))
    check_stages(opened(tmp_path), range(5))


def test_points_that_leave_the_view_and_a_specimen_that_stretches_by_half_are_no_fault(tmp_path):
    aramis(tmp_path, 0)
    aramis(tmp_path, 1, ids=np.arange(40))  # the last rows leave the view, and stay away
    aramis(tmp_path, 200, ids=np.arange(36))
    check_stages(opened(tmp_path), range(3))


def test_another_kind_of_table_is_not_a_field(tmp_path):
    (tmp_path / "log.csv").write_text("time_s,force_N\n0,1\n1,2\n")
    with pytest.raises(InputError, match="not a field"):
        FieldSeries.open([tmp_path / "log.csv"])


def test_a_header_of_a_million_empty_names_is_refused_soon(tmp_path):
    """1 s of processor time; 12 s where every name is taken apart for every dialect."""
    (tmp_path / "wide.csv").write_text("," * 1_000_000 + "\n1,2,3\n")
    start = time.process_time()
    with pytest.raises(InputError, match="not a field format"):
        FieldSeries.open([tmp_path / "wide.csv"])
    assert time.process_time() - start < 6.0
