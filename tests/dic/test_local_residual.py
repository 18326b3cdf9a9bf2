"""The local test of the residual, and the remedies for light: on residuals and pictures with a known cause."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dic_cases import CAMERA, experiment, grid, pictures, rest
from scipy import ndimage

from idic.correlation import PixelMap, ResidualMap
from idic.identification import ElementSums, LocalResidual, Remedy, p_text, z_text
from idic.identification.judgement.remedies import chi2_at, remedies
from idic.model import Noise, Options

SHAPE = (260, 300)
MESH = grid(20, 20, 280, 240, 13)  # 340 elements of 169 px
SIGMA, N_FRAMES = 2.0, 6


@cache
def pixels():
    return PixelMap.of(MESH.nodes, MESH.blocks, CAMERA, SHAPE)


def sums_of(rng, blur_px=0.0, raised=None, frames=range(N_FRAMES)):
    """Element sums of residuals of noise (variance 2 sigma^2), the reference image's in every frame.

    blur_px : correlation of the noise; raised : (pixels, factor of the residual, frames)
    """
    def noise():
        image = rng.standard_normal(SHAPE)
        if blur_px:
            image = ndimage.gaussian_filter(image, blur_px)
            image /= image.std()
        return SIGMA * image[pixels().iy, pixels().ix]

    reference = noise()
    found = []
    for k in frames:
        r = reference - noise()
        if raised is not None and k in raised[2]:
            r = np.where(raised[0], raised[1] * r, r)
        every = np.ones(len(r), dtype=bool)
        found.append(ElementSums.of(pixels(), ResidualMap(r.astype(np.float32), every, np.ones(len(r))), SIGMA))
    return found


def ring(column, row, inner, outer):
    distance = np.hypot(pixels().ix - column, pixels().iy - row)
    return (distance >= inner) & (distance < outer)


@pytest.mark.parametrize("blur_px", [0.0, 0.6, 1.2])
def test_noise_is_no_cluster_white_or_correlated(blur_px):
    rng = np.random.default_rng(3)
    assert not any(LocalResidual.of(pixels(), sums_of(rng, blur_px)).is_cluster for _ in range(15))


def test_a_ring_of_misfit_is_a_cluster_though_the_mean_is_noise():
    rng = np.random.default_rng(4)
    sums = sums_of(rng, raised=(ring(150, 130, 20, 45), np.sqrt(1.5), range(N_FRAMES)))
    mean = sum(one.chi2.sum() for one in sums) / sum(one.pixels.sum() for one in sums)
    assert mean < 1.1  # what a verdict by the mean calls noise
    found = LocalResidual.of(pixels(), sums)
    assert found.is_cluster and found.z > 8.0
    assert abs(np.hypot(found.column - 150, found.row - 130) - 32) < 25
    assert found.chi2 > 1.2 and found.typical_chi2 == pytest.approx(1.0, abs=0.03) and 0.02 < found.share < 0.15


def test_a_cluster_at_the_end_of_the_test_is_found_in_its_part():
    rng = np.random.default_rng(5)
    late = sums_of(rng, raised=(ring(80, 80, 0, 30), np.sqrt(2.0), range(15, 20)), frames=range(20))
    found = LocalResidual.of(pixels(), late)
    assert found.is_cluster and found.part == 3
    assert np.hypot(found.column - 80, found.row - 80) < 30


def test_a_residual_that_is_raised_everywhere_is_no_cluster():
    rng = np.random.default_rng(6)
    found = LocalResidual.of(pixels(),
                             sums_of(rng, raised=(np.ones(pixels().n_pixels, dtype=bool), 1.4, range(N_FRAMES))))
    assert not found.is_cluster and found.typical_chi2 == pytest.approx(1.96, rel=0.05)


def test_a_mesh_of_few_elements_does_not_tell_its_own_scatter():
    mesh = grid(20, 20, 120, 100, 20)
    few = PixelMap.of(mesh.nodes, mesh.blocks, CAMERA, SHAPE)
    every = np.ones(few.n_pixels, dtype=bool)
    sums = [ElementSums.of(few, ResidualMap(np.ones(few.n_pixels, np.float32), every, np.ones(few.n_pixels)), 1.0)]
    assert LocalResidual.of(few, sums) is None and LocalResidual.of(few, []) is None


# remedies -------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def uneven():
    """Three frames at rest; a lamp brightens one side of the later ones."""
    images = pictures((60, 60, 220, 200, 20), [rest] * 3, SHAPE, noise=SIGMA)
    lamp = np.linspace(0.0, 12.0, SHAPE[1])[None, :] - 6.0
    lit = [images[0], *((image + lamp).astype(np.float32) for image in images[1:])]
    return experiment(grid(60, 60, 220, 200, 20), lit, noise=Noise(SIGMA))


def still(frame):
    return np.zeros((len(grid(60, 60, 220, 200, 20).nodes), 2))


def test_patches_remove_a_lamp_and_the_table_shows_it(uneven):
    tried = {one.setting: one for one in Remedy.tried(uneven, CAMERA, (1, 2), still)}
    before = chi2_at(uneven, CAMERA, (1, 2), still)
    assert before > 1.3 and all(one.chi2_before == before for one in tried.values())
    patches = [one for setting, one in tried.items() if "patch" in setting]
    assert len(patches) == 2 and patches[1].chi2_after < patches[0].chi2_after < before
    assert patches[1].chi2_after - 1.0 < 0.5 * (before - 1.0)
    assert tried["lowpass_px = 1"].chi2_after > before  # what is left is smooth: a blur takes the noise only


def test_on_clean_images_no_remedy_changes_anything():
    images = pictures((60, 60, 220, 200, 20), [rest] * 2, SHAPE, noise=SIGMA)
    clean = experiment(grid(60, 60, 220, 200, 20), images, noise=Noise(SIGMA))
    for one in Remedy.tried(clean, CAMERA, (1,), still):
        assert one.chi2_before == pytest.approx(1.0, abs=0.05) and one.chi2_after == pytest.approx(1.0, abs=0.05)


def test_only_what_is_not_set_already_is_tried():
    settings = [setting for setting, _ in remedies(Options())]
    assert settings[0] == 'brightness = "patch", patch_px = 100' and not any("quintic" in one for one in settings)
    rough = replace(Options(), brightness="patch", patch_px=40.0, interpolation="cubic", lowpass_px=1.0)
    assert [setting for setting, _ in remedies(rough)] == ['interpolation = "quintic"']


# significance in words ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("z", "text"), [(3.24, "3.2"), (8.0, "8.0"), (640.8, "> 8"), (-9.0, "< -8"), (-0.04, "0.0")])
def test_standard_deviations_end_at_eight(z, text):
    assert z_text(z) == text


@pytest.mark.parametrize(("p", "text"),
                         [(0.034, "0.034"), (2e-6, "2e-06"), (4e-54, "< 1e-6"), (0.0, "< 1e-6"), (1.0, "1")])
def test_probabilities_end_at_one_in_a_million(p, text):
    assert p_text(p) == text
