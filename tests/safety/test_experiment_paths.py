"""Every key of experiment.toml that names a file refuses to leave the folder."""

from __future__ import annotations

import pytest
from experiment_file.small_experiment import write_experiment

from idic.errors import InputError
from idic.experiment_file import load_experiment

KEYS = ["experiment.images", "experiment.loads", "experiment.mesh", "experiment.mask", "experiment.still_frames",
        "experiment.image_times"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A readable experiment, and beside its folder the same files once more."""
    top = tmp_path_factory.mktemp("paths")
    write_experiment(top / "other")
    return write_experiment(top / "test")


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("outside", ["../other/images/frame_000.tif", "images/../../other/mesh.inp", "/etc/passwd"])
def test_no_key_leads_out_of_the_folder(folder, key, outside):
    overrides = {key: outside}
    if key == "experiment.image_times":  # it stands beside a log without times only
        overrides["experiment.loads"] = "loads.csv"
    with pytest.raises(InputError, match="leaves the experiment folder") as problem:
        load_experiment(folder, overrides)
    assert problem.value.key.startswith(key)


def test_the_images_of_a_further_camera_and_of_a_temperature_stay_inside_too(folder):
    text = (folder / "experiment.toml").read_text()
    second = text.replace("[camera]\n", '[[camera]]\nname = "front"\n') + (
        '\n[[camera]]\nname = "back"\nimages = "../other/images/*.tif"\npixel_size_mm = 0.1\norigin_px = [10.0, 40.0]\n'
        'axes = ["+col", "-row"]\n')
    warm = text + '\n[[boundary]]\ntemperature = { images = "../other/images/*.tif", unit = "C" }\n'
    for number, changed in enumerate((second, warm)):
        file = folder / f"changed{number}.toml"
        file.write_text(changed)
        with pytest.raises(InputError, match="leaves the experiment folder"):
            load_experiment(file)
