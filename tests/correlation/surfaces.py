"""Surfaces in space and cameras with a lens that look at them."""

import numpy as np

from idic.fe import make_mesh
from idic.images import PinholeCamera, PlacedCamera, rotation_of

TOWARDS = np.diag([1.0, -1.0, -1.0])  # from above, x to the right, y up


def placed(angles_deg, distance=100.0, focal=2000.0, centre=(64.5, 44.5), target=(0.0, 0.0, 0.0), **lens):
    """A camera at a distance of the target, turned by a rotation vector from the view along -z."""
    rotation = rotation_of(angles_deg) @ TOWARDS
    shift = np.array([0.0, 0.0, distance]) - rotation @ np.asarray(target)
    return PlacedCamera(PinholeCamera(focal, 1.01 * focal, *centre, **lens), rotation=rotation, translation_mm=shift,
                        pivot_mm=target)


CAMERA = placed((4.0, 18.0, 7.0), target=(2.5, 1.7, 0.0), skew=0.5, k1=-0.2, k2=0.1, p1=2e-3, p2=-1e-3)


def hexes(shape, n):
    """A mapped block of n = (nx, ny, nz) hex8: nodes and connectivity."""
    s = [np.linspace(0.0, 1.0, k + 1) for k in n]
    grid = np.stack(np.meshgrid(*s, indexing="ij"), axis=-1).reshape(-1, 3)
    at = np.arange(len(grid)).reshape([k + 1 for k in n])
    i, j, k = (a.ravel() for a in np.meshgrid(*(np.arange(m) for m in n), indexing="ij"))
    corner = lambda a, b, c: at[i + a, j + b, k + c]
    conn = np.stack([corner(0, 0, 0), corner(1, 0, 0), corner(1, 1, 0), corner(0, 1, 0),
                     corner(0, 0, 1), corner(1, 0, 1), corner(1, 1, 1), corner(0, 1, 1)], axis=1)
    return shape(grid), conn


def faces_where(mesh, chosen):
    """Boundary faces whose nodes all satisfy `chosen`(points)."""

    return np.array([f for f in mesh.boundary_faces() if chosen(mesh.nodes[mesh.face_nodes(f)]).all()])


def tube(radius=5.0, wall=1.0, length=12.0, around=24, along=4):
    """A tube along y of tet10, its outer face OUT."""
    from idic.fe import raise_order

    def bent(g):
        angle, r = 2 * np.pi * g[:, 0], radius - wall * (1.0 - g[:, 2])
        return np.column_stack([r * np.sin(angle), length * (g[:, 1] - 0.5), r * np.cos(angle)])

    flat, conn = hexes(lambda g: g, (around, along, 1))
    first = {}
    same = np.array([first.setdefault((round(x % 1.0, 6), round(y, 6), round(z, 6)), i)
                     for i, (x, y, z) in enumerate(flat)])
    used, number = np.unique(same, return_inverse=True)
    conn = number[conn]
    tets = np.concatenate([conn[:, t] for t in ([0, 1, 3, 7], [0, 1, 7, 4], [1, 2, 3, 7], [1, 2, 7, 6], [1, 7, 4, 5],
                                                [1, 7, 5, 6])])
    mesh = raise_order(make_mesh(bent(flat[used]), [("tet4", oriented(bent(flat[used]), tets))],
                                 element_sets={"BODY": np.arange(len(tets))}))
    nodes = mesh.nodes.copy()  # middles of edges onto the cylinders
    r = np.hypot(nodes[:, 0], nodes[:, 2])
    on = np.where(r > radius - 0.25 * wall, radius, np.where(r < radius - 0.75 * wall, radius - wall, r))
    nodes[:, [0, 2]] *= (on / r)[:, None]
    from dataclasses import replace

    mesh = replace(mesh, nodes=nodes)
    out = faces_where(mesh, lambda p: np.abs(np.hypot(p[:, 0], p[:, 2]) - radius) < 1e-6)
    return replace(mesh, edge_sets={"OUT": out})


def oriented(nodes, tets):
    a, b, c, d = (nodes[tets[:, k]] for k in range(4))
    wrong = np.einsum("ni,ni->n", np.cross(b - a, c - a), d - a) < 0
    tets = tets.copy()
    tets[wrong] = tets[wrong][:, [0, 2, 1, 3]]
    return tets


def box():
    """An L: a floor of 8 x 8 mm at z = 0 whose face FLOOR is seen, and a wall of height 2 beside it."""
    from dataclasses import replace

    nodes, conn = hexes(lambda g: g * [10.0, 8.0, 3.0] - [5.0, 4.0, 1.0], (10, 8, 3))
    middle = nodes[conn].mean(axis=1)
    keep = (middle[:, 2] < 0.0) | (middle[:, 0] > 3.0)
    used, number = np.unique(conn[keep], return_inverse=True)
    mesh = make_mesh(nodes[used], [("hex8", number.reshape(-1, 8))], element_sets={"BODY": np.arange(keep.sum())})
    floor = faces_where(mesh, lambda p: (np.abs(p[:, 2]) < 1e-9) & (p[:, 0] < 3.01))
    return replace(mesh, edge_sets={"FLOOR": floor})
