"""The order of images: read from their names where these are certain, confirmed by the motion, refused where the two
contradict each other; a wrong order is never taken in silence."""

from __future__ import annotations

import os

import numpy as np
import pytest
import tifffile
from moving_speckle import N, STEP_PX, check, images_of, write_strip
from small_experiment import change

from idic.experiment_file import load_experiment

SIGNED = [f"shot_{k:05d}.tif" for k in range(-6, 6)]
MIXED = [f"{'adgbkcfeljhi'[k]}{(k * 5) % 12}.tif" for k in range(N)]
SERIAL = [f"roll{(k * 7) % 12 + 20}_view{k}.tif" for k in range(N)]
READ = {
    "signed": SIGNED,
    "signed with plus": [f"shot{k:+04d}.tif" for k in range(-6, 6)],
    "signed, unpadded": [f"t {k} ms.tif" for k in range(-60, 60, 10)],
    "counter of four digits": [f"DSC_{k % 10000:04d}.tif" for k in range(9994, 10006)],
    "counter without zero": [f"IMG_{(k if k < 10000 else k - 9999):04d}.tif" for k in range(9995, 10007)],
    "counter of a byte": [f"f{k % 256}.tif" for k in range(250, 262)],
    "folders of a camera": [f"{100 + (k > 9999)}CANON/IMG_{k if k < 10000 else k - 9999:04d}.tif"
                            for k in range(9996, 10008)],
    "day, month, year": [f"a_{29 + k if k < 2 else k - 1:02d}-{11 if k < 2 else 12}-2024.tif" for k in range(N)],
    "month, day, year": [f"a_{12 if k < 6 else 1:02d}-{26 + k if k < 6 else k - 5:02d}-{2024 if k < 6 else 2025}.tif"
                         for k in range(N)],
    "month by name": [f"{25 + k if k < 6 else k - 5:02d}{'Nov' if k < 6 else 'Dec'}2024.tif" for k in range(N)],
    "compact date, year last": [f"t{25 + k if k < 6 else k - 5:02d}{11 if k < 6 else 12}2024.tif" for k in range(N)],
    "noon": [f"{(11 if k < 6 else 12) if k < 10 else 1}-{(54 + k) % 60 if k < 10 else k:02d}-00 "
             f"{'AM' if k < 6 else 'PM'}.tif" for k in range(N)],
    "midnight of 12 hours": [f"{'30' if k < 6 else '31'}-12-2024 {11 if k < 6 else 12}.{(54 + k) % 60:02d}.00 "
                             f"{'pm' if k < 6 else 'am'}.tif" for k in range(N)],
    "midnight": [f"x_{'2359' if k < 6 else '0000'}{(54 + k) % 60:02d}.tif" for k in range(N)],
    "unpadded": [f"frame{k + 1}.tif" for k in range(N)],
    "with and without a fraction": [f"t_{0.5 * k:g}s.tif" for k in range(N)],
    "date and time": [f"2024-11-30_10-{k:02d}-05.tif" for k in range(N)],
    "reference": ["undeformed.tif", *(f"image-{k}.tif" for k in range(1, N))],
}
REFUSED = {
    "serial number first": (SERIAL, 'order = "number 2"'),
    "mixed names": (MIXED, 'order = "listed" with images = ["images/'),
    "counter that ends anywhere": ([f"c{k % 5000:04d}.tif" for k in range(4994, 5006)], 'order = "wrapped"'),
    "pairs exchanged": ([f"c{k + 1 - 2 * (k % 2):02d}.tif" for k in range(N)],
                        'images = ["images/c01.tif", "images/c00'),
    "two exchanged": ([f"c{k + (k == 5) - (k == 6):02d}.tif" for k in range(N)], 'order = "listed"'),
    "all below zero": ([f"shot_-{N - k:04d}.tif" for k in range(N)], 'order = "signed" or order = "names"'),
    "unpadded parts of a second": ([f"10-05-0{k // 4}.{('0', '25', '5', '75')[k % 4]}.tif" for k in range(N)],
                                   "order of the files is not certain"),
    "day or month": ([f"{d:02d}-{m:02d}-2024.tif" for d, m in ((1, 2), (2, 3), (3, 1), (4, 2), (5, 3), (6, 1), (7, 4),
                                                             (8, 5), (9, 4), (10, 5), (11, 6), (12, 6))],
                     "day and month cannot be exchanged"),
}
STATED = {"serial number first": (SERIAL, 'order = "number 2"'),
          "below zero": ([f"shot_-{N - k:04d}.tif" for k in range(N)], 'order = "signed"'),
          "counter that ends anywhere": ([f"c{k % 5000:04d}.tif" for k in range(4994, 5006)], 'order = "wrapped"'),
          "quarters of a second": ([f"t_{0.25 * k + 1}s.tif" for k in range(N)], 'order = "decimals"'),
          "mixed names": (MIXED, 'order = "listed"')}


