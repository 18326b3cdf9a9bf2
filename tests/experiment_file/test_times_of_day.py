"""An experiment whose log and image times have times of day: the log is read at the images, and `check` says how."""

from __future__ import annotations

import numpy as np
import pytest
from small_experiment import change, load, write_experiment

from idic.errors import InputError

CLOCK_LOG = ("Time;Operator;force_kN;grip_um\n" + "".join(
    f"{h}:{m:02d}:{s:02d};Ada;{0.1 * k:.1f};{5 * k:.1f}\n" for k, (h, m, s) in enumerate(
        [(11, 59, 58), (11, 59, 59), (0, 0, 0), (0, 0, 1), (0, 0, 2), (0, 0, 3)])))


def write(folder, times):
    write_experiment(folder)
    change(folder, "experiment.toml", 'loads = "loads.csv"', 'loads = "loads.csv"\nimage_times = "times.csv"')
    (folder / "loads.csv").write_text(CLOCK_LOG.replace("11:", "23:"))
    (folder / "times.csv").write_text("Uhrzeit\n" + "".join(f"{time}\n" for time in times))
    return folder


def test_the_log_is_read_at_the_times_of_the_images_over_midnight(tmp_path):
    folder = write(tmp_path / "experiment", ["23:59:59", "00:00:00,500", "00:00:01,500", "00:00:02,500"])
    experiment = load(folder)
    np.testing.assert_allclose(experiment.model.times, [0, 1.5, 2.5, 3.5])
    np.testing.assert_allclose(experiment.model.channels[0].values, [100, 250, 350, 450])
    notes = "\n".join(experiment.notes)
    assert "times.csv: column Uhrzeit is read as times of day" in notes
    assert "loads.csv: column Time is read as times of day, the first of them 23:59:58" in notes
    assert "Operator holds no numbers (Ada)" in notes


def test_images_outside_the_log_are_refused(tmp_path):
    folder = write(tmp_path / "experiment", ["23:59:50", "23:59:59", "00:00:01", "00:00:02"])
    with pytest.raises(InputError, match="outside the times of the log"):
        load(folder)
