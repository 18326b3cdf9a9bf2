"""Figures of merit of a model on held-out data, and what follows from them, on made-up fits with known answers."""

import numpy as np
import pytest

from idic.diagnose.residual.heldout import share_recovered
from idic.diagnose import Misfit
from idic.diagnose.residual.heldout import better_blocks, ratio

T, RANK = 12, 200


def made(extra, seed=0, channels=1.0):
    """A fit whose free motions explain noise and `extra` chi-square per frame."""
    rng = np.random.default_rng(seed)
    gain = rng.noncentral_chisquare(RANK, np.broadcast_to(np.maximum(extra, 1e-12), T))
    return Misfit(np.arange(1, T + 1), gain, np.full(T, RANK), channels * rng.standard_normal((T, 1)), 1.0)


def test_noise_alone_has_no_excess():
    z = np.array([made(0.0, seed).excess_z for seed in range(200)])
    assert abs(z.mean()) < 4.0 / np.sqrt(len(z))  # 4 std of the mean of unit normals
    assert z.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * len(z)))


def test_the_excess_is_the_residual_of_a_model_per_free_motion():
    assert made(400.0).excess == pytest.approx(400.0 / RANK, abs=6.0 * np.sqrt(2 * (RANK + 800.0) / T) / RANK)


def test_a_right_model_recovers_everything_and_a_useless_one_nothing():
    before = made(400.0, 0, 5.0)
    assert share_recovered(before, made(0.0, 1)) > 0.95
    assert share_recovered(before, before) == 0.0
    assert 0.4 < share_recovered(made(400.0, 0), made(200.0, 1)) < 0.6


def test_the_ratio_is_zero_where_only_noise_is_left():
    assert ratio(made(400.0), made(0.0, 3)) < 0.1


def test_a_finer_grid_of_free_motions_is_no_worse_a_model():
    """More of them explain more of mere noise; that is no chi-square which a model leaves."""
    def mean(n, seed):
        gain = np.random.default_rng(seed).chisquare(n, (60, T))
        return np.mean([Misfit(np.arange(1, T + 1), one, np.full(T, n), np.zeros((T, 1)), 1.0).chi2 for one in gain])

    # std of a chi-square of 2400 is 69; of the mean of 60 it is 9, of a difference 13
    assert mean(RANK, 0) - mean(RANK - 10, 1) == pytest.approx(0.0, abs=4.0 * 13.0)


def test_there_is_no_ratio_without_an_excess_before():
    nothing = Misfit(np.arange(1, T + 1), np.full(T, RANK - 1.0), np.full(T, RANK), np.zeros((T, 1)), 1.0)
    assert np.isnan(ratio(nothing, made(0.0)))


def test_blocks_tell_where_it_got_better():
    late = np.where(np.arange(T) < T // 2, 0.0, 300.0)
    share, worst = better_blocks(made(late), made(0.0))
    assert share == 1.0 and worst < 0.3
    share, _ = better_blocks(made(late), made(late + 50.0, 1))
    assert share < 1.0
