"""A cross-section seen from above, for a report: profiles frame by frame, and a free measurement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from idic.correlation import SectionReference, section_motion
from idic.measure import section_field, smoothing_length
from idic.model import Experiment, Recording
from idic.report.result.record import FrameView, FreeFields, NoiseFloor, SectionProfile

SEED = 20  # of the noise of the still image


def section_fields(recording: Recording, reference: SectionReference, columns_px: np.ndarray, frames: Sequence[int],
                   motion: Callable[[int], np.ndarray]) -> FreeFields | None:
    """Free motion of the section in some frames, started from the simulated one.

    columns_px : (n_nodes,) column of the nodes in the reference image
    motion : frame -> simulated column and row displacement (px) and height of the nodes  # (n_nodes, 3)
    """
    differences, rises, residuals, chi2 = [], [], [], []
    for frame in frames:
        start = motion(frame)
        fit = section_field(reference, recording.stack.frame(frame), start, columns_px)
        if not fit.residual.valid.any():
            return None
        away = np.full_like(start, np.nan)
        away[fit.nodes] = (fit.motion - start)[fit.nodes]
        differences.append(away[:, :2])
        rises.append(away[:, 2])
        residual = np.where(fit.residual.valid, fit.residual.r, np.nan)
        residuals.append(reference.pixel_map.to_image(residual))
        chi2.append(fit.chi2_dof(recording.noise.std_gv))
    if not frames:
        return None
    return FreeFields(tuple(frames), np.array(differences), np.array(residuals, dtype=np.float32), np.array(chi2),
                      smoothing_length(reference, columns_px), np.array(rises))


def with_section_floor(floor: NoiseFloor, experiment: Experiment, reference: SectionReference,
                       columns_px: np.ndarray) -> NoiseFloor:
    """The floor with the free measurement of a still image: the reference with the noise of a difference."""
    recording = experiment.recording
    sigma, averaged = recording.noise.std_gv, recording.averaged or (experiment.model.reference,)
    if not sigma:
        return floor
    still = np.mean([np.asarray(recording.stack.frame(k), dtype=float) for k in averaged], axis=0)
    noise = np.random.default_rng(SEED).standard_normal(still.shape)
    still = still + sigma * np.sqrt(1.0 + 1.0 / len(averaged)) * noise
    fit = section_field(reference, still, np.zeros((len(columns_px), 3)), columns_px)
    moved = section_motion(reference.pixel_map, fit.motion)
    px, strain, rise = (float(np.sqrt(np.mean(np.square(v)))) for v in (moved.u, moved.du, moved.h))
    return replace(floor, free_px=px, free_strain=strain, free_rise=rise)


def with_profiles(views: Sequence[FrameView], reference: SectionReference,
                  motion: Callable[[int], np.ndarray]) -> tuple[FrameView, ...]:
    """The views with their profiles, as far as their residuals are there."""
    return tuple(view if view.residual is None else replace(view, profile=_profile(view, reference, motion(view.frame)))
                 for view in views)


def _profile(view: FrameView, reference: SectionReference, motion: np.ndarray) -> SectionProfile:
    pm = reference.pixel_map
    order = np.argsort(pm.column)
    at = (pm.column + section_motion(pm, motion).u)[order]
    misfit = np.asarray(view.residual, dtype=float)[:, pm.column[order]]
    compared = np.isfinite(misfit)
    heights = _at_columns(np.asarray(view.image, dtype=float), at)
    count = compared.sum(axis=0)
    means = [np.where(count > 0, np.where(compared, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
             for values in (heights, misfit)]
    return SectionProfile(at, means[0], means[1], count)


def _at_columns(image: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Every row between its columns, straight lines  # (ny, nx) -> (ny, m)"""
    floor_column = np.clip(np.floor(at).astype(int), 0, image.shape[1] - 2)
    part = np.clip(at - floor_column, 0.0, 1.0)
    return (1.0 - part) * image[:, floor_column] + part * image[:, floor_column + 1]
