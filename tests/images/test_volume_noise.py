"""Noise of a reconstruction and change of its grey values, from two scans of one state with known noise."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy import fft, ndimage

from idic.images import cube_corners, grey_change, volume_noise, whole_shift
from idic.readers import volume_entries
from idic.virtual_tests import ReconstructionNoise

N, SIDE, STD_GV = 64, 18, 5.0
CORNERS = cube_corners((0, 0, 0), (N, N, N), SIDE)


def texture(shift=(0.0, 0.0, 0.0)):
    """A smooth random texture, moved by its spectrum; standard deviation 30."""
    k = np.meshgrid(*[2 * np.pi * fft.fftfreq(N)] * 3, indexing="ij")
    white = fft.fftn(np.random.default_rng(1).standard_normal((N, N, N)))
    phase = sum(wave * part for wave, part in zip(k, shift, strict=True))
    values = fft.ifftn(white * np.exp(-0.5 * 1.8**2 * sum(wave**2 for wave in k) - 1j * phase)).real
    return 128.0 + 30.0 * values / values.std()


def white(rng):
    return STD_GV * rng.standard_normal((N, N, N))


def reconstructed(rng):
    return np.stack(list(ReconstructionNoise(STD_GV).planes(rng, (N, N, N))))


def of(volume):
    return lambda *block: volume[block]


def std_of_sums(noise):
    """By drawn noise: sums of it against the gradient of the texture, over those of independent noise."""
    slopes, ratios = np.gradient(texture()), []
    for seed in range(4):
        drawn = noise(np.random.default_rng(50 + seed))
        for slope in slopes:
            parts = [part.reshape(4, 16, 4, 16, 4, 16).sum(axis=(1, 3, 5)) for part in (drawn * slope, slope**2)]
            ratios += list((parts[0] ** 2 / parts[1]).ravel())
    return np.sqrt(np.mean(ratios)), np.sqrt(0.5 / len(ratios))


@pytest.mark.parametrize("noise", [white, reconstructed])
@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.4)])
def test_noise_and_its_correlation_come_back(noise, shift):
    rng = np.random.default_rng(7)
    first, second = texture() + noise(rng), texture(shift) + noise(rng)
    estimate = volume_noise(of(first), of(second), CORNERS, SIDE)
    assert estimate.std_gv == pytest.approx(STD_GV, rel=0.03)
    middle = len(estimate.correlation) // 2
    along = estimate.correlation[middle, middle, middle:middle + 3]
    truth = ReconstructionNoise(STD_GV).correlation((N, N), 3)[0] if noise is reconstructed else [1.0, 0.0, 0.0]
    assert along == pytest.approx(truth, abs=0.03)  # standard error of a lag: 0.01
    across = estimate.correlation[middle:middle + 3, middle, middle]
    assert across == pytest.approx([1.0, 2 / 3, 1 / 6] if noise is reconstructed else [1.0, 0.0, 0.0], abs=0.03)
    truth, share = std_of_sums(noise)
    assert estimate.sum_std_gv == pytest.approx(truth, rel=3 * share + 0.03)  # 3 %: what the fit takes
    assert (estimate.sum_std_gv > 1.7 * STD_GV) == (noise is reconstructed)


def test_change_of_the_grey_values_and_a_slow_field_come_back():
    rng = np.random.default_rng(3)
    z, y, x = np.meshgrid(*[(np.arange(N) - (N - 1) / 2) / (0.5 * N)] * 3, indexing="ij")
    first = texture() + reconstructed(rng)
    second = 1.05 * texture((0.1, 0.2, 0.0)) - 4.0 + 3.0 * x * x - 2.0 * y + reconstructed(rng)
    change = grey_change(of(first), of(second), CORNERS, SIDE)
    low, high = CORNERS.min(axis=0), CORNERS.max(axis=0) + SIDE
    half = 0.5 * (high - low) / (0.5 * N)  # of the cubes, in x, y, z from -1 to 1 over the volume
    assert change.gain == pytest.approx(1.05, abs=0.005)
    slow = dict(zip(("x", "y", "z", "xx", "yy", "zz"), change.slow_gv, strict=False))
    assert slow["xx"] == pytest.approx(3.0 * half[2] ** 2, abs=0.4)
    assert slow["y"] == pytest.approx(-2.0 * half[1], abs=0.4)
    assert abs(slow["z"]) < 0.4 and abs(slow["zz"]) < 0.5
    # the mean field is part of the offset; gain turns about zero
    mean = (second - change.gain * first)[tuple(slice(a, b) for a, b in zip(low, high, strict=True))].mean()
    assert change.offset_gv == pytest.approx(mean, abs=0.5)


def test_whole_shifts_are_found_and_taken_out():
    rng = np.random.default_rng(5)
    first, second = texture() + white(rng), np.roll(texture(), (3, -2, 4), (0, 1, 2)) + white(rng)
    assert np.array_equal(whole_shift(first, second), [3, -2, 4])
    inner = cube_corners((6, 6, 6), (N - 6, N - 6, N - 6), SIDE)
    estimate = volume_noise(of(first), of(second), inner, SIDE, shift=(3, -2, 4))
    assert estimate.std_gv == pytest.approx(STD_GV, rel=0.03)


def test_copies_and_too_few_cubes_tell_nothing():
    volume = texture()
    assert volume_noise(of(volume), of(volume.copy()), CORNERS, SIDE) is None
    assert volume_noise(of(volume), of(volume + 1.0), CORNERS[:2], SIDE) is None
    assert len(cube_corners((0, 0, 0), (10, 10, 10), SIDE)) == 0


@pytest.mark.slow
@pytest.mark.skipif("IDIC_SPAM" not in os.environ, reason="the scans in the wheel of spam are not here: "
                    "pip install --no-deps --target DIR spam==0.9.1, then IDIC_SPAM=DIR")
@pytest.mark.parametrize("name", ["snow/snow.tif", "concrete/concrete_x-ray-bin16.tif"])
@pytest.mark.parametrize("shift", [0.0, 0.25])
def test_noise_on_real_scans_comes_back(name, shift):
    """Scans with edges of grains and pores; the second is moved by a spline of order 5 and has noise of its own."""
    entry, = volume_entries(Path(os.environ["IDIC_SPAM"]), f"spam/data/{name}")
    scan = entry.block(slice(None), slice(None), slice(None)) / 256.0
    noise, rng = ReconstructionNoise(STD_GV), np.random.default_rng(3)
    moved = ndimage.shift(scan, (shift, -shift, shift / 2), order=5, mode="mirror") if shift else scan
    first, second = (values + np.stack(list(noise.planes(rng, scan.shape))) for values in (scan, moved))
    estimate = volume_noise(of(first), of(second), cube_corners((8, 8, 8), (92, 92, 92), 20), 20)
    assert estimate.std_gv == pytest.approx(STD_GV, rel=0.04)
    assert 1.7 < estimate.sum_std_gv / STD_GV < 2.2
