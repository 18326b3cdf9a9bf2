"""An experiment: what was recorded, and the model that is compared with it.

Records only: `idic.experiment_file` reads files, `idic.model.forward` simulates a model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from idic.fe import Coarse
from idic.images import PlacedCamera
from idic.model.records.gauges import Gauge
from idic.model.records.model import Model
from idic.model.records.options import Options, Stage
from idic.model.records.parts import TemperatureField
from idic.model.records.recording import CAMERA_TIME, FurtherCamera, ReadMask, Recording
from idic.parameters import ParameterSet


@dataclass(frozen=True)
class Experiment:
    """A recording and its model; docs/experiment-file.md has the file that they are read from."""

    title: str
    folder: str
    recording: Recording
    model: Model
    cameras: tuple[FurtherCamera, ...] = ()
    stages: tuple[Stage, ...] = ()
    options: Options = field(default_factory=Options)
    gauges: tuple[Gauge, ...] = ()  # where the report reads fields off
    notes: tuple[str, ...] = ()  # assumptions on reading; shown by `check` and in the report
    setup: Mapping[str, Any] = field(default_factory=dict)  # what the user wrote of camera, lens and rig
    written: frozenset[str] = frozenset()  # keys that its file has, dotted: `Remedies.written`

    def with_parameters(self, parameters: ParameterSet) -> Experiment:
        """The experiment with these parameters in the place of those of its model."""
        return replace(self, model=replace(self.model, parameters=parameters))

    def at_geometry(self, parameters: ParameterSet) -> Experiment:
        """The experiment with the mesh morphed to these parameters; see `Model.at_geometry`."""
        model = self.model.at_geometry(parameters)
        return self if model is self.model else replace(self, model=model)

    def on_coarse_mesh(self, coarse: Coarse) -> Experiment:
        """The experiment on a mesh whose nodes are a subset of the present ones, without a known error."""
        temperatures = tuple(
            replace(entry, drive=replace(entry.drive, values=entry.drive.values[:, coarse.nodes]))
            if isinstance(entry.drive, TemperatureField) else entry for entry in self.model.temperatures)
        return replace(self, model=replace(self.model, mesh=coarse.mesh, temperatures=temperatures, motion_error=None))

    @property
    def voxel_mask(self) -> ReadMask | None:
        """Reads blocks of the mask of volumes, True: compared; None: all voxels of the mesh are."""
        recording = self.recording
        if recording.voxel_mask is None:
            return None
        return recording.voxel_mask(recording.volumes, recording.averaged or (self.model.reference,))

    @property
    def time_offset(self) -> str:
        """The name of the degree of freedom: how much later this camera takes its images than the main one."""
        return f"{self.recording.camera_name}.{CAMERA_TIME}"

    def at_camera_time(self, parameters: ParameterSet, frame: int, u: np.ndarray, u_earlier: np.ndarray,
                       earlier_frame: int | None = None) -> np.ndarray:
        """The motion when this camera takes its image of a frame  # (n_nodes, d) mm

        u, u_earlier : of this frame and of an earlier one, by default the one before
        """
        if self.time_offset not in parameters or frame <= self.model.reference:
            return u
        times, earlier = self.model.times, frame - 1 if earlier_frame is None else earlier_frame
        return u + parameters[self.time_offset].value * (u - u_earlier) / (times[frame] - times[earlier])

    @property
    def views(self) -> tuple[Experiment, ...]:
        """The experiment as each camera sees it, the main camera first: images, mask, surface, noise, axes of the mesh.

        To correlate with only: what moves the simulation stays in the axes of the whole.
        """
        return (self, *(self._seen_by(camera) for camera in self.cameras))

    def _seen_by(self, entry: FurtherCamera) -> Experiment:
        mesh = self.model.mesh
        if entry.axis_order:
            mesh = replace(mesh, nodes=mesh.nodes[:, list(entry.axis_order)])
        sees_back = isinstance(entry.camera, PlacedCamera) and entry.camera.side == -self.surface_side
        model = replace(self.model, mesh=mesh, camera=entry.camera, surface=entry.surface,
                        axis_order=entry.axis_order, sees_back=sees_back)
        recording = replace(self.recording, stack=entry.stack, labels=entry.labels, noise=entry.noise, mask=entry.mask,
                            camera_name=entry.name, still_stack=None, main_labels=self.recording.labels)
        return replace(self, recording=recording, model=model, cameras=())

    @property
    def surface_side(self) -> int:
        """+1 or -1: from which side of a sheet in plane stress its change of thickness is seen, by cameras with a lens
        (the first of them, see `Model.sees_back`) or by points of three coordinates.

        0: there is none, the thickness is not known, or nothing shows motion out of the plane.
        """
        model, points = self.model, self.recording.points
        if points is not None:
            return 0 if points.depth is None else round(points.depth.side * model.camera.normal_sign())
        placed = [camera for camera in (model.camera, *(entry.camera for entry in self.cameras))
                  if isinstance(camera, PlacedCamera)]
        if model.kind != "plane_stress" or model.thickness is None or not placed:
            return 0
        return placed[0].side

    @property
    def is_stereo(self) -> bool:
        """Whether two cameras with a lens see the specimen."""
        return sum(isinstance(camera, PlacedCamera) for camera in
                   (self.model.camera, *(view.camera for view in self.cameras))) > 1

    @property
    def sees_space(self) -> bool:
        """Whether all three components of a motion are observed: by two cameras with a lens, in measured fields or in
        volumes."""
        points = self.recording.points
        if self.recording.quantity == "volume":
            return True
        return self.is_stereo if points is None else points.n_components == 3

    @property
    def pixel_size(self) -> float:
        """Length of one pixel in mesh units (mm)."""
        return self.model.camera.pixel_size

    def correlated_frames(self, frames: Sequence[int]) -> list[int]:
        """Frames that enter the sums: later than the reference and not excluded."""
        return [int(k) for k in frames if k > self.model.reference and k not in self.recording.excluded]
