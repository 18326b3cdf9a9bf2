"""Trials on photographed surfaces; the photographs are made here, with a noise and a shift that are known."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import read_toml
from idic.images import dense_speckle
from idic_studies.trial.kinds import is_unseen
from idic_studies.trial.many import run_many
from idic_studies.trial.plan import PICTURES, Campaign, Truth, draw, paint_of, scene_of
from idic_studies.trial.scenes.photographs import SURFACES, Photograph, drawn_photograph
from idic_studies.trial.scenes.recording import IMAGES, on_photograph, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.seal import Folder, answered, seal
from idic_studies.trial.trial import NOT_GENERATED

NOISE_GV, SHIFT_PX = 1.2, 0.03
SHAPE = {"stereo": (560, 1200), "composite": (480, 860), "necking": (1720, 540)}  # that hold the windows


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Photographs of painted speckle, the repeated ones moved by 0.03 px and lit by 2 % more, with noise of 1.2 GV."""
    root, rng = tmp_path_factory.mktemp("photographs"), np.random.default_rng(3)
    for name, (ny, nx) in SHAPE.items():
        pattern = dense_speckle(rng, 2.2, 40.0, 200.0, extent_px=2000.0)
        for k, file in enumerate(dict.fromkeys((SURFACES[name].photograph, *SURFACES[name].repeated))):
            if (root / file).exists():
                continue
            points = np.stack(np.meshgrid(np.arange(nx), np.arange(ny)), axis=-1).reshape(-1, 2) - SHIFT_PX * k
            seen = (1.0 + 0.02 * (k > 0)) * pattern.value(points).reshape(ny, nx)
            (root / file).parent.mkdir(parents=True, exist_ok=True)
            tifffile.imwrite(root / file, np.rint(seen + NOISE_GV * rng.standard_normal((ny, nx))).astype(np.uint8))
    return root


@pytest.mark.parametrize("surface", SURFACES)
def test_the_grey_values_are_those_of_the_photograph(folder, surface):
    one = SURFACES[surface]
    seen = tifffile.imread(folder / one.photograph)[one.window].astype(float)
    lying = seen if seen.shape[0] < seen.shape[1] else seen.T
    paint = Photograph(str(folder), surface, row=4.0, column=7.0, scale=1.5)
    rows, columns = np.mgrid[0:60:2, 0:80:2]  # every third pixel of the photograph
    found = paint.value(np.column_stack([columns.ravel(), rows.ravel()]))
    np.testing.assert_allclose(found.reshape(rows.shape), lying[4:94:3, 7:127:3], atol=1e-6)


@pytest.mark.parametrize("surface", SURFACES)
def test_what_is_left_between_repeated_photographs_is_their_noise(folder, surface):
    paint = Photograph(str(folder), surface, 0.0, 0.0, 1.5)
    assert paint.noise_std == pytest.approx(np.hypot(NOISE_GV, 12**-0.5), rel=0.02)  # no shift, no light is left
    rng = np.random.default_rng(1)
    one, other = (paint.noise((90, 150), rng) for _ in range(2))
    assert np.corrcoef(one.ravel(), other.ravel())[0, 1] == pytest.approx(0.0, abs=0.03)
    assert np.corrcoef(one[:, 1:].ravel(), one[:, :-1].ravel())[0, 1] == pytest.approx(0.0, abs=0.04)


def test_a_recording_shows_the_surface_and_states_its_noise(folder, tmp_path):
    paint = on_photograph(1, 2, drawn_photograph(np.random.default_rng(5), str(folder), 132))
    scene = plain_scene("elastic", Geometry(), NULLS["elastic"].truth, grip=0.0)
    scene = replace(scene, times=scene.times[:3], grip=scene.grip[:3])
    write_public(tmp_path, scene, solve(scene), paint)
    images = np.load(tmp_path / IMAGES).astype(float)
    stated = read_toml(tmp_path / "experiment.toml")["camera"]["noise_std_gv"]
    assert (images[2] - images[1]).std() / 2**0.5 == pytest.approx(stated, rel=0.03)
    assert images[0].std() > 20.0


def test_thirty_trials_of_known_kinds_whose_motion_calculix_computes(folder):
    campaign = Campaign(PICTURES, 4, photographs=str(folder))
    assert len(campaign.trials) == 30
    assert not any(is_unseen(name) for trial in campaign.trials for name, _ in trial.effects)
    truth = draw(campaign.select(["clean/1"])[0], 4)
    assert truth.solver == "calculix" and scene_of(truth).solid
    assert Truth.read(truth.content) == truth and paint_of(truth).photograph.folder == str(folder)


def test_a_folder_without_the_photographs_is_refused(tmp_path):
    with pytest.raises(InputError, match="photographs are missing"):
        Campaign(PICTURES, 4, photographs=str(tmp_path))


def test_photographs_beside_another_kind_of_trial_are_refused(tmp_path):
    words = ["--out", str(tmp_path / "t"), "--photographs", str(tmp_path), "--worlds"]
    answer = CliRunner().invoke(app, ["trial", *words])
    assert answer.exit_code == 2 and not (tmp_path / "t").exists()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_a_trial_runs_from_its_seal_to_its_answer(folder, tmp_path):
    trial, campaign = Folder(tmp_path), Campaign(PICTURES, 4, photographs=str(folder))
    numbers = seal(trial, campaign, campaign.select(["singles/force_offset"]), {"version": "0", "commit": "",
                                                                              "changed": None, "thresholds": {}})
    assert list(run_many(trial, list(numbers.values()), 1)) == list(numbers.values())
    (answer,) = answered(trial).values()
    assert answer["verdict"] not in ("failed", NOT_GENERATED) and answer["named"]
