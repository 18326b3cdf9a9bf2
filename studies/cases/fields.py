"""Fields that a case may store: displacements, sensitivities, residual maps, residual level of every frame.

A plane specimen has values at all its nodes in view, a cross-section at its surface nodes (u along the section, u
upwards).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from idic.correlation import build_experiment_reference, camera_at, view_of
from idic.experiment_file import seen_nodes, visible_cells
from idic.fe import FrameState
from idic.model import Experiment, build_forward
from idic.parameters import ParameterSet

STORED_FIELDS: dict[str, Callable[..., dict[str, np.ndarray]]] = {}
SHOWN_TIME_SHARES = (0.3, 0.6, 0.9)  # of the duration: the frames of residual maps


def stored_fields(names: tuple[str, ...], experiment: Experiment, identified: ParameterSet,
                  truth: ParameterSet) -> dict[str, np.ndarray]:
    """The arrays of `names`.

    Parameters
    ----------
    experiment : all frames, start values
    identified : identified parameters (start values for a simulation)
    truth : true parameters; start values where the truth has none
    """
    arrays: dict[str, np.ndarray] = {}
    for name in names:
        arrays |= STORED_FIELDS[name](experiment, identified, truth)
    return arrays


def surface_nodes(experiment: Experiment) -> np.ndarray:
    """Nodes in view, ordered by x  # (n,)"""
    model = experiment.model
    mesh, camera = model.mesh, model.camera
    _, cells = seen_nodes(mesh, model.kind, model.surface)
    inside = visible_cells(mesh, model.kind, model.surface, camera, experiment.recording.image_shape)
    nodes = np.unique(np.concatenate([cell for cell, is_visible in zip(cells, inside, strict=True) if is_visible]))
    return nodes[np.argsort(mesh.nodes[nodes, 0], kind="stable")]


def _displacements(experiment: Experiment, identified: ParameterSet, truth: ParameterSet) -> dict[str, np.ndarray]:
    """``x`` (n, dim) mm; ``u_true``, ``u_error`` (n_frames, n, dim) mm: identified less true."""
    nodes = surface_nodes(experiment)
    true = np.array([state.u[nodes] for state in _march(experiment, truth)])
    arrays = {"x": experiment.model.mesh.nodes[nodes], "u_true": true}
    if identified is not truth:
        arrays["u_error"] = np.array([state.u[nodes] for state in _march(experiment, identified)]) - true
    return arrays


def _sensitivities(experiment: Experiment, identified: ParameterSet, truth: ParameterSet) -> dict[str, np.ndarray]:
    """``phi`` (n_frames, n, dim, m) mm: lambda du/dlambda of the free parameters at the true ones; ``x`` (n, dim).

    With channels also ``channels`` (n_frames, c) and ``rho`` (n_frames, c, m), lambda dF/dlambda.
    """
    model = experiment.model
    nodes, names = surface_nodes(experiment), model.parameters.free
    slopes = np.array([truth[name].slope() for name in names])
    phi, channels, rho = [], [], []
    for state in _march(experiment, truth, names):
        phi.append(state.du[nodes] * slopes)
        channels.append(state.channels.copy())
        rho.append(state.dchannels * slopes)
    arrays = {"x": model.mesh.nodes[nodes], "phi": np.array(phi)}
    return arrays if not model.channels else arrays | {"channels": np.array(channels), "rho": np.array(rho)}


def _residuals(experiment: Experiment, identified: ParameterSet, truth: ParameterSet) -> dict[str, np.ndarray]:
    """``residual_start``, ``residual_end`` (n_shown, ny, nx), NaN off the specimen; ``residual_frames`` (n_shown,)."""
    last_frame = experiment.model.n_frames - 1
    frames = [round(part * last_frame) for part in SHOWN_TIME_SHARES]
    arrays: dict[str, np.ndarray] = {"residual_frames": np.array(frames)}
    for name, parameters in (("residual_start", experiment.model.parameters), ("residual_end", identified)):
        maps = {frame: image for frame, image, _ in _residual_maps(experiment, parameters, frames)}
        arrays[name] = np.array([maps[frame] for frame in frames], dtype=np.float32)
    return arrays


def _levels(experiment: Experiment, identified: ParameterSet, truth: ParameterSet) -> dict[str, np.ndarray]:
    """``level_mean``, ``level_abs`` (n_frames,): mean of r and of |r| over each frame; NaN without valid pixels.

    Every frame has a level, also those that took no part in the identification.
    """
    model = experiment.model
    frames = experiment.correlated_frames(range(model.n_frames))
    mean, size = np.full(model.n_frames, np.nan), np.full(model.n_frames, np.nan)
    for frame, _, r in _residual_maps(experiment, identified, frames):
        mean[frame], size[frame] = r.mean(), np.abs(r).mean()
    return {"level_mean": mean, "level_abs": size}


STORED_FIELDS |= {"displacements": _displacements, "sensitivities": _sensitivities, "residuals": _residuals,
                  "levels": _levels}


def _march(experiment: Experiment, parameters: ParameterSet, names: tuple[str, ...] = ()) -> Iterator[FrameState]:
    return build_forward(experiment).march(parameters, names)


def _residual_maps(experiment: Experiment, parameters: ParameterSet,
                   frames: list[int]) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Frame, residual image, and the residuals of its valid pixels, for experiments without brightness corrections."""
    camera = camera_at(experiment, parameters)
    reference, view = build_experiment_reference(experiment, camera), view_of(experiment, camera)
    for state in _march(experiment, parameters):
        frame = state.frame + experiment.model.reference
        if frame not in frames:
            continue
        motion = view.at(frame).motion(experiment.model.mesh.nodes, state.u)
        residual = reference.compare_pixels(experiment, frame, motion, np.zeros(0))
        image = reference.pixel_map.to_image(np.where(residual.valid, residual.r, np.nan)).astype(np.float32)
        yield frame, image, residual.r[residual.valid].astype(float)
