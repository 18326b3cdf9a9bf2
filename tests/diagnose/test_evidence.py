"""White columns: nothing to whiten stays nothing; a model with parameters that no pixel sees has no image columns."""

import numpy as np
from scipy import sparse

from idic.diagnose.residual.evidence import FrameEvidence
from idic.diagnose import Columns, Evidence, null_model, score

N_NODES, T = 5, 4


def made(rng, n_nodes=N_NODES, n_frames=T):
    """Evidence of unit weights and pure noise on all nodes, one channel."""
    n = 2 * n_nodes
    parts = tuple(FrameEvidence(sparse.csr_array(sparse.eye_array(n)), rng.standard_normal(n), rng.standard_normal(1),
                                np.zeros((n + 1, 0)), np.zeros((0, 0)), np.zeros(0)) for _ in range(n_frames))
    return Evidence(np.arange(1, n_frames + 1), np.arange(n), np.full(n_frames, 1.7),
                    np.tile(np.eye(2), (n_frames, n_nodes, 1, 1)),
                    np.ones(1), 1.0, 100, parts)


def test_a_model_without_parameters_leaves_columns_as_they_are():
    rng = np.random.default_rng(0)
    evidence = made(rng)
    column = Columns(("one",), rng.standard_normal((T, 2 * N_NODES, 1)), rng.standard_normal((T, 1, 1)))
    nothing = column.pick([])
    assert evidence.whiten(nothing).fields.shape == (T, 2 * N_NODES, 0)
    found = score(evidence, null_model(evidence, nothing), column)
    assert found.visibility[0] == 1.0 and found.moves.shape == (0, 1)
    assert found.own[0] == found.gross[0, 0] > 0.0
