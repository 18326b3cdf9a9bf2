"""Small bodies for the finite-element tests: boxes and quarter rings of every cell, held and driven."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from idic.fe import Body, cell_type, constrain, Constraints, Control, dofs_of, Loads, make_mesh, march, Section
from idic.laws import compile

SHARP = Control(tolerance=1e-12)  # difference quotients divide the solver's error by the step
PARAMETERS = {
    "elastic": np.array([200.0, 0.3]),
    "neo_hookean": np.array([30.0, 150.0]),
    "j2_linear": np.array([200.0, 0.3, 1.0, 10.0]),
}


def grid(cell: str, n, lengths=None, mapping=None):
    """A box of n[0] x n[1] (x n[2]) cells, quadrilaterals cut in two, hexahedra in six; `mapping` moves the nodes."""
    d = len(n)
    lengths = np.ones(d) if lengths is None else np.asarray(lengths, float)
    quadratic = cell in ("quad8", "tri6", "tet10", "hex20")
    fine = [m * (2 if quadratic else 1) + 1 for m in n]
    axes = [np.linspace(0, length, m) for length, m in zip(lengths, fine, strict=True)]
    nodes = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    number = np.arange(len(nodes)).reshape(fine)
    step = 2 if quadratic else 1
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)] if d == 2 else [(*c, z) for z in (0, 1)
                                                               for c in ((0, 0), (1, 0), (1, 1), (0, 1))]
    cells = []
    for index in np.ndindex(*n):
        at = lambda *c: number[tuple(int(step * (i + x)) for i, x in zip(index, c, strict=True))]  # noqa: E731
        c = [at(*corner) for corner in corners]
        if cell.startswith("tet"):
            cells += [[at(*point) for point in tet] for tet in _six_tetrahedra(cell == "tet10")]
            continue
        if cell in ("quad4", "hex8"):
            cells.append(c)
        elif cell == "tri3":
            cells += [[c[0], c[1], c[2]], [c[0], c[2], c[3]]]
        elif cell == "hex20":
            cells.append([*c, *(at(*np.mean([corners[a], corners[b]], axis=0)) for a, b in cell_type("hex8").edges)])
        elif cell == "quad8":
            cells.append([*c, at(0.5, 0), at(1, 0.5), at(0.5, 1), at(0, 0.5)])
        elif cell == "tri6":
            middle = at(0.5, 0.5)
            cells += [[c[0], c[1], c[2], at(0.5, 0), at(1, 0.5), middle],
                      [c[0], c[2], c[3], middle, at(0.5, 1), at(0, 0.5)]]
    used = np.unique(cells)
    renumber = np.full(len(nodes), -1)
    renumber[used] = np.arange(len(used))
    nodes = nodes[used]
    return make_mesh(nodes if mapping is None else mapping(nodes), [(cell, renumber[np.array(cells)])])


def _six_tetrahedra(quadratic):
    """Kuhn's cut of the unit cube: corners, and middles of edges, of six tetrahedra around one diagonal."""
    tets = []
    for order in permutations(np.eye(3)):
        corners = [np.zeros(3), order[0], order[0] + order[1], np.ones(3)]
        if np.linalg.det(np.array(order)) < 0:
            corners[1], corners[2] = corners[2], corners[1]
        middles = [(corners[a] + corners[b]) / 2 for a, b in cell_type("tet4").edges] if quadratic else []
        tets.append(corners + middles)
    return tets


def skewed(x):
    """A smooth distortion of the unit box that maps edges onto themselves and is affine along no line inside."""
    bump = np.prod(np.sin(np.pi * x), axis=1)[:, None]
    return x + bump * (np.array([0.12, -0.1, 0.08])[: x.shape[1]])


def straight_sided(mesh):
    """Mid-side nodes back to the middle of their corners (a quad8 patch test needs straight edges)."""
    nodes = mesh.nodes.copy()
    for block in mesh.blocks:
        for face in block.kind.faces:
            n = block.kind.n_face_corners
            for k, middle in enumerate(face[n:]):
                ends = block.connectivity[:, [face[k], face[(k + 1) % n]]]
                nodes[block.connectivity[:, middle]] = nodes[ends].mean(axis=1)
    return make_mesh(nodes, [(b.cell, b.connectivity) for b in mesh.blocks])


def outer_nodes(mesh):
    return mesh.face_set_nodes(mesh.boundary_faces())


