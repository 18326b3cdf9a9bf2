"""Virtual boundaries from a measured motion: starting values of their modes, and the modes of kind "dic".

The motion of an edge, U (frames x nodes), is read off a free FE-DIC. B-splines and polynomials start from its least
squares projection, courses A U shapes^T; kind "dic" takes its modes from the singular value decomposition

    U ~ sum_i  s_i  course_i  shape_i^T

of which the strongest become shapes and courses, and the amplitudes start at s_i (i = j) and zero (i != j).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from idic.model import COMPONENTS, Experiment, Model, Parametrised, Prescribed, mode_shapes

_MAX_FIT_RMS_PX = 0.1  # of the measured motion less its modes; with more, further modes are recommended


@dataclass(frozen=True)
class BoundaryStart:
    """Where the virtual boundaries of an experiment start.

    values : starting value per degree of freedom, mm; modes : per ``SET.component`` of kind "dic" its shapes
    (n_nodes of the set, modes) and courses (n_frames, time_modes); notes : what was done, in words.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    modes: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, experiment: Experiment, u_px: np.ndarray, excluded: Collection[int] = (),
           u_mm: np.ndarray | None = None) -> BoundaryStart:
        """Starting values and measured modes from a free FE-DIC.

        Parameters
        ----------
        u_px : (n_frames, n_nodes, 2) px, NaN where a node was not seen or a frame was lost
        excluded : frames to leave out
        u_mm : (n_frames, n_nodes, 3) mm, the motion in space where two cameras measured it, in the place of u_px

        Values that the user gave (``Model.stated_values``) stay; the others are fitted together with them.
        """
        model = experiment.model
        values, modes, notes = {}, {}, []
        for entry in virtual_boundaries(experiment):
            stem, drive = f"boundary.{entry.nodes}.{entry.component}", entry.drive
            nodes = model.node_set(entry.nodes)
            motion = edge_motion(model, entry, u_px, excluded, u_mm)  # (n_frames, n) mm
            in_images = np.isfinite(motion).all(axis=0)
            if not in_images.any():
                notes.append(f"{stem}: no part of this edge is in the images; it starts from rest")
                continue
            if drive.kind == "dic":
                shapes, courses, amplitudes = _strongest(motion, model.mesh.nodes[nodes], in_images, drive)
                modes[f"{entry.nodes}.{entry.component}"] = shapes, courses
            else:
                shapes, courses = mode_shapes(model, nodes, drive, stem)
                amplitudes = None
            names = entry.mode_names
            given_names = {name for name in names if name in model.stated_values}
            current_values = np.array([model.parameters[name].value for name in names])
            is_free = np.array([name not in given_names for name in names])
            if amplitudes is None or given_names:
                amplitudes = _projected(motion[:, in_images], shapes[in_images], courses, current_values, is_free)
            amplitudes = np.where(is_free, amplitudes, current_values)
            values |= {name: float(value) for name, value in zip(names, amplitudes, strict=True)
                       if name not in given_names}
            notes.append(_note(stem, experiment, motion[:, in_images], shapes[in_images], courses, amplitudes,
                               len(given_names), 1.0 - in_images.mean()))
        return cls(values, modes, tuple(notes))


def virtual_boundaries(experiment: Experiment) -> tuple[Prescribed, ...]:
    """The parametrised drives of an experiment that a free FE-DIC can see."""
    model = experiment.model
    section = model.surface is not None and model.kind != "solid"
    if experiment.recording.stack is None or experiment.recording.quantity == "height" or section:
        return ()
    seen_components = "xyz" if experiment.is_stereo or experiment.recording.quantity == "volume" else "xy"
    return tuple(p for p in model.prescribed
                 if isinstance(p.drive, Parametrised) and p.component in seen_components)


def with_boundary_start(experiment: Experiment, start: BoundaryStart) -> Experiment:
    """The experiment with these modes, starting values and notes."""
    prescribed = []
    for entry in experiment.model.prescribed:
        mode = start.modes.get(f"{entry.nodes}.{entry.component}")
        if mode is not None and isinstance(entry.drive, Parametrised):
            entry = replace(entry, drive=replace(entry.drive, shapes=mode[0], courses=mode[1]))
        prescribed.append(entry)
    return replace(experiment, model=replace(experiment.model, prescribed=tuple(prescribed),
                                             parameters=experiment.model.parameters.with_values(start.values)),
                   notes=(*experiment.notes, *start.notes))


