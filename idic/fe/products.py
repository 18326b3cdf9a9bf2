"""Products with the derivatives of a simulation, J v and J^T w, without the derivatives themselves.

Direct differentiation (`idic.fe.sensitivity`) takes a solution per unknown and increment. With many unknowns, as the
values of a field, only products are affordable: with the factorised tangent of every increment, J v takes one solution
per increment whatever the number of unknowns, and so does J^T w, backwards in time (Michaleris, Tortorelli and Vidal,
1994, doi:10.1002/nme.1620371408). In the notation of docs/method.md, equations 5.1 to 5.3, with the weights w of
du, c of the forces at the held dofs and eta of the state at the end of an increment::

    z = -K_ff^-T (w + (dh/du)^T eta + K_pf^T c),    p = z at free, c at held dofs
    J^T w += (dR/dlambda)^T p + (dh/dlambda)^T eta,    eta_n = (dR/dh_n)^T p + (dh/dh_n)^T eta

Of a point the derivatives of stress and new state are small matrices, made once. What they and the factors take beyond
`MAX_KEPT_BYTES` is made again for every product from the states at the ends of the increments.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array

from idic.errors import InputError
from idic.fe.assembly import expansion, kernels, kernels_solid, locking
from idic.fe.assembly.assembly import (
    Group, GroupEvaluation, System, element_matrices, evaluate_system, further_matrices, point_changes,
    stress_variations, values_at,
)
from idic.fe.body.body import Body, Direction
from idic.fe.body.boundary import at_time
from idic.fe.equilibrium import Control, Converged, consistent_factor
from idic.fe.sensitivity import parameter_changes
from idic.fe.solver.linear import Factor
from idic.fe.time_march import Increment, StepList, channel_values, solved_increments

MAX_KEPT_BYTES = 1_500_000_000  # of factors and derivatives of points


@dataclass(frozen=True)
class MotionSeries:
    """The motion and the channels of all frames, or a change of them: u (n_frames, n_nodes, d) mm, channels (n_frames,
    n_channels)."""

    u: np.ndarray
    channels: np.ndarray


@dataclass(frozen=True, eq=False)
class _Unknowns:
    """What v and the result of J^T w mean, sorted by kind.

    material, variation, drive : the numbers of the unknowns of each kind; a drive may be a load too
    directions : of the material ones; shapes : per group, relative change of the weight of its points per unit of each
        factor field  # (n_points, n_variation)
    histories : (n_frames, n_drives + n_dead, n_drive) derivative of the histories
    """

    n: int
    material: np.ndarray
    variation: np.ndarray
    drive: np.ndarray
    directions: tuple[Direction, ...]
    shapes: tuple[csc_array, ...]
    histories: np.ndarray


@dataclass(frozen=True, eq=False)
class _PointSlopes:
    """Derivatives of stress and new state of the points of a group, each (n_points, rows, columns); the stress acts on
    F. Those of a law without a memory have no columns of a state.

    stress_by_state, stress_by_parameter; state_by_F, state_by_state, state_by_parameter
    """

    stress_by_state: np.ndarray
    stress_by_parameter: np.ndarray
    state_by_F: np.ndarray
    state_by_state: np.ndarray
    state_by_parameter: np.ndarray

    @property
    def n_bytes(self) -> int:
        return sum(getattr(self, name).nbytes for name in self.__dataclass_fields__)


@dataclass(frozen=True, eq=False)
class _Linear:
    """The equations of an increment linearised at its end.

    factor : of the consistent tangent; at_edge : rows and columns of the stiffness at prescribed dofs  # (n_dof, n_dof)
    groups : the points there; slopes : their derivatives
    """

    factor: Factor
    at_edge: csr_array
    groups: tuple[GroupEvaluation, ...]
    slopes: tuple[_PointSlopes, ...]

    def n_bytes(self, previous: _Linear | None) -> int:
        """Memory of this increment; a factor that the increment before has too is not counted again."""
        points = sum(g.F.nbytes + g.P.nbytes for g in self.groups) + sum(slopes.n_bytes for slopes in self.slopes)
        if previous is not None and previous.factor is self.factor:
            return points
        return int(points + 2 * self.factor.pattern.factor_entries * self.at_edge.data.itemsize)


class Linearisation:
    """A simulation of all frames, and products with its derivatives by the directions.

    motion : of all frames, the reference first; steps : its increments
    """

    def __init__(self, system: System, params: Mapping[str, np.ndarray], times: np.ndarray,
                 directions: Sequence[Direction], increments: Iterable[Increment]):
        self.system, self.params, self.times = system, params, times
        self._unknowns = _sorted_unknowns(system, directions)
        self._increments: list[Increment] = []
        self._linear: list[_Linear | None] = []
        self.steps, n_bytes, previous = StepList(), 0, None
        u, channels = [np.zeros_like(system.body.mesh.nodes)], [np.zeros(len(system.body.channels))]
        self._readings = _readings(system)
        for increment in increments:
            end = increment.end
            factor = consistent_factor(system, end) if increment.factor is None else increment.factor
            linear = self._linearised(increment, replace(end, factor=None), factor)
            n_bytes, previous = n_bytes + linear.n_bytes(previous), linear
            self._linear.append(linear if n_bytes <= MAX_KEPT_BYTES else None)
            if increment.ends_frame is not None:
                u.append(end.u)
                channels.append(channel_values(system.body.channels, end.evaluation.residual.ravel()))
            checkpoint = replace(increment, factor=None, start=_checkpoint(increment.start), end=_checkpoint(end))
            self._increments.append(checkpoint)
            self.steps = StepList(increment.step_ends) if increment.step_ends else self.steps
        self.motion = MotionSeries(np.array(u), np.array(channels))

    @classmethod
    def of(cls, body: Body, params: Mapping[str, np.ndarray], times: np.ndarray, directions: Sequence[Direction],
           steps: StepList | None = None, substeps: int = 1, control: Control | None = None,
           warm_start: Iterable[np.ndarray] | None = None, may_cut: bool = False) -> Linearisation:
        """Simulate the whole test; parameters and errors as of `idic.fe.march`.

        Raises
        ------
        InputError
            As `march`; for a direction that is no material parameter, factor field, history or dead load, and for a
            body that a gauge controls.
        """
        _check(body, directions)
        system, increments = solved_increments(body, params, times, directions, steps, substeps, control, warm_start,
                                               may_cut)
        return cls(system, params, np.asarray(times, dtype=float), directions, increments)

    def tangent(self, v: np.ndarray) -> MotionSeries:
        """J v, the change of the motion along the unknowns v (n,)."""
        system, unknowns, shape = self.system, self._unknowns, self.system.body.mesh.nodes.shape
        states = [np.zeros((g.n_points, _n_state(g))) for g in system.groups]
        weights = [shapes @ v[unknowns.variation] for shapes in unknowns.shapes]
        material, histories = v[unknowns.material], unknowns.histories @ v[unknowns.drive]
        moved = MotionSeries(np.zeros_like(self.motion.u), np.zeros_like(self.motion.channels))
        edge, free_dofs = np.asarray(system.body.constraints.dofs), system.pattern.dofs
        for increment, linear in self._forwards():
            forces, du = np.zeros(shape), np.zeros(system.body.n_dof)
            for group, g, slopes, state, weight in zip(system.groups, linear.groups, linear.slopes, states, weights,
                                                       strict=True):
                dP = (np.einsum("pij,pj->pi", slopes.stress_by_state, state)
                      + slopes.stress_by_parameter @ material).reshape(g.P.shape)
                if group.mean_dilatation and g.scale is None:
                    locking.average_trace(dP[:, None], group.weights, len(group.elements))
                dP += weight[:, None, None] * g.P
                kernels.add_internal_forces(group.connectivity, group.grads, group.weights, dP, forces)
            forces = forces.ravel()
            drives, loads = self._at(histories, increment.end.time)
            du[edge] = system.body.constraints.basis @ drives
            if len(loads):
                forces -= system.body.loads.dead @ loads
            forces += linear.at_edge @ du
            step = np.zeros(system.body.n_dof)
            step[free_dofs] = linear.factor.solve(-forces[free_dofs])
            forces += linear.at_edge @ step
            du = (du + step).reshape(shape)
            for k, (group, g, slopes) in enumerate(zip(system.groups, linear.groups, linear.slopes, strict=True)):
                if _n_state(group):
                    dF = _gradient_changes(group, g, du)
                    states[k] = (np.einsum("pij,pj->pi", slopes.state_by_state, states[k])
                                 + np.einsum("pij,pj->pi", slopes.state_by_F, dF.reshape(len(dF), -1))
                                 + slopes.state_by_parameter @ material)
            if increment.ends_frame is not None:
                moved.u[increment.ends_frame] = du
                moved.channels[increment.ends_frame] = self._readings[edge].T @ forces[edge]
        return moved

    def adjoint(self, u: np.ndarray, channels: np.ndarray) -> np.ndarray:
        """J^T w, the derivative of a weighted sum of motion and channels by the unknowns  # (n,)

        u (n_frames, n_nodes, d), channels (n_frames, n_channels) : the weights
        """
        system, unknowns, shape = self.system, self._unknowns, self.system.body.mesh.nodes.shape
        states = [np.zeros((g.n_points, _n_state(g))) for g in system.groups]
        weights = [np.zeros(g.n_points) for g in system.groups]
        material, drive = np.zeros(len(unknowns.material)), np.zeros(len(unknowns.drive))
        edge, free_dofs = np.asarray(system.body.constraints.dofs), system.pattern.dofs
        for increment, linear in self._backwards():
            p, load = np.zeros(system.body.n_dof), np.zeros(shape)
            if increment.ends_frame is not None:
                load += u[increment.ends_frame]
                p[edge] = self._readings[edge] @ channels[increment.ends_frame]
            for group, g, slopes, state in zip(system.groups, linear.groups, linear.slopes, states, strict=True):
                if _n_state(group):
                    by_F = np.einsum("pij,pi->pj", slopes.state_by_F, state).reshape(g.F.shape)
                    _add_transposed_gradient(group, g, by_F, load)
            load = load.ravel()
            pull = load + linear.at_edge.T @ p
            p[free_dofs] = -linear.factor.solve_transposed(pull[free_dofs])
            for k, (group, g, slopes) in enumerate(zip(system.groups, linear.groups, linear.slopes, strict=True)):
                gradient = _plain_gradient(group, p.reshape(shape))
                weights[k] += group.weights * np.einsum("pij,pij->p", gradient, g.P)
                if group.mean_dilatation and g.scale is None:
                    locking.average_trace(gradient[:, None], group.weights, len(group.elements))
                stress = (group.weights[:, None, None] * gradient).reshape(len(gradient), -1)
                material += (np.einsum("pim,pi->m", slopes.stress_by_parameter, stress)
                             + np.einsum("pim,pi->m", slopes.state_by_parameter, states[k]))
                if _n_state(group):
                    states[k] = (np.einsum("pij,pi->pj", slopes.stress_by_state, stress)
                                 + np.einsum("pij,pi->pj", slopes.state_by_state, states[k]))
            if len(drive):
                by_edge = (load + linear.at_edge.T @ p)[edge]
                dead = system.body.loads.dead
                by_history = np.concatenate([system.body.constraints.basis.T @ by_edge,
                                             np.zeros(0) if dead is None else -dead.T @ p])
                drive += by_history @ self._histories_at(increment.end.time)
        gradient = np.zeros(unknowns.n)
        gradient[unknowns.material], gradient[unknowns.drive] = material, drive
        gradient[unknowns.variation] = sum((shapes.T @ weight for shapes, weight in
                                            zip(unknowns.shapes, weights, strict=True)),
                                           start=np.zeros(len(unknowns.variation)))
        return gradient

    def _at(self, histories: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Drives and dead loads at a time."""
        values = at_time(histories, self.times, t)
        n_drives = self.system.body.constraints.histories.shape[1]
        return values[:n_drives], values[n_drives:]

    def _histories_at(self, t: float) -> np.ndarray:
        histories = self._unknowns.histories
        return at_time(histories.reshape(len(histories), -1), self.times, t).reshape(histories.shape[1:])

    def _forwards(self) -> Iterator[tuple[Increment, _Linear]]:
        for increment, linear in zip(self._increments, self._linear, strict=True):
            yield increment, self._again(increment) if linear is None else linear

    def _backwards(self) -> Iterator[tuple[Increment, _Linear]]:
        for increment, linear in zip(reversed(self._increments), reversed(self._linear), strict=True):
            yield increment, self._again(increment) if linear is None else linear

    def _again(self, increment: Increment) -> _Linear:
        """Evaluated and factorised once more from the checkpoint."""
        start, end = increment.start, increment.end
        evaluation = evaluate_system(self.system, self.params, end.u, start.states, end.time - start.time, end.drives,
                                     end.states)
        end = replace(end, evaluation=evaluation)
        return self._linearised(increment, end, consistent_factor(self.system, end))

    def _linearised(self, increment: Increment, end: Converged, factor: Factor) -> _Linear:
        system, start = self.system, increment.start
        changes = (parameter_changes(system, self._unknowns.directions, self.params, self.times, end)
                   if self._unknowns.directions else [None] * len(system.groups))
        slopes = tuple(
            _point_slopes(system, k, g, self.params[system.body.sections[group.section].name], start.states,
                          end.time - start.time, changes[k], len(self._unknowns.material))
            for k, (group, g) in enumerate(zip(system.groups, end.evaluation.groups, strict=True)))
        at_edge = _stiffness_at_edge(system, end)
        groups = tuple(replace(g, A=None, Ke=None, b=None) for g in end.evaluation.groups)
        return _Linear(factor, at_edge, groups, slopes)


