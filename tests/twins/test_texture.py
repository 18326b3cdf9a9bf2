"""What a comparison of two reference images brings, and what gloss on one of them takes away."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile
from pinhole_twin import scores
from stereo_draws import build_repeats, draw, integrated
from wrong_calibration import write_wrongly_calibrated

from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.virtual_tests import PlateSize, PlateTest

pytestmark = pytest.mark.slow  # half a minute of processor time each
REDUCED = PlateSize.of_example(reduced=True)
N = 30


def written(folder, glossy=False):
    """The experiment.toml of `write_wrongly_calibrated` with one texture, and its truth."""
    file, true = write_wrongly_calibrated(folder)
    file.write_text(file.read_text().replace('name = "right"', 'name = "right"\ntexture = "left"'))
    if glossy:  # of the right camera alone: its light comes from elsewhere
        ny, nx = REDUCED.shape
        row, column = np.mgrid[:ny, :nx]
        spot = 80.0 * np.exp(-0.5 * ((column - nx / 2 + 20) ** 2 + (row - ny / 2) ** 2) / 25.0**2)
        for path in sorted((folder / "right").glob("*.tif")):
            image = tifffile.imread(path)
            tifffile.imwrite(path, np.clip(image + spot, 0, 255).round().astype(image.dtype))
    return file, true


@pytest.mark.parametrize("glossy", [False, True])
def test_two_reference_images_tell_the_angle_between_the_cameras(tmp_path, glossy):
    """The frames alone: 0.0017 degrees by noise (`test_stereo.py`). The textures correlate by 0.41 at the start."""
    file, true = written(tmp_path, glossy)
    found = identify(load_experiment(file)).result
    print({name: (entry["value"], entry["std"], entry["std_noise"]) for name, entry in found["parameters"].items()})
    assert found["status"] == "converged"
    assert max(abs(score) for score in scores(found, true).values()) < (3.0 if glossy else 2.0)
    angle = found["parameters"]["right.rotation_y"]
    assert angle["std"] < (1e-3 if glossy else 1e-4)
    assert abs(angle["value"] + 0.1) < 3.0 * angle["std"]


def test_errors_over_standard_deviations_stay_unit_normal_and_the_angle_gains_most(tmp_path):
    """Noise of both reference images is in the frames of both cameras, too."""
    alone = build_repeats(tmp_path, PlateTest.simulated(replace(REDUCED, true=REDUCED.user)))
    camera = replace(alone.experiment.cameras[0], texture="left")
    shared = replace(alone, experiment=replace(alone.experiment, cameras=(camera,)))
    first = draw(alone, np.random.default_rng((1, 0)))
    names, _, std = integrated(alone, first)
    draws = [integrated(shared, draw(shared, np.random.default_rng((1, k)))) for k in range(N)]
    ratio = dict(zip(names, draws[0][2] / std, strict=True))
    scores = np.array([error / own for _, error, own in draws])
    rms = np.sqrt(np.mean(scores**2, axis=0))
    print(ratio, dict(zip(names, rms.round(2), strict=True)), (np.abs(scores) < 1.96).mean().round(3))
    assert ratio["right.rotation_y"] < 0.05 and ratio["left.fx"] < 0.9 and 0.98 < ratio["BODY.E"] < 1.01
    assert np.all(rms < 1.0 + 3.5 / np.sqrt(2 * N)) and np.all(rms > 1.0 - 3.5 / np.sqrt(2 * N))
    assert (np.abs(scores) < 1.96).mean() > 0.90  # 270 of them, correlated: the standard error is some 2 %
