"""What a model leaves of a recording beyond noise, and how well its parameters need be known beside it.

The parameters of a wrong model have no meaning to a hundredth of a standard deviation of the noise. Its functional is
rough where points yield. Finer increments and further steps move its parameters by far less than the missing physics
does. Its search therefore ends, and its increments are short enough, where a step would gain a hundred-thousandth of
the misfit (0.3 % of its root). A right model has no misfit; there the standard deviations alone decide.
"""

from __future__ import annotations

from idic.correlation import CorrelationSystem
from idic.images import still_gain

SETTLED_SHARE = 1e-5  # of the misfit, in chi-square
# what noise may leave, of a pixel and of a reading, in its variance: it may be larger than stated
MAX_NOISE_OF_PIXEL, MAX_NOISE_OF_READING = 1.25, 9.0


def beyond_noise(system: CorrelationSystem, lowpass_px: float) -> float:
    """Chi-square of the functional beyond what noise can leave; 0 for generalised least squares, which have none."""
    if system.generalised:
        return 0.0
    readings = sum(len(record.channel_residual) for record in system.frames)
    return (max(0.0, system.phi_image - MAX_NOISE_OF_PIXEL * still_gain(lowpass_px) * system.n_pixels)
            + max(0.0, system.phi - system.phi_image - MAX_NOISE_OF_READING * readings))


def negligible(system: CorrelationSystem, lowpass_px: float) -> float:
    """Chi-square that does not matter beside the misfit."""
    return SETTLED_SHARE * beyond_noise(system, lowpass_px)
