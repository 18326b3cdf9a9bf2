"""Height maps as XYZ text: the heights and the grid as they were written, in every spelling; anything else refused."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import open_stack

HEIGHTS = np.array([[1.25, -2.5, np.nan, 4e-3], [0.0, 6.5, 7.25, 1e3], [np.nan, 3.5, -1e-6, 12.0]])


def rows_of(heights=HEIGHTS, pitch=(0.5, 0.25), start=(-3.0, 10.0), gap="NaN", mark="\t"):
    """The rows of a map; pitch : along and across the rows."""
    return [mark.join((f"{start[0] + pitch[0] * column:g}", f"{start[1] + pitch[1] * row:g}",
                       gap if np.isnan(height) else f"{height:.9g}"))
            for (row, column), height in np.ndenumerate(heights)]


def text_of(rows, comments=()):
    return "\n".join([*comments, *rows, ""])


def opened(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return open_stack([path], with_gaps=True)


def refused(path, text):
    with pytest.raises(InputError) as refusal:
        opened(path, text)
    error = refusal.value
    assert error.file == path and error.expected and error.found and error.remedy
    return error


@pytest.mark.parametrize("gap", ["NaN", "nan", "***", "No Data", "no data"])
@pytest.mark.parametrize("mark", ["\t", " ", "   ", ",", ", ", ";"])
def test_a_map_comes_back_height_by_height_with_its_gaps(gap, mark, tmp_path):
    stack = opened(tmp_path / "a.xyz", text_of(rows_of(gap=gap, mark=mark), ["# a map", "", "#units: um um nm"]))
    assert stack.shape == (3, 4) and stack.n_frames == 1 and stack.labels == ("a.xyz",)
    np.testing.assert_array_equal(stack.frame(0), HEIGHTS.astype(np.float32))
    assert stack.grid.pitch == (0.5, 0.25) and (stack.grid.unit, stack.grid.height_unit) == ("um", "nm")
    assert stack.grid.pitch_mm == pytest.approx((0.5e-3, 0.25e-3), rel=1e-12)  # rounding


@pytest.mark.parametrize("change", [
    lambda text: text.replace("\n", "\r\n").encode(), lambda text: text.replace("\n", "\r").encode(),
    lambda text: text.encode("utf-16"), lambda text: text.encode("utf-8-sig"), lambda text: (text + "\n \n").encode(),
    lambda text: text.replace(".", ",").encode(), lambda text: text.replace("\n", "  \n").encode(),
], ids=["windows", "old mac", "utf-16", "byte order mark", "empty lines", "decimal commas", "blanks at the ends"])
def test_a_map_is_read_as_programs_spell_it(change, tmp_path):
    np.testing.assert_array_equal(opened(tmp_path / "a.XYZ", change(text_of(rows_of()))).frame(0),
                                  HEIGHTS.astype(np.float32))


@pytest.mark.parametrize("start, pitch", [((0.0, 0.0), (-0.5, 0.5)), ((9.0, 9.0), (0.5, -0.5)),
                                          ((2.5e-4, 0.0), (1.25e-7, 1.25e-7))])
def test_rows_and_columns_keep_the_order_of_the_file(start, pitch, tmp_path):
    stack = opened(tmp_path / "a.xyz", text_of(rows_of(pitch=pitch, start=start)))
    np.testing.assert_array_equal(stack.frame(0), HEIGHTS.astype(np.float32))
    assert stack.grid.pitch == pytest.approx(np.abs(pitch), rel=0.02)  # six digits of 2.5e-4
    assert stack.grid.unit is None and stack.grid.pitch_mm is None


def test_coordinates_rounded_to_six_digits_are_a_grid(tmp_path):
    heights = np.arange(3000.0).reshape(3, 1000)
    stack = opened(tmp_path / "a.xyz", text_of(rows_of(heights, pitch=(0.137, 0.137), start=(1000.0, 0.0))))
    np.testing.assert_array_equal(stack.frame(0), heights)
    assert stack.grid.pitch[0] == pytest.approx(0.137, rel=1e-4)  # 0.01 over 137


@pytest.mark.parametrize("comment, units", [
    ("# units: um um nm", ("um", "nm")), ("#Unit = mm", ("mm", "mm")), ("# Units: µm, µm, nm", ("µm", "nm")),
    ("# X [um]  Y [um]  Z [nm]", ("um", "nm")), ("# x/mm y/mm z/um", ("mm", "um")), ("# units: px px um", ("px", "um")),
    ("# measured with units of the lab", (None, None)), ("# x, y, z", (None, None)),
])
def test_a_comment_may_state_the_units(comment, units, tmp_path):
    grid = opened(tmp_path / "a.xyz", text_of(rows_of(), [comment])).grid
    assert (grid.unit, grid.height_unit) == units


@pytest.mark.parametrize("comment", ["# units: um um furlong", "# units: um mm nm", "# units: um nm", "# units:",
                                     "# units: s s um", "# units: m^999 m^999 m"])
def test_units_that_cannot_be_meant_are_refused(comment, tmp_path):
    assert "units" in refused(tmp_path / "a.xyz", text_of(rows_of(), [comment])).what


ROWS = rows_of()
IRREGULAR = {
    "a lost point": ROWS[:5] + ROWS[6:], "a lost last point": ROWS[:-1], "a doubled point": ROWS[:6] + ROWS[5:],
    "two points exchanged": [*ROWS[:5], ROWS[6], ROWS[5], *ROWS[7:]], "one row": ROWS[:4], "one point": ROWS[:1],
    "a row and a half": ROWS[:6], "one row again and again": 3 * ROWS[:4],
    "a point beside its place": [*ROWS[:5], ROWS[5].replace("-2.5", "-2.44"), *ROWS[6:]],
    "columns one after the other": [ROWS[4 * row + column] for column in range(4) for row in range(3)],
    "rows to and fro": ROWS[:4] + ROWS[7:3:-1] + ROWS[8:],
    "turned by five degrees": [f"{x - 0.087 * y} {y + 0.087 * x} 1" for y in range(4) for x in range(5)],
    "scattered": [f"{x} {y} 1" for x, y in np.random.default_rng(3).random((20, 2))],
}


@pytest.mark.parametrize("kind", IRREGULAR)
def test_points_that_are_no_regular_grid_in_rows_are_refused(kind, tmp_path):
    error = refused(tmp_path / "a.xyz", text_of(IRREGULAR[kind]))
    assert "grid" in error.what or "row" in error.what


@pytest.mark.parametrize("text, finding", [
    ("", "no row"), ("# nothing\n", "no row"), ("X Y Z\n" + text_of(ROWS), "line 1: 'X Y Z'"),
    (text_of([*ROWS[:2], "1 2", *ROWS[3:]], ["# a"]), "line 4: '1 2'"), (text_of(["1 2 3 4"] * 12), "line 1"),
    (text_of([*ROWS[:3], "", "*** 1 2", *ROWS[4:]]), "line 5"), (text_of([*ROWS[:3], "-1.5 10 1e31"]), "line 4"),
    (text_of(ROWS).replace("-2.5", "1_0"), "line 2"), (text_of(ROWS)[:-1], "without an end"),
    (text_of(row.replace("\t", ";").replace(".", ",") + ".0" for row in ROWS), "the row"),
    (text_of(f"1,{x}00\t1,{y}00\t1,000" for y in (1, 2) for x in (1, 2)), "1,100"),
])
def test_a_damaged_file_is_refused_with_its_line(text, finding, tmp_path):
    assert finding in refused(tmp_path / "a.xyz", text).found


def test_maps_of_one_test_agree_in_size_pitch_and_units(tmp_path):
    units = ["# units: um um nm"]
    for other, message in ((text_of(rows_of(HEIGHTS[:2]), units), "size"),
                           (text_of(rows_of(pitch=(0.5, 0.3)), units), "pitch"), (text_of(rows_of()), "units"),
                           (text_of(rows_of(), ["# units: um um um"]), "units")):
        (tmp_path / "a.xyz").write_text(text_of(rows_of(), units))
        (tmp_path / "b.xyz").write_text(other)
        with pytest.raises(InputError, match=message) as refusal:
            open_stack([tmp_path / "a.xyz", tmp_path / "b.xyz"], with_gaps=True)
        assert refusal.value.file == tmp_path / "b.xyz"


def test_a_map_with_gaps_is_no_grey_image_and_one_without_heights_is_nothing(tmp_path):
    opened(tmp_path / "a.xyz", text_of(rows_of()))
    with pytest.raises(InputError, match="without a value"):
        open_stack([tmp_path / "a.xyz"]).frame(0)
    with pytest.raises(InputError, match="without a value"):
        opened(tmp_path / "a.xyz", text_of(rows_of(np.full((3, 4), np.nan)))).frame(0)
