"""An experiment on a film: its frame times meet the log, a worker gets its header, init writes what check reads."""

import re

import numpy as np
import pytest
import tifffile
from instrument_files import write_mraw

from idic.experiment_file import initial_experiment, inputs_of, read_experiment
from virtual_tests.small_strip import write_small_strip

pytest.importorskip("pyMRAW", reason="idic[instruments] is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
N_FRAMES = 10


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    """The small strip, recorded by a camera of Photron with ten frames per second."""
    folder = write_small_strip(tmp_path_factory.mktemp("film") / "strip")
    images = sorted((folder / "images").iterdir())
    write_mraw(folder / "film.mraw", np.array([tifffile.imread(image) for image in images]), 8, rate=100, step=10)
    for image in images:
        image.unlink()
    text = (folder / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(re.sub("images = .*", 'images = "film.mraw"', text))
    return folder


def with_log(folder, rows, keys=""):
    (folder / "loads.csv").write_text("time_s,force_N,grip_displacement_mm\n" + "\n".join(
        f"{time},{1000 * time},{0.1 * time}" for time in rows))
    text = (folder / "experiment.toml").read_text()
    text = re.sub("first_frame_s = .*\n", "", text)
    (folder / "experiment.toml").write_text(text.replace("[experiment]\n", f"[experiment]\n{keys}", 1))
    return read_experiment(folder).recording


@pytest.mark.parametrize("start", [0.0, 0.35])
def test_a_faster_log_is_read_at_the_times_of_the_film(start, strip):
    recording = with_log(strip, np.arange(0.0, 2.0, 0.05), f"first_frame_s = {start}\n" if start else "")
    np.testing.assert_allclose(recording.times, start + 0.1 * np.arange(N_FRAMES))
    np.testing.assert_allclose(recording.log.column("force_N"), 1000 * recording.times)


def test_a_log_with_a_row_per_image_and_another_pace_is_used_and_the_difference_told(strip):
    recording = with_log(strip, np.arange(0.0, N_FRAMES))
    np.testing.assert_allclose(recording.times, np.arange(N_FRAMES))
    assert any("span 9 s, those of the image files 0.9 s" in note for note in recording.log.notes)


def test_a_worker_gets_the_header_of_the_film(strip):
    with_log(strip, np.arange(0.0, N_FRAMES))
    assert {"film.mraw", "film.cihx"} <= {path.name for path in inputs_of(strip, {}).read_files}


def test_init_writes_the_film(strip, tmp_path):
    folder = tmp_path / "new"
    folder.mkdir()
    for name in ("film.mraw", "film.cihx"):
        (folder / name).write_bytes((strip / name).read_bytes())
    text = initial_experiment(folder)[0].read_text()
    assert 'images = "film.mraw"' in text and f"{N_FRAMES} images of 110 x 60 px" in text
    assert "every 10th was saved" in text
