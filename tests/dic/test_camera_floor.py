"""Frames at rest: how they are found, and the motion that the camera shows in them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from dic_cases import experiment, grid, pictures, rest

from idic.correlation import build_experiment_reference
from idic.measure.dic.camera_floor import MAX_STILL_FRAMES
from idic.measure import CameraFloor, find_still_frames
from idic.measure.dic.still import StillFrames, without_rigid
from idic.images import ArrayStack
from idic.model import Channel, Noise

SHAPE = (340, 280)
NOISE = 2.0
FRAME = (50, 50, 230, 290, 20)
MESH = grid(*FRAME)
MIDDLE = np.array([140.0, 170.0])
LOADS = (0.0, 0.0, 0.4, 0.8, 1.0, 0.0, 0.7)  # frame 1 before the load, frame 5 after it
REST = (0, 1, 5)


def loaded(nodes: np.ndarray, load: float) -> np.ndarray:
    """A stretch with a notch's share in it, 2 px at the ends  # (n, 2) px"""
    x, y = (nodes - MIDDLE).T
    near = np.exp(-(x**2 + y**2) / 50.0**2)
    return load * np.column_stack([-0.004 * x, 0.016 * y * (1.0 + 0.5 * near)])


def shaken(nodes: np.ndarray, by: tuple[float, float]) -> np.ndarray:
    """The camera has moved: a shift and a turn of 0.1 mrad  # (n, 2) px"""
    x, y = (nodes - MIDDLE).T
    return np.array(by) + 1e-4 * np.column_stack([-y, x])


def haze(nodes: np.ndarray, size: float, phase: float, right_only: bool = False) -> np.ndarray:
    """A smooth motion of the air between camera and specimen  # (n, 2) px"""
    x, y = 2 * np.pi * (nodes - MIDDLE).T / 130.0
    share = 1.0 / (1.0 + np.exp(-(nodes[:, 0] - MIDDLE[0]) / 10.0)) if right_only else 1.0
    return size * np.column_stack([share * np.sin(0.9 * y + phase), share * np.cos(x + 2.0 * phase)])


def motion_of(k: int, size: float = 0.0, permanent: float = 0.0, right_only: bool = False):
    """Nodes -> motion of frame k."""
    def motion(nodes: np.ndarray) -> np.ndarray:
        if k == 0:
            return rest(nodes)
        strained = loaded(nodes, LOADS[k] + (permanent if k == 5 else 0.0))
        return strained + shaken(nodes, (0.3 * np.sin(k), -0.4 * np.cos(k))) + haze(nodes, size, 1.3 * k, right_only)
    return motion


def recording(log: bool = False, **what):
    motions = [motion_of(k, **what) for k in range(len(LOADS))]
    channels = (Channel("force_N", 1e3 * np.array(LOADS), 1.0, "TOP", "y"),) if log else ()
    e = experiment(MESH, pictures(FRAME, motions, SHAPE, noise=NOISE), noise=Noise(NOISE), channels=channels)
    return e, np.array([motion(MESH.nodes) for motion in motions])


def floor_of(e, still, motion):
    return CameraFloor.of(e, build_experiment_reference(e, e.model.camera), still, lambda k: motion[k])


@pytest.fixture(scope="module")
def hazy():
    return recording(size=0.03)


@pytest.mark.parametrize("log", [False, True])
def test_frames_at_rest_are_found_in_the_motion_of_the_images_wherever_the_specimen_has_gone(hazy, log):
    e, motion = hazy
    if log:
        e = replace(e, model=replace(e.model, channels=(Channel("force_N", 1e3 * np.array(LOADS), 1.0, "TOP", "y"),)))
    found = find_still_frames(e, motion)
    assert found.frames == REST and found.source == "images" and found.unloaded == (5,)


def test_the_log_alone_finds_them_too_and_without_a_log_nothing_is_claimed(hazy):
    e, _ = hazy
    assert not find_still_frames(e).found
    logged = replace(e, model=replace(e.model, channels=(Channel("force_N", 1e3 * np.array(LOADS), 1.0, "TOP", "y"),)))
    assert find_still_frames(logged).frames == REST and find_still_frames(logged).source == "log"


