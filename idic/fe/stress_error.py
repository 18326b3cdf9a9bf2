"""First-order response of a simulation to errors of its stress: smooth fields in proportion to the stress itself.

    dP(X, t) = w_j(X) |P(X, t)| E_k,      K du = -int dP : grad N dV,      dF = int dP : grad N dV + K du

(docs/method.md, equation 14.2)
with smooth weights w_j given at the nodes and one symmetric E_k per component (xx, xy, yy in the plane). K is the
tangent of the simulated path: the response is larger where the body yields. One evaluation of the law per frame, and
one factorisation per frame of interest, serve all fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from idic.fe.assembly.assembly import Group, System, discretise, points_of
from idic.fe.equilibrium import kept_factor
from idic.fe.response import Alternative, ModelPoints, Responses, solved_responses


def stress_error_responses(base: Alternative, times: np.ndarray, u: Iterable[np.ndarray], frames: Sequence[int],
                           weights: np.ndarray) -> Iterator[Responses]:
    """The response to each field at some frames.

    Parameters
    ----------
    times : (n_frames,) s, of the model's histories, the reference first
    u : (n_nodes, d) mm of every frame after the reference, equilibrium of `base`
    frames : increasing frame numbers, counted from the reference
    weights : (n_nodes, p) w_j at the nodes

    Yields
    ------
    Responses
        Of p fields per component of the stress, component after component: (n_nodes, d, p d (d + 1) / 2).

    Raises
    ------
    NotConverged
        If the law finds no stress along the path.
    """
    system = discretise(base.body)
    points = ModelPoints(system, base)
    sums = [_NodalSums.of(system, group, weights) for group in system.groups]
    factor, matrices = None, ()
    for frame, moved in enumerate(u, start=1):
        evaluation = points.at(times, frame - 1, frame, moved, stiffness=frame in frames)
        if frame not in frames:
            continue
        factor, matrices = kept_factor(system, evaluation, factor, matrices)
        forces = _component_forces(sum(nodal_sums.of_stress(at.P)
                                       for nodal_sums, at in zip(sums, evaluation.groups, strict=True)))
        yield solved_responses(system, evaluation, factor, forces, np.zeros_like(forces))


@dataclass(frozen=True, eq=False)
class _NodalSums:
    """weights : (n_points, p) of the fields; along : per axis (n_nodes, n_points), volume times dN/dX."""

    weights: np.ndarray
    along: tuple[sparse.csr_array, ...]

    @classmethod
    def of(cls, system: System, group: Group, weights: np.ndarray) -> _NodalSums:
        n, nn, d = group.grads.shape
        rows = np.repeat(group.connectivity, group.points_per_element, axis=0).ravel()
        places = (rows, np.repeat(np.arange(n), nn))
        shape = (len(system.body.mesh.nodes), n)
        along = tuple(sparse.csr_array(((group.weights[:, None] * group.grads[:, :, axis]).ravel(), places),
                                       shape=shape) for axis in range(d))
        return cls(points_of(system, group, weights), along)

    def of_stress(self, P: np.ndarray) -> np.ndarray:
        """Nodal sums of w |P| dN/dX along every axis  # (n_points, d, d) -> (d, n_nodes, p)"""
        sized = np.linalg.norm(P, axis=(1, 2))[:, None] * self.weights
        return np.array([matrix @ sized for matrix in self.along])


def _component_forces(sums: np.ndarray) -> np.ndarray:
    """Nodal forces of every component of the stress  # (d, n_nodes, p) -> (n_nodes d, components p)"""
    d, n, p = sums.shape
    forces = []
    for i in range(d):
        for j in range(i, d):
            force = np.zeros((n, d, p))
            force[:, i] += sums[j]
            if j != i:
                force[:, j] += sums[i]
            forces.append(force.reshape(n * d, p))
    return np.concatenate(forces, axis=1)
