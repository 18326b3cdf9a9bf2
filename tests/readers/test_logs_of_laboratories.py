"""Logs as machines and spreadsheets export them are read as the numbers that stand there; what may be misread is
refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import Log, column_factor

PLAIN = "time_s,force_kN,grip_µm\n0,0.0,-0.1\n1,0.5,12.25\n2,1.25,1500.5\n"
GERMAN = PLAIN.replace(",", ";").replace(".", ",")
TIMES, FORCES, GRIP = [0.0, 1.0, 2.0], [0.0, 0.5, 1.25], [-0.1, 12.25, 1500.5]


def read(tmp_path, content: str | bytes, decimal=None):
    path = tmp_path / "loads.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return Log.read(path, decimal)


def assert_the_numbers(log, names=("time_s", "force_kN", "grip_µm")):
    for name, values in zip(names, (TIMES, FORCES, GRIP), strict=True):
        np.testing.assert_array_equal(log.column(name), values)


@pytest.mark.parametrize("text", [PLAIN, GERMAN, PLAIN.replace(",", "\t"), GERMAN.replace(";", "\t")])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_every_encoding_of_a_spreadsheet_gives_the_same_numbers_and_says_so(tmp_path, text, encoding):
    log = read(tmp_path, text.encode(encoding))
    assert_the_numbers(log)
    assert log.unit("grip_µm") == "µm"
    shown = {"utf-16": "UTF-16", "utf-16-le": "UTF-16", "utf-16-be": "UTF-16", "cp1252": "Windows-1252"}.get(encoding)
    assert [note for note in log.notes if shown] == ([f"loads.csv: read as {shown}, not UTF-8"] if shown else [])


@pytest.mark.parametrize("data", [b"time_s,force_N\n0,1\n1,\x81\n", b"\xff\xfet\x00i", b"\x00\x01\x02\xff" * 50])
def test_bytes_that_are_no_text_are_refused(tmp_path, data):
    with pytest.raises(InputError):
        read(tmp_path, data)


def test_lines_of_the_instrument_above_the_header_are_skipped_with_a_note(tmp_path):
    head = "Operator;Müller\nSpecimen no.;5\nDate;2026-11-23\n\n"
    log = read(tmp_path, head + GERMAN)
    assert_the_numbers(log)
    assert log.notes == ("loads.csv: the header is line 5; 3 lines above it are skipped",)
    assert log.lines == (6, 7, 8)


@pytest.mark.parametrize("units", ["s;kN;µm", "[s];[kN];[µm]", "(s);(kN);(µm)", "s;kN;"])
def test_a_row_of_units_below_the_header_is_their_unit(tmp_path, units):
    log = read(tmp_path, GERMAN.replace("time_s;force_kN;grip_µm", f"Time;Force;Grip\n{units}"))
    assert_the_numbers(log, ("Time", "Force", "Grip"))
    assert (log.unit("Force"), log.unit("Grip")) == ("kN", units.strip("[]()")[-2:] if "µ" in units else None)
    assert log.time_column == "Time"
    np.testing.assert_array_equal(log.times(), TIMES)


@pytest.mark.parametrize("name", ["Force [kN]", "Force (kN)", "Force / kN", "force_kN"])
def test_a_unit_at_the_end_of_a_name_is_found(tmp_path, name):
    assert read(tmp_path, PLAIN.replace("force_kN", name)).unit(name) == "kN"


def test_a_header_whose_cells_are_written_over_two_lines_is_one_row(tmp_path):
    text = PLAIN.replace("time_s,force_kN,grip_µm", '"Time\n[s]","Force, upper\n[kN]",Grip [µm]')
    log = read(tmp_path, text)
    assert_the_numbers(log, ("Time [s]", "Force, upper [kN]", "Grip [µm]"))
    assert log.unit("Force, upper [kN]") == "kN" and log.lines == (4, 5, 6)
    assert_the_numbers(read(tmp_path, f'Grips, 1" wide\nwidth "5"\n{PLAIN}'))


@pytest.mark.parametrize("stamp", ["14:05:03", "2024-03-12T14:05:03+01:00", "12.3.2024", "2024-03-12 14:05"])
def test_a_time_of_day_is_told_as_such(tmp_path, stamp):
    with pytest.raises(InputError, match="a time of day or a date") as problem:
        read(tmp_path, PLAIN.replace("\n1,", f"\n{stamp},")).times()
    assert "seconds since the first row" in problem.value.remedy


@pytest.mark.parametrize("start", [0.0, 1732812345.0])
def test_an_image_after_the_end_of_the_log_is_refused_on_every_clock(tmp_path, start):
    """Seconds since 1970: a billionth of them is a second or two, in which a force would stand still."""
    rows = "".join(f"{start + k:.1f},{100.0 * k}\n" for k in range(4))
    log, times = read(tmp_path, f"time_s,force_N\n{rows}"), start + np.arange(4.0)
    np.testing.assert_allclose(log.match(4, None, times - 0.5 * (times > start)).column("force_N"), [0, 50, 150, 250])
    with pytest.raises(InputError, match="outside the times of the log") as problem:
        log.match(4, None, times + 1.0)
    assert f"{start + 3:.0f} s" in problem.value.expected and f"{start + 4:.0f} s" in problem.value.found


@pytest.mark.parametrize("name, factor", [("Load (lbs)", 4.4482216152605), ("load_kgf", 9.80665),
                                          ("Load [kip]", 4448.2216152605)])
def test_the_units_of_machines_elsewhere_are_known(tmp_path, name, factor):
    assert column_factor(name, "N", read(tmp_path, PLAIN.replace("force_kN", name)).unit(name)) == factor


@pytest.mark.parametrize("name, found, unit", [("Force_KN", "KN", "kN"), ("Force [KN]", "KN", "kN"),
                                               ("Force [ozf]", "ozf", "N")])
def test_a_unit_that_is_written_otherwise_is_not_passed_over(name, found, unit):
    """A column in kN, renamed to ..._N as the message once advised, would be read as 1000 times less."""
    with pytest.raises(InputError, match="ends in a unit that idic does not know") as problem:
        column_factor(name, "N")
    assert problem.value.found == found and f'unit = "{unit}" }} if that is its unit' in problem.value.remedy


def test_a_units_row_that_contradicts_a_name_is_refused(tmp_path):
    log = read(tmp_path, PLAIN.replace("\n0,", "\ns,N,µm\n0,", 1))
    with pytest.raises(InputError, match="contradicts"):
        log.unit("force_kN")


@pytest.mark.parametrize("mark, text", [(";", GERMAN), (",", PLAIN), ("\t", GERMAN.replace(";", "\t")),
                                        ("|", PLAIN.replace(",", "|"))])
def test_the_separator_that_excel_states_is_obeyed(tmp_path, mark, text):
    assert_the_numbers(read(tmp_path, f"sep={mark}\n{text}"))


@pytest.mark.parametrize("end, last", [(";;", ";;"), ("", ";;"), (";;", "")])
def test_empty_columns_and_rows_at_the_end_are_left_out(tmp_path, end, last):
    header, *rows = GERMAN.splitlines()
    log = read(tmp_path, "\n".join([header + end, *(row + last for row in rows), ";;;;", ";;;;"]))
    assert_the_numbers(log)
    assert log.names == ("time_s", "force_kN", "grip_µm")


def test_an_empty_row_in_the_middle_is_no_blank_line(tmp_path):
    header, first, *rows = GERMAN.splitlines()
    log = read(tmp_path, "\n".join([header, first, ";;", *rows]))
    with pytest.raises(InputError, match="not a number"):
        log.column("force_kN")


def test_a_typographic_minus_is_a_minus(tmp_path):
    assert_the_numbers(read(tmp_path, PLAIN.replace("-", "\N{MINUS SIGN}")))


@pytest.mark.parametrize("cell", ["1.580", "1.580,5", "1.234.567", "12.345", "1.234.567,89"])
def test_thousands_separators_of_a_german_log_are_refused_and_not_read_as_1_58(tmp_path, cell):
    log = read(tmp_path, GERMAN.replace("1500,5", cell))
    with pytest.raises(InputError, match="a number with thousands separators") as problem:
        log.column("grip_µm")
    assert problem.value.key == "column grip_µm, line 4" and repr(cell) == problem.value.found
    np.testing.assert_array_equal(log.column("force_kN"), FORCES)


@pytest.mark.parametrize("cell", ["1,580", "1,234,567", "1,580.5", "1 580.5", "1'580", "1\u202f580"])
def test_thousands_separators_of_an_english_log_are_refused(tmp_path, cell):
    log = read(tmp_path, PLAIN.replace(",", ";").replace("1500.5", cell))
    with pytest.raises(InputError, match="a number with thousands separators"):
        log.column("grip_µm")


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("mark", [".", ","])
def test_a_file_with_ambiguous_marks_asks_for_decimal(tmp_path, mark, separator):
    text = "time_s;force_N\n0;900\n1;1.580\n2;2.345\n".replace(";", separator).replace(".", mark)
    with pytest.raises(InputError, match=": .*ambiguous") as problem:
        read(tmp_path, text).column("force_N")
    assert f'decimal = "{mark}"' in problem.value.remedy and "line 3" in problem.value.key
    np.testing.assert_array_equal(read(tmp_path, text, mark).column("force_N"), [900.0, 1.58, 2.345])
    with pytest.raises(InputError, match="a number with thousands separators"):  # by the other mark
        read(tmp_path, text, "," if mark == "." else ".").column("force_N")


def test_one_cell_that_can_only_be_a_fraction_settles_the_mark_of_the_file(tmp_path):
    for other, values in (("0.5", [0.5, 1.0]), ("1.5e3", [1500.0, 1.0]), ("1000.250", [1000.25, 1.0])):
        log = read(tmp_path, f"time_s;force_N;note\n{other};1.580;a\n1;2.345;b\n")
        np.testing.assert_array_equal(log.column("force_N"), [1.58, 2.345])
        np.testing.assert_array_equal(log.column("time_s"), values)


def test_a_point_in_a_file_that_commas_separate_is_a_decimal_point(tmp_path):
    np.testing.assert_array_equal(read(tmp_path, "time_s,force_N\n0,1.580\n1,2.345\n").column("force_N"), [1.58, 2.345])


def test_a_cell_longer_than_any_number_is_refused(tmp_path):
    for quote in ("", '"'):
        with pytest.raises(InputError, match="longer than any number"):
            read(tmp_path, PLAIN.replace("12.25", f"{quote}12.{'0' * 140_000}{quote}"))


def test_a_row_of_text_among_the_numbers_is_named(tmp_path):
    log = read(tmp_path, PLAIN.replace("1,0.5,12.25", "lost,gone,missing"))
    with pytest.raises(InputError, match="line 3: a row of the log holds no number"):
        log.column("force_kN")


def test_a_log_with_its_own_times_is_read_later_and_its_rates_are_those_of_its_readings(tmp_path):
    """Up in 2 s, held; images every second. Central differences between images would smear the knee over 2 s."""
    at = np.arange(0.0, 6.01, 0.1)
    rows = "".join(f"{t:.1f},{min(t, 2.0):.2f}\n" for t in at)
    on_time = read(tmp_path, "time_s,force_N\n" + rows).match(5, None, np.arange(5.0))
    np.testing.assert_allclose(on_time.column("force_N"), [0, 1, 2, 2, 2], atol=1e-9)
    np.testing.assert_allclose(on_time.rates("force_N"), [1, 1, 0.5, 0, 0], atol=1e-9)
    late = replace(on_time, late=0.7)
    np.testing.assert_allclose(late.column("force_N"), [0.7, 1.7, 2, 2, 2], atol=1e-9)
    early = replace(on_time, late=-0.7)  # the first image lies before the log: on with its rate there
    np.testing.assert_allclose(early.column("force_N"), [-0.7, 0.3, 1.3, 2, 2], atol=1e-9)
    np.testing.assert_allclose(early.of_frames([1, 2]).column("force_N"), [0.3, 1.3], atol=1e-9)
    assert not on_time.notes and not late.notes and not early.of_frames([1, 2]).notes
    assert "1 of 5 images lie up to 0.7 s outside its times" in early.notes[0]


LABVIEW = ("LabVIEW Measurement\t\n***End_of_Header***\t\nX_Dimension\tTime\tTime\t\n***End_of_Header***\t\t\t\n"
           "X_Value\tForce [N]\tComment\n")


@pytest.mark.parametrize("head, separator, suffix", [
    ("Prüfzeit;Standardkraft\ns;N\n", ";", ""), ("Time  1 - default sample rate [s];Force [N]\n", ";", ""),
    ("MTS793|MPT|ENU|1\n\nElapsed Time\tAxial Force\nSec\tN\n", "\t", ""), (LABVIEW, "\t", "\t")])
def test_times_of_machines_are_the_one_column_in_a_unit_of_time_that_grows(tmp_path, head, separator, suffix):
    log = read(tmp_path, head + "".join(f"{0.5 * k}{separator}{k}{suffix}\n" for k in range(4)))
    np.testing.assert_allclose(log.times(), [0.0, 0.5, 1.0, 1.5])


@pytest.mark.parametrize("header, cells", [("Exposure [s],Force [N]", "0.5"), ("Rise time [s],Fall time [s]", None)])
def test_other_durations_are_no_times_of_rows(tmp_path, header, cells):
    log = read(tmp_path, f"{header}\n" + "".join(f"{cells or k},{k}\n" for k in range(4)))
    assert log.times() is None


def test_rows_of_lost_images_are_left_out_by_their_numbers(tmp_path):
    log = read(tmp_path, "frame,time_s,force_N\n" + "".join(f"{k},{k / 10},{k * k}\n" for k in range(3, 9)))
    matched = log.match(4, (3, 4, 7, 8), None)
    np.testing.assert_array_equal(matched.column("force_N"), [9.0, 16.0, 49.0, 64.0])
    np.testing.assert_allclose(matched.times, [0.3, 0.4, 0.7, 0.8])
    assert "2 rows have no image of their number and are left out: frame 5, 6" in matched.notes[-1]
    for numbers in ((3, 4, 7, 12), (None, 4, 7, 8), None):
        with pytest.raises(InputError, match="more rows"):
            log.match(4, numbers, None)
