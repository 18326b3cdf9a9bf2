"""What an identification takes from a free FE-DIC before its first simulation: when it needs one, and its start."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from idic.dic.boundary import virtual_boundaries
from idic.identify.two_step import is_two_step
from idic.model.drives import build_drives, mode_names
from idic.model.experiment import Experiment, Measured


def needs_free_dic(experiment: Experiment) -> bool:
    """Whether motion or noise must first be measured from the images of the main camera alone."""
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.prescribed)
    return (measured or experiment.noise.std_gv is None or starts_from_dic(experiment) or is_two_step(experiment))


def starts_from_dic(experiment: Experiment) -> bool:
    """Whether virtual boundaries take modes or starting values from a measured motion: not where all are given, nor
    with height images (these start from a body at rest)."""
    return experiment.quantity != "height" and any(
        entry.drive.kind == "dic" or set(mode_names(entry)) - set(experiment.extras.get("given", ()))
        for entry in virtual_boundaries(experiment))


def measured_start(experiment: Experiment, u_px: np.ndarray, excluded: Collection[int]) -> np.ndarray:
    """Start of the frame-local unknowns from a free FE-DIC: nodal motion on the measured edges, zero elsewhere.

    u_px : (n_frames, n_nodes, 2) px, NaN where a node was not seen or a frame was lost. Returns (n_frames, m) mm.
    """
    drives = build_drives(experiment)
    local = np.zeros((experiment.n_frames, drives.n_local))
    if not drives.measured.any():
        return local
    back = np.linalg.inv(experiment.camera.jacobian(experiment.mesh.nodes)[:, :, :2])  # (n_nodes, 2, 2) mm/px
    u = np.einsum("nij,tnj->tni", back, u_px)
    rows = {drive: int(np.flatnonzero(drives.basis[:, drive])[0]) for drive, _ in
            zip(drives.local, drives.measured, strict=False) if drives.basis[:, drive].any()}
    good = [k for k in range(experiment.n_frames) if k not in excluded and np.isfinite(u[k]).any()]
    for column, (drive, is_measured) in enumerate(zip(drives.local, drives.measured, strict=False)):
        if is_measured:
            node, component = divmod(int(drives.dofs[rows[drive]]), experiment.n_dim)
            series = u[good, node, component]
            seen = np.isfinite(series)
            if seen.any():
                local[:, column] = np.interp(np.arange(experiment.n_frames), np.array(good)[seen], series[seen])
    return local
