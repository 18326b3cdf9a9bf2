"""Times of day in logs and image times are read as seconds on one clock; what can be read in two ways is refused."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import Log, log_of

SECONDS = [0.0, 0.25, 2.5]


def read(folder, text: str, name="loads.csv", encoding="utf-8"):
    path = folder / name
    path.write_text(text, encoding=encoding)
    return Log.read(path)


def table(stamps, header="Time;Force [N]"):
    return header + "\n" + "".join(f"{stamp};{k},5\n" for k, stamp in enumerate(stamps))


@pytest.mark.parametrize("stamps", [
    ("10:22:29.5", "10:22:29.75", "10:22:32"),
    ("10:22:29,500", "10:22:29,750", "10:22:32,000"),
    ("10:22:29:500", "10:22:29:750", "10:22:32:000"),
    ("23:59:58.5", "23:59:58.75", "00:00:01.0"),
    ("11:59:58.5 AM", "11:59:58.75 AM", "12:00:01 PM"),
    ("11:59:58.5 p.m.", "11:59:58.75 p.m.", "12:00:01 a.m."),
    ("9:59:59.5am", "9:59:59.75am", "10:00:02am"),
    ("59:58.5", "59:58.7500", "00:01.0"),
    ("90:58.5", "90:58.75", "91:01.0"),
    ("23:59:58.5", "23:59:58.75", "24:00:01.0"),
    ("2024-02-28 23:59:58.5", "2024-02-28 23:59:58.75", "2024-02-29 00:00:01.0"),
    ("2024-02-28T23:59:58.5Z", "2024-02-28T23:59:58.75Z", "2024-02-29T00:00:01Z"),
    ("2024-03-31T01:59:58.5+01:00", "2024-03-31T01:59:58.75+01:00", "2024-03-31T03:00:01.0+02:00"),
    ("31.12.2023 23:59:58,5", "31.12.2023 23:59:58,75", "01.01.2024 00:00:01"),
    ("31/12/2023 23:59:58.5", "31/12/2023 23:59:58.75", "01/01/2024 00:00:01"),
    ("12/31/23 11:59:58.5 PM", "12/31/23 11:59:58.75 PM", "1/1/24 12:00:01 AM"),
    ("04/03/2024 23:59:58.5", "04/03/2024 23:59:58.75", "05/03/2024 00:00:01"),
    ("04/03/2024 23:59:58.5", "04/03/2024 23:59:58.75", "04/04/2024 00:00:01"),
    ("04/03/2024 13:59:58.5", "04/03/2024 13:59:58.75", "04/03/2024 14:00:01"),
    ("28-Feb-2023 23:59:58.5", "28-Feb-2023 23:59:58.75", "01-Mar-2023 00:00:01"),
    ("30. Dez. 2023 23:59:58.5", "30. Dez. 2023 23:59:58.75", "31. Dez. 2023 00:00:01"),
    ("23:59:58.5 31.12.2023", "23:59:58.75 31.12.2023", "00:00:01 01.01.2024"),
])
def test_every_way_of_writing_a_time_of_day_gives_the_seconds_since_the_first_row(tmp_path, stamps):
    log = read(tmp_path, table(stamps))
    assert log.time_column == "Time"
    np.testing.assert_allclose(log.times(), SECONDS, atol=1e-9)
    np.testing.assert_array_equal(log.column("Force [N]"), [0.5, 1.5, 2.5])
    assert [note for note in log.notes if "times of day" in note and stamps[0] in note]


def test_a_column_of_dates_beside_the_times_counts(tmp_path):
    text = "Date,Time,force_N\n2024-03-01,23:00:00,1\n2024-03-02,23:00:01,2\n2024-03-03,01:00:00,3\n"
    log = read(tmp_path, text)
    np.testing.assert_array_equal(log.times(), [0, 86401, 93600])
    assert "with the dates beside it" in " ".join(log.notes) and "not read" not in " ".join(log.notes)
    standing = text.replace("03-02", "03-01").replace("03-03", "03-01").replace("23:00:01", "23:00:02")
    np.testing.assert_array_equal(read(tmp_path, standing).times(), [0, 2, 7200])  # the day of the start of the test


@pytest.mark.parametrize("header, factor", [("Time [hh:mm]", 60), ("Time (mm:ss)", 1), ("Uhrzeit", 60)])
def test_two_numbers_are_what_the_header_says(tmp_path, header, factor):
    log = read(tmp_path, table(("05:30", "05:40", "06:10"), f"{header};Force [N]"))
    np.testing.assert_array_equal(log.times(), np.array([0, 10, 40]) * factor)


def test_a_row_of_formats_below_the_header_is_its_unit(tmp_path):
    log = read(tmp_path, "Time;Force\nmm:ss;N\n05:30;1,5\n05:40;2,5\n")
    assert log.unit("Force") == "N"
    np.testing.assert_array_equal(log.times(), [0, 10])


@pytest.mark.parametrize("stamps, message", [
    (("05:30", "05:40", "06:10"), "hours and minutes, or minutes and seconds"),
    (("01/02/2024 10:00:00", "01/02/2024 10:00:01", "04/05/2024 10:00:00"), "the day or the month first"),
    (("10:00:01", "10:00:00", "10:00:02"), "not sorted"),
    (("12:59:59", "1:00:00", "1:00:01"), "not sorted"),
    (("10:00:01", "10:00:61", "10:01:02"), "no clock shows"),
    (("13:00:01 PM", "13:00:02 PM", "13:00:03 PM"), "no clock shows"),
    (("10:00:01", "", "10:00:02"), "among times of day"),
    (("10:00:01", "1.5", "10:00:02"), "among times of day"),
    (("10:00:01", "10:00", "10:00:02"), "different length"),
    (("2024-01-01 10:00:01", "10:00:02", "10:00:03"), "the date"),
    (("10:00:01Z", "10:00:02", "10:00:03"), "the time zone"),
    (("31/31/2024 10:00:01", "31/31/2024 10:00:02", "31/31/2024 10:00:03"), "does not exist"),
])
def test_times_of_day_that_are_not_certain_are_refused(tmp_path, stamps, message):
    with pytest.raises(InputError, match=message) as problem:
        read(tmp_path, table(stamps)).times()
    assert problem.value.expected and problem.value.found and problem.value.remedy
    assert "line" in problem.value.key


@pytest.mark.parametrize("images, log", [
    (("23:59:59", "00:00:00", "00:00:02"), ("23:59:58", "00:00:03")),
    (("00:00:01", "00:00:02", "00:00:04"), ("23:59:59", "00:00:05")),
    (("23:59:59", "00:00:00", "00:00:02"), ("2024-02-29 23:59:58", "2024-03-01 00:00:03")),
    (("2024-03-01 00:00:01", "2024-03-01 00:00:02", "2024-03-01 00:00:04"), ("11:59:59 PM", "12:00:05 AM")),
    (("01.03.2024 00:00:01", "01.03.2024 00:00:02", "01.03.2024 00:00:04"),
     ("2024-02-29 23:59:59", "2024-03-01 00:00:05")),
    (("2024-03-01T00:00:01+01:00", "2024-03-01T00:00:02+01:00", "2024-03-01T00:00:04+01:00"),
     ("2024-02-29T22:59:59Z", "2024-02-29T23:00:05Z")),
    (("22:31.0", "22:32.0", "22:34.0"), ("10:22:29", "10:22:35")),
])
def test_images_and_log_are_matched_on_one_clock(tmp_path, images, log):
    times = read(tmp_path, "time\n" + "\n".join(images) + "\n", "times.csv")
    on_clock = read(tmp_path, f"Time;force_N\n{log[0]};0\n{log[1]};10\n").on_the_clock_of(times)
    matched = on_clock.match(3, None, times.times())
    np.testing.assert_allclose(matched.times, [0, 1, 3])
    start = -on_clock.times()[0]
    np.testing.assert_allclose(matched.column("force_N"),
                               10 * (start + np.array([0, 1, 3])) / np.ptp(on_clock.times()))


@pytest.mark.parametrize("images, log, message", [
    (("10:00:00", "10:00:01"), "time_s,force_N\n0,1\n5,2\n", "times of different kinds"),
    (("10:00:00Z", "10:00:01Z"), "time,force_N\n09:59:59,1\n10:00:05,2\n", "time zone"),
    (("10:00:00", "10:00:01"), "time,force_N\n09:00:00,1\n20:00:00,1\n06:00:00,1\n11:00:00,2\n", "same time again"),
])
def test_two_clocks_that_do_not_fit_are_refused(tmp_path, images, log, message):
    times = read(tmp_path, "time\n" + "\n".join(images) + "\n", "times.csv")
    with pytest.raises(InputError, match=message):
        read(tmp_path, log).on_the_clock_of(times).match(2, None, times.times())


def test_a_single_column_of_times_may_have_decimal_commas(tmp_path):
    np.testing.assert_allclose(read(tmp_path, "time\n10:00:00,25\n10:00:01,5\n").times(), [0, 1.25])


@pytest.mark.parametrize("stamp", ["10:00:00", "2024-03-01 10:00:00", "2024-03-01T10:00:00"])
def test_a_comma_behind_a_time_separates_where_the_header_has_one(tmp_path, stamp):
    log = read(tmp_path, f"Time,force_N\n{stamp},25\n{stamp[:-1]}1,5\n")
    np.testing.assert_array_equal(log.times(), [0, 1])
    np.testing.assert_array_equal(log.column("force_N"), [25, 5])


def test_columns_that_are_not_read_are_named(tmp_path):
    log = read(tmp_path, "Time;Zeit;time;remark;;force_N\n10:00:00;10:00:00;0;start;7;1\n"
                         "10:00:00;10:00:00;1;hold;7;2\n")
    assert log.time_column is None and log.times() is None
    note = next(note for note in log.notes if "not read" in note)
    for part in ("Time shows the same time", "Zeit shows the same time", "time has no unit of time",
                 "remark holds no numbers (start)", "the 5. column has no name"):
        assert part in note
    assert "force_N" not in note
    with pytest.raises(InputError, match="fewer rows") as problem:
        log.match(3, None, np.arange(3.0))
    assert "Time shows the same time" in problem.value.found


@pytest.mark.parametrize("text", [
    "# operator: A, B\n# time_s;force_N\n0;1,5\n1;2,5\n",
    "# Time;Force\n# s;N\n0;1,5\n1;2,5\n",
    "% time_s;force_N\n0;1,5\n1;2,5\n",
    "// time_s;force_N\n0;1,5\n1;2,5\n",
    "#Time [s];Force [N]\n#-----\n0;1,5\n1;2,5\n",
])
def test_a_header_that_is_a_comment_is_the_header(tmp_path, text):
    log = read(tmp_path, text)
    np.testing.assert_array_equal(log.times(), [0, 1])
    name = log.names[1]
    assert log.unit(name) == "N"
    np.testing.assert_array_equal(log.column(name), [1.5, 2.5])


def test_a_file_of_numpy_is_read(tmp_path):
    np.savetxt(tmp_path / "a.csv", [[0, 1.5], [1, 2.5]], delimiter=",", header="specimen 7\ntime_s,force_N")
    np.testing.assert_array_equal(Log.read(tmp_path / "a.csv").column("force_N"), [1.5, 2.5])
    np.savetxt(tmp_path / "b.csv", [0.5, 1.25], header="time_s")
    np.testing.assert_array_equal(Log.read(tmp_path / "b.csv").times(), [0.5, 1.25])


def test_dates_in_memory_are_times():
    stamps = np.array(["2024-02-29T23:59:59.5", "2024-03-01T00:00:01"], "datetime64[ns]")
    np.testing.assert_allclose(log_of({"time": stamps, "force_N": np.arange(2.0)}).times(), [0, 1.5])
