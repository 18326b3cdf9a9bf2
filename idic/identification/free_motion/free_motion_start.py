"""What an identification takes from a free FE-DIC before its first simulation: when it needs one, and its start."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from idic.measure import surface_motion, virtual_boundaries, volume_motion
from idic.model import DriveTable, Experiment, Measured


def needs_free_dic(experiment: Experiment) -> bool:
    """Whether motion or noise must first be measured from the images of the main camera alone; volumes show the
    motion in space at once."""
    if experiment.recording.quantity == "volume":
        return False
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed)
    return (measured or experiment.recording.noise.std_gv is None or starts_from_dic(experiment)
            or experiment.options.is_two_step)


def starts_from_dic(experiment: Experiment) -> bool:
    """Whether virtual boundaries take modes or starting values from a measured motion: not where all are given, nor
    with height images (these start from a body at rest)."""
    return experiment.recording.quantity != "height" and any(
        entry.drive.kind == "dic" or set(entry.mode_names) - set(experiment.model.stated_values)
        for entry in virtual_boundaries(experiment))


def needs_motion_in_space(experiment: Experiment) -> bool:
    """Whether edges of a solid start from what two cameras with a lens measure, or volumes: from a free stereo FE-DIC,
    or a free FE-DVC."""
    in_space = experiment.is_stereo or experiment.recording.quantity == "volume"
    return experiment.model.n_dim == 3 and in_space and (starts_from_dic(experiment) or any(
        isinstance(entry.drive, Measured) for entry in experiment.model.prescribed))


def motion_in_space(experiment: Experiment) -> np.ndarray:
    """Nodal motion by a free stereo FE-DIC, or FE-DVC  # (n_frames, n_nodes, 3) mm, NaN: not seen, or the frame was
    lost"""
    if experiment.recording.quantity == "volume":
        return volume_motion(experiment).u_mm
    surface = surface_motion(experiment)
    u_mm = np.full((experiment.model.n_frames, experiment.model.mesh.n_nodes, 3), np.nan)
    u_mm[:, surface.nodes] = surface.u_mm
    return u_mm


def without_edges(experiment: Experiment, lost: np.ndarray, u_mm: np.ndarray | None = None) -> list[int]:
    """Frames that hold nothing of a motion that edges take from them: between its neighbours it is interpolated, and
    no step may change it.

    lost : (n_frames,) bool, frames that a free FE-DIC does not recognise; u_mm : the motion in space, NaN in lost
    frames, where edges take it
    """
    if not any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed):
        return []
    lost = lost if u_mm is None else np.isnan(u_mm).all(axis=(1, 2))
    return [int(k) for k in np.flatnonzero(lost) if k > experiment.model.reference
            and k not in experiment.recording.excluded]


def measured_start(experiment: Experiment, u_px: np.ndarray, excluded: Collection[int],
                   u_mm: np.ndarray | None = None, nodes: np.ndarray | None = None) -> np.ndarray:
    """Start of the frame-local unknowns from a free FE-DIC: nodal motion on the measured edges, zero elsewhere.

    u_px : (n_frames, n_nodes, 2) px, NaN where a node was not seen or a frame was lost; u_mm : the motion in space,
    where `needs_motion_in_space`, in its place; nodes : whose motion both hold, `measured_nodes` among them, None: all.
    Returns (n_frames, m) mm.
    """
    model = experiment.model
    drives = DriveTable.of(experiment)
    local = np.zeros((model.n_frames, drives.n_local))
    if not drives.measured.any():
        return local
    u, place = u_mm, np.arange(model.mesh.n_nodes)
    if nodes is not None:
        place = np.full(model.mesh.n_nodes, -1)
        place[nodes] = np.arange(len(nodes))
    if u is None:
        positions = model.mesh.nodes if nodes is None else model.mesh.nodes[nodes]
        back = np.linalg.inv(model.camera.jacobian(positions)[:, :, :2])  # (n_nodes, 2, 2) mm/px
        u = np.einsum("nij,tnj->tni", back, u_px)
    good = [k for k in range(model.n_frames) if k not in excluded and np.isfinite(u[k]).any()]
    for column, (drive, is_measured) in enumerate(zip(drives.local, drives.measured, strict=False)):
        if is_measured:
            node, component = np.divmod(drives.dofs[drives.basis[:, drive] != 0.0], model.n_dim)
            if component[0] >= u.shape[2]:
                continue  # measured out of the plane: from rest
            of_nodes = u[good][:, place[node], component]  # those that move together; all but one of them are hidden
            is_seen = np.isfinite(of_nodes).any(axis=1)
            series = np.array([row[np.isfinite(row)].mean() if row_seen else np.nan
                               for row, row_seen in zip(of_nodes, is_seen, strict=True)])
            if is_seen.any():
                local[:, column] = np.interp(np.arange(model.n_frames), np.array(good)[is_seen], series[is_seen])
    return local


def measured_nodes(experiment: Experiment) -> np.ndarray:
    """The nodes whose motion is measured, of all edges together  # (n,)"""
    drives = DriveTable.of(experiment)
    rows = [drives.basis[:, drive] != 0.0 for drive, is_measured in zip(drives.local, drives.measured, strict=False)
            if is_measured]
    return np.unique(np.concatenate([drives.dofs[row] for row in rows]) // experiment.model.n_dim if rows else
                     np.zeros(0, int)).astype(int)
