"""A loaded frame that is one large step away: shift, stretch and turn at once are found, another surface is not."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from dic_cases import experiment, grid, pictures, rest

from idic.measure import dic_stack

SHAPE = (460, 460)
FRAME = (80, 80, 220, 260, 20)
MESH = grid(*FRAME)
ACCURACY = 0.05  # px rms: 3 GV of noise on 20 px elements make 0.02


def moved(nodes: np.ndarray, shift=(0.0, 0.0), stretch=(0.0, 0.0), turn=0.0, bend=0.0) -> np.ndarray:
    angle = np.radians(turn)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    place = nodes - (150.0, 170.0)
    u = place @ (rotation @ np.diag(1.0 + np.array(stretch)) - np.eye(2)).T + shift
    u[:, 0] += bend * (place[:, 1] / 100.0) ** 2
    return u


def measured(*motions, spoilt=lambda k, image: image):
    images = pictures(FRAME, [rest, *motions], SHAPE, noise=3.0)
    return dic_stack(experiment(MESH, [spoilt(k, image) for k, image in enumerate(images)]))


@pytest.mark.parametrize("step", [
    {"shift": (75.0, 66.0), "stretch": (-0.03, 0.1)},
    {"shift": (20.0, 10.0), "turn": 20.0},
    pytest.param({"shift": (75.0, 66.0), "stretch": (0.1, -0.03)}, marks=pytest.mark.slow),
    pytest.param({"turn": 20.0}, marks=pytest.mark.slow),
    pytest.param({"shift": (40.0, 40.0), "stretch": (0.0, 0.1), "turn": 20.0}, marks=pytest.mark.slow),
    pytest.param({"shift": (60.0, 30.0), "turn": 45.0}, marks=pytest.mark.slow),
    pytest.param({"shift": (75.0, 60.0), "stretch": (-0.03, 0.1), "bend": 10.0}, marks=pytest.mark.slow),
])
def test_one_step_of_75_to_100_px_with_stretch_or_turn_is_found(step):
    motion = partial(moved, **step)
    stack = measured(motion)
    assert stack.status == ["ok", "ok"]
    assert np.sqrt(np.mean((stack.u_px[1] - motion(MESH.nodes)) ** 2)) < ACCURACY


def test_another_surface_stays_lost_and_a_near_frame_needs_no_search():
    rng = np.random.default_rng(3)
    other = pictures(FRAME, [partial(moved, shift=(20.0, 10.0))], SHAPE, noise=3.0)[0][:, ::-1]  # its mirror image
    stack = measured(partial(moved, shift=(0.4, 0.2)), partial(moved, shift=(0.8, 0.4)), rest,
                     spoilt=lambda k, image: (image, image, other, rng.normal(120.0, 40.0, SHAPE))[k]
                     if k in (2, 3) else image)
    assert stack.status == ["ok", "ok", "lost", "lost"]
    assert stack.attempts[1] == 1


@pytest.mark.parametrize("change", ["light", "focus"])
def test_the_only_loaded_frame_is_not_measured_by_the_residual_of_frames_at_rest(change):
    """Quiet frames at rest leave 0.7 GV, a loaded one under other light or focus three times that: it matches."""
    from scipy.ndimage import gaussian_filter

    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    spot = 1.0 + 0.1 * np.exp(-((columns - 200.0) ** 2 + (rows - 200.0) ** 2) / 2e4)
    motion = partial(moved, shift=(75.0, 0.0), stretch=(0.0, 0.01))
    images = pictures(FRAME, [rest] * 4 + [motion], SHAPE, noise=0.7)
    images[4] = (images[4] * spot if change == "light" else gaussian_filter(images[4], 0.7)).astype(np.float32)
    stack = dic_stack(experiment(MESH, images))
    assert stack.rms_gv[4] > 2.0 * np.median(stack.rms_gv[1:4])
    assert stack.status == ["ok"] * 5
    assert np.sqrt(np.mean((stack.u_px[4] - motion(MESH.nodes)) ** 2)) < ACCURACY
