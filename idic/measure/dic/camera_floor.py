"""The camera's own floor: what images at rest show without mechanics.

A free FE-DIC measures every still frame. Rigid motion is removed, and so are the leading motions of the loaded frames
where the specimen has been under load: they may be its permanent strain. Of the rest the variance that image noise
gives is subtracted:

    floor^2 = mean over frames and nodes of (e^2 - v),      v = var(e) by image noise
    (`idic.measure.dic.frame.DicFrame.node_std`)

What is left is the camera's: drift of light and focus, heat haze, interpolation and aliasing of a moved pattern. It is
no smaller in a loaded frame, and no law may be blamed for a motion of that size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from idic.correlation import FieldReference, ReferenceImage, frame_spline
from idic.measure.dic.field import field_frame
from idic.measure.dic.frame import DicFrame, dic_frame, gradient_share
from idic.measure.dic.regularisation import Regularisation, Smoother, build_smoother
from idic.measure.dic.status import is_recognised
from idic.measure.dic.still import MAX_LEVEL_SHARE, StillFrames, declared_stack, without_rigid
from idic.images import Stack, prefilter
from idic.model import Experiment

# regularisation length over the distance of the nodes: twice that of a measured motion, half its noise
LENGTH_NODES = 4.0
MIN_LENGTH_PX = 48.0
MAX_STILL_FRAMES = 6  # measured, spread over those found: a few passes over an image each
N_LEADING = 3  # motions of the loaded frames that may be the specimen's: elastic, its change under load, plastic
N_LOADED_FRAMES = 4  # that the leading motions are taken from, spread over the test
N_SAMPLED_NODES = 120  # nodes whose noise is computed; the others have that of the nearest
MIN_FLOOR_Z = 2.0  # standard errors of floor^2; below, the still frames show noise alone
SHARED_NOISE_SQUARE = 0.25  # correlation of e^2 of two frames: half of their variance is the reference image's
MAX_NODES = 60_000  # above, a free displacement takes longer than the rest of a report

Motion = Callable[[int], np.ndarray]


@dataclass(frozen=True, eq=False)
class CameraFloor:
    """The camera's floor of one recording.

    Attributes
    ----------
    px : float
        Root mean square over specimen and frames, per component, image noise subtracted; 0 where noise explains it.
    bound_px : float
        px that the still frames exclude: estimate plus two standard errors.
    nodes_px : array (n_nodes,)
        The same by region, 0 at nodes that are not seen.
    length_px : float
        Size of a region: shorter waves are smoothed away.
    frames : tuple of int
        Still frames that it was measured in; numbers of the separate images where `separate`.
    source : str
        See `idic.measure.dic.still.StillFrames`.
    drift_px : tuple of float
        Rigid motion (rms over the specimen) of each of them.
    separate : bool
    """

    px: float
    bound_px: float
    nodes_px: np.ndarray
    length_px: float
    frames: tuple[int, ...]
    source: str
    drift_px: tuple[float, ...]
    separate: bool = False

    @classmethod
    def of(cls, experiment: Experiment, reference: ReferenceImage, still: StillFrames,
           motion: Motion | None = None) -> CameraFloor | None:
        """Measure the floor in the still frames; None where there is none, or none that the free FE-DIC recognises.

        Parameters
        ----------
        experiment : Experiment
            View of one camera, image noise known.
        reference : ReferenceImage
            Of that view (`idic.correlation.experiment_reference.build_experiment_reference`), grey.
        motion : callable, optional
            Frame -> displacement of the nodes (n_nodes, 2) px, NaN where unknown: the start of a still frame, and the
            motions of the specimen.
        """
        model, recording = experiment.model, experiment.recording
        if not still.found or not recording.noise.std_gv or model.mesh.n_nodes > MAX_NODES:
            return None
        cells, at = model.mesh.surface_cells(model.surface), reference.pixel_map.nodes_px
        size = build_smoother(at, cells, Regularisation()).size_px
        least = MIN_LENGTH_PX if recording.points is None else 0.0
        smoother = build_smoother(at, cells, Regularisation("mechanical", max(LENGTH_NODES * size, least)))
        measured = list(_measured(experiment, reference, smoother, still, motion))
        if not measured:
            return None
        nodes = np.all([np.isfinite(frame.u_px).all(axis=1) for _, frame in measured], axis=0)
        nodes &= measured[0][1].factorisation.measured
        leading = _leading(experiment, reference, smoother, still, motion, nodes)
        noise = _NodeNoise(reference, measured[0][1], experiment, nodes)
        floors = []
        for number, frame in measured:
            u = frame.u_px[nodes].reshape(1, -1)
            warp = without_rigid(u, at[nodes])
            drift = float(np.sqrt(np.mean((u - warp) ** 2)))
            if number in still.unloaded and leading is not None:
                if np.abs(warp @ leading[0][0]) > MAX_LEVEL_SHARE * leading[1]:
                    continue  # a permanent strain: no camera's
                warp = without_rigid(u, at[nodes], leading[0])
            warp = warp.reshape(-1, 2)
            in_reference = number in recording.averaged and not still.separate
            floors.append(_StillFrameFloor(number, drift, noise.excess(warp, in_reference),
                                float(noise.variance(in_reference).mean())))
        return _floor(floors, noise, nodes, smoother, still) if floors else None


@dataclass(frozen=True, eq=False)
class _StillFrameFloor:
    """One still frame: its rigid motion, px, e^2 - v of every node (m,), px^2, and the mean of v."""

    number: int
    drift_px: float
    excess: np.ndarray
    variance: float


def _measured(experiment: Experiment, reference: ReferenceImage, smoother: Smoother, still: StillFrames,
              motion: Motion | None) -> Iterator[tuple[int, DicFrame]]:
    """Number and free displacement of the still frames that show the pattern of the reference image."""
    stack, numbers = _images(experiment, still)
    for k in numbers:
        if isinstance(reference, FieldReference):
            field = field_frame(reference, reference.measured(experiment, k), smoother)
            if field is not None:
                yield k, field
            continue
        spline = prefilter(stack.frame(k), reference.degree, experiment.options.lowpass_px)
        start = np.zeros((experiment.model.mesh.n_nodes, 2))
        if motion is not None and not still.separate:
            start = np.nan_to_num(motion(k))
        frame = dic_frame(reference, spline, start, smoother, experiment.options.brightness)
        if frame.converged and frame.factorisation is not None and is_recognised(reference, frame):
            yield k, frame


def _images(experiment: Experiment, still: StillFrames) -> tuple[Stack, list[int]]:
    """The stack of the still images, and at most `MAX_STILL_FRAMES` of their numbers."""
    if still.separate:
        stack = declared_stack(experiment.recording)
        numbers = list(range(stack.n_frames))
    else:
        stack = experiment.recording.stack
        averaged = len(experiment.recording.averaged) > 1
        numbers = [k for k in still.frames if averaged or k != experiment.model.reference]
    picks = np.unique(np.linspace(0, len(numbers) - 1, min(len(numbers), MAX_STILL_FRAMES)).round().astype(int))
    return stack, [numbers[i] for i in picks]


def _leading(experiment: Experiment, reference: ReferenceImage, smoother: Smoother, still: StillFrames,
             motion: Motion | None, nodes: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Leading measured motions of loaded frames (at most N_LEADING, 2 m), largest amplitude of the first.

    None where no frame was at rest after the load: nothing can be a permanent strain.
    """
    loaded = [k for k in experiment.correlated_frames(range(experiment.model.n_frames)) if k not in still.frames]
    if not still.unloaded or motion is None or not loaded:
        return None
    picks = np.unique(np.linspace(0, len(loaded) - 1, N_LOADED_FRAMES + 1).round().astype(int)[1:])
    motions = []
    for k in (loaded[i] for i in picks):
        if isinstance(reference, FieldReference):
            field = field_frame(reference, reference.measured(experiment, k), smoother)
            motions += [] if field is None else [field.u_full_px[nodes].ravel()]
            continue
        spline = frame_spline(experiment, k)
        frame = dic_frame(reference, spline, np.nan_to_num(motion(k)), smoother, experiment.options.brightness)
        if is_recognised(reference, frame):
            motions.append(frame.u_full_px[nodes].ravel())
    if not motions:
        return None
    warps = without_rigid(np.array(motions), reference.pixel_map.nodes_px[nodes])
    vectors = np.linalg.svd(warps, full_matrices=False)[2][:N_LEADING]
    return vectors, float(np.abs(warps @ vectors[0]).max())


