"""What every lens model has to keep: the contract of cameras, a distortion with exact derivatives and an inverse, and
its place in experiment.toml and in the diagnosis.
"""

from __future__ import annotations

import numpy as np
import pytest
from camera_contract import CameraContract
from experiment_file.small_experiment import TOML, write_experiment

from idic.diagnose import candidate_library
from idic.diagnose import Situation
from idic.errors import InputError
from idic.experiment_file import load_experiment, read_toml
from idic.images import LENS_MODELS, LensCamera, rotation_of

ROTATION = rotation_of([3.0, -8.0, 2.0]) @ np.diag([1.0, -1.0, -1.0])
POINTS = np.random.default_rng(25).uniform([-30, -25, -8], [30, 25, 8], (200, 3))
IDEAL = np.random.default_rng(4).uniform(-0.15, 0.15, (100, 2))
TELECENTRIC = TOML[TOML.index("[camera]"):TOML.index("[material")]
MODELS = pytest.mark.parametrize("model", LENS_MODELS.values(), ids=LENS_MODELS.keys())


def camera_of(model):
    """A camera with plausible values of the coefficients."""
    return model(2468.5, 2471.2, 638.9, 407.3, skew=-0.4, rotation=ROTATION, translation_mm=[-2.0, 3.0, 240.0],
                 **model.example)


class LensContract(CameraContract):
    points = POINTS


for _name, _model in LENS_MODELS.items():
    globals()[f"Test{_name.title()}"] = type(f"Test{_name.title()}", (LensContract,), {
        "cameras": {_name: camera_of(_model)}, "parameters": _model.parameters, "__module__": __name__})


@MODELS
def test_a_distortion_has_exact_derivatives_and_leaves_the_axis_as_it_is(model):
    camera, step = camera_of(model), 1e-6
    _, slope = camera.distort(IDEAL)
    for axis in range(2):
        e = step * np.eye(2)[axis]
        quotient = (camera.distort(IDEAL + e)[0] - camera.distort(IDEAL - e)[0]) / (2 * step)
        np.testing.assert_allclose(slope[:, :, axis], quotient, atol=1e-9)
    assert set(model.example) == set(model.coefficients) and model.leading in model.coefficients
    at_defaults = model(1000.0, 1000.0, 0.0, 0.0)
    position, slope = at_defaults.distort(np.zeros((1, 2)))
    np.testing.assert_allclose(position, 0.0, atol=1e-15)
    np.testing.assert_allclose(slope, np.eye(2)[None], atol=1e-12)  # fx is the focal length


@MODELS
def test_the_inverse_of_a_lens_is_that_of_newtons_method(model):
    camera = camera_of(model)
    target, allowed = camera.distort(IDEAL)[0], np.full(len(IDEAL), 1e-11)
    np.testing.assert_allclose(camera.undistort(target, allowed), IDEAL, atol=1e-14)
    np.testing.assert_allclose(LensCamera.undistort(camera, target, allowed), camera.undistort(target, allowed),
                               rtol=0, atol=1e-16)  # an explicit inverse rounds differently: last bit 3e-17
    assert np.isnan(camera.undistort(np.full((1, 2), np.nan), np.ones(1))).all()


@MODELS
def test_the_leading_coefficient_is_that_of_the_third_power_of_the_radius(model):
    small = 1e-2 * IDEAL
    slope = camera_of(model).coefficient_slopes(small)[:, :, model.coefficients.index(model.leading)]
    np.testing.assert_allclose(slope, small * (small**2).sum(axis=1, keepdims=True), rtol=1e-3)


@MODELS
def test_an_experiment_takes_a_lens_and_the_diagnosis_looks_for_its_distortion(model, tmp_path):
    name = next(name for name, other in LENS_MODELS.items() if other is model)
    values = "".join(f"{key} = {value}\n" for key, value in model.example.items())
    table = (f'[camera]\nmodel = "{name}"\nfx_px = 2000.0\nfy_px = 2010.0\ncx_px = 29.0\ncy_px = 24.0\n{values}'
             f"rotation = {ROTATION.tolist()}\ntranslation_mm = [-2.0, 1.5, 200.0]\n")
    folder = write_experiment(tmp_path / "test", TOML.replace(TELECENTRIC, table))
    experiment = load_experiment(folder)
    lens = experiment.model.camera.lens
    assert isinstance(lens, model) and {key: lens.values()[key] for key in model.example} == dict(model.example)
    names = {f"camera.{key}" for key in model.parameters}
    assert names <= set(load_experiment(folder, {"dof": [{"name": name} for name in names]}).model.parameters.free)
    seen = Situation(read_toml(folder / "experiment.toml"), experiment, {}, {}, {}, np.zeros(0), np.zeros(0))
    distortion = next(candidate for candidate in candidate_library() if candidate.name == "lens_distortion")
    (variant,) = distortion.variants(seen)
    assert load_experiment(folder, variant.edits).model.parameters[f"camera.{model.leading}"].free
    if not model.is_calibrated:
        (tmp_path / "test" / "experiment.toml").write_text(
            TOML.replace(TELECENTRIC, table + 'calibration = "cal.json"\n'))
        with pytest.raises(InputError, match="keys of another camera model"):
            load_experiment(folder)
