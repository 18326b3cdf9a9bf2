"""Twins in which a second camera changes what can be determined, and the run of such an experiment."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "identify")]

from camera_twin import LEFT_EYE, RIGHT_EYE, TRUTH, WHOLE_EYE, clean_views, write_folder  # noqa: E402
from twin_runs import identify as identify_folder  # noqa: E402

from idic.correlation import (  # noqa: E402
    CorrelationContext, FrameResponse, build_experiment_reference, camera_at, frame_system, with_all_cameras,
)
from idic.errors import InputError  # noqa: E402
from idic.experiment_file import load_experiment  # noqa: E402
from idic.identification import identify, noise_weights  # noqa: E402
from idic.images import ArrayStack  # noqa: E402
from idic.model import build_forward  # noqa: E402
from idic.virtual_tests import Sensor, record  # noqa: E402

EYES = [LEFT_EYE, RIGHT_EYE]


@pytest.fixture(scope="module")
def views():
    return clean_views(EYES)


@pytest.fixture(scope="module")
def pair(views, tmp_path_factory):
    """The experiment.toml of both cameras."""
    return write_folder(tmp_path_factory.mktemp("pair") / "test", EYES, views)


# what can be determined -----------------------------------------------------------------------------------------
def test_a_second_camera_on_the_other_half_determines_the_modulus_that_the_first_leaves_open(views, pair, tmp_path):
    """The second camera looks from behind (mirrored), turned by 2 degrees, with another scale and more noise."""
    alone = identify(load_experiment(write_folder(tmp_path / "alone", EYES[:1], views[:1]))).result
    assert [entry["name"] for entry in alone["not_identifiable"]] == ["STIFF.E"]
    both = identify(load_experiment(pair)).result
    assert not both["not_identifiable"]
    for name, truth in TRUTH.items():
        found = both["parameters"][f"{name}.E"]
        assert found["value"] == pytest.approx(truth, abs=3 * found["std"])
        assert found["std"] < 0.03 * truth


def test_two_cameras_with_one_view_have_errors_smaller_by_the_root_of_two(tmp_path):
    """Each with a reference image of its own: the stated standard deviation falls by sqrt(2) and holds over draws."""
    twins = [WHOLE_EYE, replace(WHOLE_EYE, name="again", pattern_seed=8)]
    views = clean_views(twins)
    one = load_experiment(write_folder(tmp_path / "one", twins[:1], views[:1]))
    two = load_experiment(write_folder(tmp_path / "two", twins, views))
    std = {n: [identify(e).result["parameters"][n]["std"] for e in (one, two)] for n in ("SOFT.E", "STIFF.E")}
    for single, double in std.values():
        assert single / double == pytest.approx(np.sqrt(2.0), rel=0.1)  # two patterns differ in their gradients
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        stacks = [ArrayStack(np.array([record(i, Sensor(eye.shape, noise_std=eye.noise), rng) for i in images]))
                  for eye, images in zip(twins, views, strict=True)]
        drawn = replace(two, recording=replace(two.recording, stack=stacks[0]),
                        cameras=(replace(two.cameras[0], stack=stacks[1]),))
        found = identify(drawn).result["parameters"]
        scores += [(found[f"{n}.E"]["value"] - TRUTH[n]) / found[f"{n}.E"]["std"] for n in TRUTH]
    # 24 scores: their rms is 1 within 15 %; interpolation adds a bias of some 0.3 std on 55 x 50 px
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def context_of(experiment):
    forward = build_forward(experiment)
    names = experiment.model.parameters.free
    camera = camera_at(experiment, experiment.model.parameters)
    return forward, CorrelationContext(experiment, experiment.model.parameters, names, names, camera,
                                       build_experiment_reference(experiment, camera), noise_weights(experiment),
                                       forward.drives.local_precision)


def test_without_shared_unknowns_the_information_of_two_cameras_is_the_sum_of_theirs(pair):
    """M, b and the functional add up camera by camera, each divided by its own noise."""
    experiment = load_experiment(pair)
    forward, single = context_of(experiment)
    both = with_all_cameras(single)
    other = replace(both.others[0], others=())
    state = list(forward.march(experiment.model.parameters, single.moving))[2]
    response = FrameResponse(2, state.u, state.channels, state.du, state.dchannels, state.local_du,
                             state.local_dchannels)
    joined, first, second = (frame_system(c, response, np.zeros(0)) for c in (both, single, other))
    assert np.allclose(joined.M, first.M + second.M, rtol=1e-9)
    assert np.allclose(joined.b, first.b + second.b, rtol=1e-9)
    assert np.allclose(joined.spread, first.spread + second.spread, rtol=1e-9)
    assert joined.phi == pytest.approx(first.phi + second.phi, rel=1e-9)
    assert np.allclose(joined.frames[0].cameras, np.vstack([first.frames[0].cameras, second.frames[0].cameras]),
                       rtol=1e-6)


def test_degrees_of_freedom_of_the_second_camera_are_its_own(views, tmp_path):
    """A calibration that is off by 0.3 degrees and one per cent is found back as behind.rotation_deg, .pixel_size."""
    off = "".join(f'[[dof]]\nname = "behind.{name}"\n' for name in ("rotation_deg", "pixel_size"))
    path = write_folder(tmp_path / "off", [WHOLE_EYE, RIGHT_EYE], [clean_views([WHOLE_EYE])[0], views[1]], further=off)
    experiment = load_experiment(path)
    start = experiment.model.parameters["behind.rotation_deg"].value
    shifted = experiment.model.parameters.with_values({"behind.rotation_deg": start + 0.5})
    found = identify(replace(experiment, model=replace(experiment.model, parameters=shifted))).result
    assert found["status"] == "converged"
    back = found["parameters"]["behind.rotation_deg"]
    assert back["std"] is None or back["value"] == pytest.approx(start, abs=4 * back["std"])
    assert "camera.rotation_deg" not in found["parameters"]


# a run ------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def run(views, tmp_path_factory):
    """A run in which the second camera missed a frame: a black image is in its place."""
    folder = tmp_path_factory.mktemp("run")
    path = write_folder(folder / "test", EYES, views)
    tifffile.imwrite(path.parent / "behind" / "frame_003.tif", np.zeros(RIGHT_EYE.shape, np.uint8))
    state, result = identify_folder(path, folder / "run")
    return path, folder / "run", result


def test_the_result_holds_noise_residual_and_frames_of_every_camera(run):
    _, folder, result = run
    assert result["status"] == "converged"
    assert set(result["cameras"]) == {"camera", "behind"}
    behind = result["cameras"]["behind"]
    assert behind["noise"]["source"] == "given" and behind["noise"]["std_gv"] == pytest.approx(3.0, rel=0.02)
    assert [frame["status"] for frame in behind["frames"]] == ["ok", "ok", "ok", "lost"]
    assert [frame["status"] for frame in result["cameras"]["camera"]["frames"]] == ["ok"] * 4
    chi2 = [result["cameras"][name]["residual"]["image_chi2_dof"] for name in ("camera", "behind")]
    assert min(chi2) < result["residual"]["image_chi2_dof"] < max(chi2)
    # 1 but for the last column of the image, whose neighbours the reference does not show
    assert chi2 == pytest.approx([1.0, 1.0], abs=0.25)
    assert json.loads((folder / "result.json").read_text())["cameras"]["behind"] == behind


@pytest.mark.slow
def test_the_report_shows_every_camera(run):
    from idic.run import write_report

    page = write_report(run[1]).read_text()
    assert "Camera behind" in page
    assert (run[1] / "figures" / "residual_maps_behind.png").exists()


def test_the_weighting_of_the_paper_knows_several_cameras(pair, tmp_path):
    _, result = identify_folder(pair, tmp_path / "run", options__weighting="paper")
    for name, truth in TRUTH.items():
        found = result["parameters"][f"{name}.E"]
        assert found["value"] == pytest.approx(truth, abs=3 * found["std"])


def test_check_draws_the_mesh_on_every_camera(pair):
    from idic.report import check

    report = check(load_experiment(pair))
    assert [camera.name for camera in report.cameras] == ["behind"]
    assert report.cameras[0].overlay.png != report.overlay.png
    assert any(line.startswith("camera       behind: 95 x 80 px") for line in report.lines())


# bad input ----------------------------------------------------------------------------------------------------------
def spoilt(path, tmp_path, old, new):
    text = path.read_text()
    assert old in text
    folder = tmp_path / "spoilt"
    shutil.copytree(path.parent, folder)
    (folder / "experiment.toml").write_text(text.replace(old, new, 1))
    return folder


@pytest.mark.parametrize("old, new, key, found", [
    ('images = "behind/*.tif"', 'images = "behind/frame_00[012].tif"', "camera[1].images", "3"),
    ('name = "behind"', 'name = "camera"', "", "camera"),
    ('name = "behind"', 'name = "SOFT"', "", "SOFT"),
    ('name = "behind"\n', "", "camera[1].name", "no such key"),
    ('images = "behind/*.tif"', 'imgs = "behind/*.tif"', "camera[1].imgs", "imgs"),
    ('images = "behind/*.tif"', 'images = "behind/*.tif"\nplane = ["x", "z"]', "camera[1].plane", "['x', 'z']"),
    ('images = "behind/*.tif"', 'images = "behind/*.tif"\nsurface = "RIGHT"', "camera[1].surface", "'RIGHT'"),
    ('name = "camera"', 'name = "camera"\nmask = "m.png"', "", "mask in the first [[camera]]"),
    ("origin_px = [80.0, 40.3]", "origin_px = [8000.0, 40.3]", "camera[1]", "columns"),
])
def test_a_bad_camera_table_gives_one_clear_message(pair, tmp_path, old, new, key, found):
    with pytest.raises(InputError) as error:
        load_experiment(spoilt(pair, tmp_path, old, new))
    assert (error.value.key or "") == key and found in str(error.value.found)
    assert error.value.remedy and error.value.expected


# a solid from its side ----------------------------------------------------------------------------------------------
def test_a_camera_from_the_side_of_a_solid_sees_its_x_and_z():
    """At the true motion both views leave interpolation error only, each in the axes that it sees."""
    from solid_bar import side_and_front

    experiment, states = side_and_front()
    _, single = context_of(experiment)
    both = with_all_cameras(single)
    for state in states[1:]:
        response = FrameResponse(state.frame, state.u, state.channels, state.du, state.dchannels, state.local_du,
                                 state.local_dchannels)
        n_pixels, _, rr, _ = frame_system(both, response, np.zeros(0)).frames[0].cameras.T
        assert (np.sqrt(rr / n_pixels) < 1.0).all()  # grey values; a tenth of a pixel would leave 3