class _NodeNoise:
    """Variance of the displacement of the nodes by image noise, and how many motions are independent."""

    def __init__(self, reference: ReferenceImage, frame: DicFrame, experiment: Experiment, nodes: np.ndarray):
        numbers = np.flatnonzero(nodes)
        sample = numbers[np.unique(np.linspace(0, len(numbers) - 1, min(len(numbers), N_SAMPLED_NODES)).astype(int))]
        dofs = (2 * sample[:, None] + [0, 1]).ravel()
        unit = np.zeros((2 * len(frame.u_px), len(dofs)))
        unit[dofs, np.arange(len(dofs))] = 1.0
        x = frame.factorisation.lu.solve(unit)
        gram = x.T @ (frame.hessian @ x)
        self.sigma2 = experiment.recording.noise.in_sums_gv**2 * gradient_share(reference)
        self.kappa, self.n_images = frame.kappa, reference.n_images
        at = reference.pixel_map.nodes_px
        gains = np.diagonal(gram).reshape(-1, 2).mean(axis=1)
        self.gains = gains[scipy.spatial.cKDTree(at[sample]).query(at[numbers])[1]]  # (m,)
        share = len(numbers) / len(sample)
        diagonal = float((np.diagonal(gram) ** 2).sum())
        squares = share * diagonal + share**2 * (float((gram**2).sum()) - diagonal)
        self.n_independent = float((share * np.trace(gram)) ** 2 / squares)

    def variance(self, in_reference: bool) -> np.ndarray:
        """Variance per component  # (m,) px^2; in_reference : the frame is one of those averaged to the reference."""
        reference_share = -1.0 / self.n_images if in_reference else 1.0 / self.n_images
        return self.sigma2 * max(self.kappa + reference_share, 0.0) * self.gains

    def excess(self, warp: np.ndarray, in_reference: bool) -> np.ndarray:
        """e^2 - v  # (m, 2) px -> (m,) px^2; an averaged frame has lost its part of the mean."""
        share = 1.0 - 1.0 / self.n_images if in_reference else 1.0
        return (np.mean(warp**2, axis=1) - self.variance(in_reference)) / share**2


