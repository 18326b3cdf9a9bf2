"""A body walked once more along known displacements: its tangent and element forces, frame by frame.

What a small change does to the motion or to a reading is one back-substitution per frame with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from idic.errors import NotConverged
from idic.fe.assembly.assembly import Evaluation, Group, System, discretise, evaluate_system, stiffness_times
from idic.fe.body.body import Body
from idic.fe.body.boundary import drives_at
from idic.fe.equilibrium import factorise_tangent
from idic.fe.solver.linear import Factor


@dataclass(frozen=True, eq=False)
class Tangent:
    """A body in equilibrium at one frame; index : of the frame among those that were asked for."""

    index: int
    system: System
    evaluation: Evaluation
    factor: Factor

    @property
    def held(self) -> np.ndarray:
        """Prescribed degrees of freedom."""
        return np.asarray(self.system.body.constraints.dofs)

    def times(self, motion: np.ndarray, transposed: bool = False) -> np.ndarray:
        """K motion, or K^T motion, held dofs included on both sides  # (n_dof, m) mm -> (n_dof, m) N"""
        return stiffness_times(self.system, self.evaluation, motion, transposed)

    def answer(self, motion: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Displacement of the whole body under motion of held dofs and nodal forces  # (n_dof, m) each -> (n_dof, m)"""
        load = forces - self.times(motion)
        dofs, displacement = self.system.pattern.dofs, motion.copy()
        displacement[dofs] += self.factor.solve(load[dofs])
        return displacement

    def adjoint(self, load: np.ndarray) -> np.ndarray:
        """K^-T load on the free dofs, zero on held ones  # (n_dof, m)"""
        dofs, solution = self.system.pattern.dofs, np.zeros_like(load)
        solution[dofs] = self.factor.solve_transposed(load[dofs])
        return solution

    def element_forces(self) -> csr_array:
        """Internal forces of every element  # (n_elements, n_dof) N"""
        parts = [(forces.ravel(), np.repeat(np.asarray(group.elements), forces.shape[1]), group.dofs.ravel())
                 for group, forces in self._forces()]
        values, rows, columns = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        body = self.system.body
        return csr_array((values, (rows, columns)), shape=(body.mesh.n_elements, body.n_dof))

    def element_work(self, fields: np.ndarray) -> np.ndarray:
        """Work of the internal forces of every element on nodal fields  # (n_dof, m) -> (n_elements, m) N mm"""
        work = np.zeros((self.system.body.mesh.n_elements, fields.shape[1]))
        for group, forces in self._forces():
            work[group.elements] = np.einsum("ei,eim->em", forces, fields[group.dofs])
        return work

    def _forces(self) -> Iterator[tuple[Group, np.ndarray]]:
        """Every group of elements and their internal forces  # (n_elements of the group, nodes d) N"""
        for group, at in zip(self.system.groups, self.evaluation.groups, strict=True):
            forces = np.einsum("p,pij,paj->pai", group.weights, at.P, group.grads)
            yield group, forces.reshape(len(group.elements), group.points_per_element, -1).sum(axis=1)


def tangents_along(body: Body, params: Mapping[str, np.ndarray], times: np.ndarray, frames: Sequence[int],
                   motion: np.ndarray, only: int | None = None) -> Iterator[Tangent]:
    """The tangent of every frame on the way; history-dependent laws keep their history along it.

    Parameters
    ----------
    params : per section, in the law's order; times : (n_frames,) s from the reference on
    frames : increasing, numbers among `times`; motion : (len(frames), n_nodes, d) mm, in equilibrium
    only : place of the one frame that is wanted; laws without history are evaluated there alone

    Raises
    ------
    NotConverged
        If a law finds no answer along the path.
    """
    system = discretise(body)
    states, former, factor, matrices = system.rest_states(), 0, None, ()
    history = any(state.size for state in states)
    for index, frame in enumerate(frames if only is None else frames[:only + 1]):
        if only is not None and index < only and not history:
            continue
        ev = evaluate_system(system, params, np.ascontiguousarray(motion[index]), states, times[frame] - times[former],
                             drives_at(body, times, times[frame]), guesses=states if former else None)
        if ev.trouble:
            raise NotConverged(f"{ev.trouble}, frame {frame}")
        states, former = tuple(g.state for g in ev.groups), frame
        if only is not None and index < only:
            continue
        stiffness_times(system, ev, np.zeros((body.n_dof, 1)))  # leaves the element matrices in ev
        element_matrices = (*(g.Ke for g in ev.groups if g.Ke is not None), *ev.pressure_K, *ev.seam_K)
        if factor is None or not all(np.array_equal(a, b) for a, b in zip(element_matrices, matrices, strict=True)):
            factor, matrices = factorise_tangent(system, ev), element_matrices
        yield Tangent(index, system, ev, factor)
