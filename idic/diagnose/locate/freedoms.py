"""Motions that a frame may be given freely: of the driven boundaries with the law kept, and of the camera.

Boundary: smooth modes along every driven set, both components, propagated into the body by the model's own tangent.
A component that the model leaves free on such a set gets nodal forces of the same shapes instead: friction, a grip
that holds more than it should. Camera: what position, direction and lens of one frame can do; an even stretch in one
direction only is none of it.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import block_diag

from idic.correlation import View, ViewKind
from idic.diagnose.locate.tangents import ModelTangent
from idic.diagnose.residual.residual_evidence import CameraResidual, ResidualEvidence
from idic.images import CAMERA_PARAMETERS, PLACEMENT_STEM, PlacedCamera, RIGID, Scanner
from idic.model import COMPONENTS, Model

EDGE_MODE_DEGREE = 3  # of the modes along an edge
FACE_MODE_DEGREE = 2  # of those on a face
PLACED = tuple(f"{PLACEMENT_STEM}.{name}" for name in RIGID)
BENDING = tuple(name for name, kind in CAMERA_PARAMETERS.items() if kind.bends)


def edge_modes(model: Model, nodes: np.ndarray) -> np.ndarray:
    """Legendre polynomials along the main direction of a set, or over its two main directions of a solid's face

    Returns
    -------
    (n, modes); of a set without extent the constant only
    """
    points = model.mesh.nodes[nodes]
    centred = points - points.mean(axis=0)
    size, directions = np.linalg.svd(centred, full_matrices=False)[1:]
    along = [centred @ d for d, s in zip(directions, size, strict=True) if s > 1e-6 * max(size[0], 1e-300)]
    along = [a / np.abs(a).max() for a in along[:model.n_dim - 1]]
    if not along or not np.isfinite(along[0]).all():
        return np.ones((len(nodes), 1))
    if len(along) == 1:
        return legendre.legvander(along[0], min(EDGE_MODE_DEGREE, len(nodes) - 1))
    modes = legendre.legvander2d(along[0], along[1], [FACE_MODE_DEGREE, FACE_MODE_DEGREE])
    order = np.add.outer(np.arange(FACE_MODE_DEGREE + 1), np.arange(FACE_MODE_DEGREE + 1)).ravel()
    return modes[:, order <= FACE_MODE_DEGREE]


def boundary_patterns(model: Model, held_dofs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motion of held dofs (mm) and nodal forces on the others (N per node)  # (n_dof, p) each, one of them zero"""
    n_dim, n_dof = model.n_dim, model.mesh.nodes.size
    is_held = np.zeros(n_dof, dtype=bool)
    is_held[held_dofs] = True
    motions: list[np.ndarray] = []
    forces: list[np.ndarray] = []
    for name in dict.fromkeys(entry.nodes for entry in model.prescribed):
        nodes = model.node_set(name)
        shapes = edge_modes(model, nodes)
        for component in range(len(COMPONENTS[:n_dim])):
            dofs = nodes * n_dim + component
            for moved, kind in ((is_held[dofs], motions), (~is_held[dofs], forces)):
                if moved.sum() >= max(2, shapes.shape[1]) or moved.all():
                    pattern = np.zeros((n_dof, shapes.shape[1]))
                    pattern[dofs[moved]] = shapes[moved]
                    kind.append(pattern)
    motion, force = (np.hstack(part) if part else np.zeros((n_dof, 0)) for part in (motions, forces))
    return (np.hstack([motion, np.zeros_like(force)]), np.hstack([np.zeros_like(motion), force]))


