"""Direct differentiation of a converged increment: how displacements and forces change along each direction.

At each converged increment, with the consistent tangent K already factorised (docs/method.md, equations 5.1 to 5.3)::

    K_ff du_f = -(dR/dlambda + dR/dh_n dh_n + K_fp du_p),   dh_{n+1} = dh/du du + dh/dh_n dh_n + dh/dlambda

The discrete algorithm is differentiated: the derivatives are exact for the increments taken, of any size (Michaleris,
Tortorelli & Vidal, Int. J. Numer. Methods Eng. 37 (1994) 2471, doi:10.1002/nme.1620371408).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.fe.assembly import expansion, kernels
from idic.fe.assembly.assembly import (
    band_place, force_changes, held_stiffness_times, point_changes, points_of, stiffness_times, stress_variations,
)
from idic.fe.assembly.assembly import Evaluation, System
from idic.fe.thickness_change import influence_on_rise
from idic.fe.body.boundary import drive_changes, pressure_force
from idic.fe.equilibrium import Converged, consistent_factor
from idic.fe.solver.linear import Factor
from idic.fe.body.body import Direction, Body


COLUMNS_AT_A_TIME = 16  # directions whose changes of the stress at all points are held together


@dataclass(frozen=True)
class Changes:
    """Derivatives along nd directions at one time.

    du (n_dof, nd) mm; forces (n_dof, nd) N, of the residual (non-zero at prescribed dofs only); states per group
    (n_points, nd, n_state).
    """

    du: np.ndarray
    forces: np.ndarray
    states: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Influence:
    """Same-frame influence of the model's local drives and, after them, of its local loads.

    du (n_nodes, d, m) mm per unit of drive or load; forces (n_dof, m) N per unit; factor : the factorisation that it
    was found with, where the stiffness is constant, else None; rise (n_nodes, m) mm per unit, of the seen surface of a
    sheet (`idic.fe.thickness_change`), None: not wanted
    """

    du: np.ndarray
    forces: np.ndarray
    factor: Factor | None
    rise: np.ndarray | None = None


def check_directions(body: Body, directions: Sequence[Direction], n_frames: int) -> None:
    """Raise InputError for a direction that is not exactly one of the kinds or does not fit the model."""
    n_drives = body.constraints.histories.shape[1]
    n_loads = (0 if body.loads.dead is None else body.loads.dead.shape[1]) + len(body.loads.pressure_faces)
    for d in directions:
        kinds = {"material": d.material is not None, "d_histories": d.d_histories is not None,
                 "d_loads": d.d_loads is not None, "thickness": d.thickness, "expansion": d.expansion is not None,
                 "d_temperature": d.d_temperature is not None, "variation": d.variation is not None,
                 "d_readings": d.d_readings is not None, "d_tips": d.d_tips is not None}
        given_kinds = {kind for kind, is_given in kinds.items() if is_given}
        together = ({"d_loads", "thickness"}, {"d_histories", "d_temperature", "d_loads", "d_readings"})
        if not given_kinds or (len(given_kinds) > 1 and not any(given_kinds <= kinds for kinds in together)):
            raise InputError(f"direction {d.name} must be of exactly one kind",
                             expected=f"one of {', '.join(kinds)} (d_loads may go with thickness; d_histories, "
                             "d_temperature, d_loads and d_readings go together)", found=f"{len(given_kinds)} of them",
                             remedy="give one direction per kind of parameter")
        if given_kinds & {"expansion", "d_temperature"} and body.temperature is None:
            raise InputError("a direction of thermal expansion, but no temperature", key=d.name,
                             expected="a temperature in the model", found="none",
                             remedy="give the model a temperature, or leave this direction out")
        for table_name, table, n in (("d_histories", d.d_histories, n_drives), ("d_loads", d.d_loads, n_loads),
                                     ("d_temperature", d.d_temperature, body.mesh.n_nodes)):
            if table is not None and np.shape(table) != (n_frames, n):
                raise InputError(f"{table_name} of direction {d.name} has the wrong shape", expected=str((n_frames, n)),
                                 found=str(np.shape(table)), remedy="give one row per frame")
        if d.d_readings is not None and (body.control is None or np.shape(d.d_readings) != (n_frames,)):
            raise InputError(f"readings of direction {d.name} without a gauge, or of the wrong shape",
                             expected=f"{n_frames} values for a model with control",
                             found=str(np.shape(d.d_readings)), remedy="give one value per frame")
        if d.thickness and body.kind == "solid":
            raise InputError("a solid has no thickness parameter", key=d.name, remedy="lock it, or move the nodes")


def at_rest(system: System, n_directions: int) -> Changes:
    """Zero derivatives of the reference state."""
    mode = system.body.mode
    states = tuple(np.zeros((g.n_points, n_directions, g.law.n_state(mode))) for g in system.groups)
    zero = np.zeros((system.body.n_dof, n_directions))
    return Changes(zero, zero, states)


def differentiate(system: System, params: Mapping[str, np.ndarray], directions: Sequence[Direction],
                  times: np.ndarray, start: Converged, end: Converged, factor: Factor,
                  start_changes: Changes) -> Changes:
    """Derivatives at `end` from those at `start` (`start_changes`), with the factorised consistent tangent at `end`."""
    nd, dt, shape = len(directions), end.time - start.time, end.u.shape
    forces = np.zeros((*shape, nd))
    dparams = parameter_changes(system, directions, params, times, end)
    expansions = _expansion_changes(system, directions, times, end)
    _add_variations(system, directions, end, forces)
    for k, g in enumerate(end.evaluation.groups):
        concerned = _concerning(dparams[k], expansions[k], start_changes.states[k])
        if not len(concerned):
            continue
        dP, _ = point_changes(system, k, g, _params(system, k, params), start.states, dt, None,
                                       np.ascontiguousarray(start_changes.states[k][:, concerned]),
                                       _part(dparams[k], (..., concerned, slice(None))),
                                       _part(expansions[k], (slice(None), concerned)))
        part = np.zeros((*shape, len(concerned)))
        force_changes(system, k, g, dP, part)
        forces[..., concerned] += part
    forces = forces.reshape(-1, nd)
    du = np.zeros_like(forces)
    _add_drive_changes(system, directions, times, end, du, forces)
    if du.any():
        forces += stiffness_times(system, end.evaluation, du)
    free_dofs = system.pattern.dofs
    moved = np.zeros_like(du)
    moved[free_dofs] = factor.solve(-forces[free_dofs])
    forces += held_stiffness_times(system, end.evaluation, moved)
    forces[free_dofs] = 0.0  # in equilibrium along every direction; only rounding is left
    du += moved
    if system.body.control is not None:
        reading_changes = [change.reading for change in drive_changes(system.body, directions, times, end.time)]
        du, forces = on_course(system, end.evaluation, factor, du, forces, np.array(reading_changes))
    states = []
    for k, g in enumerate(end.evaluation.groups):
        if system.groups[k].law.spec.n_state == 0 and not system.body.surface_side:  # nothing but F33, a start value
            states.append(start_changes.states[k])
            continue
        states.append(point_changes(system, k, g, _params(system, k, params), start.states, dt,
                                             du.reshape(*shape, nd), start_changes.states[k], dparams[k],
                                             expansions[k])[1])
    return Changes(du, forces, tuple(states))


def influence_at(system: System, params: Mapping[str, np.ndarray], start: Converged, end: Converged,
                 factor: Factor | None, previous: Influence | None) -> Influence:
    """The influence at `end`; the same record as in the frame before where the stiffness is the same.

    start : of the increment that ends there; factor : of the consistent tangent at `end`, None: not known yet
    """
    body = system.body
    if not (body.local_drives or body.local_loads):
        none = np.zeros((len(end.u), 0)) if body.surface_side else None
        return Influence(np.zeros((*end.u.shape, 0)), np.zeros((body.n_dof, 0)), None, none)
    factor = consistent_factor(system, end) if factor is None else factor
    if previous is not None and factor is previous.factor:
        return previous
    du, forces = local_influence(system, end, factor)
    constant = factor is end.factor and bool(end.factor_matrices)
    du = du.reshape(*end.u.shape, -1)
    rise = influence_on_rise(system, params, start, end, du) if body.surface_side else None
    return Influence(du, forces, factor if constant else None, rise)


def local_influence(system: System, end: Converged, factor: Factor) -> tuple[np.ndarray, np.ndarray]:
    """Same-frame influence of the model's local drives and, after them, of its local loads.

    ``du/dw = [-K_ff^-1 K_fp basis ; basis]`` and ``K_ff^-1 f`` for a load of nodal forces f per unit: the drive moves
    at this time only, so the influence of earlier motion through the material's memory is left out.

    Returns
    -------
    du (n_dof, m) mm per unit of drive or load, forces (n_dof, m) N per unit
    """
    du, forces = answers(system, end.evaluation, factor, system.body.local_drives, system.body.local_loads)
    if system.body.control is not None:
        du, forces = on_course(system, end.evaluation, factor, du, forces, np.zeros(du.shape[1]))
    return du, forces


def answers(system: System, evaluation: Evaluation, factor: Factor, drives: Sequence[int],
            loads: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Response of the body to a unit of some drives and, after them, of some loads, at fixed history.

    Returns
    -------
    du (n_dof, m) mm, forces (n_dof, m) N, as `local_influence`
    """
    constraints = system.body.constraints
    du = np.zeros((system.body.n_dof, len(drives) + len(loads)))
    du[constraints.dofs, :len(drives)] = constraints.basis[:, list(drives)]
    forces = stiffness_times(system, evaluation, du)
    for k, load in enumerate(loads, len(drives)):
        forces[:, k] -= _unit_load(system, evaluation.u, load)
    free_dofs = system.pattern.dofs
    moved = np.zeros_like(du)
    moved[free_dofs] = factor.solve(-forces[free_dofs])
    forces += held_stiffness_times(system, evaluation, moved)
    forces[free_dofs] = 0.0
    return du + moved, forces


