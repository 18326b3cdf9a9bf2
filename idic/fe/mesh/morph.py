"""Round holes whose place and size are degrees of freedom: the mesh morphs, X(lam) = X0 + sum (lam_i - lam_i0) V_i.

The rim moves rigidly (x, y) or radially (radius), all other walls stay, and between them the velocity V is harmonic: it
fades smoothly, and the elements next to the rim keep most of their shape. V does not depend on lam, so that finite
changes are exact on the rim: a circle stays a circle.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from idic.errors import NotConverged
from idic.fe.mesh.mesh import Mesh

MAX_OFF_CIRCLE = 0.05  # of the radius: how far corner nodes of a rim may lie off its circle (meshes made on an image)
MAX_WALL_NORMAL_Z = 0.5  # |n_z| of a wall of a solid; top and bottom face are no walls
MIN_JACOBIAN_IN_BOUNDS = 0.25  # of its first value: kept by every element within the bounds of a single dof
MIN_JACOBIAN = 0.05  # of its first value: below this a mesh is not simulated


@dataclass(frozen=True)
class Hole:
    """A round hole through the body: centre (2,) and radius in mm, of the circle through its corner nodes.

    rim : (n,) node indices, mid-side nodes included.
    """

    centre: np.ndarray
    radius: float
    rim: np.ndarray

    def velocities(self, mesh: Mesh) -> dict[str, np.ndarray]:
        """V of "x", "y" and "radius" of a hole  # {name: (n_nodes, dim)}, 1

        On the rim (1, 0), (0, 1) and (X - centre)/radius; zero on every other wall; harmonic between; no z component.
        """
        faces, _ = _walls(mesh)
        boundary_nodes = np.unique(np.concatenate([mesh.face_set_nodes(faces), self.rim]))
        stiffness, used = laplacian(mesh)
        inner = np.setdiff1d(used, boundary_nodes)
        components = np.zeros((mesh.n_nodes,
                               3))  # a rigid shift in one direction, and the two components of the radial field
        components[self.rim, 0] = 1.0
        components[self.rim, 1:] = (mesh.nodes[self.rim, :2] - self.centre) / self.radius
        if len(inner):
            components[inner] = splu(stiffness[inner][:, inner].tocsc()).solve(-(stiffness[inner] @ components))
        flat = np.zeros((mesh.n_nodes, mesh.n_dim))
        fields = {"x": flat.copy(), "y": flat.copy(), "radius": flat.copy()}
        fields["x"][:, 0] = fields["y"][:, 1] = components[:, 0]
        fields["radius"][:, :2] = components[:, 1:]
        return fields


@dataclass(frozen=True, eq=False)
class Wall:
    """A wall around a centre.

    looks_inwards : of a hole, not of the outside of a tube; off : mm, how far its corner nodes lie off the circle;
    turns : (n,) rad, angle that every face spans
    """

    hole: Hole
    looks_inwards: bool
    off: float
    turns: np.ndarray


@dataclass(frozen=True)
class Morph:
    """One geometric degree of freedom: its value `start` on the mesh as read, and V = dX/dvalue  # (n_nodes, dim)"""

    name: str
    start: float
    velocity: np.ndarray


def find_holes(mesh: Mesh) -> tuple[Hole, ...]:
    """The round holes of a plane mesh, or through a solid along z, from left to right.

    Holes that are not round (corner nodes off the circle by more than 5 % of its radius) are left out.
    """
    holes = [wall.hole for wall in walls_about_a_centre(mesh)
             if wall.looks_inwards and wall.off <= MAX_OFF_CIRCLE * wall.hole.radius]
    return tuple(sorted(holes, key=lambda hole: tuple(np.round(hole.centre, 9))))


def walls_about_a_centre(mesh: Mesh) -> Iterator[Wall]:
    """Connected walls whose faces all look towards the centre of their circle, or all away from it: holes, tubes."""
    faces, normals = _walls(mesh)
    for part in _connected(mesh, faces):
        wall_corners = np.array([mesh.face_nodes(face)[:_n_corners(mesh)] for face in faces[part]])  # (n, corners)
        corners = np.unique(wall_corners)
        centre, radius = fit_circle(mesh.nodes[corners, :2])
        offsets = mesh.nodes[wall_corners, :2] - centre
        side = np.einsum("ni,ni->n", normals[part], offsets.mean(axis=1))
        if (side < 0).all() or (side > 0).all():
            angles = np.arctan2(offsets[..., 1], offsets[..., 0])
            turns = np.ptp((angles - angles[:, :1] + np.pi) % (2.0 * np.pi), axis=1)
            off = float(np.abs(np.hypot(*(mesh.nodes[corners, :2] - centre).T) - radius).max())
            yield Wall(Hole(centre, radius, mesh.face_set_nodes(faces[part])), bool(side[0] < 0), off, turns)


