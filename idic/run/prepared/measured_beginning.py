"""What a free FE-DIC leaves an identification to begin with: excluded frames, frame-local unknowns, edges, noise.

A RUN reads the FE-DIC from its store (`prepare`), an identification in memory has just made it (`in_memory`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from idic.errors import InputError
from idic.identification import measured_noise, measured_start, without_edges
from idic.measure import BoundaryStart
from idic.model import DriveTable, Experiment, Noise


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """What the free FE-DIC of the main camera says of the frames.

    u_px : (n_frames, n, 2) px of `nodes`, None: of all; unexplained, lost : (n_frames,) bool
    in_space : (n_frames, n_nodes, 3) mm by a free stereo FE-DIC; None where it is not needed
    """

    u_px: np.ndarray
    unexplained: np.ndarray
    lost: np.ndarray
    nodes: np.ndarray | None = None
    in_space: np.ndarray | None = None


def motion_of_volumes(u_mm: np.ndarray) -> FreeMotion:
    """A free FE-DVC as that motion  # (n_frames, n_nodes, 3) mm"""
    explained = np.zeros(len(u_mm), dtype=bool)
    return FreeMotion(u_mm[:, :, :2], explained, np.isnan(u_mm).all(axis=(1, 2)), in_space=u_mm)


@dataclass(frozen=True, eq=False)
class Beginning:
    """What is known before the first simulation.

    excluded : frames, by the user or because they show nothing; local : (n_frames, m) mm, start of the frame-local
    unknowns; boundary : of virtual boundaries
    """

    excluded: tuple[int, ...]
    local: np.ndarray
    boundary: BoundaryStart = field(default_factory=BoundaryStart)


def beginning_of(experiment: Experiment, motion: FreeMotion | None) -> Beginning:
    """What to begin with; motion : None where no free FE-DIC is needed.

    Raises
    ------
    InputError
        The free FE-DIC follows the specimen in no frame after the reference.
    """
    if motion is None:
        return Beginning(tuple(experiment.recording.excluded),
                         np.zeros((experiment.model.n_frames, DriveTable.of(experiment).n_local)))
    excluded = list(experiment.recording.excluded)
    excluded += [int(k) for k in np.flatnonzero(motion.unexplained) if int(k) not in excluded]
    excluded += [k for k in without_edges(experiment, motion.lost, motion.in_space) if k not in excluded]
    _require_frames(experiment, excluded)
    local = measured_start(experiment, motion.u_px, excluded, motion.in_space,
                           motion.nodes if motion.in_space is None else None)
    return Beginning(tuple(excluded), local, BoundaryStart.of(experiment, motion.u_px, excluded, motion.in_space))


def _require_frames(experiment: Experiment, excluded: list[int]) -> None:
    compared = set(range(experiment.model.reference + 1, experiment.model.n_frames)) - set(excluded)
    if not compared and len(excluded) > len(experiment.recording.excluded):
        raise InputError("no frame after the reference can be compared", key="experiment.images",
                         expected="images on which the speckle is followed from the reference on",
                         found=f"{len(excluded) - len(experiment.recording.excluded)} frames with another pattern",
                         remedy="look at the images and at the place of the mesh: idic check")


def cameras_to_measure(experiment: Experiment) -> list[int]:
    """The numbers of the further cameras (from 1) that need a free FE-DIC of their own."""
    return [number for number, camera in enumerate(experiment.cameras, 1)
            if camera.noise.std_gv is None or experiment.options.is_two_step]


def camera_noises(experiment: Experiment, free_noises: Mapping[int, float], excluded: tuple[int, ...]) -> list[Noise]:
    """The noise of every camera: given, else of its free FE-DIC; and its covariance where consecutive images show one.

    free_noises : GV, by the number of the camera (0: the main one)
    """
    noises = []
    for number, view in enumerate(experiment.views):
        noise = view.recording.noise
        if noise.std_gv is None:
            noise = replace(noise, std_gv=float(free_noises[number]), source="residual_of_free_dic")
        noises.append(measured_noise(replace(view, recording=replace(view.recording, noise=noise, excluded=excluded))))
    return noises
