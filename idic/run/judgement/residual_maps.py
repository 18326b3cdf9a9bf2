"""Residuals of an evaluated point, frame by frame: computed from the stored motion and images where they are asked for.

A map of every frame would take four times the room of 8-bit images.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from idic.correlation import Reference, ResidualMap, view_of
from idic.model import Experiment
from idic.run.prepared.context import RunContext, correlation_context
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name
from idic.run.store.system_store import load_evaluation


class PointResiduals:
    """Comparison of the images of one camera at an evaluated point.

    Parameters
    ----------
    evaluation : its number; values : of its parameters, internal units
    brightness : frame -> gain and offset per patch
    camera : number of the camera, 0 the main one
    """

    def __init__(self, context: RunContext, evaluation: int, values: Mapping[str, float],
                 brightness: Mapping[int, tuple[float, ...]], camera: int = 0):
        self._context, self._evaluation, self._brightness = context, evaluation, brightness
        self._parameters, self._camera = context.experiment.model.parameters.with_values(values), camera

    @cached_property
    def _shared(self):
        return correlation_context(self._context, self._parameters).cameras[self._camera]

    @property
    def experiment(self) -> Experiment:
        """The experiment as the camera sees it."""
        return self._shared.experiment

    @property
    def reference(self) -> Reference:
        return self._shared.reference

    @property
    def kind(self) -> str:
        """What the images show (`idic.correlation.views.view`)."""
        return view_of(self.experiment, self._shared.camera).kind

    @cached_property
    def _u(self) -> FrameArrays:
        return FrameArrays.open(self._context.store.group(group_name(self._evaluation, BASE)), "u")

    def compare(self, frame: int) -> ResidualMap:
        """Residual and validity of the pixels in a frame later than the reference."""
        experiment, k = self.experiment, frame - self._context.experiment.model.reference
        u_earlier, u = self._u.read(k - 1, k + 1)
        u = experiment.model.turned(experiment.at_camera_time(self._shared.parameters, frame, u, u_earlier))
        motion = view_of(experiment, self._shared.camera).at(frame).motion(experiment.model.mesh.nodes, u)
        return self.reference.compare_pixels(experiment, frame, motion, np.array(self._brightness.get(frame, ())))

    def map(self, frame: int) -> np.ndarray:
        """Residual in the reference image, NaN where there is no valid pixel  # (ny, nx) float32"""
        return self.as_image(self.compare(frame))

    def as_image(self, residual: ResidualMap) -> np.ndarray:
        """A comparison as a map  # (ny, nx) float32"""
        return self.reference.pixel_map.to_image(np.where(residual.valid, residual.r, np.nan)).astype(np.float32)


def residuals_of(context: RunContext, entry: Mapping, camera: int = 0) -> Callable[[int], np.ndarray | None]:
    """frame -> residual map of the point that an entry of the history of ``result.json`` describes; None where a frame
    is not later than the reference."""
    records = load_evaluation(context.store, entry["evaluation"], context.names).system.frames
    brightness = {record.frame: tuple(record.brightness_of(camera).tolist()) for record in records}
    at = PointResiduals(context, entry["evaluation"], entry["values"], brightness, camera)
    model = context.experiment.model
    return lambda frame: at.map(frame) if model.reference < frame < model.n_frames else None
