"""Two models of one recording are measured by the same free motions."""

import numpy as np
from side_twins import Side, write_folder

from idic.diagnose import identification_at, residual_evidence
from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.experiment_file import load_experiment
from idic.identification import identify


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
    np.testing.assert_array_equal(misfit_of(after, grid).rank, misfit_of(before, grid).rank)
