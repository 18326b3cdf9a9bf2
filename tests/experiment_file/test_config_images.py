"""What an experiment.toml says of its images: which frames, mask, noise, heights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tifffile

from experiment_file.small_experiment import change, load, load_experiment, write_experiment
from idic.correlation import build_experiment_reference
from idic.errors import InputError


@pytest.fixture
def folder(tmp_path):
    return write_experiment(tmp_path / "test")


def test_reference_and_excluded_frames_are_found_by_number_and_by_name(folder):
    e = load(folder, "kind =", 'reference = "frame_001.tif"\nexclude_frames = [3, "frame_000.tif"]\nkind =')
    assert e.model.reference == 1 and e.recording.excluded == (3, 0)


def test_a_reference_that_no_compared_image_follows_is_refused(folder):
    with pytest.raises(InputError, match="no image follows the reference"):
        load(folder, "kind =", 'reference = "frame_001.tif"\nexclude_frames = [3, "frame_002.tif"]\nkind =')


def test_a_mask_is_white_where_the_image_is_correlated(folder):
    pixels = np.zeros((50, 60), np.uint8)
    pixels[10:40, 10:50] = 255
    tifffile.imwrite(folder / "mask.tif", pixels)
    np.testing.assert_array_equal(load(folder, "kind =", 'mask = "mask.tif"\nkind =').recording.mask, pixels > 0)


def renumbered(folder, numbers):
    """The images under these numbers, with times by an interval."""
    for path, number in zip(sorted((folder / "images").glob("*.tif"))[::-1], numbers[::-1], strict=True):
        path.rename(path.with_name(f"frame_{number:06d}.tif"))
    change(folder, "experiment.toml", "kind =", "frame_interval_s = 0.5\nkind =")


def test_a_missing_image_does_not_shift_the_times_of_all_later_ones(folder):
    renumbered(folder, (0, 10, 30, 40))
    with pytest.raises(InputError, match="an image is missing") as caught:
        load(folder)
    assert caught.value.key == "experiment.frame_interval_s"
    assert "frame_000030.tif after frame_000010.tif" in caught.value.found
    assert "exclude_frames" in caught.value.remedy and "image_times" in caught.value.remedy


@pytest.mark.parametrize("numbers", [
    (5, 10, 15, 20), (0, 7, 10, 23), (120558, 120559, 120600, 120601), (101001, 101003, 101004, 101006),
    (0, 100, 101, 102), (0, 100, 300, 800)])
def test_a_thinned_series_odd_steps_and_times_of_the_day_are_no_gap(folder, numbers):
    renumbered(folder, numbers)
    np.testing.assert_allclose(load(folder).model.times, [0.0, 0.5, 1.0, 1.5])


def test_still_frames_give_the_noise(folder):
    generator = np.random.default_rng(2)
    pattern = 100 + 40 * np.sin(np.arange(50)[:, None] / 3) * np.cos(np.arange(60) / 4)
    (folder / "still").mkdir()
    for k in range(4):
        tifffile.imwrite(folder / "still" / f"s{k}.tif",
                         np.rint(pattern + generator.normal(0, 3, pattern.shape)).astype(np.uint8))
    change(folder, "experiment.toml", "noise_std_gv = 2.0\n", "")
    e = load(folder, "kind =", 'still_frames = "still/*.tif"\nkind =')
    # 3.01 with quantisation; 4 images of about 900 px in the ROI: 2 % statistical
    assert e.recording.noise.source == "still_frames" and e.recording.noise.std_gv == pytest.approx(3.01, rel=0.08)


def test_still_frames_of_another_window_are_refused(folder):
    (folder / "still").mkdir()
    for k in range(2):
        tifffile.imwrite(folder / "still" / f"s{k}.tif", np.zeros((20, 30), np.uint8))
    with pytest.raises(InputError, match="size differs") as refused:
        load(folder, "kind =", 'still_frames = "still/*.tif"\nkind =')
    assert "window" in refused.value.remedy and refused.value.found == "30 x 20 px"


def still_images(folder, slope):
    generator = np.random.default_rng(2)
    pattern = 120 + 80 * np.sin(np.arange(50)[:, None] / 3) * np.cos(np.arange(60) / 4)
    (folder / "still").mkdir()
    for k in range(6):
        noisy = pattern + np.sqrt(2.0 + slope * pattern) * generator.normal(size=pattern.shape)
        tifffile.imwrite(folder / "still" / f"s{k}.tif", np.rint(noisy).astype(np.uint8))
    change(folder, "experiment.toml", "noise_std_gv = 2.0\n", "")
    return load(folder, "kind =", 'still_frames = "still/*.tif"\nkind =')


def test_noise_that_grows_with_the_intensity_is_noted_and_weighed_on_demand(folder):
    plain = still_images(folder, 0.1)
    assert plain.recording.noise.stabiliser is None and any("noise grows with the intensity" in note
                                                            for note in plain.notes)
    weighed = load_experiment(folder, {"camera.noise_model": "grey_level"})
    model, level = weighed.recording.noise.stabiliser.model, weighed.recording.noise.stabiliser.level
    # 4500 squares over the range of the pattern: the slope to some 10 %
    assert model.slope == pytest.approx(0.1, rel=0.3) and weighed.recording.noise.source == "still_frames"
    assert weighed.recording.noise.std_gv == pytest.approx(np.sqrt(model.offset + model.slope * level))
    recorded, seen = plain.recording.stack.frame(1).astype(float), weighed.recording.stack.frame(1).astype(float)
    order = np.argsort(recorded.ravel())
    assert (np.diff(seen.ravel()[order]) >= 0).all()  # grey values keep their order


def test_noise_that_is_the_same_everywhere_is_not_noted(folder):
    assert not any("noise grows" in note for note in still_images(folder, 0.0).notes)


def test_a_noise_model_may_be_given(folder):
    change(folder, "experiment.toml", "noise_std_gv = 2.0\n", "noise_model = { offset_gv2 = 1.0, slope_gv = 0.02 }\n")
    e = load(folder)
    assert e.recording.noise.source == "given" and e.recording.noise.stabiliser.model.slope == 0.02


def test_a_noise_model_without_still_frames_is_refused(folder):
    change(folder, "experiment.toml", "noise_std_gv = 2.0\n", 'noise_model = "grey_level"\n')
    with pytest.raises(InputError, match=": .*noise_model"):
        load(folder)


def test_several_reference_frames_are_averaged(folder):
    e = load(folder, "kind =", 'reference = [0, 1]\nkind =')
    assert e.recording.averaged == (0, 1) and e.model.reference == 1 and e.recording.n_references == 2
    one, two = load_experiment(folder, {"experiment.reference": 1}), build_experiment_reference(e, e.model.camera)
    assert two.n_images == 2 and one.recording.averaged == () and one.recording.n_references == 1
    single = [build_experiment_reference(replace(one, model=replace(one.model, reference=k)), e.model.camera).f
              for k in (0, 1)]
    assert np.allclose(two.f, np.mean(single, axis=0), atol=1e-4)  # float32


def test_without_noise_and_still_frames_the_noise_is_left_open(folder):
    assert load(folder, "noise_std_gv = 2.0\n", "").recording.noise.std_gv is None


def height_folder(folder, **options):
    for k in range(4):
        image = np.full((50, 60), 5.0 + k, np.float32)
        image[3, 4] = np.nan
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", image)
    return load(folder, "kind =", 'quantity = "height"\nheight_unit = "um"\nkind =', options)


def test_height_maps_stay_in_their_unit_gaps_included(folder):
    e = height_folder(folder)
    assert e.recording.quantity == "height" and e.recording.height_unit == 1e-3
    image = e.recording.stack.frame(1)
    assert image.dtype == np.float32 and image[0, 0] == 6.0 and np.isnan(image[3, 4])
    assert e.recording.noise.std_gv == 2.0  # in the unit of the images


def test_height_maps_are_neither_blurred_nor_levelled_unless_asked(folder):
    options = height_folder(folder).options
    assert options.lowpass_px == 0.0 and options.brightness == "none"


def test_a_gain_in_patches_is_no_correction_for_heights(folder):
    with pytest.raises(InputError, match="brightness"):
        height_folder(folder, **{"options.brightness": "patch"})


@pytest.mark.parametrize("given", ["noise_std_gv = 2.0\n", ""])
def test_still_frames_that_drift_are_told_with_a_given_noise_too(folder, given):
    generator = np.random.default_rng(2)
    rows, columns = np.mgrid[:50, :60]
    (folder / "still").mkdir()
    for k in range(3):
        pattern = 100 + 40 * np.sin(rows / 3) * np.cos((columns - 0.2 * k) / 4)
        tifffile.imwrite(folder / "still" / f"s{k}.tif",
                         np.rint(pattern + generator.normal(0, 2, pattern.shape)).astype(np.uint8))
    change(folder, "experiment.toml", "noise_std_gv = 2.0\n", given)
    e = load(folder, "kind =", 'still_frames = "still/*.tif"\nkind =')
    assert any("not at rest: s2.tif has moved by 0.4" in note or "not at rest: s2.tif has moved by 0.3" in note
               for note in e.notes)
