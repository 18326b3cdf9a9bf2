"""First-order response of a simulation to another law, load or motion, without a new simulation.

The other model follows the displacements of the first one. Its out-of-balance forces, and the difference of the
prescribed motion, act on the tangent of the first one:

    K du = -(R_other(u) - R(u) + K_fp du_p),      dF = R_other(u) - R(u) + K du   at the held dofs

One Newton step for any change of the model, at the cost of one evaluation and one back-substitution per frame. Each
model keeps its own history along the given path; the change of the path itself enters at the present frame only.

Models that differ in loads, motions or factors on the stress alone share the stresses of their points (`ModelPoints`),
and all models are solved for together: a hundred of them cost little more than their different laws.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.errors import NotConverged
from idic.fe.assembly import kernels
from idic.fe.assembly.assembly import (
    Evaluation, evaluate_system, external_force, stiffness_times, weight_factor,
)
from idic.fe.assembly.assembly import System, discretise
from idic.fe.assembly.linear import kept_response
from idic.fe.body.boundary import drives_at
from idic.fe.equilibrium import kept_factor
from idic.fe.body.body import Body
from idic.fe.sensitivity import answer_to_control


@dataclass(frozen=True)
class Alternative:
    """Another model on the same mesh with the same held dofs; params as for `march`."""

    body: Body
    params: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Responses:
    """Change of one frame under every other model: displacement (n_nodes, d, m) mm, channels (n_channels, m)."""

    du: np.ndarray
    dchannels: np.ndarray


def first_responses(base: Alternative, times: np.ndarray, frames: Sequence[int], u: np.ndarray,
                    alternatives: Sequence[Alternative]) -> Iterator[Responses]:
    """The response of every other model at each of some frames.

    Parameters
    ----------
    times : (n_frames,) s, of the models' histories, the reference first
    frames : increasing frame numbers, the reference (0) not among them; the path is straight in between
    u : (n, n_nodes, d) mm, equilibrium of `base` at these frames

    Yields
    ------
    Responses
        nan from the frame on in which the law of another model has no solution along the path.

    Raises
    ------
    NotConverged
        If the law of `base` has no solution.
    """
    first = discretise(base.body)
    unvaried = first if not base.body.variations else discretise(replace(base.body, variations=()), first.pattern)
    systems = [like(unvaried, alternative.body) for alternative in alternatives]
    base_points, courses, course_of = ModelPoints(first, base), [], []
    for system, alternative in zip(systems, alternatives, strict=True):
        course = next((i for i, candidate in enumerate(courses) if candidate.serves(system, alternative)), None)
        if course is None:
            course = len(courses)
            courses.append(ModelPoints(system, alternative))
        course_of.append(course)
    factor, matrices, alive = None, (), [True] * len(courses)
    for previous_frame, frame, moved in zip((0, *frames), frames, u, strict=False):
        span = (times, previous_frame, frame, moved)
        former_states = base_points.states
        evaluation = base_points.at(*span, stiffness=True)
        thinned = _thinned(first, former_states, base_points.states)
        factor, matrices = kept_factor(first, evaluation, factor, matrices)
        stresses = [course.attempt(*span, thinned) if living else None
                    for course, living in zip(courses, alive, strict=True)]
        alive = [stress is not None for stress in stresses]
        forces, motions = np.zeros((moved.size, len(systems))), np.zeros((moved.size, len(systems)))
        drives, held_dofs = drives_at(base.body, times, times[frame]), np.asarray(base.body.constraints.dofs)
        for i, (system, course) in enumerate(zip(systems, course_of, strict=True)):
            if not alive[course]:
                continue
            other_drives = drives_at(system.body, times, times[frame])
            internal = _internal_force(system, courses[course].system, stresses[course])
            forces[:, i] = (internal - external_force(system, other_drives, moved) - evaluation.residual).ravel()
            motions[held_dofs, i] = other_drives.prescribed - drives.prescribed
        responses = solved_responses(first, evaluation, factor, forces, motions)
        lost = [i for i, course in enumerate(course_of) if not alive[course]]
        responses.du[..., lost] = responses.dchannels[..., lost] = np.nan
        yield responses


def like(base: System, body: Body) -> System:
    """`discretise` of a model; numbering and shape functions of `base` are used again where they are the same."""
    base_body = base.body
    alike = _numbered_alike(body, base_body)
    reusable = (alike and np.array_equal(body.mesh.nodes, base_body.mesh.nodes)
                and (body.kind, body.thickness, body.locking) == (base_body.kind, base_body.thickness,
                                                                     base_body.locking)
                and body.quadrature == base_body.quadrature and not base_body.variations and not base.pressures
                and not body.loads.pressure_faces and not any(group.mean_dilatation for group in base.groups)
                and all(section.law.spec.crack_band is None or section.law is base_section.law
                        for section, base_section in zip(body.sections, base_body.sections, strict=True)))
    if not reusable:
        return discretise(body, base.pattern if alike else None)
    groups = []
    for group in base.groups:
        factor = weight_factor(body, group.section, group.cell, group.connectivity, group.weights,
                                        group.mean_dilatation)
        weights = group.weights if factor is None else group.weights * factor
        law = body.sections[group.section].law
        linear = kept_response(law, body.mode, group.grads, weights, len(group.elements), group.mean_dilatation)
        groups.append(replace(group, law=law, weights=weights, linear=linear))
    return replace(base, body=body, groups=tuple(groups))


def _numbered_alike(first: Body, second: Body) -> bool:
    """Whether elements, sections and held dofs of two models are the same."""
    return (np.array_equal(first.constraints.dofs, second.constraints.dofs)
            and len(first.sections) == len(second.sections) and len(first.mesh.blocks) == len(second.mesh.blocks)
            and len(first.seams) == len(second.seams)
            and all(np.array_equal(a.pairs, b.pairs) for a, b in zip(first.seams, second.seams, strict=True))
            and all(np.array_equal(a.elements, b.elements)
                    for a, b in zip(first.sections, second.sections, strict=True))
            and all(np.array_equal(a.connectivity, b.connectivity)
                    for a, b in zip(first.mesh.blocks, second.mesh.blocks, strict=True)))


class ModelPoints:
    """Stresses of a model's points along given displacements; they keep their history."""

    def __init__(self, system: System, body: Alternative):
        self.system, self.params, self.states = system, body.params, system.rest_states()

    def serves(self, system: System, body: Alternative) -> bool:
        """Whether the points of another model go through the same."""
        base_body, other_model = self.system.body, system.body
        if (len(self.system.groups) != len(system.groups)
                or not _equal(base_body.temperature, other_model.temperature)
                or not _equal(base_body.start_temperature, other_model.start_temperature)):
            return False
        return all(a.law is b.law and a.name == b.name and a.expansion == b.expansion
                   and np.array_equal(self.params[a.name], body.params[b.name])
                   for a, b in zip(base_body.sections, other_model.sections, strict=True)) and all(
                       a.mean_dilatation == b.mean_dilatation and (not a.mean_dilatation or a.weights is b.weights)
                       and np.array_equal(a.elements, b.elements)
                       for a, b in zip(self.system.groups, system.groups, strict=True))

    def attempt(self, times: np.ndarray, start_frame: int, frame: int, u: np.ndarray,
                thinned: Sequence[np.ndarray]) -> Evaluation | None:
        """`at` without stiffness; None where the law finds no answer."""
        try:
            return self.at(times, start_frame, frame, u, False, thinned)
        except NotConverged:
            return None

    def at(self, times: np.ndarray, start_frame: int, frame: int, u: np.ndarray, stiffness: bool,
           thinned: Sequence[np.ndarray] = ()) -> Evaluation:
        """The points at the displacement u (n_nodes, d) mm of `frame`, from their states at `start_frame`.

        Their new states are kept. `NotConverged` where the law has no solution. thinned : per group (n_points,), in
        plane stress, by which the thickness stretches of another model changed: theirs nearly do the same.
        """
        drives = drives_at(self.system.body, times, times[frame])
        guesses = self.states if start_frame else None
        if [len(factor) for factor in thinned] == [len(state) for state in self.states] != []:
            guesses = [state[:, -1:] * factor[:, None] for state, factor in zip(self.states, thinned, strict=True)]
        evaluation = evaluate_system(self.system, self.params, u, self.states, times[frame] - times[start_frame],
                                     drives, guesses=guesses, stiffness=stiffness)
        if evaluation.trouble:
            raise NotConverged(f"{evaluation.trouble}, frame {frame}")
        self.states = tuple(group.state for group in evaluation.groups)
        return evaluation