def answer_to_control(system: System, evaluation: Evaluation, factor: Factor) -> tuple[np.ndarray, np.ndarray]:
    """Response to a unit of the controlled drive or load  # du (n_dof, 1) mm, forces (n_dof, 1) N"""
    control = system.body.control
    return answers(system, evaluation, factor, *(() if number is None else (number,)
                                                 for number in (control.drive, control.load)))


def on_course(system: System, evaluation: Evaluation, factor: Factor, du: np.ndarray, forces: np.ndarray,
              reading_changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Changes (n_dof, nd) at a fixed size of the controlled drive or load, with the size that the gauge asks for.

    reading_changes : (nd,) mm, change of its reading
    """
    gauge = system.body.control.gauge
    moved, felt = answer_to_control(system, evaluation, factor)
    more = (reading_changes - gauge @ du) / (gauge @ moved)
    return du + moved * more, forces + felt * more


def _unit_load(system: System, u: np.ndarray, load: int) -> np.ndarray:
    """Nodal forces of a load of one unit on the present shape  # (n_dof,); load : dead ones first, then pressures"""
    dead = system.body.loads.dead
    n_dead = 0 if dead is None else dead.shape[1]
    if load < n_dead:
        return dead[:, load]
    force, x = np.zeros(system.body.n_dof), system.body.mesh.nodes + u
    for faces in system.pressures:
        if faces.load == load - n_dead:
            np.add.at(force, faces.dofs, pressure_force(faces, x).reshape(faces.dofs.shape))
    return force


def _concerning(dparams, dexpansion, dstate: np.ndarray) -> np.ndarray:
    """Directions along which the stress of a group changes at fixed displacement  # (n,) int"""
    concerned = dstate.any(axis=(0, 2))
    if dparams is not None:
        concerned |= dparams.any(axis=-1) if dparams.ndim == 2 else dparams.any(axis=(0, 2))
    if dexpansion is not None:
        concerned |= dexpansion.any(axis=0)
    return np.flatnonzero(concerned)


def _part(changes: np.ndarray | None, selection) -> np.ndarray | None:
    return None if changes is None else np.ascontiguousarray(changes[selection])


def _params(system: System, k: int, params: Mapping[str, np.ndarray]) -> np.ndarray:
    return params[system.body.sections[system.groups[k].section].name]


def parameter_changes(system: System, directions, params, times: np.ndarray,
                       end: Converged) -> list[np.ndarray | None]:
    """Changes of the parameters of each group, of its points where they depend on the temperature

    Returns
    -------
    per group (nd, n_params) or (n_points, nd, n_params); None: no direction concerns it
    """
    changes = []
    for group, g in zip(system.groups, end.evaluation.groups, strict=True):
        group_changes = _unit_changes(system, group.section, directions, params)
        if g.temperature is not None:
            warming = _nodal_warming(system, directions, times, end)
            group_changes = group.law.spec.temperature.changes(
                params[system.body.sections[group.section].name], g.temperature, group_changes,
                None if warming is None else points_of(system, group, warming), len(directions))
        if group.size is not None:
            group_changes = group.law.spec.crack_band.changes(band_place(group), group_changes, group.size)
        changes.append(group_changes)
    return changes


def _nodal_warming(system: System, directions, times: np.ndarray, end: Converged) -> np.ndarray | None:
    """Change of the temperature of the nodes along each direction  # (n_nodes, nd) K; None: none changes it"""
    warmings = [change.temperature for change in drive_changes(system.body, directions, times, end.time)]
    if all(change is None for change in warmings):
        return None
    return np.stack([np.zeros(system.body.mesh.n_nodes) if change is None else change for change in warmings], axis=1)


def _unit_changes(system, section: int, directions, params) -> np.ndarray | None:
    """Unit changes of the parameters of a section  # (nd, n_params); None: no direction concerns it"""
    name = system.body.sections[section].name
    rows = np.zeros((len(directions), len(params[name])))
    for k, direction in enumerate(directions):
        if direction.material is not None and system.body.sections[direction.material[0]].name == name:
            rows[k, direction.material[1]] = 1.0
    return rows if rows.any() else None


def _expansion_changes(system: System, directions, times: np.ndarray, end: Converged) -> list[np.ndarray | None]:
    """Change of the free thermal expansion of the points of each group  # (n_points, nd); None: none changes it"""
    if end.drives.temperature is None:
        return [None] * len(system.groups)
    warming = [change.temperature for change in drive_changes(system.body, directions, times, end.time)]
    changes = []
    for group in system.groups:
        nodal = expansion.nodal_changes(system.body, group.section, directions, end.drives.temperature, warming)
        changes.append(None if nodal is None else points_of(system, group, nodal))
    return changes


def _add_variations(system: System, directions, end: Converged, forces: np.ndarray) -> None:
    """Forces at fixed stress of weights that change; forces (n_nodes, d, nd)."""
    for group, g in zip(system.groups, end.evaluation.groups, strict=True):
        changes = stress_variations(system, group, directions)
        if changes is None:
            continue
        concerned = np.flatnonzero(np.diff(changes.indptr))
        for first in range(0, len(concerned), COLUMNS_AT_A_TIME):
            columns = concerned[first:first + COLUMNS_AT_A_TIME]
            part = np.zeros((*forces.shape[:2], len(columns)))
            dP = np.ascontiguousarray(changes[:, columns].toarray()[:, :, None, None] * g.P[:, None])
            kernels.add_internal_force_changes(group.connectivity, group.grads, group.weights, dP, part)
            forces[..., columns] += part


def _add_drive_changes(system: System, directions, times, end: Converged, du: np.ndarray, forces: np.ndarray) -> None:
    """Prescribed motion into du, loads and thickness into the change of the residual at fixed displacement."""
    body, ev = system.body, end.evaluation
    x = body.mesh.nodes + end.u
    for k, (direction, change) in enumerate(
            zip(directions, drive_changes(body, directions, times, end.time), strict=True)):
        du[body.constraints.dofs, k] = change.prescribed
        if direction.thickness:
            forces[:, k] += ev.internal.ravel() / body.thickness
        if change.dead.any():
            forces[:, k] -= body.loads.dead @ change.dead
        for seam, dofs, tip, moved in zip(body.seams, system.seam_dofs, end.drives.tips, change.tips, strict=True):
            if moved:
                np.add.at(forces[:, k], dofs, moved * np.einsum("eij,ej->ei", seam.slopes(tip), end.u.ravel()[dofs]))
        for faces in system.pressures:
            factor = change.pressure[faces.load]
            if direction.thickness:
                factor += end.drives.pressure[faces.load] / body.thickness
            if factor != 0.0:
                np.add.at(forces[:, k], faces.dofs, -factor * pressure_force(faces, x).reshape(faces.dofs.shape))
