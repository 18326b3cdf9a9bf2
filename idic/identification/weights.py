"""Weights of images and channels: by their noise, or the ratio of the paper's weighting."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from idic.correlation import MAX_GRADIENT_NOISE, Weights, build_experiment_reference, ordinary_variance
from idic.errors import InputError
from idic.identification.noise.input_noise import gradient_noise, logged_noise
from idic.images import lowpass, noise_share
from idic.model import Experiment


def noise_weights(experiment: Experiment, views: Sequence[Experiment] = ()) -> Weights:
    """Weights by noise: of the images (after the low-pass) and of the channels.

    views : the cameras of the experiment with their noise, where the experiment's own do not know it

    Raises
    ------
    InputError
        If the noise of the images is not known.
    """
    views = views or experiment.views
    if any(view.recording.noise.std_gv is None for view in views):
        raise InputError("the noise of the images is not known", key="[camera] noise_std_gv",
                         expected="its standard deviation", found="nothing",
                         remedy="give it, or use idic.identify, which measures it")
    main_noise, *camera_noises = (float(view.recording.noise.in_sums_gv * np.sqrt(gradient_noise_share(view)))
                                  for view in views)
    noises = np.array([logged_noise(experiment.model, channel) for channel in experiment.model.channels], dtype=float)
    share = ordinary_variance(experiment.recording.n_references)
    return Weights(1.0 / (share * main_noise**2), main_noise, noises**-2.0, noises,
                   tuple(1.0 / (share * noise**2) for noise in camera_noises), tuple(camera_noises))


def gradient_noise_share(experiment: Experiment) -> float:
    """How much of the noise variance is left for sums against the gradient after the low-pass of the images.

    All of it for height images, whose sums against the rise are as smooth as the rise, and for measured fields.
    """
    if experiment.recording.quantity != "grey":
        return 1.0
    std_px = experiment.options.lowpass_px
    # the sums weigh by another gradient than the image's
    if std_px > 0.0 and gradient_noise(experiment) > MAX_GRADIENT_NOISE:
        reference = build_experiment_reference(experiment, experiment.model.camera)
        parts = (reference.fx, reference.fy)  # type: ignore[attr-defined]
        return noise_share(*(reference.pixel_map.to_image(part, 0.0) for part in parts),
                           std_px)  # type: ignore[call-arg]
    image = lowpass(experiment.recording.stack.frame(experiment.model.reference).astype(np.float32), std_px)
    rows, columns = np.gradient(image)
    return noise_share(columns, rows, std_px)


def paper_weights(by_noise: Weights, alpha: float, slopes: np.ndarray,
                  correlation_matrix: Callable[[Weights], np.ndarray]) -> Weights:
    """The weighting of the paper: (1 - alpha) / |M_image| to alpha / |M_channel|.

    Several cameras share 1 - alpha, several channels share alpha; each term is divided by its own |M|. The images keep
    the weight of their noise and the others follow in ratio, so that priors, which count in standard deviations, keep
    their weight (Neggers et al. 2015, Eqs 13-15).

    Parameters
    ----------
    by_noise : weights by noise
    slopes : (n,) d natural / d scaled of the unknowns at the starting point
    correlation_matrix : M of the starting point with the weights it is called with  # (n, n)
    """
    n_cameras, n_channels = 1 + len(by_noise.cameras), len(by_noise.channels)

    def size(number: int) -> float:
        """|M| of one term alone: the main camera, the further ones, the channels."""
        unit = np.eye(n_cameras + n_channels)[number]
        weights = replace(by_noise, image=unit[0], cameras=tuple(unit[1:n_cameras]), channels=unit[n_cameras:])
        return float(np.linalg.norm(slopes[:, None] * correlation_matrix(weights) * slopes))

    sizes = [size(number) for number in range(n_cameras + n_channels)]
    share = alpha / (1.0 - alpha) * n_cameras / max(n_channels, 1)  # of a channel over that of a camera
    ratios = [sizes[0] / term if term else 0.0 for term in sizes]
    return replace(by_noise, cameras=tuple(by_noise.image * ratio for ratio in ratios[1:n_cameras]),
                   channels=np.array([by_noise.image * ratio * share for ratio in ratios[n_cameras:]]))