def _check(body: Body, directions: Sequence[Direction]) -> None:
    """Raise InputError for what has no products."""
    n_dead = 0 if body.loads.dead is None else body.loads.dead.shape[1]
    for d in directions:
        kinds = {"thickness": d.thickness, "expansion": d.expansion is not None, "d_tips": d.d_tips is not None,
                 "d_temperature": d.d_temperature is not None, "d_readings": d.d_readings is not None,
                 "d_loads of a pressure": d.d_loads is not None and np.any(np.asarray(d.d_loads)[:, n_dead:])}
        excluded = [kind for kind, is_given in kinds.items() if is_given]
        if excluded:
            raise InputError(f"no products with the derivatives by {d.name}", found=", ".join(excluded),
                             expected="a material parameter, a factor field, a history or a dead load",
                             remedy="differentiate directly")
    if body.control is not None:
        raise InputError("no products with the derivatives of a body that a gauge controls",
                         expected="drives and loads of known size", found="a gauge", remedy="differentiate directly")


def _sorted_unknowns(system: System, directions: Sequence[Direction]) -> _Unknowns:
    body, kinds = system.body, {"material": [], "variation": [], "drive": []}
    for k, direction in enumerate(directions):
        kinds["material" if direction.material is not None else
              "variation" if direction.variation is not None else "drive"].append(k)
    material, variation, drive = (np.array(numbers, dtype=np.int64) for numbers in kinds.values())
    shapes = tuple(_weight_shapes(system, group, [directions[k] for k in variation]) for group in system.groups)
    n_frames, n_drives = body.constraints.histories.shape
    n_dead = 0 if body.loads.dead is None else body.loads.dead.shape[1]
    histories = np.zeros((n_frames, n_drives + n_dead, len(drive)))
    for column, k in enumerate(drive):
        if directions[k].d_histories is not None:
            histories[:, :n_drives, column] = directions[k].d_histories
        if directions[k].d_loads is not None:
            histories[:, n_drives:, column] = np.asarray(directions[k].d_loads)[:, :n_dead]
    return _Unknowns(len(directions), material, variation, drive, tuple(directions[k] for k in material), shapes,
                     histories)


