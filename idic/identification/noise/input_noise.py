"""Noise of the inputs: of a logged channel, and of the gradient of the reference image.

Where the noise of the gradient exceeds a tenth of the pattern's own (mean squares), the gradient is taken from the
image without it (`idic.images.quality.gradient_noise`), so that error bars hold.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from idic.correlation import MAX_GRADIENT_NOISE, build_experiment_reference
from idic.identification.noise.free_residual import free_residual_noise
from idic.identification.noise.recordings import CONSECUTIVE, FREE_RESIDUAL, STILL, recordings
from idic.images import Camera, DEGREES, NoiseCovariance, gradient_noise_share, pixel_gain, prefilter
from idic.model import Channel, CorrelatedNoise, Experiment, Model, Noise, Recording

MAD_TO_STD = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
MIN_CHANNEL_NOISE_SHARE = 1e-4  # of the range of a series
MIN_GAP_SHARE = 1e-9  # of the range of a series: readings that are closer are equal
MAX_STEPS_OF_A_GAP = 6  # between its readings, the closest ones; finer steps do not make differences zero
MIN_STEPS_OF_RANGE = 6  # of a rounded series; one of fewer is as well a load that is held, taken off, put on again
MAX_OFF_STEP = 0.05  # of its steps: how far from whole ones the readings of a rounded series may be
MIN_VALUES = 6  # of a series whose differences tell its noise
MIN_VALUES_OF_A_LONG_LOG = 20  # a knee is in few of its third differences
MIN_UNEVENNESS = 0.01  # of the largest step of time
NOISE_SHARE_OF_A_SHORT_LOG = 2e-3  # of its largest value
MIN_NOISE_RATIO = 1.08  # of measured to assumed noise; below, 95 % intervals still hold in 93 %, and nothing is changed
MIN_STANDARD_ERRORS = 4.0  # of that difference
MAX_NOISE_RATIO = 4.0  # above, it is motion or light that the images differ by
TOLD = {STILL: "still frames show", CONSECUTIVE: "consecutive images show",
        FREE_RESIDUAL: "the residual of a free FE-DIC shows"}
MIN_TOLD_CORRELATION = 0.05  # of neighbouring pixels


def logged_noise(model: Model, channel: Channel) -> float:
    """Standard deviation of a reading of a channel: the stated one, else that of its course over all frames."""
    times = model.times if channel.times is None else channel.times
    return float(channel.noise_std or channel_noise(channel.values, times))


def channel_noise(values: np.ndarray, times: np.ndarray | None = None) -> float:
    """Standard deviation of the noise of a series (n,), in its unit.

    Third differences remove a smooth course and amplify white noise by sqrt(20); their median ignores the few frames at
    a knee. Where the times (n,) are not even, divided differences take their place if they show less: a straight course
    over uneven times is straight to them alone. In a short series a knee or a curve is in most third differences: the
    least of second, third and fourth ones counts. Never below the error of rounding, the resolution over sqrt(12): of
    coarse readings most differences are zero. Never below 1e-4 of the range of the series, so that the weight of a
    noise-free record is finite.
    """
    values = np.asarray(values, float)
    n, floor = len(values), MIN_CHANNEL_NOISE_SHARE * max(float(np.ptp(values)) if len(values) else 0.0, 1e-12)
    floor = max(floor, resolution(values) / np.sqrt(12.0))
    if n < MIN_VALUES:
        return max(floor, NOISE_SHARE_OF_A_SHORT_LOG * float(np.abs(values).max(initial=0.0)))
    orders = (2, 3, 4) if n < MIN_VALUES_OF_A_LONG_LOG else (3,)
    steps = np.diff(np.arange(n) if times is None else np.asarray(times, float))
    estimates = [_noise_of_differences(values, np.ones(n - 1), order) for order in orders]
    if np.ptp(steps) > MIN_UNEVENNESS * steps.max(initial=0.0) and (steps > 0.0).all():
        estimates += [_noise_of_differences(values, steps, order) for order in orders]
    return max(floor, min(estimates))


def resolution(values: np.ndarray) -> float:
    """The step between the readings of a series (n,) that is rounded to whole ones, in its unit; 0 of another.

    All readings are whole steps apart, and the change from one to the next differs by one step and back, as that of a
    smooth course does only by rounding. A range of a few steps tells nothing: a load that is held, taken off and put on
    again has it, too.
    """
    levels = np.unique(values)
    gaps = np.diff(levels)
    gaps = gaps[gaps > MIN_GAP_SHARE * np.ptp(values)] if len(gaps) else gaps
    if not len(gaps):
        return 0.0
    for parts in range(1, MAX_STEPS_OF_A_GAP + 1):
        step = float(gaps.min()) / parts
        if np.ptp(values) < (MIN_STEPS_OF_RANGE - 0.5) * step:
            continue
        for distance in levels[levels - levels[0] > 0.5 * step] - levels[0]:  # files round, too: by longer distances
            step = float(distance) / max(np.rint(distance / step), 1.0)
        counts = (values - levels[0]) / step
        bends = np.diff(np.rint(counts), 2)
        to_and_fro = (np.abs(bends[1:]) == 1.0) & (bends[1:] == -bends[:-1])
        if np.abs(counts - np.rint(counts)).max() <= MAX_OFF_STEP and to_and_fro.any():
            return step
    return 0.0


def _noise_of_differences(values: np.ndarray, steps: np.ndarray, order: int) -> float:
    """By the median of the differences of an order, divided by the steps (n - 1,) between the values"""
    if np.ptp(steps) == 0.0:
        differences, gain = np.diff(values, order), float(comb(2 * order, order))
        return MAD_TO_STD * float(np.median(np.abs(differences))) / np.sqrt(gain)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    windows = sliding_window_view(at, order + 1)  # (n - order, order + 1)
    distances = windows[:, :, None] - windows[:, None, :] + np.eye(order + 1)
    weights = 1.0 / distances.prod(axis=2)  # of Newton's divided differences
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return MAD_TO_STD * float(np.median(np.abs((weights * sliding_window_view(values, order + 1)).sum(axis=1))))


def gradient_noise(experiment: Experiment) -> float:
    """Mean square of the noise in the reference image's gradient over that of the pattern, where the mesh is seen.

    0 where it is not known (height images, images of unknown noise), infinite where all of the gradient is noise. The
    share over the whole image, background included, is the answer where that is small already.
    """
    recording = experiment.recording
    noise = recording.noise.std_gv
    if recording.stack is None or recording.quantity != "grey" or not noise:
        return 0.0
    options = experiment.options
    degree, noise = DEGREES[options.interpolation], noise / np.sqrt(recording.n_references)
    image = recording.stack.frame(experiment.model.reference)
    iy, ix = (part.ravel() for part in np.indices(image.shape, dtype=np.int32))
    slopes = prefilter(image, degree, options.lowpass_px).gradient_at_pixels(ix, iy)
    share = gradient_noise_share(*slopes, noise, degree, options.lowpass_px)
    return share if share <= MAX_GRADIENT_NOISE else build_experiment_reference(experiment,
                                                                     experiment.model.camera).gradient_noise  # type: ignore[attr-defined]


def gradient_notes(experiment: Experiment) -> list[str]:
    """Notes for the result where the gradient of the reference image is noisy."""
    share = gradient_noise(experiment)
    if share <= MAX_GRADIENT_NOISE:
        return []
    if not np.isfinite(share):
        return ["the gradient of the reference image is noise only: there is no pattern to correlate, and the error "
                "bars are meaningless"]
    return [f"noise is {100.0 * share / (1.0 + share):.0f} % of the mean square of the reference image's gradient: "
            "the gradient is taken from the Wiener-filtered image, which keeps the error bars correct; more "
            "reference images make them smaller"]


def with_measured_noise(experiment: Experiment) -> Experiment:
    """The experiment with the covariance of its image noise, where its images show more than it assumes.

    Every camera is judged by its own images (`idic.images.quality.noise_covariance`). What is given or measured stays
    where the images agree with it, to the last bit.
    """
    views = experiment.views
    noises = [measured_noise(view) for view in views]
    cameras = tuple(replace(camera, noise=noise) for camera, noise in zip(experiment.cameras, noises[1:], strict=True))
    return replace(experiment, recording=replace(experiment.recording, noise=noises[0]), cameras=cameras)


def measured_noise(view: Experiment) -> Noise:
    """The noise of one camera, with its correlation where that matters; unchanged for heights and unknown noise.

    Images at rest decide where they tell it, else consecutive images of the test, else what a free FE-DIC leaves: one
    that differs by more than `MAX_NOISE_RATIO` times the noise shows motion or light.
    """
    noise = view.recording.noise
    recording = view.recording
    if recording.stack is None or recording.quantity != "grey" or not noise.std_gv or noise.correlated is not None:
        return noise
    reference = build_experiment_reference(view, view.model.camera)
    region = reference.pixel_map.to_image(np.ones(len(reference.pixel_map.points())), 0.0) > 0.0
    for recording in recordings(view):
        covariance = NoiseCovariance.of(recording.stack, recording.frames, region, view.options.lowpass_px)
        if covariance is not None and covariance.sum_std_gv < MAX_NOISE_RATIO * noise.std_gv:
            return _judged(noise, covariance, view.options.lowpass_px, recording.source)
    if (isinstance(view.model.camera, Camera)
            and (covariance := free_residual_noise(view, reference, region)) is not None):
        return _judged(noise, covariance, view.options.lowpass_px, FREE_RESIDUAL)
    return noise


def _judged(noise: Noise, covariance: NoiseCovariance, lowpass_px: float, source: str) -> Noise:
    ratio = covariance.sum_std_gv / noise.std_gv
    margin = max(MIN_NOISE_RATIO, 1.0 + MIN_STANDARD_ERRORS * covariance.relative_uncertainty)
    if not margin < ratio < MAX_NOISE_RATIO:
        return noise
    compared = covariance.std_gv * np.sqrt(max(pixel_gain(covariance.correlation, lowpass_px), 0.0))
    std = float(compared) if compared > MIN_NOISE_RATIO * noise.std_gv else noise.std_gv
    rows = tuple(tuple(float(value) for value in row) for row in covariance.correlation)
    return replace(noise, std_gv=std,
                   correlated=CorrelatedNoise(covariance.std_gv, covariance.sum_std_gv, rows, noise.std_gv, source))


def noise_content(recording: Recording) -> dict:
    """The noise of one camera for the result: of a compared pixel, and of sums against the gradient where it
    differs."""
    noise = recording.noise
    content = {"std_gv": noise.std_gv, "source": noise.source, "unit": recording.value_unit}
    if (correlated := noise.correlated) is None:
        return content
    source = {"covariance_source": correlated.source} if correlated.source else {}
    return content | source | {"recorded_std_gv": correlated.recorded_gv, "sum_std_gv": correlated.sum_std_gv,
                               "stated_std_gv": correlated.stated_gv,
                               "correlation": [list(row) for row in correlated.correlation]}


def _field_note(noise: Noise, neighbour_correlation: float) -> str:
    return (f"noise of measured fields: {noise.recorded_gv:.3g} µm per component of a point "
            f"({noise.source.replace('_', ' ')}), with a correlation of {neighbour_correlation:.2f} between "
            f"neighbours: sums over many points scatter as if it were {noise.in_sums_gv:.3g} µm, which weights "
            "and error bars count")


def noise_notes(experiment: Experiment) -> list[str]:
    """Notes for the result where the image noise is correlated, or larger than stated."""
    notes = []
    for view in experiment.views:
        if (correlated := view.recording.noise.correlated) is None:
            continue
        of = "" if len(experiment.views) == 1 else f" of {view.recording.camera_name}"
        if view.recording.points is not None:
            notes.append(_field_note(view.recording.noise, correlated.neighbour_correlation))
            continue
        text = (f"image noise{of}: {correlated.stated_gv:.3g} {view.recording.value_unit} "
                f"({view.recording.noise.source.replace('_', ' ')}), "
                f"but {TOLD[correlated.source]} {correlated.recorded_gv:.3g}")
        if abs(correlated.neighbour_correlation) > MIN_TOLD_CORRELATION:
            text += f" with a correlation of {correlated.neighbour_correlation:.2f} between neighbouring pixels"
        notes.append(f"{text}: sums against the gradient carry {correlated.sum_std_gv:.3g}, which weights and error "
                     f"bars count")
    return notes
