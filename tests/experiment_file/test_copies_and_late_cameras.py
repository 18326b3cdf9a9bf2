"""Images that repeat the one before, images that are lost, and cameras that are late are told by `idic check`, with
the lines to write; tests that rest, or move unevenly, are not."""

from __future__ import annotations

import re

import numpy as np
import pytest
import tifffile
from moving_speckle import N, STEP_PX, check, image_of, images_of, write_strip
from small_experiment import change

import idic
from idic.errors import InputError

CAMERAS = """[[camera]]
name = "left"
pixel_size_mm = 0.05
origin_px = [10.0, 70.0]
axes = ["+col", "-row"]
noise_std_gv = 2.0

[[camera]]
name = "right"
images = "right/*.tif"
pixel_size_mm = 0.05
origin_px = [10.0, 70.0]
axes = ["+col", "-row"]
noise_std_gv = 2.0
"""


def accepted(folder):
    """The output of `idic check`, which accepts the experiment."""
    code, output = check(folder)
    assert code == 0, output
    return output


def excluded(output):
    """The frames that the output proposes to exclude."""
    return [int(number) for number in re.findall(r'"n(\d+)\.tif"', output)]


def recorded(folder, images, rows=None, more=""):
    return write_strip(folder, [f"n{k:02d}.tif" for k in range(len(images))], images, rows=rows, more=more)


def copies(shown, kind):
    """Images of a film that shows these states: a new number is a new exposure, others are copies of it."""
    exposures, generator = images_of(range(max(shown) + 1)), np.random.default_rng(3)
    spread = {"equal": 0.0, "lossy": 0.6}.get(kind)
    if spread is None:  # the same state, taken again
        return [image_of(state, generator) for state in shown]
    return [np.clip(np.rint(exposures[k] + generator.normal(0.0, spread, exposures[k].shape)), 0, 255).astype(np.uint8)
            if spread else exposures[k] for k in shown]


