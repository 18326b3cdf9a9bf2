"""A laminate in its plane, solved without the laws and the solver of the product: small strains, secant iteration.

Eight-node elements with nine points each. Every iteration solves a linear orthotropic sheet whose moduli at every point
are the secants of the last strains:

    stiffening : t11 += stiffening E1 e11^2
    hahn_tsai  : g = t12 / G12 + alpha t12^3, in closed form (reversible)
    lost       : t12 = G12 g / (1 + g_max / g_0), g_max the largest shear so far (damage)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)
CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
TOLERANCE, MOST_ITERATIONS = 1e-7, 100  # of the largest displacement: a thousandth of the noise


def slopes(a: float, b: float) -> np.ndarray:
    """Derivatives of the eight shape functions over the local coordinates  # (2, 8)"""
    found = np.zeros((2, 8))
    for k, (p, q) in enumerate(CORNERS):
        found[:, k] = 0.25 * p * (1 + b * q) * (2 * a * p + b * q), 0.25 * q * (1 + a * p) * (a * p + 2 * b * q)
    found[:, 4], found[:, 6] = (-a * (1 - b), -0.5 * (1 - a * a)), (-a * (1 + b), 0.5 * (1 - a * a))
    found[:, 5], found[:, 7] = (0.5 * (1 - b * b), -b * (1 + a)), (-0.5 * (1 - b * b), -b * (1 - a))
    return found


def strain_matrices(nodes: np.ndarray, connectivity: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """(e11, e22, 2 e12) in axes turned by an angle (deg) over the motion of an element's nodes, and the areas.

    # (n_elements, 9, 3, 16), (n_elements, 9) mm²
    """
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
    at, parts, areas = nodes[connectivity], [], []
    for i, a in enumerate(POINTS):
        for j, b in enumerate(POINTS):
            local = slopes(a, b)
            jacobian = np.einsum("dk,nkx->ndx", local, at)
            d = np.einsum("nxd,dk->nxk", np.linalg.inv(jacobian), local)
            B = np.zeros((len(at), 3, 16))
            B[:, 0, 0::2], B[:, 1, 1::2], B[:, 2, 0::2], B[:, 2, 1::2] = d[:, 0], d[:, 1], d[:, 1], d[:, 0]
            parts.append(np.einsum("ij,njk->nik", turn, B))
            areas.append(np.linalg.det(jacobian) * WEIGHTS[i] * WEIGHTS[j])
    return np.stack(parts, 1), np.stack(areas, 1)


def secants(values: Mapping[str, float], e: np.ndarray, largest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modulus added along axis 1, and secant shear modulus, at the strains e (…, 3)  # (…,) MPa each"""
    G, g = values["G12"], np.abs(e[..., 2])
    shear = np.full(g.shape, G)
    if "alpha" in values:
        p = 1.0 / (values["alpha"] * G)
        stress = 2.0 * np.sqrt(p / 3.0) * np.sinh(np.arcsinh(1.5 * g / values["alpha"] / p * np.sqrt(3.0 / p)) / 3.0)
        shear = np.where(g > 1e-9, stress / np.maximum(g, 1e-9), G)
    elif "g_0" in values:
        shear = G / (1.0 + np.maximum(largest, g) / values["g_0"])
    return values.get("stiffening", 0.0) * values["E1"] * e[..., 0], shear


def solved(mesh, values: Mapping[str, float], grip: np.ndarray, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Motion and force where RIGHT moves along x by the grip (n_frames,) mm, and LEFT stays; both are clamped.

    # (n_frames, n_nodes, 2) mm, (n_frames,) N
    """
    (block,) = mesh.blocks
    B, area = strain_matrices(mesh.nodes, block.connectivity, values["angle"])
    dofs = (2 * block.connectivity[:, :, None] + np.arange(2)).reshape(len(B), 16)
    rows, columns = np.repeat(dofs, 16, axis=1).ravel(), np.tile(dofs, 16).ravel()
    right, left = 2 * mesh.node_sets["RIGHT"], 2 * mesh.node_sets["LEFT"]
    fixed = np.concatenate([right, right + 1, left, left + 1])
    free = np.setdiff1d(np.arange(2 * mesh.n_nodes), fixed)
    below = 1.0 - values["nu12"] ** 2 * values["E2"] / values["E1"]
    C = np.zeros((*area.shape, 3, 3))
    C[..., 0, 1] = C[..., 1, 0] = values["nu12"] * values["E2"] / below
    C[..., 1, 1] = values["E2"] / below
    u, largest, motions, forces = np.zeros(2 * mesh.n_nodes), np.zeros(area.shape), [], []
    for way in grip:
        for _ in range(MOST_ITERATIONS):
            along, C[..., 2, 2] = secants(values, np.einsum("npik,nk->npi", B, u[dofs]), largest)
            C[..., 0, 0] = values["E1"] / below + along
            stiffness = thickness * np.einsum("npik,npij,npjm,np->nkm", B, C, B, area, optimize=True)
            K = csr_matrix((stiffness.ravel(), (rows, columns))).tocsc()
            moved = np.zeros_like(u)
            moved[right] = way
            moved[free] = splu(K[free][:, free]).solve(-K[free] @ moved)
            change, u = np.abs(moved - u).max(), moved
            if change <= TOLERANCE * np.abs(grip).max():
                break
        else:
            raise AssertionError("the secant iteration does not end")
        largest = np.maximum(largest, np.abs(np.einsum("npik,nk->npi", B, u[dofs])[..., 2]))
        motions.append(u.reshape(-1, 2).copy())
        forces.append(float((K @ u)[right].sum()))
    return np.array(motions), np.array(forces)
