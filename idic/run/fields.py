"""What was measured and simulated at the identified parameters, frame by frame: from memory, or from a RUN folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from idic.correlation import (
    CorrelationContext, FrameResponse, ResidualMap, camera_at, channel_values, view_of, with_all_cameras,
)
from idic.diagnose import context_of
from idic.errors import InputError
from idic.measure import Seen, in_mm
from idic.identification import Identification
from idic.images import AnyCamera, Camera
from idic.model import Experiment, Model
from idic.run.judgement.accepted_point import channels_of, refuse_passed_point
from idic.run.judgement.residual_maps import residuals_of
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name
from idic.run.store.run_folders import folders_of


class Fields(Protocol):
    """Fields of an identified experiment.

    experiment : with the mesh as it was identified; camera : the main one, as it was identified
    simulated, measured : (n_frames, n_channels) channels in internal units, NaN before the reference
    """

    @property
    def experiment(self) -> Experiment: ...
    @property
    def camera(self) -> AnyCamera: ...
    @property
    def simulated(self) -> np.ndarray: ...
    @property
    def measured(self) -> np.ndarray: ...

    def u(self, frame: int) -> np.ndarray:
        """Simulated displacement of a frame, the reference or a later one  # (n_nodes, dim) mm"""
        ...

    def residual(self, frame: int) -> np.ndarray:
        """f - g(x + u) of the main camera in the reference image, NaN where nothing is compared  # (ny, nx)"""
        ...

    def u_measured(self, frame: int) -> np.ndarray:
        """Displacement by a free FE-DIC, in the plane that the main camera sees  # (n_nodes, 2) mm, NaN where not seen

        Raises
        ------
        InputError
            Nothing can be measured: height images, or no such frame.
        """
        ...

    def identified_in_memory(self) -> Identification:
        """The identification of this process.

        Raises
        ------
        InputError
            The fields are those of a RUN.
        """
        ...


@dataclass(frozen=True, eq=False)
class FieldsInMemory:
    """The fields of an identification in this process: its simulation is kept, residuals are made when they are asked
    for."""

    identification: Identification

    @cached_property
    def context(self) -> CorrelationContext:
        """Cameras, reference images and parameters of the accepted point."""
        return with_all_cameras(context_of(self.identification))

    @property
    def experiment(self) -> Experiment:
        return self.context.experiment

    @property
    def camera(self) -> AnyCamera:
        return self.context.camera

    @cached_property
    def responses(self) -> Mapping[int, FrameResponse]:
        """The simulation of the accepted point, by frame."""
        if self.identification.point is None or self.identification.point.system is None:
            raise nothing_simulated(self.identification.state.history)
        reference = self.identification.experiment.model.reference
        path = self.identification.path
        march = self.identification.march
        states: Iterable[FrameResponse] = (path.frames if path is not None
                                           else (FrameResponse.of(state, reference) for state in march()))
        return {response.frame: response for response in states}

    def identified_in_memory(self) -> Identification:
        return self.identification

    def u(self, frame: int) -> np.ndarray:
        return self.responses[checked_frame(self.experiment.model, frame)].u

    def u_measured(self, frame: int) -> np.ndarray:
        return _freely_measured(self.context, checked_frame(self.experiment.model, frame), self.u)

    def residual(self, frame: int) -> np.ndarray:
        pixels = self.pixels(checked_frame(self.experiment.model, frame, later=True))
        return self.context.reference.pixel_map.to_image(np.where(pixels.valid, pixels.r, np.nan))

    def pixels(self, frame: int, number: int = 0) -> ResidualMap:
        """The pixels of a camera in a frame, its brightness removed."""
        response, of = self.responses[frame], self.context.cameras[number]
        light = {record.frame: record.brightness_of(number) for record in self.identification.point.system.frames}
        view = view_of(of.experiment, of.camera).at(frame)
        earlier = self.responses[max(frame - 1, of.experiment.model.reference)]
        u = of.experiment.at_camera_time(of.parameters, frame, response.u, earlier.u)
        motion = view.motion(of.experiment.model.mesh.nodes, of.experiment.model.turned(u))
        return of.reference.compare_pixels(of.experiment, frame, motion, light.get(frame, np.zeros(0)))

    @cached_property
    def simulated(self) -> np.ndarray:
        experiment, parameters = self.experiment, self.identification.parameters
        table = np.full((experiment.model.n_frames, len(experiment.model.channels)), np.nan)
        for frame, response in self.responses.items():
            table[frame] = channel_values(experiment, parameters, response.channels, frame)
        return table

    @property
    def measured(self) -> np.ndarray:
        return self.experiment.model.measured_channels(self.identification.parameters)