def _floor(floors: list[_StillFrameFloor], noise: _NodeNoise, nodes: np.ndarray, smoother: Smoother,
           still: StillFrames) -> CameraFloor:
    mean = np.mean([floor.excess for floor in floors], axis=0)  # (m,) px^2
    shared = (1.0 + SHARED_NOISE_SQUARE * (len(floors) - 1)) / len(floors)
    error = float(np.mean([floor.variance for floor in floors])) * np.sqrt(2.0 / noise.n_independent * shared)
    square = float(mean.mean())
    px = float(np.sqrt(square)) if square > MIN_FLOOR_Z * error else 0.0
    nodal_px = np.zeros(len(nodes))
    if px:
        local = np.zeros(len(nodes))
        local[nodes] = mean
        rings = max(1, round(smoother.length_px / smoother.size_px))
        local = np.maximum(_averaged(local, nodes, smoother, rings), (0.5 * px) ** 2)  # a region is a small sample
        nodal_px[nodes] = np.sqrt(local[nodes] * square / local[nodes].mean())
    return CameraFloor(px, float(np.sqrt(max(square, 0.0) + MIN_FLOOR_Z * error)), nodal_px, smoother.length_px,
                       tuple(floor.number for floor in floors), still.source, tuple(floor.drift_px for floor in floors),
                       still.separate)


def _averaged(values: np.ndarray, nodes: np.ndarray, smoother: Smoother, rings: int) -> np.ndarray:
    """Means over the neighbours that are seen, as often as `rings`  # (n_nodes,)"""
    weight = smoother.neighbours.astype(float) * nodes.astype(float)[None, :]
    total = np.asarray(weight.sum(axis=1)).ravel()
    for _ in range(rings):
        values = np.where(nodes, (weight @ values) / np.maximum(total, 1e-300), 0.0)
    return values
