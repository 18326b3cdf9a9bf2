"""A diagnosis whose own model finds no answer on a copy of the recording says so."""

import numpy as np
import pytest
from side_twins import Side, write_folder

from idic.diagnose import Fit, diagnose
from idic.errors import NotConverged
from idic.experiment_file import load_experiment
from idic.identification import identify


def failing(jobs):
    """Every refit ends without an answer."""
    return [Fit(job.name, job.labels[0], "failed", {}, {}, np.zeros((1, 0)), None, None, None,
                problem="null: no equilibrium at 3 s") for job in jobs]


class Source:
    """Knows no experiment: none is asked for."""

    def with_motion_error(self, error):
        return self


def test_a_null_model_without_a_refit_is_a_message_and_not_a_traceback(tmp_path):
    found = identify(load_experiment(write_folder(tmp_path / "clean", Side())))
    with pytest.raises(NotConverged, match="fitted again to a copy .* no equilibrium at 3 s"):
        diagnose(Source(), found, failing, library=())
