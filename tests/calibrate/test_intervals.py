"""Intervals of calibrations hold the truth in six worlds (studies/evidence/calibration_intervals.py)."""

import numpy as np
import pytest
from idic_studies.evidence.calibration_intervals import WORLDS, calibrated

N_DRAWS = 30


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS)
def test_intervals_hold_without_being_wide(world):
    draws = calibrated(world, N_DRAWS)
    by_draw = draws.inside.mean(axis=1)
    error = max(float(by_draw.std(ddof=1)) / np.sqrt(N_DRAWS), 0.005)
    assert 0.93 - 3.0 * error < by_draw.mean() < 0.97 + 3.0 * error
    # of Student's interval by four views, 1.6 of the normal one; by ten, 1.15; thirty draws know the error to 13 %
    assert 0.85 < draws.width.mean() < (1.8 if world == "few views" else 1.5)
    assert (draws.n_scattered > N_DRAWS // 2) == (world in ("focus", "late trigger", "few views"))
    assert draws.n_shaped == N_DRAWS if world == "bent" else draws.n_shaped <= 1
