"""Stress intensity factors and J of a crack tip, as integrals over a ring of elements around it.

With x1 along the crack and a weight q, one within the ring and zero outside,

    J = int (s_ij u_i,1 - W d_1j) q_,j dA
    I = int (s_ij U_i,1 + S_ij u_i,1 - s_ik E_ik d_1j) q_,j dA,      K = E' I / 2

Rice, J. Appl. Mech. 35 (1968) 379, doi:10.1115/1.3601206; domain form: Shih, Moran & Nakamura, Int. J. Fract. 30 (1986)
79, doi:10.1007/BF00034019; auxiliary field (U, E, S) of a unit K: Yau, Wang & Corten, J. Appl. Mech. 47 (1980) 335,
doi:10.1115/1.3153665. E' is E in plane stress and E/(1 - nu²) in plane strain. Small strains, free straight faces and
one material within the ring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.fe.crack.cut import Cut
from idic.fe.mesh.element import cell_type
from idic.fe.mesh.mesh import Mesh

INNER_SHARE = 0.5  # of the outer radius of the ring
MAX_RADIUS_SHARE = 0.85  # of the distance to the next edge, corner of the path or other material
MIN_ELEMENTS = 2.0  # sizes of an element at the tip: a smaller ring does not resolve the field
MAX_ELEMENTS = 8.0  # sizes of an element: a larger ring says nothing more


@dataclass(frozen=True, eq=False)
class Ring:
    """The elements around a tip that the integrals go over.

    Attributes
    ----------
    tip : (2,) mm; direction : (2,) unit vector along which the crack grows
    radius : mm, outer one
    parts : per kind of element: connectivity (n, nn), dN/dX (n, nq, nn, 2) 1/mm, places (n, nq, 2) mm from the tip,
        weights (n, nq) mm², dq/dX (n, nq, 2) 1/mm, shape functions (nq, nn)
    section : number of the material of the ring among those handed in
    """

    tip: np.ndarray
    direction: np.ndarray
    radius: float
    parts: tuple[tuple[np.ndarray, ...], ...]
    section: int

    def shifted(self, change: float) -> Ring:
        """The same elements and weights around a tip that is further along the crack (mm)."""
        way = change * self.direction
        parts = tuple((connectivity, grads, places - way, weights, q_grads)
                      for connectivity, grads, places, weights, q_grads in self.parts)
        return replace(self, tip=self.tip + way, parts=parts)

    @property
    def turn(self) -> np.ndarray:
        """Rows are the axes of the crack: along it, and across towards its left side  # (2, 2)"""
        c, s = self.direction
        return np.array([[c, s], [-s, c]])

    def tip_load(self, u: np.ndarray, tangent: np.ndarray, isotropic: tuple[float, float] | None,
                 kind: str) -> TipLoad:
        """The load of a tip.

        Parameters
        ----------
        u : (n_nodes, 2) mm
        tangent : (2, 2, 2, 2) MPa, in-plane stress by strain of the linear elastic material at the tip
        isotropic : E (MPa) and nu; None of another material
        kind : "plane_stress" or "plane_strain"
        """
        turn, J, interactions = self.turn, 0.0, np.zeros(2)
        stiffness = np.einsum("ai,bj,ck,dl,ijkl->abcd", turn, turn, turn, turn, tangent)
        for connectivity, grads, places, weights, q_grads in self.parts:
            gradient = np.einsum("ai,eni,eqnj,bj->eqab", turn, u[connectivity][..., :2], grads, turn)  # u_a,b
            strain = 0.5 * (gradient + gradient.swapaxes(-1, -2))
            stress = np.einsum("abcd,eqcd->eqab", stiffness, strain)
            dq = np.einsum("ai,eqi->eqa", turn, q_grads)
            energy = 0.5 * np.einsum("eqab,eqab->eq", stress, strain)
            J += float(np.sum(weights * (np.einsum("eqij,eqi,eqj->eq", stress, gradient[..., 0], dq)
                                         - energy * dq[..., 0])))
            if isotropic is None:
                continue
            for mode in range(2):
                places_along = np.einsum("ai,eqi->eqa", turn, places)
                slope, unit_stress, unit_strain = _unit_field(places_along, mode, isotropic, kind)
                interactions[mode] += float(np.sum(weights * (
                    np.einsum("eqij,eqi,eqj->eq", stress, slope, dq)
                    + np.einsum("eqij,eqi,eqj->eq", unit_stress, gradient[..., 0], dq)
                    - np.einsum("eqij,eqij->eq", stress, unit_strain) * dq[..., 0])))
        if isotropic is None:
            return TipLoad(np.nan, np.nan, J)
        E, nu = isotropic
        modulus = E if kind == "plane_stress" else E / (1.0 - nu**2)
        K_I, K_II = (0.5 * modulus * interactions).tolist()
        return TipLoad(K_I, K_II, J)


def ring_around(mesh: Mesh, cut: Cut, length: float, sections: Sequence[np.ndarray]) -> Ring | None:
    """The ring of a crack of this length (mm); None where there is no room for it.

    sections : (n,) elements of each material
    """
    segment, start = _segment(cut, length)
    direction = (cut.path[segment + 1] - cut.path[segment]) / np.linalg.norm(cut.path[segment + 1] - cut.path[segment])
    tip = cut.path[segment] + (length - start) * direction
    centres, sizes, elements = _elements(mesh)
    nearest = int(np.argmin(np.linalg.norm(centres - tip, axis=1)))
    size, section = sizes[nearest], next(k for k, members in enumerate(sections) if elements[nearest] in members)
    straight = length - start if segment or not _begins_at_edge(cut) else np.inf
    is_foreign = ~np.isin(elements, sections[section])
    to_foreign = np.linalg.norm(centres[is_foreign] - tip, axis=1).min(initial=np.inf)
    room = MAX_RADIUS_SHARE * min(_edge_distance(mesh, cut, tip, length), straight, to_foreign)
    if not room >= MIN_ELEMENTS * size:
        return None
    radius = min(room, MAX_ELEMENTS * size)
    return Ring(tip, direction, radius, tuple(_parts(mesh, tip, radius)), section)


