"""The identified model walked once more along its own displacements: tangents and element forces, frame by frame.

Everything that asks "what would a small change here do to the images" is one back-substitution per frame with them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.errors import NotConverged
from idic.fe import (
    Evaluation, Factor, System, discretise, drives_at, evaluate_system, factorise_tangent, stiffness_times,
)
from idic.identification import Identification
from idic.model import Readings


@dataclass(frozen=True, eq=False)
class Tangent:
    """The model at one frame.

    index : of the frame within the evidence; readings : rows of the channels that are no reactions, None: all are
    """

    index: int
    system: System
    evaluation: Evaluation
    factor: Factor
    readings: Readings | None = None

    @property
    def held(self) -> np.ndarray:
        """Prescribed degrees of freedom."""
        return np.asarray(self.system.body.constraints.dofs)

    def answer(self, motion: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Displacement of the whole body under motion of held dofs and nodal forces  # (n_dof, m) each -> (n_dof, m)"""
        load = forces - stiffness_times(self.system, self.evaluation, motion)
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
        parts = []
        for group, at in zip(self.system.groups, self.evaluation.groups, strict=True):
            forces = np.einsum("p,pij,paj->pai", group.weights, at.P, group.grads)
            forces = forces.reshape(len(group.elements), group.points_per_element, -1).sum(axis=1)
            rows = np.repeat(np.asarray(group.elements), forces.shape[1])
            parts.append((forces.ravel(), rows, group.dofs.ravel()))
        values, rows, columns = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        body = self.system.body
        return csr_array((values, (rows, columns)), shape=(body.mesh.n_elements, body.n_dof))

    def element_work(self, fields: np.ndarray) -> np.ndarray:
        """Work of the internal forces of every element on nodal fields  # (n_dof, m) -> (n_elements, m) N mm"""
        work = np.zeros((self.system.body.mesh.n_elements, fields.shape[1]))
        for group, at in zip(self.system.groups, self.evaluation.groups, strict=True):
            n_el, per = len(group.elements), group.points_per_element
            forces = np.einsum("p,pij,paj->pai", group.weights, at.P, group.grads)  # (n_points, nn, d)
            forces = forces.reshape(n_el, per, -1).sum(axis=1)  # (n_el, nn d)
            work[group.elements] = np.einsum("ei,eim->em", forces, fields[group.dofs])
        return work


def tangents(identification: Identification, residual: ResidualEvidence, only: int | None = None) -> Iterator[Tangent]:
    """The tangent of every frame of the evidence; history-dependent laws keep their history along the path.

    only : place of the one frame that is wanted; laws without history are evaluated there alone

    Raises
    ------
    NotConverged
        If a law finds no answer along the path.
    """
    forward, parameters = identification.forward, identification.parameters
    model, params = forward.body_at(parameters, identification.local), forward.law_values(parameters)
    start = identification.experiment.model.reference
    times = identification.experiment.model.times[start:]
    system = discretise(model)
    states, former, factor, matrices, solved = system.rest_states(), 0, None, (), residual.solved_u
    history = any(state.size for state in states)
    for index, number in enumerate(residual.evidence.frames if only is None else residual.evidence.frames[:only + 1]):
        if only is not None and index < only and not history:
            continue
        frame = int(number) - start
        ev = evaluate_system(system, params, np.ascontiguousarray(solved[index]), states,
                               times[frame] - times[former],
                               drives_at(model, times, times[frame]), guesses=states if former else None)
        if ev.trouble:
            raise NotConverged(f"{ev.trouble}, frame {frame}")
        if only is not None and index < only:
            states, former = tuple(g.state for g in ev.groups), frame
            continue
        stiffness_times(system, ev, np.zeros((model.n_dof, 1)))  # leaves the element matrices in ev
        element_matrices = (*(g.Ke for g in ev.groups if g.Ke is not None), *ev.pressure_K, *ev.seam_K)
        if factor is None or not all(np.array_equal(a, b) for a, b in zip(element_matrices, matrices, strict=True)):
            factor, matrices = factorise_tangent(system, ev), element_matrices
        states, former = tuple(g.state for g in ev.groups), frame
        yield Tangent(index, system, ev, factor, forward.readings)
