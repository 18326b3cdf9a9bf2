"""One step from a finished fit gives the fit to a part of the recording; the other part judges it. On made-up normal
equations."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse

from idic.diagnose.residual.evidence import FrameEvidence
from idic.diagnose import Columns, Evidence, holds
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.selection.block_step import BlockJudgement, judged_by_step, judged_parts, parts_of

SIDE, T, ERROR = 13, 8, np.array([0.7, -0.3])
AT = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"), axis=-1).reshape(-1, 2) * 10.0
GRID = Grid(AT, AT.min(axis=0), np.ptp(AT, axis=0), np.array([6, 6]))


def evidence():
    """Nodes on a square grid, every node tied to its eight neighbours; no unknowns of single frames."""
    near = np.abs(AT[:, None] - AT[None]).max(axis=2) < 11.0
    A = sparse.csr_array(np.kron(np.where(near, 0.1, 0.0) + 2.0 * np.eye(len(AT)), np.eye(2)))
    n = A.shape[0]
    part = FrameEvidence(A, np.zeros(n), np.zeros(1), np.zeros((n + 1, 0)), np.zeros((0, 0)), np.zeros(0))
    return Evidence(np.arange(1, T + 1), np.arange(n), np.ones(T), np.broadcast_to(np.eye(2), (T, len(AT), 2, 2)),
                    np.ones(1), 0.0, 1000, (part,) * T)


def columns():
    rng = np.random.default_rng(3)
    return Columns(("a", "b"), rng.standard_normal((T, 2 * len(AT), 2)), rng.standard_normal((T, 1, 2)))


def with_residual(found, null, fields, channels):
    """The evidence with a white residual motion (T, n_seen) and readings (T, 1)."""
    parts = tuple(replace(part, q=part.A @ fields[t], channel_q=channels[t]) for t, part in enumerate(found.parts))
    return SimpleNamespace(evidence=replace(found, parts=parts), null=null)


@pytest.fixture(scope="module")
def off():
    """A model that is right but for its parameters, which are off by `ERROR`."""
    found, null = evidence(), columns()
    white = found.whiten(null)
    return with_residual(found, null, white.fields @ ERROR, white.channels @ ERROR)


def test_nodes_of_two_parts_share_no_element_and_later_frames_come_later(off):
    one, two, *later = parts_of(off.evidence, GRID)
    for part in (one, two):
        fits, judges = AT[np.unique(np.flatnonzero(part.fit) // 2)], AT[np.unique(np.flatnonzero(part.judge) // 2)]
        assert np.abs(fits[:, None] - judges[None]).max(axis=2).min() > 11.0
    assert not (one.judge & two.judge).any()
    for part in later:
        assert np.flatnonzero(part.fit_frames).max() < np.flatnonzero(part.judge_frames).min()
    assert [int(part.judge_frames.sum()) for part in later] == [2, 2]


def test_a_model_that_is_right_but_for_its_parameters_leaves_nothing_on_the_part_that_the_fit_has_not_seen(off):
    for found in judged_parts(off, GRID, parts_of(off.evidence, GRID)):
        assert found.gain.sum() < 1e-12 and (found.channels**2).sum() < 1e-12


def test_a_motion_in_one_square_alone_is_left_there_and_a_model_with_it_is_better(off):
    spot = np.exp(-((AT - 15.0) ** 2).sum(axis=1) / 50.0).repeat(2)
    left = with_residual(evidence(), off.null, np.tile(spot, (T, 1)), np.zeros((T, 1)))
    judged = judged_by_step(left, off, GRID)
    assert len(judged) == 4 and holds(judged)
    assert max(one.drop for one in judged) > 1.0
    assert not holds(judged_by_step(off, left, GRID))


def test_frames_that_do_not_determine_the_model_do_not_judge():
    null = columns()
    fields = null.fields.copy()
    fields[:7, :, 1] = 0.0  # its second parameter acts in the last frame alone
    channels = null.channels.copy()
    channels[:7, :, 1] = 0.0
    found = evidence()
    model = with_residual(found, Columns(null.names, fields, channels), np.zeros((T, fields.shape[1])),
                          np.zeros((T, 1)))
    names = [part.name for part, fit in zip(parts_of(found, GRID), judged_parts(model, GRID, parts_of(found, GRID)),
                                            strict=True) if fit]
    assert names == ["squares 1", "squares 2"]


def test_without_a_block_nothing_is_held_against_a_model():
    assert holds(()) and not holds([BlockJudgement("a", 0.0, 0.0, 1.0, -10.0)])
    assert holds([BlockJudgement("a", 0.0, 0.0, 1.0, -5.0), BlockJudgement("b", 0.0, 0.0, 1.0, 1.0)])  # noise