def test_a_load_that_the_log_shows_is_no_rest_whatever_the_images_say(hazy):
    e, motion = hazy
    held = np.array(LOADS) + np.eye(len(LOADS))[1] * 0.05
    logged = replace(e, model=replace(e.model, channels=(Channel("force_N", 1e3 * held, 1.0, "TOP", "y"),)))
    assert find_still_frames(logged, motion).frames == (0, 5)


def test_declared_frames_count_and_excluded_ones_do_not(hazy):
    e, motion = hazy
    told = replace(e, recording=replace(e.recording, still_frames=(0, 1)))
    assert find_still_frames(told).frames == (0, 1) and find_still_frames(told).source == "declared"
    assert find_still_frames(told, motion).source == "declared and images"
    assert find_still_frames(replace(e, recording=replace(e.recording, excluded=(5,))), motion).frames == (0, 1)


def test_a_specimen_that_keeps_a_strain_is_not_at_rest_again(hazy):
    e, _ = hazy
    motion = np.array([motion_of(k, permanent=0.05)(MESH.nodes) for k in range(len(LOADS))])
    assert find_still_frames(e, motion).frames == (0, 1)


def test_the_floor_is_the_motion_of_the_air_and_not_the_shift_of_the_specimen(hazy):
    e, motion = hazy
    floor = floor_of(e, find_still_frames(e, motion), motion)
    own = [without_rigid(haze(MESH.nodes, 0.03, 1.3 * k).reshape(1, -1), MESH.nodes) for k in (1, 5)]
    truth = float(np.sqrt(np.mean(np.square(own))))
    assert floor.frames == (1, 5)
    # waves of 130 px lose a tenth to the smoothing, three motions go too
    assert floor.px == pytest.approx(truth, rel=0.2)
    assert np.sqrt(np.mean(floor.nodes_px**2)) == pytest.approx(floor.px, rel=0.02)
    shifts = [np.hypot(0.3 * np.sin(k), 0.4 * np.cos(k)) / np.sqrt(2.0) for k in (1, 5)]
    assert floor.drift_px == pytest.approx(shifts, abs=0.02)


def test_a_quiet_camera_has_no_floor_and_a_bound_below_a_hundredth_of_a_pixel():
    e, motion = recording()
    floor = floor_of(e, find_still_frames(e, motion), motion)
    assert floor.px == 0.0 and not floor.nodes_px.any()
    assert 0.0 < floor.bound_px < 0.01


def test_the_floor_differs_by_region():
    e, motion = recording(size=0.05, right_only=True)
    floor = floor_of(e, find_still_frames(e, motion), motion)
    right, left = MESH.nodes[:, 0] > 180, MESH.nodes[:, 0] < 100
    assert floor.nodes_px[right].mean() > 1.7 * floor.nodes_px[left].mean()


def test_a_permanent_strain_that_only_the_log_calls_rest_is_not_blamed_on_the_camera():
    e, _ = recording(log=True, permanent=0.05)
    elastic = np.array([loaded(MESH.nodes, load) for load in LOADS])  # what an elastic model simulates
    still = find_still_frames(e)
    assert 5 in still.frames
    floor = floor_of(e, still, elastic)
    assert 5 not in floor.frames and floor.px == 0.0


def test_a_small_strain_that_is_left_belongs_to_the_specimen():
    e, motion = recording(permanent=0.008)
    still = find_still_frames(e, motion)
    assert 5 in still.frames
    assert floor_of(e, still, motion).px < 0.005  # 0.012 px of strain (rms) are left in frame 5


def test_no_more_than_six_still_images_are_measured():
    e, motion = recording()
    still = ArrayStack(pictures(FRAME, [partial(rest)] * 9, SHAPE, noise=NOISE, seed=5))
    told = replace(e, recording=replace(e.recording, still_stack=still))
    found = find_still_frames(told)
    assert found.separate and found.found and found.source == "declared"
    floor = floor_of(told, found, motion)
    assert len(floor.frames) == MAX_STILL_FRAMES and floor.separate and floor.px == 0.0


def test_without_still_frames_there_is_no_floor(hazy):
    e, motion = hazy
    assert floor_of(e, StillFrames(), motion) is None
