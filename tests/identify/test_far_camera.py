"""A camera that is found far from where the search begins: its steps are measured by what the images lose by them."""

from __future__ import annotations

from dataclasses import replace

from twin_runs import ELASTIC, FORCE, GRIPS, TRUTH, Twin, clean_images, write_folder

from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.parameters import USUAL_MAX_STEP, ParameterSet

STARTS = {"camera.tilt_x": -3.0, "camera.tilt_y": 3.0}  # scales, each three pixels at the corner of 100 x 140
STRETCH = (0.0, 0.1, 0.2, 0.3)  # mm of 6: a tilt shows by as much as the specimen has moved


def tilted(folder):
    """A camera that looks straight at the specimen, described as one that is tilted and not known exactly."""
    twin = Twin(grip=STRETCH, times=(0.0, 1.0, 2.0, 3.0))
    toml = ELASTIC + GRIPS + FORCE + "".join(f'\n[[dof]]\nname = "{name}"\nidentify = true\n' for name in STARTS)
    known = load_experiment(write_folder(folder, twin, toml, clean_images(twin)))
    known = replace(known, recording=replace(known.recording, noise=replace(known.recording.noise, std_gv=2.0)))
    values = {name: units * known.model.parameters[name].scale for name, units in STARTS.items()}
    return replace(known, model=replace(known.model, parameters=known.model.parameters.with_values(values)))


def test_a_tilt_of_twelve_pixels_at_the_corner_is_gone_in_a_few_steps(tmp_path):
    experiment = tilted(tmp_path / "test")
    found = identify(experiment)
    assert found.state.status == "converged"
    for name in STARTS:
        entry = found.result["parameters"][name]
        assert entry["std"] < experiment.model.parameters[name].scale  # they are determined
        assert abs(entry["value"]) < 4.0 * entry["std"], (name, entry)
    for name, value in TRUTH.items():
        entry = found.result["parameters"][f"BODY.{name}"]
        assert abs(entry["value"] - value) < 4.0 * entry["std"], (name, entry)
    assert found.state.evaluations <= 9  # the way is 3 scales, a step 3.5 at most; then Gauss-Newton


def test_steps_of_one_pixel_would_take_as_many_as_there_are_pixels(tmp_path):
    """Each direction of the tilt by itself: the ridge keeps the weaker one waiting."""
    experiment = tilted(tmp_path / "test")
    short = ParameterSet(replace(p, max_step=USUAL_MAX_STEP) for p in experiment.model.parameters.values())
    assert identify(replace(experiment, model=replace(experiment.model, parameters=short))).state.evaluations > 15
