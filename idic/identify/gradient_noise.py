"""What is to be said of noise in the gradient of the reference image.

Where it is above a tenth of the pattern's own, the gradient is taken without it (`idic.images.quality.gradient_noise`): error
bars hold. Nothing is left to follow where all of the gradient is noise.
"""

from __future__ import annotations

import numpy as np

from idic.correlation.comparison import DEGREE
from idic.correlation.frame_equations import build_reference
from idic.correlation.reference import NOISY
from idic.images.interpolate import gradient_at_pixels, prefilter
from idic.images.quality.gradient_noise import gradient_noise_share
from idic.model.experiment import Experiment


def gradient_noise(experiment: Experiment) -> float:
    """Mean square of the noise in the reference image's gradient over that of the pattern, where the mesh is seen.

    0 where it is not known (heights, images whose noise nobody stated or measured), infinite where all is noise. Where
    even the whole image has gradient enough, with the background that hardly has any, that is the answer.
    """
    noise = experiment.noise.std_gv
    if experiment.stack is None or experiment.quantity != "grey" or not noise:
        return 0.0
    options = experiment.options
    degree, noise = DEGREE[options.interpolation], noise / np.sqrt(experiment.n_references)
    image = experiment.stack.frame(experiment.reference)
    iy, ix = (part.ravel() for part in np.indices(image.shape, dtype=np.int32))
    slopes = gradient_at_pixels(prefilter(image, degree, options.lowpass_px), ix, iy)
    share = gradient_noise_share(*slopes, noise, degree, options.lowpass_px)
    return share if share <= NOISY else build_reference(experiment, experiment.camera).gradient_noise


def gradient_notes(experiment: Experiment) -> list[str]:
    """What is to be said where the gradient is noisy."""
    share = gradient_noise(experiment)
    if share <= NOISY:
        return []
    if not np.isfinite(share):
        return ["the gradient of the reference image is all noise: there is no pattern to follow, and the error bars "
                "mean nothing"]
    return [f"noise is {100.0 * share / (1.0 + share):.0f} % of the mean square of the reference image's gradient: the "
            "sums weigh by the gradient of the image without it (Wiener's filter), which keeps the error bars true; more "
            "reference images would make them smaller"]
