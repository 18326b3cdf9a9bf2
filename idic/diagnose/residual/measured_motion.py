"""A diagnosis on the measured motion, where the images are out of register with the identified model.

The residual of an image tells a motion error to first order as long as it is smaller than the grain of the pattern.
Beyond, it is the difference of two unrelated patterns: what free motions explain of it saturates, a model that comes
nearer hardly looks better, and every score test on it is worthless. A free FE-DIC has followed the frames. Its nodal
motion takes the place of the images (`FieldPoints`): the residual is the distance of two motions, however large, and
the whole chain works on it as on the export of another DIC system.

Edges that are measured frame by frame move in the strongest modes of the measured motion
(`idic.measure.dic.boundary`): a
correction of one frame would act on all later ones of a law with a history. They stay as measured: a law that is
pixels off would bend them to its error.
"""

from __future__ import annotations

import copy
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.identification import Identification
from idic.images import Stack, StackView
from idic.measure import BoundaryStart, edge_modes, with_boundary_start
from idic.model import Experiment, FieldPoints, Measured, Noise, Recording

MAX_REGISTER_PX = 1.0  # rms of a frame; with more the residual of its image is no error of motion to first order
MIN_MISFIT_CHI2 = 10.0  # per pixel; where contrast is well above noise, an error of 1 px leaves more
MOTION_STD_PX = 0.1  # of a measured node: what regularisation and interpolation leave, far above noise
UM_PER_MM = 1e3


@dataclass(frozen=True, eq=False)
class MotionStack(StackView):
    """Measured motion in the place of the images of a stack.

    motion_um : (n_frames, n_points, 2) along columns and rows, NaN where nothing was measured
    """

    motion_um: np.ndarray

    @property
    def images(self) -> Stack:
        """The images that the motion was measured in."""
        return self.stack

    def frame(self, k: int) -> np.ndarray:
        """Motion of frame `k`  # (n_points, 2) float32, µm"""
        return self.motion_um[k].astype(np.float32)


@dataclass(frozen=True, eq=False)
class OutOfRegister:
    """How far the model is off the measured motion, and what the images say of the enriched one.

    gap_px : (n_frames,) rms over the measured nodes, 0 where none is known; image_chi2 : per pixel, of the identified
    model; enriched_chi2 : of the enriched one, fitted to the images for a few evaluations; None without one
    """

    gap_px: np.ndarray
    image_chi2: float
    enriched_chi2: float | None = None

    def content(self) -> dict:
        """The entry ``register`` of diagnosis.json."""
        return {"gap_px": self.gap_px.tolist(), "image_chi2_before": self.image_chi2,
                "image_chi2_after": self.enriched_chi2, "words": self.words}

    @property
    def words(self) -> str:
        """What it means for the diagnosis."""
        worst = int(np.argmax(self.gap_px))
        return (f"The identified model is up to {self.gap_px[worst]:.2g} px (rms, frame {worst}) off the motion that a "
                "free FE-DIC measures: the images are out of register, and their residual gives no information on "
                "the motion. "
                f"This diagnosis compares with the measured motion instead; its error is taken as {MOTION_STD_PX:g} px "
                f"per node.{self._on_images}")

    @property
    def _on_images(self) -> str:
        if self.enriched_chi2 is None:
            return ""
        return (f" Fitted to the images for a few evaluations, the enriched model lowers their chi² per pixel from "
                f"{self.image_chi2:.3g} to {self.enriched_chi2:.3g}.")


def holds_motion(recording: Recording) -> bool:
    """Whether an experiment is one of `by_motion`, or a copy of it with noise."""
    stack = recording.stack
    while isinstance(stack, StackView) and not isinstance(stack, MotionStack):
        stack = stack.stack
    return isinstance(stack, MotionStack)


def may_be_out_of_register(identification: Identification) -> bool:
    """Whether the residual of the images is so large that a free FE-DIC must tell if they are in register.

    One camera that looks at a plane, and a model whose simulation was kept.
    """
    experiment = identification.experiment
    if (experiment.recording.points is not None or experiment.recording.quantity != "grey" or len(experiment.views) != 1
            or experiment.model.n_dim != 2 or identification.stored is None or identification.point is None
            or identification.point.system is None):
        return False
    return image_chi2(identification) > MIN_MISFIT_CHI2


