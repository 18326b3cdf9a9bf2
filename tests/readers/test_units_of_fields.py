"""Lengths in pixels are taken as pixels, or asked for: never as millimetres without a word."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from test_field_exports import GRID, displaced

from idic.errors import InputError
from idic.readers import FieldSeries, FieldStack

SIZE_MM = 0.05  # of a pixel
PLACES_PX = 20.0 * (GRID - GRID.min(axis=0)) + 40.0  # y upwards


def moved_px(k: int) -> np.ndarray:
    """Displacement in stage k, v upwards  # (48, 2) px"""
    return 20.0 * displaced(k)


def stages(folder, header: str, row) -> None:
    """row : (number, column, row downwards, u, v upwards) -> cells"""
    for k in range(3):
        rows = [",".join(map(str, row(i, x, 1000.0 - y, u, v)))
                for i, ((x, y), (u, v)) in enumerate(zip(PLACES_PX, moved_px(k), strict=True))]
        (folder / f"s_{k}.csv").write_text("\n".join([header, *rows]))


def opened(folder, **how) -> FieldStack:
    series = FieldSeries.open(sorted(folder.iterdir()), **how)
    return FieldStack(series, series.measured_points([0]))


def assert_motion(stack: FieldStack) -> None:
    """Positions and displacements in mm, both with y upwards."""
    places = SIZE_MM * PLACES_PX
    np.testing.assert_allclose(stack.points.positions - stack.points.positions.mean(axis=0),
                               places - places.mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(stack.frame(2)[:, :2] * [1.0, -1.0] / 1e3, SIZE_MM * moved_px(2), atol=2e-6)


MATCHID = ("Coordinates.Image X [Pixel],Coordinates.Image Y [Pixel],disp.Horizontal Displacement U [Pixel],"
           "disp.Vertical Displacement V [Pixel]")


@pytest.mark.parametrize("header, row", [
    (MATCHID, lambda i, x, y, u, v: (x, y, u, -v)),
    ("node_id,x_px,y_px,disp_u,disp_v", lambda i, x, y, u, v: (i, x, y, u, v)),  # al-dic: v upwards, y_px downwards
    ("subset_x,subset_y,disp_u,disp_v", lambda i, x, y, u, v: (x, y, u, -v)),
    ("x_px,y_px,u_px,v_px", lambda i, x, y, u, v: (x, y, u, -v)),
])
def test_exports_in_pixels_need_a_scale_and_have_rows_downwards(tmp_path, header, row):
    stages(tmp_path, header, row)
    with pytest.raises(InputError, match="px without a scale"):
        opened(tmp_path)
    assert_motion(opened(tmp_path, pixel_size_mm=SIZE_MM))


def test_lost_points_of_matchid_are_empty_cells(tmp_path):
    stages(tmp_path, MATCHID, lambda i, x, y, u, v: (x, y, "", "") if i == 3 and v else (x, y, u, -v))
    assert np.flatnonzero(np.isnan(opened(tmp_path, pixel_size_mm=SIZE_MM).frame(2)).any(axis=1)).tolist() == [3]


def test_matchid_positions_in_pixels_beside_displacements_in_mm_are_refused(tmp_path):
    stages(tmp_path, MATCHID.replace("U [Pixel]", "U [mm]").replace("V [Pixel]", "V [mm]"),
           lambda i, x, y, u, v: (x, y, u, v))
    with pytest.raises(InputError, match="different units"):
        opened(tmp_path)


def test_micrometres_beside_millimetres_are_converted(tmp_path):
    stages(tmp_path, "x [mm],y [mm],u [µm],v [µm]", lambda i, x, y, u, v: (SIZE_MM * x, -SIZE_MM * y, 1e3 * SIZE_MM * u,
                                                                            1e3 * SIZE_MM * v))
    assert_motion(opened(tmp_path))


def test_micrometres_beside_a_column_without_a_unit_are_refused(tmp_path):
    stages(tmp_path, "x [um],y [um],u,v", lambda i, x, y, u, v: (x, y, u, v))
    with pytest.raises(InputError, match="different units"):
        opened(tmp_path)


def pyxel(folder) -> None:
    """Point data U in px, y upwards, as pyxel writes its meshes."""
    for k in range(3):
        meshio.Mesh(np.column_stack([PLACES_PX, np.zeros(len(GRID))]), [("vertex", np.arange(len(GRID))[:, None])],
                    point_data={"U": np.column_stack([moved_px(k), np.zeros(len(GRID))])}).write(folder / f"s{k}.vtu")


def test_a_vtu_file_names_no_unit_so_that_mm_are_assumed(tmp_path):
    pyxel(tmp_path)
    series = opened(tmp_path).series
    assert series.unit_assumed and series.unit == "mm"
    assert not FieldSeries.open(sorted(tmp_path.iterdir()), unit="mm").unit_assumed


def test_a_vtu_file_in_pixels_has_y_upwards(tmp_path):
    pyxel(tmp_path)
    stack = opened(tmp_path, unit="px", pixel_size_mm=SIZE_MM)
    assert_motion(stack)
    assert not stack.series.unit_assumed


@pytest.mark.parametrize("write", [pyxel, lambda folder: stages(folder, "x,y,u,v", lambda i, *cells: cells)])
def test_a_pixel_size_next_to_a_file_without_a_unit_is_a_question(tmp_path, write):
    write(tmp_path)
    with pytest.raises(InputError, match="unit of the fields is not known") as asked:
        opened(tmp_path, pixel_size_mm=SIZE_MM)
    assert 'fields_unit = "px"' in asked.value.remedy
    opened(tmp_path, unit="px", pixel_size_mm=SIZE_MM)