def _weight_shapes(system: System, group: Group, directions: Sequence[Direction]) -> csc_array:
    """Relative change of the weights of a group's points by each factor field  # (n_points, n)"""
    changes = stress_variations(system, group, directions)
    return csc_array((group.n_points, len(directions))) if changes is None else changes


def _n_state(group: Group) -> int:
    """Variables of the state that the next increment depends on; a start value of F33 is none."""
    return group.law.spec.n_state


def _point_slopes(system: System, k: int, g: GroupEvaluation, params: np.ndarray, states, dt: float,
                  dparams: np.ndarray | None, n_material: int) -> _PointSlopes:
    group, d = system.groups[k], system.n_dim
    n, n_state, n_stored = group.n_points, _n_state(group), states[k].shape[1]
    by_state, by_parameter = np.zeros((n, d * d, n_state)), np.zeros((n, d * d, n_material))
    state_by_F, state_by_state = np.zeros((n, n_state, d * d)), np.zeros((n, n_state, n_state))
    state_by_parameter = np.zeros((n, n_state, n_material))
    if dparams is not None:
        changes = point_changes(system, k, g, params, states, dt, None, np.zeros((n, n_material, n_stored)), dparams)
        by_parameter, state_by_parameter = _on_true_stress(group, g, *changes)
    if n_state:
        unit = np.zeros((n, n_state, n_stored))
        unit[:, np.arange(n_state), np.arange(n_state)] = 1.0
        by_state, state_by_state = _on_true_stress(
            group, g, *point_changes(system, k, g, params, states, dt, None, unit, None))
        unit_F = np.tile(np.eye(d * d).reshape(-1, d, d), (n, 1, 1, 1))
        guess = np.ascontiguousarray(g.state[:, -1]) if system.body.mode == 2 else None
        _, changed_state, _ = expansion.directional(
            group.law, system.body.mode, g.Fbar, g.expansion, g.P, states[k], values_at(group, params, g), dt, unit_F,
            np.zeros((n, d * d, n_stored)), None, None, guess=guess)
        state_by_F = _columns_last(changed_state[:, :, :n_state])
    return _PointSlopes(by_state, by_parameter, state_by_F, state_by_state, state_by_parameter)


