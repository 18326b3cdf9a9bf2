"""Noise of the inputs: of a logged channel, and of the gradient of the reference image.

Where the noise of the gradient exceeds a tenth of the pattern's own (mean squares), the gradient is taken from the image
without it (`idic.images.quality.gradient_noise`), so that error bars hold.
"""

from __future__ import annotations

import numpy as np

from idic.correlation.experiment_reference import build_reference
from idic.correlation.reference import MAX_GRADIENT_NOISE
from idic.images.interpolate import DEGREES, gradient_at_pixels, prefilter
from idic.images.quality.gradient_noise import gradient_noise_share
from idic.model.experiment import Experiment

MAD_TO_STD = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
MIN_CHANNEL_NOISE_SHARE = 1e-4  # of the range of a series
MIN_VALUES = 6  # of a series whose third differences tell its noise
NOISE_SHARE_OF_A_SHORT_LOG = 2e-3  # of its largest value


def channel_noise(values: np.ndarray) -> float:
    """Standard deviation of the noise of a series (n,), in its unit.

    Third differences remove a smooth course and amplify white noise by sqrt(20); their median ignores the few frames at
    a knee. Never below 1e-4 of the range of the series, so that the weight of a noise-free record is finite.
    """
    values = np.asarray(values, float)
    floor = MIN_CHANNEL_NOISE_SHARE * max(float(np.ptp(values)), 1e-12)
    if len(values) < MIN_VALUES:
        return max(floor, NOISE_SHARE_OF_A_SHORT_LOG * float(np.abs(values).max(initial=0.0)))
    third = np.diff(values, 3)
    return max(floor, MAD_TO_STD * float(np.median(np.abs(third))) / np.sqrt(20.0))


def gradient_noise(experiment: Experiment) -> float:
    """Mean square of the noise in the reference image's gradient over that of the pattern, where the mesh is seen.

    0 where it is not known (height images, images of unknown noise), infinite where all of the gradient is noise. The
    share over the whole image, background included, is the answer where that is small already.
    """
    noise = experiment.noise.std_gv
    if experiment.stack is None or experiment.quantity != "grey" or not noise:
        return 0.0
    options = experiment.options
    degree, noise = DEGREES[options.interpolation], noise / np.sqrt(experiment.n_references)
    image = experiment.stack.frame(experiment.reference)
    iy, ix = (part.ravel() for part in np.indices(image.shape, dtype=np.int32))
    slopes = gradient_at_pixels(prefilter(image, degree, options.lowpass_px), ix, iy)
    share = gradient_noise_share(*slopes, noise, degree, options.lowpass_px)
    return share if share <= MAX_GRADIENT_NOISE else build_reference(experiment, experiment.camera).gradient_noise  # type: ignore[attr-defined]


def gradient_notes(experiment: Experiment) -> list[str]:
    """Notes for the result where the gradient of the reference image is noisy."""
    share = gradient_noise(experiment)
    if share <= MAX_GRADIENT_NOISE:
        return []
    if not np.isfinite(share):
        return ["the gradient of the reference image is all noise: there is no pattern to correlate, and the error bars "
                "mean nothing"]
    return [f"noise is {100.0 * share / (1.0 + share):.0f} % of the mean square of the reference image's gradient: the "
            "gradient is taken from the image without it (Wiener filter), which keeps the error bars true; more reference "
            "images make them smaller"]
