"""Blocks that fit and blocks that judge have nothing in common; a better model is better on both."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt
from side_twins import TOML, Side, write_folder

from idic.diagnose.refit import identification_at
from idic.diagnose.blocks import (
    BUFFER_PX,
    FittedModel,
    judged,
    judged_by_blocks,
    later_frames,
    squares,
    reason_against_later_frames,
)
from idic.diagnose.residual.heldout import fit, grid_of
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.dic import dic_stack
from idic.experiment_file.load import load_experiment
from idic.experiment_file.load import load_rendered
from idic.identify.in_memory import identify
from idic.identify.measured_start import measured_start
from idic_studies.trial.scenes.effects import EFFECTS
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve


@pytest.mark.parametrize("shape", [(84, 132), (200, 90), (64, 64), (60, 100), (300, 1000), (512, 640)])
def test_squares_of_both_colours_are_apart_by_the_buffer(shape):
    block, other = squares(shape)
    assert not (block.fit_mask & block.judge_mask).any()
    np.testing.assert_array_equal(block.fit_mask, other.judge_mask)
    away = distance_transform_cdt(~block.fit_mask, metric="chessboard")
    nearest = away[block.judge_mask].min()
    assert nearest >= BUFFER_PX
    assert 0.4 < (block.fit_mask | block.judge_mask).mean() < 0.97


def test_a_mask_of_the_user_is_respected():
    mask = np.zeros((84, 132), dtype=bool)
    mask[:, :60] = True
    for block in squares(mask.shape, mask):
        assert not block.fit_mask[:, 60:].any() and block.judge_mask.any()


def test_later_frames_judge_the_fit_of_earlier_ones():
    for block in later_frames(range(1, 17)):
        assert max(block.fit_frames) < min(block.judge_frames)
    assert [len(block.judge_frames) for block in later_frames(range(1, 17))] == [4, 4]
    assert later_frames([1, 2, 3]) == ()


@pytest.mark.slow
def test_the_right_model_is_better_on_every_block(tmp_path):
    """A turning grip, found and put into the model: what it leaves on any block is noise."""
    scene = EFFECTS["grip_rotation"].change(plain_scene("elastic", Geometry(), NULLS["elastic"].truth), 0.3,
                                            np.random.default_rng(1))
    stack = write_public(tmp_path, scene, solve(scene), Paint(3, 4))
    before = load_rendered(tmp_path, stack)
    boundary = [{"nodes": "LEFT", "ux": 0.0, "uy": 0.0},
                {"nodes": "RIGHT", "uy": 0.0, "ux": {"column": "grip_mm", "noise_std": 2e-4,
                                                     "corrections": [{"kind": "rotation"}]}}]
    after = load_rendered(tmp_path, stack, {"boundary": boundary, "dof": [{"name": "boundary.RIGHT.x.rotation"}]})
    grid = grid_of(residual_evidence(identify(before)))
    for one in judged_by_blocks(FittedModel(before, {}), FittedModel(after, {}), grid):
        assert one.better and one.before > 5.0 * one.std, one
        assert abs(one.after) < 4.0 * one.std, one


def test_a_model_with_a_lens_is_measured_by_the_same_free_motions(tmp_path):
    """A lens moves the nodes in the image: a grid of its own had fewer cells, and a chi-square of 120 less."""
    path = write_folder(tmp_path / "clean", Side())
    plain, bent = load_experiment(path), load_experiment(path, {"camera.k1": -2e-5})
    found = identify(plain)
    before = residual_evidence(found, light=False)
    after = residual_evidence(identification_at(bent, found.parameters.as_values(), found.local, found.steps),
                              light=False)
    size = next(n for n in np.arange(1.5, 4.0, 0.1) if (grid_of(after, n).cells != grid_of(before, n).cells).any())
    grid = grid_of(before, size)
    np.testing.assert_array_equal(fit(after, grid).rank, fit(before, grid).rank)


MEASURED = TOML.replace("ux = { column = \"grip_mm\", noise_std = 0.0002 }\nuy = 0.0",
                        'ux = "measured"\nuy = "measured"')
VIRTUAL = MEASURED.replace('"measured"', '{ virtual = "bspline", modes = 2, time_modes = 3 }')


def test_a_right_model_with_a_measured_edge_leaves_noise_on_later_frames(tmp_path):
    """The edge moves by 2 px in frames that had no part in the fit; taken to be at rest there, nothing would fit."""
    experiment = load_experiment(write_folder(tmp_path / "clean", Side(), toml=MEASURED))
    found = identify(experiment, measured_start(experiment, dic_stack(experiment).u_px, ()))
    one = later_frames(range(1, experiment.n_frames))[0]
    left = judged(FittedModel(experiment, found.parameters.as_values(), found.local), one,
                  grid_of(residual_evidence(found)))
    assert abs(left.excess) < 4.0 * left.excess_std
    assert (np.abs(left.channels) < 4.5).all()


def test_later_frames_judge_nothing_of_a_virtual_boundary(tmp_path):
    experiment = load_experiment(write_folder(tmp_path / "clean", Side(), toml=VIRTUAL))
    assert "RIGHT along x, RIGHT along y" in reason_against_later_frames(experiment)
    assert reason_against_later_frames(replace(experiment, prescribed=())) is None
