"""From the simulated motion of one frame to its equations in the degrees of freedom.

Nodal throughout: displacement and sensitivities are projected into the image at the nodes, the image kernel returns
nodal sums, and no pixel-sized sensitivity is ever formed (docs/method.md, section 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from idic.correlation.cameras import joined_equations, unit_weights, with_camera_sums
from idic.correlation.channels import channel_equations
from idic.correlation.image_equations.comparison import NoiseTerms, Reference
from idic.correlation.image_equations.context import CorrelationContext, FrameResponse
from idic.correlation.image_equations.equations import FrameEquations, SeenColumns
from idic.correlation.experiment_reference import build_experiment_reference, camera_at
from idic.correlation.field.equations import FieldEquations
from idic.correlation.field.reference import FieldReference
from idic.correlation.image_equations.frame import NodalEquations
from idic.correlation.image_equations.system import CorrelationSystem, eliminate
from idic.correlation.views.view import view_of
from idic.fe import nodal_deformation
from idic.images import AnyCamera, PLACEMENT_STEM, PlacedCamera
from idic.model import Experiment


def with_all_cameras(context: CorrelationContext,
                     attach: Callable[[Experiment, AnyCamera], Reference] | None = None) -> CorrelationContext:
    """The context of the main camera with those of the further ones; attach : `build_reference`, or a cache of it."""
    others = []
    for number, experiment in enumerate(context.experiment.views[1:]):
        camera = camera_at(experiment, context.parameters)
        others.append(replace(context, experiment=experiment, camera=camera, weights=context.weights.of_camera(number),
                              reference=(attach or build_experiment_reference)(experiment, camera)))
    return replace(context, others=tuple(others))


def frame_system(context: CorrelationContext, response: FrameResponse, local: np.ndarray) -> CorrelationSystem:
    """M, b and the functional of one frame, its local unknowns eliminated.

    local : (m,) present values of the frame-local unknowns.
    """
    per_camera = [frame_equations(camera, response, local) for camera in context.cameras]
    pixels = [(nodal.n_valid, nodal.n_lost) for nodal, _ in per_camera]
    if len(per_camera) == 1:
        return eliminate(response.frame, context.names, per_camera[0][1], context.weights, *pixels[0])
    weights = [camera.weights for camera in context.cameras]
    joined, parts = joined_equations([equations for _, equations in per_camera], weights, pixels)
    n_pixels, n_lost = np.sum(pixels, axis=0).tolist()
    system = eliminate(response.frame, context.names, joined, unit_weights(context.weights), n_pixels, n_lost)
    return with_camera_sums(system, parts, weights)


def frame_equations(context: CorrelationContext, response: FrameResponse,
                    local: np.ndarray) -> tuple[NodalEquations, FrameEquations]:
    """The equations of one frame in one camera: at the nodes, and in all unknowns before the local ones are eliminated.

    A frame without contrast has no pixel in any sum.
    """
    experiment, camera, reference = context.experiment, context.camera, context.reference
    response = turned_response(experiment, response)
    nodes = experiment.mesh.nodes
    view = view_of(experiment, camera).at(response.frame)
    motion = view.motion(nodes, response.u)
    nodal, own = reference.compare(experiment, response.frame, motion), global_columns(context, response)
    if isinstance(reference, FieldReference) and isinstance(nodal, FieldEquations):
        alike = reference.kept.columns(view, nodes, response.u, response.local_du)
        projected = nodal.gram_of(own, alike)
        noise = NoiseTerms(SeenColumns(own, alike, reference.visible(nodal)))
    else:
        local_columns = view.columns(nodes, response.u, response.local_du)
        columns = np.hstack([own, local_columns])
        if reference.shows_nothing(nodal):
            nodal = _without_pixels(reference, nodal)
        projected = nodal.gram(columns, local_columns.shape[1])
        noise = reference.noise_terms(nodal, response.frame, motion, columns, projected)
    return nodal, FrameEquations(
        gram=projected.matrix, rhs=projected.rhs, rr=nodal.rr, shared=noise.shared, kappa=nodal.kappa,
        channels=channel_equations(context, response), local_precision=context.local_precision, local_gap=-local,
        noise_gram=noise.gram, basis=noise.basis, scatter=context.local_scatter,
        few=isinstance(reference, FieldReference))


def turned_response(experiment: Experiment, response: FrameResponse) -> FrameResponse:
    """The motion in the axes of this camera."""
    if not (experiment.axis_order or experiment.sees_back):
        return response
    return replace(response, u=experiment.turned(response.u), du=experiment.turned(response.du),
                   local_du=experiment.turned(response.local_du))


def _without_pixels(reference: Reference, nodal: NodalEquations) -> NodalEquations:
    """The equations of a frame that shows nothing: no pixel in any sum."""
    n_pixels = nodal.n_valid + nodal.n_lost
    return replace(nodal, q=0.0 * nodal.q, H=0.0 * nodal.H, hb=0.0 * nodal.hb, bb=0.0 * nodal.bb, rb=0.0 * nodal.rb,
                   rr=0.0, n_valid=0, n_lost=n_pixels, lost=reference.pixel_map.pixels_per_element.astype(np.int64),
                   lost_pixels=np.arange(n_pixels), element_rr=0.0 * nodal.element_rr)


def global_columns(context: CorrelationContext, response: FrameResponse,
                   gradient: np.ndarray | None = None) -> np.ndarray:
    """Image columns of all free degrees of freedom  # (n_components n_nodes, n)

    gradient : `nodal_gradient` of the motion, where it is known already
    """
    nodes = context.experiment.mesh.nodes
    view = view_of(context.experiment, context.camera).at(response.frame)
    moved = view.columns(nodes, response.u, at_fixed_pixels(context.experiment, response.u, response.du,
                                                            context.moving))
    columns = np.zeros((view.n_components * len(nodes), len(context.names)))
    stem, placed = f"{context.experiment.camera_name}.", isinstance(context.camera, PlacedCamera)
    for i, name in enumerate(context.names):
        if name in context.moving:
            columns[:, i] = moved[:, context.moving.index(name)]
        elif name.startswith(stem) or (placed and name.startswith(f"{PLACEMENT_STEM}.")):
            if gradient is None:
                gradient = nodal_gradient(context.experiment, response.u)
            columns[:, i] = view.camera_column(nodes, response.u, gradient, name.removeprefix(stem))
    return columns


def at_fixed_pixels(experiment: Experiment, u: np.ndarray, du: np.ndarray, moving: Sequence[str]) -> np.ndarray:
    """Sensitivities at fixed points of the undeformed body instead of at nodes that move  # (n_nodes, dim, n_moving)

    Where a degree of freedom moves the nodes by V = dX/dlam: phi = dU/dlam - (grad u) V (docs/method.md, equation 5.5).
    """
    velocity = {morph.name: morph.velocity for morph in experiment.morphs}
    if velocity.keys().isdisjoint(moving):
        return du
    du, gradient = du.copy(), nodal_gradient(experiment, u)
    for i, name in enumerate(moving):
        if name in velocity:
            v = experiment.turned(velocity[name])
            du[:, :, i] -= np.einsum("nij,nj->ni", gradient, v)
            du[:, :v.shape[1], i] += v
    return du


def nodal_gradient(experiment: Experiment, u: np.ndarray) -> np.ndarray:
    """Deformation gradient at the nodes  # (n_nodes, dim, dim), of a motion with a third component (n_nodes, 3, 2)"""
    gradient = nodal_deformation(experiment.mesh, u)
    return np.where(np.isnan(gradient), np.eye(*gradient.shape[1:]), gradient)  # nodes of no element do not matter


def correlated_frames(experiment: Experiment, frames: Sequence[int]) -> list[int]:
    """Frames that enter the sums: later than the reference and not excluded."""
    return [int(k) for k in frames if k > experiment.reference and k not in experiment.excluded]
