"""Two copies of one recording: the same signal, independent noise, whoever reads them."""

import pickle

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from idic.diagnose.residual.thinning import CHOICE, ThinnedStack
from idic.diagnose import JUDGEMENT
from idic.images import ArrayStack
from idic.model import CorrelatedNoise, Noise

SIGMA, SHAPE = 3.0, (300, 400)
N = SHAPE[0] * SHAPE[1]


@pytest.fixture(scope="module")
def copies():
    """Signal, and the noise of both copies of a frame whose own noise is normal with SIGMA."""
    rng = np.random.default_rng(4)
    signal = 100.0 + 20.0 * np.sin(np.arange(SHAPE[1]) / 9.0) * np.ones(SHAPE)
    stack = ArrayStack((signal + SIGMA * rng.standard_normal((2, *SHAPE))).astype(np.float32))
    return stack, [ThinnedStack(stack, Noise(SIGMA), sign, 11).frame(1) - signal for sign in (CHOICE, JUDGEMENT)]


def test_the_noise_of_each_copy_is_larger_by_the_root_of_two(copies):
    for noise in copies[1]:
        assert noise.std() == pytest.approx(np.sqrt(2.0) * SIGMA, rel=5.0 / np.sqrt(2.0 * N))  # 5 std of a std


def test_the_noises_of_the_copies_are_independent(copies):
    one, other = (noise.ravel() for noise in copies[1])
    assert abs(np.corrcoef(one, other)[0, 1]) < 5.0 / np.sqrt(N)


def test_the_mean_of_the_copies_is_the_recording(copies):
    stack = copies[0]
    pair = [ThinnedStack(stack, Noise(SIGMA), sign, 11).frame(0) for sign in (CHOICE, JUDGEMENT)]
    np.testing.assert_allclose(np.mean(pair, axis=0), stack.frame(0), atol=1e-4)  # float32 of 100


def test_another_process_reads_the_same_copy(copies):
    stack = ThinnedStack(copies[0], Noise(SIGMA), CHOICE, 11)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(stack)).frame(1), stack.frame(1))


def test_frames_seeds_and_cameras_have_noise_of_their_own(copies):
    still = ArrayStack(np.zeros((2, *SHAPE), dtype=np.float32))
    frames = [ThinnedStack(still, Noise(1.0), CHOICE, seed, camera).frame(k).ravel()
              for seed, camera, k in ((11, 0, 0), (11, 0, 1), (12, 0, 0), (11, 1, 0))]
    correlation = np.corrcoef(frames) - np.eye(4)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(N)


def test_copies_of_correlated_noise_are_independent_of_one_another():
    """White noise added to smooth noise would leave the copies' sums against a slow pattern correlated."""
    smooth = gaussian_filter(np.random.default_rng(5).standard_normal((200, 200)), 0.6, mode="wrap")
    smooth /= smooth.std()
    rows = [[float(np.mean(smooth * np.roll(smooth, (i, j), (0, 1)))) for j in range(-4, 5)] for i in range(-4, 5)]
    noise = Noise(SIGMA, correlated=CorrelatedNoise(SIGMA, SIGMA, tuple(map(tuple, rows)), SIGMA))
    still = ArrayStack((SIGMA * smooth[None]).astype(np.float32))
    one, other = (ThinnedStack(still, noise, sign, 11).frame(0) for sign in (CHOICE, JUDGEMENT))
    sums = [copy.reshape(40, 5, 40, 5).sum(axis=(1, 3)).ravel() for copy in (one, other)]
    assert abs(np.corrcoef(*sums)[0, 1]) < 5.0 / np.sqrt(1600)  # white noise in place of coloured one: 0.4