def where(mesh, condition):
    return np.flatnonzero(condition(*mesh.nodes.T))


def faces_where(mesh, condition):
    """Boundary faces whose nodes all satisfy the condition."""
    faces = mesh.boundary_faces()
    return np.array([f for f in faces if np.all(condition(*mesh.nodes[mesh.face_nodes(f)].T))])


def body(mesh, kind, law="elastic", kinematics=None, constraints=None, **more):
    section = Section("BODY", compile(law, kinematics), np.arange(mesh.n_elements))
    return Body(mesh, kind, (section,), constraints, **more)


def affine_constraints(mesh, nodes, H, n_frames=2):
    """u = t H X at these nodes, t from 0 to 1."""
    d = mesh.n_dim
    dofs = (nodes[:, None] * d + np.arange(d)).ravel()
    return Constraints(dofs, (mesh.nodes[nodes] @ H.T).reshape(-1, 1), np.linspace(0, 1, n_frames)[:, None])


def held(mesh, parts, n_frames=2):
    """Constraints of (nodes, component, history or 0.0): uniform prescribed components."""
    rows = []
    for nodes, component, history in parts:
        fixed = np.isscalar(history)
        rows.append((dofs_of(nodes, component, mesh.n_dim), np.ones((len(nodes), 0 if fixed else 1)),
                     np.zeros((n_frames, 0)) if fixed else np.reshape(history, (n_frames, 1))))
    return constrain(rows, n_frames)


def last(model, params, times=(0.0, 1.0), **more):
    """The final frame of a run."""
    values = params if isinstance(params, dict) else {"BODY": np.asarray(params, float)}
    for frame in march(model, values, np.asarray(times, float), **more):
        pass
    return frame


def quarter_ring(cell, n, a=1.0, b=2.0, height=0.25):
    """A quarter of a ring, radius a to b, n x n cells (solids: one layer more in depth)."""

    def bend(x):
        r, angle = a + (b - a) * x[:, 0], np.pi / 2 * x[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), *x[:, 2:].T * height])

    return grid(cell, (n, n) if cell_type(cell).dim == 2 else (n, n, 1), mapping=bend)


def pressed_ring(mesh, kind, law="elastic", kinematics=None, pressure=1.0, n_frames=2, **more):
    """The quarter ring held by symmetry, under follower pressure on its inner face; plane strain also for hex8."""
    parts = [(where(mesh, lambda x, y, *z: np.abs(x) < 1e-9), "x", 0.0),
             (where(mesh, lambda x, y, *z: np.abs(y) < 1e-9), "y", 0.0)]
    if mesh.n_dim == 3:
        parts.append((np.arange(mesh.n_nodes), "z", 0.0))
    inner = np.abs(np.hypot(*mesh.nodes.T[:2]) - np.hypot(*mesh.nodes.T[:2]).min()) < 1e-6
    faces = np.array([f for f in mesh.boundary_faces() if inner[mesh.face_nodes(f)].all()])
    loads = Loads(pressure_faces=(faces,), pressure_histories=np.linspace(0, pressure, n_frames)[:, None])
    return body(mesh, kind, law, kinematics, held(mesh, parts, n_frames), loads=loads, **more)


def l2_error(mesh, u, exact):
    """L2 norm of u_h - u over the body, relative to that of u; `exact` maps (n, d) points to (n, d)."""
    error = size = 0.0
    for block in mesh.blocks:
        xi, w = block.kind.quadrature_rule(4)
        N, dN = block.kind.shape_functions(xi), block.kind.shape_gradients(xi)
        X = np.einsum("qa,eak->eqk", N, mesh.nodes[block.connectivity])
        jac = np.linalg.det(np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], dN)) * w
        uh = np.einsum("qa,eak->eqk", N, u[block.connectivity])
        true = exact(X.reshape(-1, X.shape[2])).reshape(X.shape)
        error += np.sum(jac[..., None] * (uh - true) ** 2)
        size += np.sum(jac[..., None] * true**2)
    return np.sqrt(error / size)


def volume(mesh) -> float:
    """Of a solid, or the area of a plane mesh, by the quadrature of the elements."""
    total = 0.0
    for block in mesh.blocks:
        points, weights = block.kind.quadrature_rule()
        jac = np.einsum("eai,qaj->eqij", mesh.nodes[block.connectivity], block.kind.shape_gradients(points))
        total += float((np.linalg.det(jac) * weights).sum())
    return total
