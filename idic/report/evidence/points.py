"""The measured points of some frames with the residual of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from idic.correlation import FieldReference
from idic.images import Camera
from idic.model import Experiment
from idic.report.result.record import PointMaps


def point_maps_of(experiment: Experiment, camera: Camera, reference: FieldReference, frames: Sequence[int],
                  motion: Callable[[int], np.ndarray]) -> PointMaps:
    """Displacement and residual of the points on the mesh, along the axes of the mesh; the residual without the motion
    that is the frame's own (a rigid motion, offset, tilts and bending along the normal).

    camera : at the identified parameters; motion : frame -> simulated displacement of the nodes (n_nodes, c) px
    """
    pm = reference.pixel_map
    at, row = np.unique(pm.point, return_inverse=True)
    axes = camera.jacobian(np.zeros((1, 2)))[0] * camera.pixel_size  # columns of the mesh axes, rotated and mirrored

    c = reference.n_components
    turn = np.eye(c)
    turn[:2, :2] = axes
    if c == 3:
        turn[2, 2] = camera.normal_sign()

    def along_mesh(values: np.ndarray) -> np.ndarray:
        points = np.full((len(at), c), np.nan)
        points[row, pm.component] = values / reference.row_weight
        return points @ turn

    measured, residual = [], []
    for frame in frames:
        displacements = reference.measured(experiment, frame)
        at_nodes = motion(frame)
        nodal = reference.compare(experiment, frame, at_nodes)
        frame_motion = np.linalg.pinv(nodal.bb, hermitian=True) @ nodal.rb
        rows_left = reference.compare_pixels(experiment, frame, at_nodes, frame_motion)
        measured.append(along_mesh(displacements))
        residual.append(along_mesh(np.where(rows_left.valid, rows_left.r, np.nan)))
    return PointMaps(tuple(frames), camera.inverse(pm.positions[at]), np.array(measured), np.array(residual),
                     experiment.recording.points.pitch_mm, 0.0 if reference.depth is None else reference.depth.std_um)