@pytest.mark.parametrize("kind", ["equal", "lossy", "taken again"])
@pytest.mark.parametrize("shown", [[k // 2 for k in range(16)], [0, 1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9],
                                   [0, 1, 2, 3, 4, 5, 5, 7, 8, 9, 10, 11], [k // 3 for k in range(15)]])
def test_repeated_images_are_proposed_for_exclusion(kind, shown, tmp_path):
    rows = [(float(k), STEP_PX * max(shown) / (len(shown) - 1) * k) for k in range(len(shown))]
    output = accepted(recorded(tmp_path / "a", copies(shown, kind), rows))
    assert excluded(output) == [k for k in range(1, len(shown)) if shown[k] == shown[k - 1]], output
    assert "lost between them" not in output


def test_a_test_that_rests_repeats_no_image(tmp_path):
    states = [0, 1, 2, 3, 3, 3, 3, 4, 5, 6, 6, 6]
    assert "repeat" not in accepted(recorded(tmp_path / "a", images_of(states),
                                          [(k, STEP_PX * state) for k, state in enumerate(states)]))


@pytest.mark.parametrize("missing", [1, 2, 3])
def test_lost_images_are_told_by_the_step_of_the_motion(missing, tmp_path):
    states = [*range(6), *range(5 + missing + 1, 12 + missing)]
    rows = [(k / 4.0, STEP_PX * k / 4.0) for k in range(4 * 16)]
    output = accepted(recorded(tmp_path / "a", images_of(states), rows, more="frame_interval_s = 1.0"))
    number = "an image" if missing == 1 else f"{missing} images"
    assert f"from n05.tif to n06.tif the images move {1.0 + missing:.0f}"[:-1] in output and f"{number} lost" in output


@pytest.mark.parametrize("states", [[0, 1, 2, 3, 4, 5, 7, 9, 11, 13, 15, 17], [0, 0, 0, 1, 2, 3, 4, 4, 4, 5, 6, 7],
                                    [0.3 * k**1.5 for k in range(N)]])
def test_an_uneven_test_has_lost_no_image(states, tmp_path):
    rows = [(k / 4.0, STEP_PX * float(np.interp(k / 4.0, range(N), states))) for k in range(4 * N - 3)]
    assert "lost" not in accepted(recorded(tmp_path / "a", images_of(states), rows, more="frame_interval_s = 1.0"))


def two_cameras(folder, frames, more=""):
    """The strip before two cameras, the right one so many frames late: it rests, moves, and moves faster."""
    corners = [0, 3, 8, 20], [0.0, 0.0, 3.0, 15.0]
    moments = np.arange(16.0)
    states = np.interp(moments, *corners)
    recorded(folder, images_of(states), [(float(k), STEP_PX * state) for k, state in enumerate(states)])
    text = (folder / "experiment.toml").read_text()
    change(folder, "experiment.toml", text[text.index("[camera]"):text.index("[material")], CAMERAS + "\n")
    with (folder / "experiment.toml").open("a") as stream:
        stream.write(more)
    (folder / "right").mkdir()
    for k, image in enumerate(images_of(np.interp(moments + frames, *corners), seed=2)):
        tifffile.imwrite(folder / "right" / f"n{k:02d}.tif", image)
    return folder


@pytest.mark.parametrize("frames, words", [
    (-2.0, ("right shows a moment 2.", "earlier", "shift the images of right by 2",
            "leave out n00.tif to n01.tif of right and n14.tif to n15.tif of left")),
    (2.6, ("right shows a moment 2.", "later", "shift the images of right by 3",
           "leave out n00.tif to n02.tif of left and n13.tif to n15.tif of right"))])
def test_images_of_different_moments_are_refused_with_the_shift_until_the_user_states_the_offset(
        frames, words, tmp_path):
    folder = two_cameras(tmp_path / "a", frames)
    code, output = check(folder)
    assert code == 2 and all(word in " ".join(output.split()) for word in words), output
    with pytest.raises(InputError) as refused:  # before anything is computed or written
        idic.identify(folder, tmp_path / "run")
    assert all(word in " ".join(str(refused.value).split()) for word in words) and not (tmp_path / "run").exists()
    with (folder / "experiment.toml").open("a") as stream:
        stream.write('\n[[dof]]\nname = "right.time_offset"\n')
    assert "frames" in accepted(folder)


def test_of_a_long_test_some_frames_tell_how_many_images_two_cameras_are_apart(tmp_path, monkeypatch):
    folder = two_cameras(tmp_path / "a", -2.0)
    monkeypatch.setattr("idic.measure.sequence.frames.MAX_FRAMES", 8)
    with pytest.raises(InputError, match="right shows a moment 2.* earlier") as refused:
        idic.identify(folder)
    assert "n00.tif to n01.tif of right and n14.tif to n15.tif of left" in str(refused.value)


def test_images_that_are_paired_as_told_are_accepted(tmp_path):
    folder = two_cameras(tmp_path / "a", -2.0)
    for name in ("n00", "n01"):
        (folder / "right" / f"{name}.tif").unlink()
    for name in ("n14", "n15"):
        (folder / "images" / f"{name}.tif").unlink()
    log = (folder / "loads.csv").read_text().splitlines()
    (folder / "loads.csv").write_text("\n".join(log[:-2]) + "\n")
    assert "moment than left" not in accepted(folder)


@pytest.mark.parametrize("frames", [-1.0, 1.0, -0.4, 0.3, 0.0])
def test_a_late_camera_is_told_with_its_offset(frames, tmp_path):
    output = accepted(two_cameras(tmp_path / "a", frames))
    if not frames:
        assert "moment than left" not in output
        return
    sentence = re.search(r"right shows (an earlier|a later) moment than left .*? by ([\d.]+) ± ([\d.]+) frames", output)
    assert sentence and sentence[1] == ("an earlier" if frames < 0 else "a later"), output
    assert float(sentence[2]) == pytest.approx(abs(frames), abs=max(0.05, 3.0 * float(sentence[3])))
    assert 'name = "right.time_offset", value = ' in output


@pytest.mark.parametrize("frames", [-0.4, -1.0])
def test_the_offset_of_a_late_camera_is_identified(frames, tmp_path):
    """Without contraction the strip is stretched evenly, as its images are; the motion is straight between frames."""
    folder = two_cameras(tmp_path / "a", frames, '\n[[dof]]\nname = "right.time_offset"\n')
    text = (folder / "experiment.toml").read_text()
    for start, end, line in (("E = {", "\n\n[[boundary]]", "E = 70e3\nnu = 0.0"), ("[[channel]]", "\n[[dof]]", "")):
        text = text[:text.index(start)] + line + text[text.index(end):]
    (folder / "experiment.toml").write_text(text)
    result = idic.identify(folder, overrides={"options.substeps": 1}).content
    offset = result["parameters"]["right.time_offset"]
    assert abs(offset["value"] - frames) < 4.0 * offset["std"] < 0.05
    assert result["cameras"]["right"]["residual"]["image_chi2_dof"] < 1.3  # 10 without the offset: cubic rendering


def test_a_time_offset_that_is_not_identified_is_refused(tmp_path):
    folder = two_cameras(tmp_path / "a", 0.0, '\n[[dof]]\nname = "right.time_offset"\nvalue = 1.0\nidentify = false\n')
    code, output = check(folder)
    assert code == 2 and "prior = { mean" in output