def labels_of(names):
    return tuple(name.rpartition("/")[2] for name in names)


def pattern_of(names):
    return 'images = "images/**/*.tif"' if "/" in names[0] else 'images = "images/*.tif"'


@pytest.mark.parametrize("kind", READ)
def test_names_are_read_in_the_order_of_time(kind, tmp_path):
    folder = write_strip(tmp_path / "a", READ[kind])
    change(folder, "experiment.toml", 'images = "images/*.tif"', pattern_of(READ[kind]))
    assert load_experiment(folder).recording.labels == labels_of(READ[kind])
    code, output = check(folder)
    assert code == 0 and "order of" not in output and "orders of" not in output, output


@pytest.mark.parametrize("kind", REFUSED)
@pytest.mark.parametrize("with_log", [True, False])
def test_an_order_that_the_motion_contradicts_is_refused(kind, with_log, tmp_path):
    names, remedy = REFUSED[kind]
    code, output = check(write_strip(tmp_path / "a", names, with_log=with_log))
    assert code == 2 and remedy in output, output


@pytest.mark.parametrize("kind", STATED)
def test_a_stated_order_is_taken(kind, tmp_path):
    names, line = STATED[kind]
    folder = write_strip(tmp_path / "a", names, more=line)
    if "listed" in line:
        listed = ", ".join(f'"images/{name}"' for name in names)
        change(folder, "experiment.toml", 'images = "images/*.tif"', f"images = [{listed}]")
    assert load_experiment(folder).recording.labels == tuple(names)
    assert check(folder)[0] == 0


def test_the_names_can_be_stated_against_the_motion(tmp_path):
    assert check(write_strip(tmp_path / "a", SERIAL, more='order = "names"'))[0] == 0


def test_names_that_count_down_are_told_by_the_times_of_the_files(tmp_path):
    names = [f"c{N - k:02d}.tif" for k in range(N)]
    folder = write_strip(tmp_path / "a", names)
    for k, name in enumerate(names):
        os.utime(folder / "images" / name, (1.7e9 + 10.0 * k,) * 2)
    code, output = check(folder)
    assert code == 0 and "The motion in the images does not decide" in output
    assert f'order = "listed" with images = ["images/{names[0]}"' in output


def test_an_order_that_does_not_exist_is_refused(tmp_path):
    code, output = check(write_strip(tmp_path / "a", SIGNED, more='order = "time"'))
    assert code == 2 and "names, signed, wrapped, clock" in output


def test_frames_before_the_trigger_have_their_numbers_in_log_and_keys(tmp_path):
    folder = write_strip(tmp_path / "a", SIGNED, frames=range(-6, 6), more="reference = -5\nexclude_frames = [-6]")
    recording = load_experiment(folder)
    assert recording.model.reference == 1 and recording.recording.excluded == (0,)
    assert check(folder)[0] == 0