def _on_true_stress(group: Group, g: GroupEvaluation, dP: np.ndarray,
                    changed_state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Changes (n_points, m, ...) of stress, acting on F, and state as columns; the mean over an element that small
    strains need is left for the product."""
    if g.scale is not None:
        locking.stress_finite(g.scale, dP.shape[-1], dP)
    return _columns_last(dP.reshape(*dP.shape[:2], -1)), _columns_last(changed_state[:, :, :_n_state(group)])


def _columns_last(changes: np.ndarray) -> np.ndarray:
    """(n_points, m, rows) -> (n_points, rows, m)"""
    return np.ascontiguousarray(changes.transpose(0, 2, 1))


def _stiffness_at_edge(system: System, end: Converged) -> csr_array:
    """The stiffness in the elements with prescribed dofs: right in the rows and the columns of these."""
    for group, g in zip(system.groups, end.evaluation.groups, strict=True):
        element_matrices(group, g)
    parts = [(g.Ke[group.holding], group.dofs[group.holding])
             for group, g in zip(system.groups, end.evaluation.groups, strict=True)]
    parts += list(further_matrices(system, end.evaluation))
    rows, columns, entries = [], [], []
    for matrices, dofs in parts:
        row, column = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        rows.append(row.ravel())
        columns.append(column.ravel())
        entries.append(matrices.ravel())
    n = system.body.n_dof
    return csr_array(coo_array((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))),
                               shape=(n, n)))


def _plain_gradient(group: Group, field: np.ndarray) -> np.ndarray:
    """Gradient of a nodal field (n_nodes, d) at the points of a group  # (n_points, d, d)"""
    d = field.shape[1]
    gradient = np.empty((group.n_points, 1, d, d))
    changes = (kernels_solid if d == 3 else kernels).gradient_changes
    changes(group.connectivity, group.grads, np.ascontiguousarray(field)[:, :, None], gradient)
    return gradient[:, 0]


def _gradient_changes(group: Group, g: GroupEvaluation, du: np.ndarray) -> np.ndarray:
    """Change of what the law sees of F by a motion (n_nodes, d)  # (n_points, d, d)"""
    dF = _plain_gradient(group, du)[:, None]
    if g.scale is not None:
        locking.changes_finite(g.F, g.scale, g.Jbar, group.weights, dF)
    elif group.mean_dilatation:
        locking.average_trace(dF, group.weights, len(group.elements))
    return dF[:, 0]


def _add_transposed_gradient(group: Group, g: GroupEvaluation, by_F: np.ndarray, out: np.ndarray) -> None:
    """Add the transpose of `_gradient_changes` times by_F (n_points, d, d) to out (n_nodes, d)."""
    if g.scale is not None:
        d, n_el = by_F.shape[1], len(group.elements)
        turned = np.linalg.inv(g.F).transpose(0, 2, 1)
        volume = group.weights * np.linalg.det(g.F)
        slope = g.scale / d * np.einsum("pij,pij->p", by_F, g.F)
        of_element = slope.reshape(n_el, -1).sum(axis=1) / (g.Jbar * group.weights.reshape(n_el, -1).sum(axis=1))
        share = np.repeat(of_element, group.points_per_element) * volume - slope
        by_F = g.scale[:, None, None] * by_F + share[:, None, None] * turned
    elif group.mean_dilatation:
        by_F = by_F / group.weights[:, None, None]
        locking.average_trace(by_F[:, None], group.weights, len(group.elements))
        by_F = by_F * group.weights[:, None, None]
    kernels.add_internal_forces(group.connectivity, group.grads, np.ones(group.n_points), np.ascontiguousarray(by_F),
                                out)


def _readings(system: System) -> np.ndarray:
    """What the channels read of the forces  # (n_dof, n_channels)"""
    readings = np.zeros((system.body.n_dof, len(system.body.channels)))
    for k, channel in enumerate(system.body.channels):
        np.add.at(readings[:, k], np.asarray(channel.dofs, dtype=np.int64), channel.factor)
    return readings


def _checkpoint(at: Converged) -> Converged:
    return replace(at, evaluation=None, factor=None, factor_matrices=())
