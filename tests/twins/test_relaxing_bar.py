"""A free spectrum finds kernels that are no sums of exponentials, on a bar whose truth is a convolution."""

import numpy as np
import pytest
from relaxing_bar import E, KERNELS, NU, write_folder

import idic
from idic.run.reporting.write import load_record

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kernel", list(KERNELS))
def test_the_modulus_of_a_free_spectrum_is_the_true_one_over_the_visited_times(tmp_path, kernel):
    """One draw of the noise: the points of the band err together, so that nine tenths of it are asked for."""
    write_folder(tmp_path / "test", kernel)
    result = idic.identify(str(tmp_path / "test"), out=str(tmp_path / "run"))
    assert result.status == "converged"
    curve, = load_record(tmp_path / "run").relaxation
    assert curve.time[0] < 0.3 and curve.time[-1] > 250.0  # s
    expected = E / (2.0 * (1.0 + NU)) * KERNELS[kernel](curve.time)
    error = curve.modulus - expected
    assert np.abs(error / expected).max() < 0.01
    assert np.mean(np.abs(error) < 1.96 * curve.std) >= 0.9
    assert (np.abs(error) < 3.0 * curve.std).all()