def _begins_at_edge(cut: Cut) -> bool:
    return bool(cut.left_nodes[0] != cut.right_nodes[0])


def _segment(cut: Cut, length: float) -> tuple[int, float]:
    """The straight part of the path that holds the tip, and where it begins (mm)."""
    ends = np.cumsum(np.linalg.norm(np.diff(cut.path, axis=0), axis=1))
    segment = min(int(np.searchsorted(ends, length)), len(ends) - 1)
    return segment, float(ends[segment - 1]) if segment else 0.0


def _elements(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre (n, 2) mm, size (n,) mm and number (n,) of every element."""
    centres, sizes, numbers = [], [], []
    for block in mesh.blocks:
        corners = mesh.nodes[block.connectivity[:, :block.kind.n_corners], :2]
        ahead = np.roll(corners, -1, axis=1)
        area = 0.5 * np.sum(corners[..., 0] * ahead[..., 1] - corners[..., 1] * ahead[..., 0], axis=1)
        centres.append(corners.mean(axis=1))
        sizes.append(np.sqrt(area))
        numbers.append(block.first + np.arange(block.n_elements))
    return np.concatenate(centres), np.concatenate(sizes), np.concatenate(numbers)


def _edge_distance(mesh: Mesh, cut: Cut, tip: np.ndarray, length: float) -> float:
    """Distance of the tip from the next edge of the body, its own faces left out: their ends count (mm)."""
    face_nodes = set(cut.left_nodes.tolist()) | set(cut.right_nodes.tolist())
    faces = [mesh.face_nodes(face)[:2] for face in mesh.boundary_faces()]
    ends = mesh.nodes[[pair for pair in faces if not {int(pair[0]), int(pair[1])} <= face_nodes], :2]
    a, b = ends[:, 0], ends[:, 1]
    along = np.clip(np.einsum("ni,ni->n", tip - a, b - a) / np.einsum("ni,ni->n", b - a, b - a), 0.0, 1.0)
    return float(np.linalg.norm(a + along[:, None] * (b - a) - tip, axis=1).min(initial=np.inf))


def _parts(mesh: Mesh, tip: np.ndarray, radius: float):
    inner = INNER_SHARE * radius
    weight = np.clip((radius - np.linalg.norm(mesh.nodes[:, :2] - tip, axis=1)) / (radius - inner), 0.0, 1.0)
    for block in mesh.blocks:
        # by the corners: between them the weight is that of the linear element, and no mid-side node adds waves
        n_corners = block.kind.n_corners
        q = weight[block.connectivity[:, :n_corners]]
        chosen = np.ptp(q, axis=1) > 0.0
        if not chosen.any():
            continue
        connectivity, q = block.connectivity[chosen], q[chosen]
        points, w = block.kind.quadrature_rule()
        shape, linear = block.kind.shape_functions(points), _LINEAR[n_corners]
        jac = np.einsum("eak,qai->eqki", mesh.nodes[connectivity], block.kind.shape_gradients(points))
        inverse = np.linalg.inv(jac)
        grads = np.einsum("qai,eqik->eqak", block.kind.shape_gradients(points), inverse)
        q_grads = np.einsum("ea,qai,eqik->eqk", q, cell_type(linear).shape_gradients(points), inverse)
        places = np.einsum("qa,eak->eqk", shape, mesh.nodes[connectivity]) - tip
        yield connectivity, grads, places, np.linalg.det(jac) * w, q_grads


_LINEAR = {3: "tri3", 4: "quad4"}


@dataclass(frozen=True)
class TipLoad:
    """What loads a tip: K_I and K_II in MPa sqrt(mm), nan where the material is not isotropic; J in N/mm."""

    K_I: float
    K_II: float
    J: float


def _unit_field(places: np.ndarray, mode: int, isotropic: tuple[float, float],
                kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u_i,1 (..., 2), stress and strain (..., 2, 2) of a unit K (Williams 1957, doi:10.1115/1.4011454)

    places : (..., 2) mm in the axes of the crack
    """
    E, nu = isotropic
    r, t = np.hypot(places[..., 0], places[..., 1]), np.arctan2(places[..., 1], places[..., 0])
    s, c, s3, c3 = np.sin(0.5 * t), np.cos(0.5 * t), np.sin(1.5 * t), np.cos(1.5 * t)
    factor = 1.0 / np.sqrt(2.0 * np.pi * r)
    if mode == 0:
        xx, yy, xy = c * (1.0 - s * s3), c * (1.0 + s * s3), s * c * c3
    else:
        xx, yy, xy = -s * (2.0 + c * c3), s * c * c3, c * (1.0 - s * s3)
    stress = factor[..., None, None] * np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    poisson = nu if kind == "plane_stress" else nu / (1.0 - nu)
    modulus = E if kind == "plane_stress" else E / (1.0 - nu**2)
    trace = np.trace(stress, axis1=-2, axis2=-1)
    strain = ((1.0 + poisson) * stress - poisson * trace[..., None, None] * np.eye(2)) / modulus
    rotation = -2.0 * (s if mode == 0 else c) * factor / modulus  # (u_2,1 - u_1,2)/2, conjugate to the trace
    slope = np.stack([strain[..., 0, 0], strain[..., 0, 1] + rotation], axis=-1)
    return slope, stress, strain