def test_a_log_that_counts_the_frames_in_another_order_is_refused(tmp_path):
    names = [f"c{k:02d}.tif" for k in (*range(6, 12), *range(6))]
    code, output = check(write_strip(tmp_path / "a", names, frames=(*range(6, 12), *range(6))))
    assert code == 2 and "frame column disagrees" in output
    code, output = check(write_strip(tmp_path / "b", [f"s{k}.tif" for k in (*range(60, 66), *range(6))],
                                     frames=sorted((*range(60, 66), *range(6)))))
    assert code == 2 and "contradicts the order of their names" in output and 'order = "wrapped"' in output


def test_times_that_name_the_images_in_another_order_are_refused(tmp_path):
    folder = write_strip(tmp_path / "a", SERIAL, more='image_times = "times.csv"')
    (folder / "times.csv").write_text("image,time_s\n" + "".join(f"{name},{k}\n" for k, name in enumerate(SERIAL)))
    code, output = check(folder)
    assert code == 2 and "two orders of the images" in output and "found: roll27_view1.tif" in output


@pytest.mark.parametrize("source", ["TIFF", "sidecar", "seconds"])
@pytest.mark.parametrize("moving", [True, False])
def test_times_in_files_that_contradict_the_names_are_told(source, moving, tmp_path):
    names = [f"n{k:02d}.tif" for k in range(N)]
    images = images_of(range(N) if moving else [0.0] * N)
    folder = write_strip(tmp_path / "a", names, images)
    for k, name in enumerate(names):
        second = (k + 6) % 12
        if source == "TIFF":
            tifffile.imwrite(folder / "images" / name, images[k], datetime=f"2024:11:30 10:00:{second:02d}")
        else:
            stamp = f"2024-11-30T10:00:{second:02d}.5"
            text = f'{{"timestamp_ms": {1000 * second + 5}}}' if source == "seconds" else stamp
            (folder / "images" / name).with_suffix(".json" if source == "seconds" else ".txt").write_text(text)
    code, output = check(folder)
    assert code == 0
    assert ("two orders of the images: n00.tif, n01.tif, n02.tif … n10.tif, n11.tif by their names, n06.tif, n07.tif, "
            "n08.tif … n04.tif, n05.tif by the times in the files") in output
    assert f"The motion in the images {'is that of the names' if moving else 'does not decide'}" in output


def test_times_of_saving_count_where_the_motion_does_not_decide(tmp_path):
    names = [f"n{k:02d}.tif" for k in range(N)]
    for moving in (True, False):
        folder = write_strip(tmp_path / f"{moving}", names, images_of(range(N) if moving else [0.0] * N))
        for k, name in enumerate(names):
            os.utime(folder / "images" / name, (1e9 + (k + 6) % 12, 1e9 + (k + 6) % 12))
        assert ("two orders of the images" in check(folder)[1]) is not moving


@pytest.mark.parametrize("states", [[*range(7), *range(5, 0, -1)], [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8],
                                    [0, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6], [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5],
                                    [0, 1, 2, 4, 6, 8, 7, 5, 3, 2, 1, 0]])
def test_unloading_rests_and_cycles_are_in_order(states, tmp_path):
    names = [f"n{k:02d}.tif" for k in range(N)]
    rows = [(k, STEP_PX * state) for k, state in enumerate(states)]
    code, output = check(write_strip(tmp_path / "a", names, images_of(states), rows=rows))
    assert code == 0 and "contradict" not in output and "repeat" not in output, output


@pytest.mark.parametrize("states", [[*range(7), *range(5, 0, -1)], [0.0] * N, list(np.linspace(0.0, 4.0, N) ** 2)])
def test_without_a_log_a_smooth_course_is_in_order(states, tmp_path):
    code, output = check(write_strip(tmp_path / "a", [f"n{k:02d}.tif" for k in range(N)], images_of(states),
                                     with_log=False))
    assert code == 0 and "contradicts" not in output, output
