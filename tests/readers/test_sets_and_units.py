"""Small languages of the experiment file: sets by position, units, numbers of frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from idic.errors import InputError
from idic.readers import FrameNames, column_factor, factor_between, parse_unit, points_where
from idic.readers import unit_in_name

POINTS = np.array([[0.0, -10.0], [3.0, 0.0], [-2.0, 4.0]])


@pytest.mark.parametrize("expression, expected", [
    ("y < -9.9", [1, 0, 0]), ("x >= 0 and y > -1", [0, 1, 0]), ("x < 0 or y < -9", [1, 0, 1]), ("not x > 0", [1, 0, 1]),
    ("0 <= x <= 3", [1, 1, 0]), ("abs(x) < 2.5", [1, 0, 1]), ("x**2 + y**2 < 3.1**2", [0, 1, 0]),
    ("sqrt(x*x) > 2.5", [0, 1, 0]),
    ("(x < 1) and (y/2 > -6)", [1, 0, 1]), ("-y > 9", [1, 0, 0]),
])
def test_positions_are_compared_as_written(expression, expected):
    np.testing.assert_array_equal(points_where(expression, POINTS), np.array(expected, bool))


@pytest.mark.parametrize("expression", [
    "", "x", "x + 1", "__import__('os').system('true')", "x.__class__", "z > 0", "(lambda: 1)() > 0", "[1][0] > x",
    "x == 0",
    "open('a') > x", "x > 'a'", "x < 9**9**9", "x > 1j", "exec('1') > x", "x if y else x", "x > True", "x & y",
    "f(x) > 1",
    "x < 1; y < 1", "(" * 500 + "x" + ")" * 500 + " > 0", "x > 0" + " and x > 0" * 1000,
])
def test_anything_else_is_refused(expression):
    with pytest.raises(InputError) as caught:
        points_where(expression, POINTS)
    assert caught.value.expected and caught.value.remedy


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="xyz0123456789<>=+-*/() .andort_'\"[]{}:,", max_size=40))
def test_no_text_does_more_than_give_a_mask_or_a_refusal(expression):
    try:
        assert points_where(expression, POINTS).shape == (3,)
    except InputError:
        pass


@pytest.mark.parametrize("unit, internal, factor", [
    ("GPa", "MPa", 1e3), ("N/mm^2", "MPa", 1.0), ("N/m^2", "MPa", 1e-6), ("um", "mm", 1e-3), ("min", "s", 60.0),
    ("kPa*s", "MPa*s", 1e-3),
    ("1/h", "1/s", 1 / 3600), ("%", "-", 0.01), ("rad", "deg", 180 / np.pi), ("bar", "MPa", 0.1), ("kN", "N", 1e3),
])
def test_units_convert_to_internal_ones(unit, internal, factor):
    assert factor_between(unit, internal) == pytest.approx(factor, rel=1e-14)  # one multiplication or two


@pytest.mark.parametrize("unit", ["", "kg m", "MPaa", "N//mm", "mm^", "*N", "N mm mmm"])
def test_a_unit_of_another_kind_is_refused(unit):
    with pytest.raises(InputError):
        factor_between(unit, "MPa")


def test_a_column_tells_its_unit_by_its_name():
    assert unit_in_name("force_N") == "N" and unit_in_name("force") is None and unit_in_name("N") is None
    assert column_factor("grip_um", "mm") == pytest.approx(1e-3)
    assert column_factor("grip", "mm", "um") == pytest.approx(1e-3)
    assert parse_unit("deg").dimension == "angle"


def test_the_number_that_differs_is_the_number_of_the_frame():
    assert FrameNames(("zoom-0050_1.tif", "zoom-0053_1.tif", "zoom-0078_1.tif")).numbers == (50, 53, 78)
    assert FrameNames(("a.tif", "b.tif")).numbers is None
    assert FrameNames(("s1_1.tif", "s2_2.tif")).numbers is None  # two numbers differ
    assert FrameNames(("movie.tif[0]", "movie.tif[1]")).numbers == (0, 1)


def test_numbers_mean_file_names_where_they_all_occur_there_else_indices():
    labels = ("zoom-0050_1.tif", "zoom-0053_1.tif", "zoom-0078_1.tif")
    assert FrameNames(labels).indices([78], file=None, key="k")[0] == (2,)
    assert FrameNames(labels).indices([1, "zoom-0078_1.tif"], file=None, key="k")[0] == (1, 2)
    with pytest.raises(InputError, match="ambiguous"):
        FrameNames(labels).indices([78, 1], file=None, key="k")
    assert FrameNames(("f_1.tif", "f_2.tif")).indices([1], file=None, key="k")[0] == (0,)


def test_a_named_reference_without_a_number_leaves_the_numbers_of_the_others_their_meaning():
    labels = ("reference.tif", *(f"img_{k:04d}.tif" for k in range(8)))
    found, note = FrameNames(labels).indices([5], file=None, key="k")
    assert [labels[k] for k in found] == ["img_0005.tif"] and "img_0005.tif" in note
    assert FrameNames(labels).numbers is None  # a log has a row for the reference, too
    dated = ("reference_2024_1.tif", *labels[1:])
    assert FrameNames(dated).indices([5], file=None, key="k")[0] == (6,)


def test_a_number_that_is_one_of_several_in_the_names_is_refused_unless_both_readings_agree():
    labels = tuple(f"cam_{k:04d}_1205{33 + k}.tif" for k in range(1, 9))
    with pytest.raises(InputError, match="ambiguous") as caught:
        FrameNames(labels).indices([3], file=None, key="k")
    assert "cam_0003_120536.tif" in str(caught.value) and "cam_0004_120537.tif" in str(caught.value)
    from_zero = tuple(f"cam_{k:04d}_1205{33 + k}.tif" for k in range(8))
    assert FrameNames(from_zero).indices([3], file=None, key="k")[0] == (3,)
    with pytest.raises(InputError, match="no such frame"):
        FrameNames(labels).indices([120536], file=None, key="k")


def test_numbers_that_are_no_part_of_the_names_are_indices_with_a_note():
    labels = tuple(f"cam_{k:04d}_1205{33 + k}.tif" for k in range(1, 9))
    found, note = FrameNames(labels).indices([0], file=None, key="k")
    assert found == (0,) and "indices from 0" in note
    assert FrameNames(("a.tif", "b.tif")).indices([1], file=None, key="k") == ((1,), None)


@pytest.mark.parametrize("unit, internal, size", [
    ("in", "mm", 25.4), ("um", "mm", 1e-3), ("min", "s", 60.0), ("lbf", "N", 0.45359237 * 9.80665),
    ("kip", "N", 1e3 * 0.45359237 * 9.80665), ("kgf", "N", 9.80665), ("bar", "MPa", 0.1), ("kPa", "MPa", 1e-3),
    ("psi", "MPa", 0.45359237 * 9.80665 / 25.4**2), ("ksi", "MPa", 1e3 * 0.45359237 * 9.80665 / 25.4**2),
    ("rad", "deg", 180.0 / 3.14159265358979), ("N/mm^2", "MPa", 1.0), ("GPa*s", "MPa*s", 1e3)])
def test_units_have_the_size_of_their_definition(unit, internal, size):
    assert factor_between(unit, internal) == pytest.approx(size, rel=1e-12)
