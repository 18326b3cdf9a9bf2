"""Recordings that people reported elsewhere, made anew: order of frames, repeated images, a camera that is late."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from moving_speckle import check

import idic

pytestmark = pytest.mark.slow  # each makes an example and identifies it


@pytest.fixture
def reported(shared_data, tmp_path):
    """A function: the folder of a situation."""

    def make(name, *variant):
        script, folder = shared_data("reported") / name / "make.py", tmp_path / "test"
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        subprocess.run([sys.executable, script, folder, *variant], check=True, env=os.environ | {"PATH": path})
        return folder

    return make


def deviations(folder):
    """(value - truth) / std of the parameters of the material."""
    truth = json.loads((folder / "truth.json").read_text())["parameters"]
    parameters = idic.identify(folder).content["parameters"]
    return {name: (parameters[name]["value"] - value) / parameters[name]["std"] for name, value in truth.items()}


@pytest.mark.parametrize("variant", ["negative", "negative-log"])
def test_frames_that_count_from_the_trigger_are_in_the_order_of_time(reported, variant):
    folder = reported("frame-order", variant)
    code, output = check(folder)
    assert code == 0 and "reference shot_-0006.tif" in output and "moves RIGHT" not in output
    assert max(map(abs, deviations(folder).values())) < 4.0


@pytest.mark.parametrize("variant", ["lossy", "exact"])
def test_a_film_that_was_decoded_twice_is_told(reported, variant):
    code, output = check(reported("repeated-frames", variant))
    assert code == 0 and "11 of 24 images, frame_001.tif the first, repeat the one before" in output
    assert '"frame_019.tif", "frame_021.tif"]' in output


def test_a_late_camera_is_told_and_identified(reported):
    folder = reported("late-camera")
    code, output = check(folder)
    assert code == 0 and "right shows an earlier moment than left" in output and "by 1.0" in output
    with (folder / "experiment.toml").open("a") as stream:
        stream.write('\n[[dof]]\nname = "right.time_offset"\n')
    assert max(map(abs, deviations(folder).values())) < 4.0