@dataclass(frozen=True)
class FieldsOfRun:
    """The fields that a RUN folder holds, read when they are asked for."""

    run: Path
    result: Mapping

    @cached_property
    def context(self) -> RunContext:
        """The RUN, opened."""
        folders = folders_of(self.run).values()
        if len(folders) > 1:
            raise InputError("several experiments were identified together", file=self.run, expected="the RUN of one",
                             found="a joint RUN", remedy=f"load one of {', '.join(map(str, folders))}")
        context = open_run(str(self.run))
        _ = self._accepted
        refuse_passed_point(context, self.result)
        return context

    def identified_in_memory(self) -> Identification:
        raise InputError("a RUN holds no identification of this process", file=self.run,
                         expected="an identification in memory", found="a RUN",
                         remedy="idic.identify(experiment) without out")

    @cached_property
    def _accepted(self) -> Mapping:
        history = self.result.get("history", ())
        accepted = [entry for entry in history if entry["accepted"]]
        if not accepted:
            raise nothing_simulated(history)
        return accepted[-1]

    @cached_property
    def experiment(self) -> Experiment:
        experiment = self.context.experiment
        return experiment.at_geometry(experiment.model.parameters.with_values(self._accepted["values"]))

    @property
    def camera(self) -> AnyCamera:
        return camera_at(self.experiment, self.experiment.model.parameters.with_values(self._accepted["values"]))

    def u(self, frame: int) -> np.ndarray:
        k = checked_frame(self.experiment.model, frame) - self.experiment.model.reference
        return FrameArrays.open(self.context.store.group(group_name(self._accepted["evaluation"], BASE)),
                                "u").read(k, k + 1)[0]

    def u_measured(self, frame: int) -> np.ndarray:
        parameters = self.experiment.model.parameters.with_values(self._accepted["values"])
        return _freely_measured(correlation_context(self.context, parameters),
                                checked_frame(self.experiment.model, frame),
                                self.u)

    def residual(self, frame: int) -> np.ndarray:
        return self._residuals(checked_frame(self.experiment.model, frame, later=True))

    @cached_property
    def _residuals(self) -> Callable[[int], np.ndarray]:
        return residuals_of(self.context, self._accepted)

    @property
    def simulated(self) -> np.ndarray:
        return self._channels[0]

    @property
    def measured(self) -> np.ndarray:
        return self._channels[1]

    @cached_property
    def _channels(self) -> tuple[np.ndarray, np.ndarray]:
        return channels_of(self.context, self.result)


def _freely_measured(context: CorrelationContext, frame: int, simulated: Callable[[int], np.ndarray]) -> np.ndarray:
    """See `Fields.u_measured`; simulated : frame -> (n_nodes, dim) mm, from which the measurement starts."""
    experiment, camera = context.experiment, context.camera
    inputs = Seen.by(experiment, context.reference.image)
    if inputs is None or not isinstance(camera, Camera):
        raise InputError("no free FE-DIC of these images", key="source",
                         expected="grey images of a surface by a telecentric camera, or measured fields",
                         found=f"{experiment.recording.quantity} images" if inputs is None
                         else "a camera with a lens, which sees "
                         "motion towards it as motion in the plane",
                         remedy="use the simulated fields" if inputs is None else
                         "use the simulated fields, or idic.measure.dic.stereo.surface_motion with two cameras")
    nodes, view = experiment.model.mesh.nodes, view_of(experiment, camera)

    def start_px(k: int) -> np.ndarray:
        return view.at(k).motion(nodes, experiment.model.turned(simulated(k)))[:, :2]

    motion = inputs.free_motion((frame,), start_px)[0]
    return in_mm(motion, nodes, camera, camera.at(frame))


def nothing_simulated(history: Sequence[Mapping]) -> InputError:
    """The refusal to show fields of an identification whose first simulation failed."""
    reason = next((entry["message"] for entry in history if entry.get("message")), "no simulation")
    return InputError("there is no field to show", key="result", expected="an accepted simulation", found=reason,
                      remedy="correct start values, loads or boundaries, and identify again")


def checked_frame(model: Model, frame: int, later: bool = False) -> int:
    """The number of a simulated frame, counted from the end where it is negative; later : than the reference.

    Raises
    ------
    InputError
        There is no such frame.
    """
    first, n = model.reference + later, model.n_frames
    try:
        is_whole = int(frame) == frame  # a time of 2.7 s is no frame
    except (TypeError, ValueError):
        is_whole = False
    number = int(frame) + (n if frame < 0 else 0) if is_whole else -1
    if not first <= number < n:
        raise InputError("no such frame", key="frame", expected=f"{first} to {n - 1}, or -1 for the last",
                         found=repr(frame), remedy="correct the number: frames count from 0")
    return number
