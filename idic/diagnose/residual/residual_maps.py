"""Residual maps of one frame in standard deviations of noise: before, after, on the held-out copy, and of noise
alone."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from idic.correlation import CorrelationContext, view_of
from idic.diagnose.residual.measured_motion import holds_motion
from idic.diagnose.residual.residual_evidence import ResidualEvidence, context_of, joined_cameras
from idic.identification import Identification


def maps_of_evidence(residual: ResidualEvidence, frame: int) -> tuple[np.ndarray, ...]:
    """Residual maps of a compared frame, one per camera  # (ny, nx), NaN outside"""
    at = int(np.flatnonzero(residual.evidence.frames == frame)[0])
    return tuple(residual_in_sigma(camera.context, frame, camera.seen_u[at]) for camera in residual.cameras)


def maps_of_identification(identification: Identification, frame: int) -> tuple[np.ndarray, ...]:
    """Residual maps of an identified point, one per camera; it is simulated up to this frame, without derivatives  #
    (ny, nx)"""
    u = next(state.u for state in identification.march()
             if state.frame + identification.experiment.model.reference == frame)
    return tuple(residual_in_sigma(context, frame, context.experiment.model.turned(u))
                 for context in joined_cameras(context_of(identification)))


def map_of_noise(like: np.ndarray, seed: int) -> np.ndarray:
    """A draw of unit noise where another map has values  # (ny, nx)"""
    return np.where(np.isfinite(like), np.random.default_rng(seed).standard_normal(like.shape), np.nan)


def residual_in_sigma(context: CorrelationContext, frame: int, u: np.ndarray) -> np.ndarray:
    """Residual of a frame over the standard deviation of the noise that its interpolation leaves  # (ny, nx), NaN
    outside

    Gain and offset of the frame (levels of height images) are removed by least squares. u : (n_nodes, dim) mm
    """
    experiment = context.experiment
    motion = view_of(experiment, context.camera).at(frame).motion(experiment.model.mesh.nodes, u)
    nodal = context.reference.compare(experiment, frame, motion)
    light = np.linalg.pinv(nodal.bb, hermitian=True) @ nodal.rb if nodal.n_brightness else np.zeros(0)
    pixels = context.reference.compare_pixels(experiment, frame, motion, light)
    noise = experiment.recording.noise.std_gv * np.sqrt(pixels.reference_gain / pixels.n_images + pixels.noise_gain)
    r = pixels.r.astype(float) / noise
    image = context.reference.pixel_map.to_image(np.where(pixels.valid, r, np.nan))
    points = experiment.recording.points if holds_motion(experiment.recording) else None
    return image if points is None else spread(image, points.positions_px)


def spread(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values at scattered points, spread to half the distance of neighbours so that a picture shows them.

    image : (ny, nx), NaN between the points; points : (n, 2) columns and rows
    """
    is_known = np.isfinite(image)
    if not is_known.any() or len(points) < 2:
        return image
    reach = 0.75 * float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))  # the corner of a square of neighbours
    distance, (row, column) = distance_transform_edt(~is_known, return_indices=True)
    return np.where(distance <= reach, image[row, column], np.nan)
