"""A video in place of images: the same frames in any order, what is said of its codec, and a whole run."""

import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "identify")]

from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder  # noqa: E402

from idic.errors import InputError  # noqa: E402
from idic.experiment_file import load_experiment  # noqa: E402
from idic.identification import identify  # noqa: E402
from idic.readers import open_stack, read_image  # noqa: E402


def write_video(path, frames, codec="FFV1"):
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*codec), 10.0, (width, height), True)
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.repeat(frame[:, :, None], 3, axis=2) if frame.ndim == 2 else frame)
    writer.release()
    return path


@pytest.fixture
def frames():
    """Grey noise, smooth enough for a codec, each frame another."""
    rng = np.random.default_rng(3)
    return [cv2.GaussianBlur(rng.integers(0, 255, (48, 64), dtype=np.uint8), (0, 0), 1.5) for _ in range(7)]


def test_frames_of_a_lossless_video_are_the_images_in_whatever_order_they_are_asked_for(frames, tmp_path):
    stack = open_stack([write_video(tmp_path / "test.avi", frames)])
    assert (stack.n_frames, stack.shape) == (7, (48, 64))
    assert stack.labels[3] == "test.avi[3]"
    for k in (0, 1, 6, 2, 2, 5, 0, 3):
        np.testing.assert_array_equal(stack.frame(k), frames[k])
    assert stack.notes() == []


def test_a_lossy_or_coloured_video_is_read_with_a_remark(frames, tmp_path):
    lossy = open_stack([write_video(tmp_path / "lossy.mp4", frames, "mp4v")])
    assert lossy.n_frames == 7
    assert np.abs(lossy.frame(4).astype(int) - frames[4]).mean() < 10  # the right frame, compressed
    assert "compresses with loss" in lossy.notes()[0]
    coloured = [np.dstack([frame, frame // 2, frame // 3]) for frame in frames]
    stack = open_stack([write_video(tmp_path / "colour.avi", coloured)])
    assert any("luminance" in note for note in stack.notes())
    assert stack.frame(0).ndim == 2


def test_something_else_under_the_name_of_a_video_is_refused(tmp_path):
    for text in (b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n", b"", b"RIFF1234AVI garbage" * 10):
        (tmp_path / "fake.avi").write_bytes(text)
        with pytest.raises(InputError, match="video cannot be read"):
            open_stack([tmp_path / "fake.avi"])


def test_a_test_recorded_as_a_video_gives_the_parameters_of_its_images(tmp_path):
    path = write_folder(tmp_path / "images", Twin(), ELASTIC + GRIPS + FORCE)
    shutil.copytree(tmp_path / "images", tmp_path / "video")
    files = sorted((tmp_path / "video" / "images").glob("*.tif"))
    write_video(tmp_path / "video" / "test.avi", [read_image(file) for file in files])
    shutil.rmtree(tmp_path / "video" / "images")
    text = path.read_text().replace('images = "images/*.tif"', 'images = "test.avi"')
    (tmp_path / "video" / "experiment.toml").write_text(text)
    assert load_experiment(tmp_path / "video").model.times[-1] == 5.0  # from the log, row by row
    found = [identify(load_experiment(tmp_path / name)).result["parameters"] for name in ("images", "video")]
    assert found[0] == found[1]


@pytest.mark.parametrize("depth, told", [(np.uint16, True), (np.uint8, False)])
def test_a_video_of_more_than_8_bits_is_read_with_a_remark_on_what_is_lost(tmp_path, depth, told):
    path = tmp_path / "deep.avi"
    kind = cv2.CV_16U if depth == np.uint16 else cv2.CV_8U
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"FFV1"), 10.0, (64, 48),
                             [cv2.VIDEOWRITER_PROP_IS_COLOR, 0, cv2.VIDEOWRITER_PROP_DEPTH, kind])
    assert writer.isOpened()
    image = np.random.default_rng(3).integers(0, np.iinfo(depth).max, (48, 64), dtype=depth)
    writer.write(image)
    writer.release()
    stack = open_stack([path])
    assert np.abs(stack.frame(0).astype(int) - (image >> 8 if told else image)).max() <= 1  # rounded, not cut
    assert any("of its 16 bits per pixel the upper 8 are read" in note for note in stack.notes()) == told
