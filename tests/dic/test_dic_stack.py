"""A whole stack: large motion, what is lost or unexplained, noise, frames before the reference."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from dic_cases import experiment, grid, pictures, rest

from idic.measure import Regularisation, dic_stack
from idic.model import Noise, Options

SHAPE = (370, 240)
NOISE = 3.0
FRAME = (40, 40, 200, 180, 20)
MESH = grid(*FRAME)
ACCURACY = 0.05  # px rms: 3 GV of noise on 20 px elements make 0.02


def moved(nodes: np.ndarray, k: float) -> np.ndarray:
    """12 px per frame downwards, with a stretch that grows."""
    return np.column_stack([0.004 * k * (nodes[:, 0] - 110.0), 12.0 * k + 0.006 * k * (nodes[:, 1] - 110.0)])


def motion(k: float) -> np.ndarray:
    return moved(MESH.nodes, k)


@pytest.fixture(scope="module")
def images():
    """Seven frames; the last one has a jump of five steps."""
    return pictures(FRAME, [partial(moved, k=k) for k in (0, 1, 2, 3, 4, 5, 10)], SHAPE, noise=NOISE)


@pytest.fixture(scope="module")
def found(images):
    return dic_stack(experiment(MESH, images))


def test_motions_over_100_px_are_followed_frame_by_frame_and_in_jumps(found):
    assert found.status == ["ok"] * 7 and found.converged[1:].all()
    for index, k in enumerate((0, 1, 2, 3, 4, 5, 10)):
        error = np.sqrt(np.mean((found.u_px[index] - motion(k)) ** 2))
        assert error < ACCURACY
    assert np.abs(found.u_px[6]).max() > 115.0


def test_the_noise_of_one_image_follows_from_the_residual(found):
    assert found.noise_gv == pytest.approx(NOISE, rel=0.05)  # interpolation adds; 22 000 px are good to 1 %
    assert found.chi2_dof[1:] == pytest.approx(1.0, abs=0.12)
    assert np.isnan(found.chi2_dof[0]) and np.isnan(found.rms_gv[0])


def test_the_residual_is_compared_with_a_given_noise(images):
    half = dic_stack(experiment(MESH, images[:3], noise=Noise(NOISE / 2)))
    assert half.chi2_dof[1:] == pytest.approx(4.0, rel=0.12)


def test_one_jump_of_120_px_and_back_is_found(images):
    jumps = dic_stack(experiment(MESH, [images[0], images[6], images[1]]))
    assert jumps.status == ["ok"] * 3
    assert jumps.attempts[1] >= 3  # no frame to frame start could reach it
    for index, k in ((1, 10), (2, 1)):
        assert np.sqrt(np.mean((jumps.u_px[index] - motion(k)) ** 2)) < ACCURACY


def test_the_reference_may_lie_in_the_middle(images):
    middle = dic_stack(experiment(MESH, images[:5], reference=0))
    backward = dic_stack(experiment(MESH, images[:5][::-1], reference=4))
    assert np.abs(backward.u_px[::-1] - middle.u_px).max() < 5e-3  # same frames in the same order: same starts
    assert backward.status == ["ok"] * 5


def test_lost_unexplained_and_excluded_frames_are_said_and_do_not_spoil_the_others(images):
    rng = np.random.default_rng(11)
    other = rng.normal(120.0, 40.0, SHAPE).astype(np.float32)  # another scene
    cracked = images[3].copy()
    cracked[120:150, :] = rng.normal(120.0, 40.0, (30, SHAPE[1]))
    stack = [images[0], images[1], other, images[2], cracked, images[4], images[5]]
    odd = dic_stack(experiment(MESH, stack, excluded=(5,)))
    assert odd.status == ["ok", "ok", "lost", "ok", "unexplained", "excluded", "ok"]
    assert np.isnan(odd.u_px[2]).all() and np.isnan(odd.u_px[5]).all()
    assert odd.mismatched[4] > 0.05 and np.isnan(odd.u_px[4]).any()
    for index, k in ((1, 1), (3, 2), (6, 5)):
        assert np.sqrt(np.mean((odd.u_px[index] - motion(k)) ** 2)) < ACCURACY
    assert odd.noise_gv == pytest.approx(NOISE, rel=0.05)


def test_a_specimen_that_leaves_the_view_keeps_its_visible_part(images):
    cut = [image[:225] for image in images[:6]]
    left = dic_stack(experiment(MESH, cut))
    assert left.status == ["ok"] * 6 and left.n_lost[5] > 0
    inside = (MESH.nodes + motion(5))[:, 1] < 215.0
    assert np.sqrt(np.nanmean((left.u_px[5] - motion(5))[inside] ** 2)) < ACCURACY


def test_a_flickering_lamp_does_not_move_anything(images, found):
    lamp = (1.0, 0.85, 1.1, 0.9, 1.0, 1.05, 0.8)
    lit = [gain * image + 5.0 * k for k, (gain, image) in enumerate(zip(lamp, images, strict=True))]
    lit = dic_stack(experiment(MESH, lit))
    assert lit.status == ["ok"] * 7
    assert np.nanmax(np.abs(lit.u_px - found.u_px)) < 0.03  # noise enters the two with another gain
    blind = experiment(MESH, [images[0], 0.6 * images[1] - 20.0], options=Options(brightness="none"))
    assert dic_stack(blind).rms_gv[1] > 3 * found.rms_gv[1]  # and without the correction it shows


def test_progress_and_quintic_interpolation(images):
    seen = []
    quintic = replace(experiment(MESH, images[:3]), options=Options(interpolation="quintic"))
    found = dic_stack(quintic, "none", progress=lambda done, n: seen.append((done, n)))
    assert seen == [(1, 3), (2, 3)] and found.length_px == 0.0
    assert np.sqrt(np.mean((found.u_px[2] - motion(2)) ** 2)) < ACCURACY


def bent(nodes: np.ndarray) -> np.ndarray:
    """Waves over four elements, upright ones across and lying ones along  # (n_nodes, 2)"""
    x, y = 2 * np.pi * (nodes - 40.0).T / 80.0
    return 0.3 * np.column_stack([np.sin(x), np.sin(y)])


