"""The way from the image of one camera with a lens to that of another, at rest, and its derivatives.

    x + v(x) = Q(X(x)),      phi = q(X) - F p(X),      F = J_Q T [J_P T]^-1        docs/method.md, 17.10 to 17.12

The symbols are those of `idic.correlation.pinhole.texture`; J_P and J_Q are the Jacobians of the projections.
"""

from __future__ import annotations

import numpy as np

from idic.correlation.image_equations.context import CorrelationContext
from idic.correlation.views.pinhole_view import in_space, solved_at_seen, surface_tangents
from idic.correlation.pixels.cells import N_MONOMIALS, N_NODES, NODE_POINTS, TRANSFORMS, monomials
from idic.correlation.pixels.pixel_map import PixelMap
from idic.images import PLACEMENT_STEM, PlacedCamera
from idic.model import Experiment


def way_between(pixel_map: PixelMap, first: CorrelationContext, second: CorrelationContext) -> np.ndarray:
    """From the pixel of one camera to that of the other: monomial coefficients  # (n_elements, 2, 8) px

    Quadratic on every face, also of linear elements: perspective is not linear between their nodes.
    """
    nodes, way = in_space(first.experiment.model.mesh.nodes), np.zeros((pixel_map.n_elements, 2, N_MONOMIALS))
    for kind in np.unique(pixel_map.kind):
        quadratic, of_kind = 2 + kind % 2, pixel_map.kind == kind
        points, n = NODE_POINTS[quadratic], N_NODES[kind]
        shape = (monomials(points[:, 0], points[:, 1]) @ TRANSFORMS[kind])[:, :n]  # (n_points, n)
        places = np.einsum("qi,eid->eqd", shape, nodes[pixel_map.conn[of_kind, :n]]).reshape(-1, 3)
        shift = (second.camera.project(places) - first.camera.project(places)).reshape(-1, len(points), 2)
        way[of_kind] = np.einsum("kq,eqc->eck", TRANSFORMS[quadratic][:, :len(points)], shift)
    return way


def columns_between(first: CorrelationContext, second: CorrelationContext, names: tuple[str, ...]) -> np.ndarray:
    """Motion of the second image against the first by every degree of freedom  # (2 n_nodes, n) px per unit"""
    experiment = first.experiment
    nodes = experiment.model.mesh.nodes
    tangents = in_space(surface_tangents(experiment.model.mesh, experiment.model.surface))  # (n_nodes, 3, 2)
    first_slopes, second_slopes = (context.camera.jacobian(nodes) @ tangents for context in (first, second))
    columns = np.zeros((len(nodes), 2, len(names)))
    for i, name in enumerate(names):
        if moves_at_rest(first.experiment, name) or moves_at_rest(second.experiment, name):
            # of the point that a pixel shows, along the surface
            along = solved_at_seen(first_slopes, _velocity(first, name))
            columns[:, :, i] = _velocity(second, name) - np.einsum("nck,nk->nc", second_slopes, along)
    return columns.reshape(2 * len(nodes), -1)


def moves_at_rest(view: Experiment, name: str) -> bool:
    """Whether a degree of freedom moves the image of a point of the undeformed surface in this camera."""
    stem = f"{view.recording.camera_name}."
    if name.startswith((stem, f"{PLACEMENT_STEM}.")):
        return isinstance(view.model.camera, PlacedCamera) and not view.model.camera.is_motion(name.removeprefix(stem))
    return any(morph.name == name for morph in view.model.morphs)


def _velocity(context: CorrelationContext, name: str) -> np.ndarray:
    """Motion of the images of the nodes at rest by a degree of freedom  # (n_nodes, 2) px per unit"""
    nodes = in_space(context.experiment.model.mesh.nodes)
    if not moves_at_rest(context.experiment, name):
        return np.zeros((len(nodes), 2))
    for morph in context.experiment.model.morphs:
        if morph.name == name:
            return np.einsum("ncd,nd->nc", context.camera.jacobian(nodes), in_space(morph.velocity))
    stem = f"{context.experiment.recording.camera_name}."
    return context.camera.parameter_jacobian(nodes, name.removeprefix(stem))