def boundary_fields(residual: ResidualEvidence, tangent: ModelTangent,
                    patterns: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Image motion of the boundary's freedoms in one frame  # (n_seen, p)"""
    experiment = residual.context.experiment
    moved = tangent.answer(*patterns).reshape(*experiment.model.mesh.nodes.shape, -1)
    return _unit(in_images(residual, tangent.index, moved))


def in_images(residual: ResidualEvidence, index: int, moved: np.ndarray) -> np.ndarray:
    """Changes of the motion of the nodes in one frame as motions in all images  # (n_nodes, dim, p) mm -> (n_seen,
    p)"""
    frame, u = int(residual.evidence.frames[index]), residual.u[index]
    return residual.at_seen(lambda camera: camera.view.at(frame).columns(
        camera.context.experiment.model.mesh.nodes, camera.turned(u), camera.turned(moved)))


def camera_fields(residual: ResidualEvidence, index: int) -> np.ndarray:
    """Image motions that the camera parameters of one frame allow, every camera by itself  # (n_seen, q)

    Grey images: every camera parameter of this frame alone (it moved, turned, its focus breathed), and distortion and
    tilt that were always there; of a lens, its place, focal length, centre and distortion. Heights: the specimen
    shifted, turned, magnified in the image; levels of the instrument and its scale of heights. Volumes: a rigid motion
    and another magnification of the scan.
    """
    frame = int(residual.evidence.frames[index])
    fields = [_of_camera(camera, frame, camera.turned(residual.u[index])) for camera in residual.cameras]
    columns = fields[0] if len(fields) == 1 else block_diag(*fields)
    return _unit(columns[residual.evidence.seen])


def _of_camera(camera: CameraResidual, frame: int, u: np.ndarray) -> np.ndarray:
    """What one camera may do in one frame  # (n_components n_nodes, q)"""
    experiment, view = camera.context.experiment, camera.view
    nodes = experiment.model.mesh.nodes
    if isinstance(view.camera, Scanner):
        return _of_scanner(view.camera, nodes + u)
    if view.kind != ViewKind.GREY:
        return _of_instrument(experiment.model, view, u)
    frame_view = view.at(frame)
    if isinstance(view.camera, PlacedCamera):
        distortion, tilts = view.camera.lens.leading, PLACED[:2]
        names, constant = ("fx", "cx", "cy", distortion, *PLACED), (distortion, "fx", *tilts)
    else:
        names, constant = tuple(CAMERA_PARAMETERS), BENDING  # constant: in all frames, the reference included
    deformed = frame_view.deformed(nodes, u)
    moved = [frame_view.moved_camera.parameter_jacobian(deformed, name).ravel() for name in names]
    gradient = experiment.model.nodal_gradient(u)
    still = [frame_view.camera_column(nodes, u, gradient, name) for name in constant]
    return np.column_stack(moved + still)


def _of_scanner(scanner: Scanner, points: np.ndarray) -> np.ndarray:
    """What a scanner may do in one scan: a rigid motion and another magnification; points : (n_nodes, 3) mm, deformed

    Returns
    -------
    (3 n_nodes, 7) column, row, slice
    """
    arms = points - points.mean(axis=0)
    moved = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    moved += [np.cross(axis, arms) for axis in np.eye(3)]
    return np.stack([field @ scanner.matrix.T for field in (*moved, arms)], axis=-1).reshape(3 * len(arms), -1)


def _unit(fields: np.ndarray) -> np.ndarray:
    """Every field with a largest motion of 1 px; zero stays zero."""
    largest = np.abs(fields).max(axis=0, initial=0.0)
    return fields / np.where(largest > 0.0, largest, 1.0)


def _of_instrument(model: Model, view: View, u: np.ndarray) -> np.ndarray:
    """What a profilometer may do in one frame; in a symmetric section it must do the same to both halves

    Returns
    -------
    (3 n_nodes, q) column, row, height
    """
    at = view.camera.project(view.points(model.mesh.nodes))
    rise = view.motion(model.mesh.nodes, u)[:, 2]
    centre = view.camera.project(np.zeros((1, model.n_dim)))[0] if model.symmetry else at.mean(axis=0)
    (x, y), unit, none = (at - centre).T, np.ones(len(at)), np.zeros(len(at))
    fields = [(x, y, none), (none, none, unit), (none, none, rise)]
    if not model.symmetry:
        fields += [(unit, none, none), (none, unit, none), (-y, x, none), (none, none, x), (none, none, y)]
    return np.stack(fields, axis=-1).transpose(1, 0, 2).reshape(3 * len(at), -1)