def test_a_frame_is_judged_smooth_and_measured_with_the_length_of_the_mesh(images):
    """Half the distance of the nodes keeps waves that the search, over two nodes, damps; noise grows by what the
    shorter length lets through, and no frame is judged otherwise."""
    wave = pictures(FRAME, [rest, bent], SHAPE, noise=NOISE)
    measured, smooth = (dic_stack(experiment(MESH, wave), length) for length in (Regularisation(),
                                                                                 Regularisation.smooth()))
    assert (measured.length_px, smooth.length_px) == (10.0, 40.0)
    inner = ((MESH.nodes > 50) & (MESH.nodes < (190, 170))).all(axis=1)
    kept = [float((stack.u_px[1] * bent(MESH.nodes))[inner].sum() / (bent(MESH.nodes)[inner] ** 2).sum())
            for stack in (measured, smooth)]
    assert kept[0] > 0.96 and kept[1] < 0.93
    still = pictures(FRAME, [rest], SHAPE, noise=NOISE)[0], pictures(FRAME, [rest], SHAPE, noise=NOISE, seed=2)[0]
    noise = [dic_stack(experiment(MESH, still), length).u_px[1].std() for length in (Regularisation(),
                                                                                     Regularisation.smooth())]
    assert 1.2 < noise[0] / noise[1] < 4.0
    cracked = images[1].copy()
    cracked[120:150, :] = np.random.default_rng(11).normal(120.0, 40.0, (30, SHAPE[1]))
    stacks = [dic_stack(experiment(MESH, [images[0], cracked, images[2]]), length)
              for length in (Regularisation(), Regularisation.smooth())]
    assert stacks[0].status == stacks[1].status and np.array_equal(stacks[0].mismatched, stacks[1].mismatched)