def _thinned(system: System, former: Sequence[np.ndarray], states: Sequence[np.ndarray]) -> list[np.ndarray]:
    """By which the thickness stretches of the points have changed, per group; [] but for plane stress  # (n_points,)"""
    if system.body.kind != "plane_stress":
        return []
    return [state[:, -1] / former_state[:, -1] for former_state, state in zip(former, states, strict=True)]


def _equal(first: np.ndarray | None, second: np.ndarray | None) -> bool:
    return (first is None and second is None) or (first is not None and second is not None
                                                  and np.array_equal(first, second))


def _internal_force(system: System, evaluated: System, stresses: Evaluation) -> np.ndarray:
    """Of a model, from the stresses of the points of another one  # (n_nodes, d) N"""
    if all(group.grads is twin.grads and np.array_equal(group.weights, twin.weights)
           for group, twin in zip(system.groups, evaluated.groups, strict=True)):
        return stresses.internal
    internal = np.zeros_like(stresses.u)
    for group, at in zip(system.groups, stresses.groups, strict=True):
        kernels.add_internal_forces(group.connectivity, group.grads, group.weights, at.P, internal)
    return internal


def solved_responses(system: System, evaluation: Evaluation, factor, forces: np.ndarray,
                     motions: np.ndarray) -> Responses:
    """Answer of the tangent to forces lacking for equilibrium and to another prescribed motion  # (n_dof, m) each"""
    free_dofs, channels = system.pattern.dofs, system.body.channels
    if motions.any():
        forces = forces + stiffness_times(system, evaluation, motions)
    moved = np.zeros_like(forces)
    moved[free_dofs] = factor.solve(-forces[free_dofs])
    readings = np.zeros((len(forces), len(channels)))
    for k, channel in enumerate(channels):
        np.add.at(readings[:, k], np.asarray(channel.dofs, dtype=np.int64), channel.factor)
    channel_changes = readings.T @ forces + stiffness_times(system, evaluation, readings, transposed=True).T @ moved
    moved = motions + moved
    if system.body.control is not None:  # the gauge stays on its course
        gauge, (with_it, felt) = system.body.control.gauge, answer_to_control(system, evaluation, factor)
        more = -(gauge @ moved) / (gauge @ with_it)
        moved, channel_changes = moved + with_it * more, channel_changes + readings.T @ (felt * more)
    return Responses(moved.reshape(*evaluation.u.shape, -1), channel_changes)
