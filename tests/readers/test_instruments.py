"""Files of instruments: films, height maps and logs come in as they were recorded, or are refused with the reason."""

from importlib.util import find_spec

import numpy as np
import pytest
from instrument_files import write_cine, write_mraw, write_plu, write_plux, write_zs2

from idic.errors import InputError
from idic.readers import Log, open_stack

pytest.importorskip("surfalize", reason="idic[instruments] is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # pymraw on files without 12 bits

RNG = np.random.default_rng(5)
FRAMES = RNG.integers(0, 4096, (5, 12, 23)).astype(np.uint16)  # an odd number of pixels: packed frames share a byte
WITH_BOTH_LIBRARIES = pytest.mark.skipif(find_spec("SurfaceTopography") is None,
                                         reason="SurfaceTopography is not installed")
HEIGHTS = RNG.normal(40.0, 3.0, (20, 30)).astype(np.float32)
HEIGHTS[3, 4] = np.nan


def recorded(path):
    stack = open_stack([path])
    return np.array([stack.frame(k) for k in (3, 0, 1, 4, 2)])[[1, 2, 4, 0, 3]], stack


# high-speed cameras -----------------------------------------------------------------------------------
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_frames_of_photron_are_the_recorded_ones_in_any_order(bits, tmp_path):
    frames = FRAMES >> 4 if bits == 8 else FRAMES
    write_mraw(tmp_path / "film.mraw", frames, bits)
    read, stack = recorded(tmp_path / "film.mraw")
    np.testing.assert_array_equal(read, frames)
    assert stack.frame(0).dtype == (np.uint8 if bits == 8 else np.uint16)


def test_values_on_the_upper_side_of_16_bits_are_shifted_back(tmp_path):
    write_mraw(tmp_path / "film.mraw", FRAMES << 4, 16, side="Higher")
    np.testing.assert_array_equal(recorded(tmp_path / "film.mraw")[0], FRAMES)


def test_the_times_of_photron_count_the_saved_frames(tmp_path):
    write_mraw(tmp_path / "film.mraw", FRAMES, 16, rate=5000, step=25)
    stack = open_stack([tmp_path / "film.mraw"])
    np.testing.assert_allclose(stack.times_s, np.arange(5) * 25 / 5000)
    assert "every 25th" in stack.notes()[0]


def test_a_film_written_by_pymraw_is_read(tmp_path):
    import pyMRAW

    pyMRAW.save_mraw(FRAMES, str(tmp_path / "film.cih"), bit_depth=16,
                     info_dict={"Record Rate(fps)": 2000, "Save Step": 4})
    read, stack = recorded(tmp_path / "film.mraw")
    np.testing.assert_array_equal(read, FRAMES)
    np.testing.assert_allclose(stack.times_s, np.arange(5) * 4 / 2000)


@pytest.mark.parametrize("spoil, words", [
    (lambda path: path.with_suffix(".cihx").unlink(), "film.cihx"),
    (lambda path: path.write_bytes(path.read_bytes()[:-100]), "bytes"),
    (lambda path: path.write_bytes(path.read_bytes() * 2), "bytes"),
    (lambda path: write_mraw(path, FRAMES, 16, colour="Bayer"), "Bayer"),
])
def test_a_film_of_photron_that_does_not_fit_its_header_is_refused(spoil, words, tmp_path):
    path = tmp_path / "film.mraw"
    write_mraw(path, FRAMES, 16)
    spoil(path)
    with pytest.raises(InputError, match=words):
        open_stack([path])


@pytest.mark.parametrize("bits, packing", [(8, 0), (16, 0), (12, 1024)])
@pytest.mark.parametrize("setup_length", [10384, 11000])
def test_frames_of_phantom_are_the_recorded_ones_in_any_order(bits, packing, setup_length, tmp_path):
    frames = RNG.integers(0, 2**min(bits, 12), (5, 12, 24)).astype(np.uint16)
    stamps = 5.0 + np.arange(5) / 400 if setup_length < 10408 else None  # of an older camera
    write_cine(tmp_path / "film.cine", frames, bits, packing=packing, setup_length=setup_length, rate=400,
               stamps=stamps)
    read, stack = recorded(tmp_path / "film.cine")
    np.testing.assert_array_equal(read, frames)
    np.testing.assert_allclose(stack.times_s, np.arange(5) / 400, atol=1e-8)


def test_packed_10_bit_values_of_phantom_keep_their_order(tmp_path):
    codes = np.arange(5 * 8 * 24).reshape(5, 8, 24) % 1000
    write_cine(tmp_path / "film.cine", codes, 10, packing=256)
    read, stack = recorded(tmp_path / "film.cine")
    order = np.argsort(codes, axis=None, kind="stable")
    assert (np.diff(read.ravel()[order].astype(int)) >= 0).all() and read.max() > 800
    assert "table of the camera" in stack.notes()[0]


def test_the_stamps_of_phantom_go_on_over_a_full_minute(tmp_path):
    times = 59.9985 + np.arange(5) / 1000
    write_cine(tmp_path / "film.cine", FRAMES[:, :, :16], 16, stamps=times, rate=1000)
    np.testing.assert_allclose(open_stack([tmp_path / "film.cine"]).times_s, np.arange(5) / 1000, atol=1e-8)


@pytest.mark.parametrize("keys, words", [({"cfa": 3}, "gb/rg"), ({"stamps": np.arange(5) * 0.5 + 7.0}, "0.5 s apart"),
                                         ({"rate": 0}, "neither")])
def test_a_film_of_phantom_in_colour_or_without_certain_times_is_refused(keys, words, tmp_path):
    write_cine(tmp_path / "film.cine", FRAMES[:, :, :16], 16, **keys)
    with pytest.raises(InputError, match=words):
        open_stack([tmp_path / "film.cine"])


def test_a_truncated_film_of_phantom_is_refused(tmp_path):
    path = tmp_path / "film.cine"
    write_cine(path, FRAMES[:, :, :16], 16)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(InputError, match=": .*truncated"):
        open_stack([path])


# profilometers ----------------------------------------------------------------------------------------
@WITH_BOTH_LIBRARIES
@pytest.mark.parametrize("name, write", [("map.plu", write_plu), ("map.plux", write_plux)])
def test_a_map_of_sensofar_has_its_heights_pitch_and_gaps(name, write, tmp_path):
    write(tmp_path / name, HEIGHTS, 0.83)
    stack = open_stack([tmp_path / name], with_gaps=True)
    np.testing.assert_array_equal(stack.frame(0), HEIGHTS)
    np.testing.assert_allclose(stack.grid.pitch_mm, 0.83e-3, rtol=1e-6)
    assert stack.grid.height_unit == "um"


@WITH_BOTH_LIBRARIES
@pytest.mark.parametrize("suffix", ["x3p", "al3d"])
def test_a_map_that_surfalize_writes_comes_back(suffix, tmp_path):
    from surfalize import Surface

    Surface(HEIGHTS.astype(float), 0.5, 0.7).save(tmp_path / f"map.{suffix}")
    stack = open_stack([tmp_path / f"map.{suffix}"], with_gaps=True)
    np.testing.assert_allclose(stack.frame(0), HEIGHTS, atol=2e-6)
    np.testing.assert_allclose(stack.grid.pitch_mm, (0.5e-3, 0.7e-3), rtol=1e-6)


@WITH_BOTH_LIBRARIES
@pytest.mark.parametrize("suffix", ["sdf", "sur", "tmd"])
def test_a_map_on_which_the_libraries_differ_is_refused_with_both_readings(suffix, tmp_path):
    from surfalize import Surface

    Surface(HEIGHTS.astype(float), 0.5, 0.5).save(tmp_path / f"map.{suffix}")
    with pytest.raises(InputError, match="do not agree") as refusal:
        open_stack([tmp_path / f"map.{suffix}"], with_gaps=True)
    assert "surfalize: " in refusal.value.found and "SurfaceTopography: " in refusal.value.found


@WITH_BOTH_LIBRARIES
def test_the_times_of_maps_are_those_at_which_they_were_taken(tmp_path):
    for k in range(3):
        write_plu(tmp_path / f"{k}.plu", HEIGHTS + k, 0.83)
        content = (tmp_path / f"{k}.plu").read_bytes()
        (tmp_path / f"{k}.plu").write_bytes(content.replace(b"10:00:00", f"10:0{2 * k}:30".encode()))
    stack = open_stack([tmp_path / f"{k}.plu" for k in range(3)], with_gaps=True)
    np.testing.assert_allclose(stack.times_s, [0.0, 120.0, 240.0])


# logs -------------------------------------------------------------------------------------------------
def write_tdms(path, *channels, parts=1):
    """channels : (group, name, values, properties)"""
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for part in range(parts):
            writer.write_segment([ChannelObject(group, name, np.array_split(values, parts)[part], properties)
                                  for group, name, values, properties in channels])


SAMPLING = {"wf_increment": 0.1, "wf_start_offset": 2.5, "wf_samples": 1}
FORCE = np.linspace(0.0, 900.0, 40)


def test_channels_of_tdms_have_their_units_and_times_from_the_start_offset_on(tmp_path):
    write_tdms(tmp_path / "log.tdms", ("test", "force", FORCE, SAMPLING | {"unit_string": "N"}),
               ("test", "stroke", FORCE / 100, SAMPLING | {"unit_string": "mm"}))
    log = Log.read(tmp_path / "log.tdms")
    assert log.names == ("time_s", "force", "stroke") and log.unit("stroke") == "mm" and log.unit("force") == "N"
    np.testing.assert_allclose(log.times(), 2.5 + 0.1 * np.arange(40))
    np.testing.assert_allclose(log.column("force"), FORCE)


def test_channels_of_tdms_that_were_sampled_otherwise_are_named_and_left_out(tmp_path):
    write_tdms(tmp_path / "log.tdms", ("test", "force", FORCE, SAMPLING), ("test", "stroke", FORCE, SAMPLING),
               ("test", "temperature", FORCE[:4], SAMPLING | {"wf_increment": 1.0}))
    log = Log.read(tmp_path / "log.tdms")
    assert log.names == ("time_s", "force", "stroke")
    assert any("temperature (4 samples every 1 s)" in note for note in log.notes)


def test_channels_of_tdms_of_different_length_end_with_the_shortest(tmp_path):
    write_tdms(tmp_path / "log.tdms", ("test", "force", FORCE, SAMPLING), ("test", "stroke", FORCE[:33], SAMPLING))
    log = Log.read(tmp_path / "log.tdms")
    assert len(log.rows) == 33 and any("force 40, stroke 33" in note for note in log.notes)


def test_a_tdms_file_that_was_interrupted_is_read_as_far_as_it_is_complete(tmp_path):
    path = tmp_path / "log.tdms"
    write_tdms(path, ("test", "force", FORCE, SAMPLING), ("test", "stroke", FORCE, SAMPLING), parts=2)
    path.write_bytes(path.read_bytes()[:-100])
    log = Log.read(path)
    assert 20 <= len(log.rows) < 40 and any("interrupted" in note for note in log.notes)
    np.testing.assert_allclose(log.column("force"), FORCE[:len(log.rows)])


NAMES = {5: "Prüfzeit", 8: "Standardkraft"}
RECORD = {5: np.arange(6.0), 8: np.arange(6.0) * 125}


def test_a_record_of_zwick_has_the_names_of_its_channels_and_its_time(tmp_path):
    write_zs2(tmp_path / "test.zs2", [RECORD], NAMES)
    log = Log.read(tmp_path / "test.zs2")
    assert log.names == ("time_s", "Standardkraft")
    np.testing.assert_allclose(log.times(), RECORD[5])
    np.testing.assert_allclose(log.column("Standardkraft"), RECORD[8])
    assert log.unit("Standardkraft") is None and "states no units" in log.notes[0]


def test_records_of_several_specimens_are_refused(tmp_path):
    write_zs2(tmp_path / "test.zs2", [RECORD, RECORD], NAMES)
    with pytest.raises(InputError, match="several specimens"):
        Log.read(tmp_path / "test.zs2")


def write_xlsx(path, **sheets):
    from openpyxl import Workbook

    workbook = Workbook()
    workbook.remove(workbook.active)
    for title, rows in sheets.items():
        sheet = workbook.create_sheet(title)
        for row in rows:
            sheet.append(row)
    workbook.save(path)


def test_the_record_of_a_workbook_is_the_sheet_with_the_rows(tmp_path):
    write_xlsx(tmp_path / "log.xlsx", Results=[["E", 71000.0]],
               Specimen=[["operator", "N.N."], ["time", "force"], ["s", "kN"],
                         *([0.1 * k, 1.234 * k] for k in range(20))])
    log = Log.read(tmp_path / "log.xlsx")
    assert log.names == ("time", "force") and log.unit("force") == "kN"
    np.testing.assert_allclose(log.column("force"), 1.234 * np.arange(20))
    np.testing.assert_allclose(log.times(), 0.1 * np.arange(20))


def test_a_workbook_with_two_records_is_refused(tmp_path):
    rows = [["time_s", "force_N"], *([k, k] for k in range(20))]
    write_xlsx(tmp_path / "log.xlsx", Specimen1=rows, Specimen2=rows)
    with pytest.raises(InputError, match="Specimen2 with 20"):
        Log.read(tmp_path / "log.xlsx")