def fit_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle nearest to points (n, 2): least squares of x² + y² = 2 c·x + const (Kåsa 1976)"""
    origin = points.mean(axis=0)
    x = points - origin
    matrix = np.column_stack([2.0 * x, np.ones(len(x))])
    (a, b, c), *_ = np.linalg.lstsq(matrix, (x**2).sum(axis=1), rcond=None)
    return origin + (a, b), float(np.sqrt(max(c + a * a + b * b, 0.0)))


def on_circle(mesh: Mesh, holes: Iterable[Hole]) -> Mesh:
    """The mesh with the mid-side nodes of these rims on their circles: straight edges make a hole look smaller."""
    nodes = mesh.nodes.copy()
    corners = np.unique(np.concatenate([block.connectivity[:, :block.kind.n_corners].ravel()
                                        for block in mesh.blocks]))
    for hole in holes:
        middle = np.setdiff1d(hole.rim, corners)
        nodes[middle, :2] = nearest_on_circle(nodes[middle, :2], hole.centre, hole.radius)
    return replace(mesh, nodes=nodes)


def nearest_on_circle(points: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """The points (..., 2), none of them the centre, moved radially onto a circle."""
    offset = points - centre
    return centre + offset * (radius / np.hypot(offset[..., :1], offset[..., 1:]))


def admissible(mesh: Mesh, velocity: np.ndarray, least: float = MIN_JACOBIAN_IN_BOUNDS) -> tuple[float, float]:
    """Changes (low < 0 < high, mm) along which every element keeps `least` of its Jacobian, at corners too.

    The determinant is quadratic in the change (V has two components), so its roots are exact.
    """
    h = 0.1 * float(np.ptp(mesh.nodes, axis=0).max()) / max(np.abs(velocity).max(), 1e-300)
    up, down = (mesh.jacobian_ratios(mesh.nodes + s * h * velocity) for s in (1.0, -1.0))
    a, b = (up - down) / (2.0 * h), (up + down - 2.0) / (2.0 * h * h)  # ratio = 1 + a d + b d²
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(a * a - 4.0 * b * (1.0 - least))
        q = -0.5 * (a + np.where(a >= 0, root, -root))
        roots = np.concatenate([q / b, (1.0 - least) / q])
    roots = roots[np.isfinite(roots)]
    return float(roots[roots < 0].max(initial=-np.inf)), float(roots[roots > 0].min(initial=np.inf))


def morphed(mesh: Mesh, morphs: Iterable[Morph], values: Mapping[str, float]) -> Mesh:
    """The mesh with the geometry of these values (mm, by name; a morph without a value stays).

    Raises
    ------
    NotConverged
        If an element would be flattened or inverted: a trial that goes too far, to be rejected.
    """
    nodes = mesh.nodes
    for morph in morphs:
        change = values.get(morph.name, morph.start) - morph.start
        nodes = nodes + change * morph.velocity if change else nodes
    if nodes is mesh.nodes:
        return mesh
    if not mesh.jacobian_ratios(nodes).min() > MIN_JACOBIAN:
        raise NotConverged("the mesh cannot follow such a change of geometry: an element would be flattened")
    return replace(mesh, nodes=nodes)


def _n_corners(mesh: Mesh) -> int:
    """Corners of a face (edge); one kind of face for all, as meshes of solids without pyramids have it."""
    return mesh.blocks[0].kind.n_face_corners


def _walls(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Boundary edges, or the faces of a solid that stand upright, and their outward normals  # (n, 2), (n, 2)"""
    faces = mesh.boundary_faces()
    points = np.array([mesh.nodes[mesh.face_nodes(face)[:_n_corners(mesh)]] for face in faces])  # (n, corners, dim)
    if mesh.n_dim == 2:
        along = points[:, 1] - points[:, 0]
        return faces, np.stack([along[:, 1], -along[:, 0]], axis=1)
    normals = np.cross(points[:, 2] - points[:, 0], points[:, -1] - points[:, 1])  # triangles and quads
    upright = np.abs(normals[:, 2]) < MAX_WALL_NORMAL_Z * np.linalg.norm(normals, axis=1)
    return faces[upright], normals[upright, :2]


def _connected(mesh: Mesh, faces: np.ndarray) -> list[np.ndarray]:
    """Indices of faces that hang together, part by part."""
    pairs = np.concatenate([np.stack([nodes[:1].repeat(len(nodes) - 1), nodes[1:]], axis=1)
                            for nodes in (mesh.face_nodes(face) for face in faces)])
    graph = sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(mesh.n_nodes, mesh.n_nodes))
    label = connected_components(graph, directed=False)[1][[mesh.face_nodes(face)[0] for face in faces]]
    return [np.flatnonzero(label == k) for k in np.unique(label)]


def laplacian(mesh: Mesh) -> tuple[sparse.csr_array, np.ndarray]:
    """Integral of grad N_a · grad N_b  # (n_nodes, n_nodes), and the nodes that belong to elements"""
    rows, columns, values = [], [], []
    for block in mesh.blocks:
        xi, w = block.kind.quadrature_rule()
        slopes = block.kind.shape_gradients(xi)
        jac = np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], slopes)
        grads = np.einsum("qai,eqik->eqak", slopes, np.linalg.inv(jac))
        values.append(np.einsum("eqak,eqbk,eq->eab", grads, grads, np.linalg.det(jac) * w).ravel())
        n = block.connectivity.shape[1]
        rows.append(np.repeat(block.connectivity, n, axis=1).ravel())
        columns.append(np.tile(block.connectivity, (1, n)).ravel())
    triplet = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    used = np.unique(np.concatenate([block.connectivity.ravel() for block in mesh.blocks]))
    return sparse.csr_array(sparse.coo_array(triplet, shape=(mesh.n_nodes,) * 2)), used