def image_chi2(identification: Identification) -> float:
    """Roughly chi² per pixel at the accepted point (`misfit` of the estimator): 0.8 to 1.2 for noise."""
    return identification.point.misfit(identification.experiment.options.lowpass_px)


def out_of_register(identification: Identification, u_px: np.ndarray,
                    unexplained: Collection[int] = ()) -> OutOfRegister | None:
    """How far the identified model is off the measured motion; None where the images are in register.

    u_px : (n_frames, n_nodes, 2) px, NaN where nothing was measured; unexplained : frames whose measured motion does
    not fit their images either
    """
    experiment = identification.experiment
    gaps = np.zeros(experiment.model.n_frames)
    nodes, camera = experiment.model.mesh.nodes, experiment.model.camera
    for number, u in enumerate(identification.stored()):
        frame = number + experiment.model.reference
        moved = camera.project(nodes + u) - camera.project(nodes)
        gap = ((u_px[frame] - moved) ** 2).sum(axis=1)
        if frame not in experiment.recording.excluded and frame not in unexplained and np.isfinite(gap).any():
            gaps[frame] = np.sqrt(np.nanmean(gap))
    return OutOfRegister(gaps, image_chi2(identification)) if gaps.max() > MAX_REGISTER_PX else None


def with_edge_modes(document: Mapping[str, Any], experiment: Experiment, u_px: np.ndarray) -> dict[str, Any]:
    """Edits that let measured edges move in the strongest modes of their measured motion; {} without such an edge."""
    tables, changed = copy.deepcopy(list(document.get("boundary", ()))), False
    for table in tables:
        edges = [entry for entry in experiment.model.prescribed
                 if entry.nodes == table.get("nodes") and isinstance(entry.drive, Measured)]
        if not edges:
            continue
        number = max(edge_modes(experiment, entry, u_px, MOTION_STD_PX, experiment.recording.excluded)
                     for entry in edges)
        for key in ("u", "ux", "uy"):
            drive = table.get(key)
            if drive == "measured" or (isinstance(drive, Mapping) and drive.get("measured")):
                table[key], changed = {"virtual": "dic", "modes": number, "time_modes": number}, True
    return {"boundary": tables} if changed else {}


def by_motion(experiment: Experiment, u_px: np.ndarray, excluded: Collection[int] = ()) -> Experiment:
    """The experiment with its measured motion in the place of its images.

    Points are the measured nodes within the image, in pixels of the image. Virtual edges move as measured, locked.
    """
    excluded = tuple(sorted({*experiment.recording.excluded, *excluded}))
    start = BoundaryStart.of(experiment, u_px, excluded)
    experiment = with_boundary_start(experiment, start)
    names = [name for name in experiment.model.parameters.free if name not in start.values]
    experiment = experiment.with_parameters(experiment.model.parameters.with_free(names))
    at = experiment.model.camera.project(experiment.model.mesh.nodes)
    ny, nx = experiment.recording.image_shape
    is_inside = (at >= 0.0).all(axis=1) & (at <= [nx - 1, ny - 1]).all(axis=1)
    is_measured = np.isfinite(u_px).all(axis=2).any(axis=0) & is_inside
    mm_per_px = experiment.pixel_size
    stack = MotionStack(experiment.recording.stack, UM_PER_MM * mm_per_px * u_px[:, is_measured])
    points = FieldPoints(at[is_measured], (ny, nx), mm_per_px)
    options = replace(experiment.options, brightness="none", defocus="none", lowpass_px=0.0, edge_margin_px=0,
                      border_px=0)
    return replace(experiment, recording=replace(experiment.recording, stack=stack, points=points,
                                                 quantity="displacement", mask=None, excluded=excluded,
                                                 noise=Noise(MOTION_STD_PX * UM_PER_MM * mm_per_px, "given")),
                   options=options)