def edge_motion(model: Model, entry: Prescribed, u_px: np.ndarray, excluded: Collection[int] = (),
                u_mm: np.ndarray | None = None) -> np.ndarray:
    """Measured motion of a set of nodes, frames that are missing bridged in time  # (n_frames, n) mm, NaN: not seen"""
    nodes, component = model.node_set(entry.nodes), COMPONENTS.index(entry.component)
    camera, first = model.camera, model.reference
    motion = np.full((model.n_frames, len(nodes)), np.nan)
    if u_mm is not None:
        later = [k for k in range(first, model.n_frames) if k not in excluded]
        motion[later] = u_mm[later][:, nodes, component]
    else:
        rest_px = camera.project(model.mesh.nodes[nodes])
        plane = camera.inverse(rest_px)
        for k in range(first, model.n_frames):
            moved = u_px[k, nodes, :2]
            measured = np.isfinite(moved).all(axis=1)
            if k not in excluded and measured.any():
                motion[k, measured] = (camera.inverse(rest_px[measured] + moved[measured]) - plane[measured])[:,
                                                                                                              component]
    frames = np.arange(model.n_frames)
    motion[:first + 1] = 0.0
    for column in motion.T:
        measured = np.isfinite(column)
        if measured[first + 1:].any():
            column[~measured] = np.interp(frames[~measured], frames[measured], column[measured])
    return motion


def edge_modes(experiment: Experiment, entry: Prescribed, u_px: np.ndarray, max_residual_px: float,
               excluded: Collection[int] = ()) -> int:
    """Fewest modes, in space and in time, that leave less than `max_residual_px` (rms) of a measured edge motion."""
    motion = edge_motion(experiment.model, entry, u_px, excluded) / experiment.pixel_size
    motion = motion[:, np.isfinite(motion).all(axis=0)]
    strength = np.linalg.svd(motion, compute_uv=False) ** 2
    residual_px = np.sqrt(np.maximum(strength.sum() - np.cumsum(strength), 0.0) / max(motion.size, 1))
    return 1 + int(np.argmax(residual_px <= max_residual_px)) if len(residual_px) else 1


def _projected(motion: np.ndarray, shapes: np.ndarray, courses: np.ndarray, values: np.ndarray,
               is_free: np.ndarray) -> np.ndarray:
    """Least squares amplitudes of the free modes, the others given  # (modes * time_modes,) mm

    By the normal equations, whose matrix is a Kronecker product; B-splines are well conditioned, and
    undetermined modes get the smallest amplitudes.
    """
    matrix = np.kron(shapes.T @ shapes, courses.T @ courses)
    rhs = (shapes.T @ motion.T @ courses).ravel() - matrix @ np.where(is_free, 0.0, values)
    amplitudes = values.copy()
    if is_free.any():
        amplitudes[is_free] = np.linalg.lstsq(matrix[np.ix_(is_free, is_free)], rhs[is_free], rcond=1e-10)[0]
    return amplitudes


def _strongest(motion: np.ndarray, points: np.ndarray, in_images: np.ndarray,
               drive: Parametrised) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The strongest shapes and courses of a motion, each of largest value 1, and the amplitudes of the motion in them.

    Nodes that are not seen move like the nearest one that is.
    """
    u, s, vt = np.linalg.svd(motion[:, in_images], full_matrices=False)
    shapes, courses = np.zeros((len(in_images), drive.modes)), np.zeros((len(motion), drive.time_modes))
    amplitudes = np.zeros((drive.modes, drive.time_modes))
    nearest = np.argmin(np.linalg.norm(points[:, None] - points[in_images][None], axis=2), axis=1)  # (n,)
    for i in range(min(len(s), max(drive.modes, drive.time_modes))):
        if s[i] <= 1e-12 * s[0]:
            break
        shape, course = vt[i], u[:, i]
        largest, peak = shape[np.argmax(np.abs(shape))], course[np.argmax(np.abs(course))]
        if i < drive.modes:
            shapes[:, i] = (shape / largest)[nearest]
        if i < drive.time_modes:
            courses[:, i] = course / peak
        if i < min(amplitudes.shape):
            amplitudes[i, i] = s[i] * largest * peak
    return shapes, courses, amplitudes.ravel()


def _note(stem, experiment, motion, shapes, courses, amplitudes, n_given, unseen) -> str:
    per_px = experiment.pixel_size
    fitted = courses @ amplitudes.reshape(shapes.shape[1], courses.shape[1]).T @ shapes.T
    residual_px = float(np.sqrt(np.mean((motion - fitted) ** 2))) / per_px
    text = (f"{stem}: {len(amplitudes)} modes start from the motion that a free FE-DIC measures there "
            f"(up to {np.abs(motion).max() / per_px:.2g} px; they leave {residual_px:.2g} px rms of it)")
    if n_given:
        text += f"; {n_given} of them as given"
    if unseen > 0:
        text += f"; {100 * unseen:.0f} % of its nodes are not seen"
    if residual_px > _MAX_FIT_RMS_PX:
        text += "; more modes along the edge or in time would fit it better"
    return text
