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
from idic.correlation.views.pinhole_view import PinholeView
from idic.correlation.views.view import View, view_of
from idic.images import AnyCamera, PLACEMENT_STEM, PlacedCamera
from idic.model import Experiment, Model, is_camera_time


def with_all_cameras(context: CorrelationContext,
                     attach: Callable[[Experiment, AnyCamera], Reference] | None = None) -> CorrelationContext:
    """The context of the main camera with those of the further ones.

    attach : `build_experiment_reference`, or a cache of it
    """
    companions = []
    for number, experiment in enumerate(context.experiment.views[1:]):
        camera = camera_at(experiment, context.parameters)
        companions.append(replace(context, experiment=experiment, camera=camera,
                                  weights=context.weights.of_camera(number),
                                  reference=(attach or build_experiment_reference)(experiment, camera)))
    return replace(context, others=tuple(companions))


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
    experiment, reference = context.experiment, context.reference
    response = turned_response(experiment.model, at_camera_time(context, response))
    nodes, view = experiment.model.mesh.nodes, view_of(experiment, context.camera).at(response.frame)
    motion, jacobian = view.motion(nodes, response.u), view.jacobian(nodes, response.u)
    nodal, columns = reference.compare(experiment, response.frame, motion), _columns(context, response, view, jacobian)
    if isinstance(reference, FieldReference) and isinstance(nodal, FieldEquations):
        alike = reference.products.columns(view, nodes, response.u, response.local_du)
        projected = nodal.gram_of(columns, alike)
        noise = NoiseTerms(SeenColumns(columns, alike, reference.visible(nodal)))
    else:
        columns = np.hstack([columns, view.projected(jacobian, response.local_du)])
        if reference.shows_nothing(nodal):
            nodal = _without_pixels(reference, nodal)
        projected = nodal.gram(columns, response.local_du.shape[2])
        noise = reference.noise_terms(nodal, columns, projected)
    return nodal, FrameEquations(
        gram=projected.matrix, rhs=projected.rhs, rr=nodal.rr, shared=noise.shared, kappa=nodal.kappa,
        channels=channel_equations(context, response), local_precision=context.local_precision, local_gap=-local,
        noise_gram=noise.gram, basis=noise.basis, scatter=context.local_scatter,
        few=isinstance(reference, FieldReference))


def at_camera_time(context: CorrelationContext, response: FrameResponse) -> FrameResponse:
    """The motion when this camera takes its image of the frame (`idic.model.camera_time`)."""
    name = context.experiment.time_offset
    if name not in context.moving:
        return response
    velocity = response.du[:, :, context.moving.index(name)]
    return replace(response, u=response.u + context.parameters[name].value * velocity)


def turned_response(model: Model, response: FrameResponse) -> FrameResponse:
    """The motion in the axes of this camera."""
    if not (model.axis_order or model.sees_back):
        return response
    return replace(response, u=model.turned(response.u), du=model.turned(response.du),
                   local_du=model.turned(response.local_du))


def _without_pixels(reference: Reference, nodal: NodalEquations) -> NodalEquations:
    """The equations of a frame that shows nothing: no pixel in any sum."""
    n_pixels = nodal.n_valid + nodal.n_lost
    return replace(nodal, q=0.0 * nodal.q, H=0.0 * nodal.H, hb=0.0 * nodal.hb, bb=0.0 * nodal.bb, rb=0.0 * nodal.rb,
                   rr=0.0, n_valid=0, n_lost=n_pixels, lost=reference.pixel_map.pixels_per_element.astype(np.int64),
                   lost_pixels=np.arange(n_pixels), element_rr=0.0 * nodal.element_rr)


def global_columns(context: CorrelationContext, response: FrameResponse,
                   gradient: np.ndarray | None = None) -> np.ndarray:
    """Image columns of all free degrees of freedom  # (n_components n_nodes, n)

    gradient : `Model.nodal_gradient` of the motion, where it is known already
    """
    view = view_of(context.experiment, context.camera).at(response.frame)
    return _columns(context, response, view, view.jacobian(context.experiment.model.mesh.nodes, response.u), gradient)


def _columns(context: CorrelationContext, response: FrameResponse, view: View | PinholeView, jacobian: np.ndarray,
             gradient: np.ndarray | None = None) -> np.ndarray:
    """The same; view, jacobian : of the frame."""
    experiment, nodes = context.experiment, context.experiment.model.mesh.nodes
    of_camera = [name for name in context.names if name not in context.moving and _is_of_camera(context, name)]
    if gradient is None and (of_camera or _moves_nodes(experiment.model, context.moving)):
        gradient = experiment.model.nodal_gradient(response.u)
    moved = view.projected(jacobian, at_fixed_pixels(experiment.model, response.u, response.du, context.moving,
                                                     gradient))
    columns, stem = np.zeros((len(moved), len(context.names))), f"{experiment.recording.camera_name}."
    for i, name in enumerate(context.names):
        if is_camera_time(name) and name != experiment.time_offset:
            continue  # of another camera
        if name in context.moving:
            columns[:, i] = moved[:, context.moving.index(name)]
        elif name in of_camera:
            columns[:, i] = view.camera_column(nodes, response.u, gradient, name.removeprefix(stem))
    return columns


def _is_of_camera(context: CorrelationContext, name: str) -> bool:
    """Whether a degree of freedom is one of this camera, or of the place of the specimen before it."""
    placed = isinstance(context.camera, PlacedCamera) and name.startswith(f"{PLACEMENT_STEM}.")
    return placed or name.startswith(f"{context.experiment.recording.camera_name}.")


def _moves_nodes(model: Model, moving: Sequence[str]) -> bool:
    """Whether one of these degrees of freedom moves the nodes of the undeformed mesh."""
    return any(morph.name in moving for morph in model.morphs)


def at_fixed_pixels(model: Model, u: np.ndarray, du: np.ndarray, moving: Sequence[str],
                    gradient: np.ndarray | None = None) -> np.ndarray:
    """Sensitivities at fixed points of the undeformed body instead of at nodes that move  # (n_nodes, dim, n_moving)

    Where a degree of freedom moves the nodes by V = dX/dlam: phi = dU/dlam - (grad u) V (docs/method.md, equation 5.5).
    gradient : `Model.nodal_gradient` of the motion, where it is known already
    """
    if not _moves_nodes(model, moving):
        return du
    velocity = {morph.name: morph.velocity for morph in model.morphs}
    du, gradient = du.copy(), model.nodal_gradient(u) if gradient is None else gradient
    for i, name in enumerate(moving):
        if name in velocity:
            v = model.turned(velocity[name])
            du[:, :, i] -= np.einsum("nij,nj->ni", gradient, v)
            du[:, :v.shape[1], i] += v
    return du
