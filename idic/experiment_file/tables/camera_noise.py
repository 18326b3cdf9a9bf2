"""The noise of the main camera: given, or from still frames; uniform, or by grey value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.checks.model import corners_px, seen_nodes, seen_region, visible_cells
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.cameras import NoiseModelTable
from idic.experiment_file.checks.images_at_rest import check_exposures
from idic.fe import Mesh
from idic.images import Camera, NoiseModel, StabilisedStack, Stabiliser, Stack, drift_note, still_noise
from idic.model import Experiment, Noise

UNIFORM, BY_GREY_LEVEL = "uniform", "grey_level"
MIN_REPORTED_NOISE_RATIO = 1.3  # noise of bright over that of dark pixels (95 % and 5 % of the grey values)


class StillFrames:
    """The still frames and the pixels on the specimen."""

    def __init__(self, config: ExperimentFile, frames, mesh: Mesh, camera: Camera, file):
        self.config, self.frames, self.file = config, frames, file
        table = config.experiment
        stack = frames.stack if frames.still_stack is None else frames.still_stack
        indices = frames.still if frames.still_stack is None else range(stack.n_frames)
        self.images = [stack.frame(k) for k in indices]
        labels = frames.labels if frames.still_stack is None else stack.labels
        self.labels = [labels[k] for k in indices]
        points, cells = seen_nodes(mesh, table.kind, table.surface)
        corners = corners_px(points, cells, table.kind, table.surface, camera)
        visible = visible_cells(mesh, table.kind, table.surface, camera, frames.stack.shape)
        self.region = seen_region(corners, visible, frames.stack.shape, frames.mask)

    @property
    def drift_notes(self) -> tuple[str, ...]:
        """A note where they are not at rest."""
        if len(self.images) < 2 or len({np.shape(image) for image in self.images}) > 1:
            return ()
        note = drift_note(self.images, self.labels, self.region)
        return (note,) if note else ()

    def measured(self, measure):
        """The result of `measure(images, region)`; its errors name the key."""
        try:
            return measure(self.images, self.region)
        except InputError as error:
            raise InputError(error.what, file=self.file, key="experiment.still_frames", expected=error.expected,
                             found=error.found, remedy=error.remedy
                             or "name other frames, or leave the key out") from None


def camera_noise(config: ExperimentFile, frames, mesh: Mesh, camera: Camera, file) -> tuple[Noise, tuple[str, ...]]:
    """Noise of one image and notes; the noise stays open if neither a value nor still frames are given.

    frames : `idic.experiment_file.load.Frames`

    Raises
    ------
    InputError
        The still frames are unusable, or missing although the noise is measured by grey value.
    """
    table = config.camera
    noise_model = None if table is None else table.noise_model
    stated_std = None if table is None else table.noise_std_gv
    if noise_model not in (None, UNIFORM):
        _check_model(config, stated_std, file)
    if stated_std is not None:
        return Noise(stated_std, "given"), _drift(config, frames, mesh, camera, file)
    if not frames.still and frames.still_stack is None and not isinstance(noise_model, NoiseModelTable):
        if noise_model == BY_GREY_LEVEL:
            raise InputError("noise by grey value needs still frames", file=file,
                             key="camera.noise_model", expected="experiment.still_frames", found="none",
                             remedy="name two or more images taken at rest, or give offset_gv2 and slope_gv")
        return Noise(None, ""), ()
    still_frames = StillFrames(config, frames, mesh, camera, file)
    notes = still_frames.drift_notes
    reference = np.asarray(frames.stack.frame(frames.reference), dtype=float)[still_frames.region]
    if isinstance(noise_model, NoiseModelTable):
        noise, level_notes = _by_grey_level(NoiseModel(noise_model.offset_gv2, noise_model.slope_gv), reference,
                                            "given", file)
        return noise, (*level_notes, *notes)
    if config.experiment.quantity == "grey":
        check_exposures(still_frames.images, still_frames.labels, still_frames.region, file, "experiment.still_frames")
    model = still_frames.measured(NoiseModel.of)
    if noise_model == BY_GREY_LEVEL:
        noise, level_notes = _by_grey_level(model, reference, "still_frames", file)
        return noise, (*level_notes, *notes)
    noise = Noise(still_frames.measured(still_noise).std_gv, "still_frames")
    dark, bright = np.sqrt(model.variance(np.quantile(reference, [0.05, 0.95])))
    if config.experiment.quantity == "height" or bright < MIN_REPORTED_NOISE_RATIO * dark:
        return noise, notes
    return noise, (*notes, f"the noise grows with the intensity, from {dark:.2g} to {bright:.2g} grey values: "
                   f'[camera] noise_model = "{BY_GREY_LEVEL}" weighs every pixel by its own',)


def _drift(config: ExperimentFile, frames, mesh: Mesh, camera: Camera, file) -> tuple[str, ...]:
    """A note on still frames that are declared next to a given noise, and are not at rest."""
    if not frames.still and frames.still_stack is None:
        return ()
    return StillFrames(config, frames, mesh, camera, file).drift_notes


def _check_model(config: ExperimentFile, stated_std: float | None, file) -> None:
    """Refuse a noise model for heights, and together with a stated standard deviation that replaces it."""
    problem = None
    if config.experiment.quantity == "height":
        problem = 'quantity = "height"', "leave noise_model out: height images have no grey values"
    elif stated_std is not None:
        problem = (f"noise_std_gv = {stated_std:g}, one value for every intensity",
                   "leave out noise_model or noise_std_gv")
    if problem:
        raise InputError("noise by grey value is not possible here", file=file, key="camera.noise_model",
                         expected="grey images, and no noise_std_gv", found=problem[0], remedy=problem[1])


def _by_grey_level(model: NoiseModel, reference: np.ndarray, source: str, file) -> tuple[Noise, tuple[str, ...]]:
    level = float(reference.mean())
    if model.offset + model.slope * level <= 0.0:
        raise InputError("the noise variance is negative at the mean grey value of the specimen", file=file,
                         key="camera.noise_model", expected="offset_gv2 + slope_gv * grey value > 0",
                         found=f"{model.offset:.4g} + {model.slope:.4g} * {level:.4g}",
                         remedy="correct offset_gv2 and slope_gv")
    stabiliser = Stabiliser(model, level)
    note = (f"noise variance {model.offset:.3g} + {model.slope:.3g} I over the grey value I: grey values are "
            f"transformed; the standard deviation is then {stabiliser.std_gv:.3g} everywhere; "
            f"{level:.0f} stays {level:.0f}")
    return Noise(stabiliser.std_gv, source, stabiliser), (note,)


def with_stabilised_images(experiment: Experiment) -> Experiment:
    """The experiment with transformed grey values of the main camera if its noise depends on the grey value."""
    recording = experiment.recording
    if recording.noise.stabiliser is None:
        return experiment
    return replace(experiment, recording=replace(recording,
                                                 stack=StabilisedStack(recording.stack, recording.noise.stabiliser)))


def recorded(stack: Stack) -> Stack:
    """The recorded images, as copied into a RUN."""
    return stack.stack if isinstance(stack, StabilisedStack) else stack
