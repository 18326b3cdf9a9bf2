"""From displacements to residual and stiffness: the discretised model, its evaluation, and partial derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array

from idic.errors import InputError
from idic.fe.assembly import expansion, in_parts, kernels, kernels_solid, locking
from idic.fe.assembly.linear import KeptResponse, LinearResponse, kept_response
from idic.fe.body.variation import factor_of
from idic.fe.body.boundary import Drives, PressureFaces, pressure_faces, pressure_force, pressure_stiffness
from idic.fe.solver import storage
from idic.fe.solver.known_pattern import known_pattern
from idic.fe.solver.linear import Pattern
from idic.fe.mesh.element import cell_type
from idic.fe.body.body import Body, Section, uses_mean_dilatation
from idic.laws import CompiledLaw, LawSpec, element_sizes


@dataclass(frozen=True)
class Group:
    """Elements of one cell and one section, with everything about them that does not change.

    Attributes
    ----------
    elements : (n_el,) global indices
    connectivity : (n_el, nn); dofs : (n_el, nn d)
    grads : (n_el nq, nn, d) dN/dX in 1/mm; weights : (n_el nq,) volume in mm³, thickness included
    positions : (n_el, nn d, nn d) places in the stored stiffness
    mean_b : (n_el, nn d) d(mean divergence)/du, small-strain mean dilatation only
    largest_area : mm², the largest sum over an element of |w dN/dX|: nodal force per stress
    steepest : 1/mm, the largest |dN/dX|
    holding : (n,) elements with prescribed dofs, counted within the group
    size : (n_el nq,) mm, of the element of each point, where the law depends on it, else None
    linear : the one response of all points, where the law is linear, else None
    """

    section: int
    law: CompiledLaw
    cell: str
    elements: np.ndarray
    connectivity: np.ndarray
    dofs: np.ndarray
    grads: np.ndarray
    weights: np.ndarray
    positions: np.ndarray
    mean_dilatation: bool
    mean_b: np.ndarray | None
    largest_area: float
    steepest: float
    holding: np.ndarray
    size: np.ndarray | None = None
    linear: KeptResponse | None = None

    @property
    def n_points(self) -> int:
        return len(self.weights)

    @property
    def points_per_element(self) -> int:
        return len(self.weights) // len(self.elements)


@dataclass(frozen=True)
class System:
    """A model made ready to be solved."""

    body: Body
    groups: tuple[Group, ...]
    pressures: tuple[PressureFaces, ...]
    pressure_positions: tuple[np.ndarray, ...]
    seam_dofs: tuple[np.ndarray, ...]
    seam_positions: tuple[np.ndarray, ...]
    pattern: Pattern
    size: float  # mm, diagonal of the body

    @property
    def n_dim(self) -> int:
        return self.body.mesh.n_dim

    def rest_states(self) -> tuple[np.ndarray, ...]:
        """The state of the points of each group at rest  # per group (n_points, n_state)"""
        mode = self.body.mode
        return tuple(np.tile(g.law.initial_state(mode), (g.n_points, 1)) for g in self.groups)


def discretise(body: Body, pattern: Pattern | None = None) -> System:
    """Shape function gradients, numbering and scatter positions of a (validated) model.

    pattern : of another model with the same elements and held dofs, where there is one
    """
    mesh = body.mesh
    parts = []
    for index, section in enumerate(body.sections):
        for block in mesh.blocks:
            chosen = np.asarray(section.elements)
            chosen = chosen[(chosen >= block.first) & (chosen < block.first + block.n_elements)]
            if len(chosen):
                parts.append((index, section, block.cell, chosen, block.connectivity[chosen - block.first]))
    d = mesh.n_dim
    dofs = [_dofs(connectivity, d) for *_, connectivity in parts]
    seam_dofs = tuple(seam.dofs for seam in body.seams)
    if pattern is None:
        pattern = known_pattern(mesh.nodes, [*dofs, *seam_dofs], np.asarray(body.constraints.dofs))
    groups = tuple(_group(body, pattern, *part, part_dofs) for part, part_dofs in zip(parts, dofs, strict=True))
    pressures = pressure_faces(body)
    extent = np.ptp(mesh.nodes[np.concatenate([p[-1].ravel() for p in parts])], axis=0)
    return System(body, groups, pressures, tuple(pattern.positions(p.dofs) for p in pressures), seam_dofs,
                  tuple(pattern.positions(pairs) for pairs in seam_dofs), pattern,
                  float(np.linalg.norm(extent)))


def _dofs(connectivity, d):
    return np.ascontiguousarray((connectivity[:, :, None] * d + np.arange(d)).reshape(len(connectivity), -1))


def _group(body: Body, pattern: Pattern, index: int, section: Section, cell: str, elements, connectivity, dofs):
    connectivity = np.ascontiguousarray(connectivity, dtype=np.int64)
    xi, w = cell_type(cell).quadrature_rule(body.quadrature.get(cell))
    jac = np.einsum("eak,qai->eqki", body.mesh.nodes[connectivity], cell_type(cell).shape_gradients(xi))  # dX_k/dxi_i
    grads = np.einsum("qai,eqik->eqak", cell_type(cell).shape_gradients(xi), np.linalg.inv(jac))
    depth = body.thickness if body.mesh.n_dim == 2 else 1.0
    volumes = np.linalg.det(jac) * w
    weights = (volumes * depth).ravel()
    size = None if section.law.spec.crack_band is None else np.repeat(
        element_sizes(cell, volumes.sum(axis=1), body.mesh.n_dim), volumes.shape[1])
    grads = np.ascontiguousarray(grads.reshape(-1, *grads.shape[2:]))
    remedy, mean_b = uses_mean_dilatation(body, cell), None
    factor = weight_factor(body, index, cell, connectivity, weights, remedy)
    weights = weights if factor is None else weights * factor  # with mean dilatation the same all over an element
    if remedy and section.law.small:
        mean_b = np.empty(dofs.shape)
        locking.mean_divergence(grads, weights, mean_b)
    return Group(index, section.law, cell, np.asarray(elements), connectivity, dofs, grads, weights,
                 pattern.positions(dofs), remedy, mean_b,
                 float(np.abs(weights[:, None, None] * grads).reshape(*dofs.shape[:1], -1, grads[0].size).sum(1).max()),
                 float(np.abs(grads).max()), np.flatnonzero((pattern.equation[dofs] < 0).any(axis=1)), size,
                 kept_response(section.law, body.mode, grads, weights, len(elements), remedy))


def weight_factor(body: Body, section: int, cell: str, connectivity: np.ndarray, weights: np.ndarray,
                  mean_dilatation: bool) -> np.ndarray | None:
    """Factor of the model's variations on the weights of a group's points, None without any  # (n_points,)"""
    if not body.variations:
        return None
    places = expansion.at_points(body, cell, connectivity, weights, mean_dilatation, body.mesh.nodes)
    return factor_of(body.variations, body.sections[section].name, places)


# evaluation ---------------------------------------------------------------------------------------
@dataclass
class GroupEvaluation:
    """One group at one iterate. Fbar is what the law saw; scale, Jbar, b belong to F-bar.

    expansion (n_points,) is the free thermal expansion alpha (T - T_reference), None where there is no temperature.
    temperature (n_points,) is that of a law whose parameters depend on it, in °C, else None.
    """

    F: np.ndarray
    Fbar: np.ndarray
    P: np.ndarray  # acting on F: P_eff with mean dilatation
    state: np.ndarray
    A: np.ndarray | None = None
    Ke: np.ndarray | None = None
    scale: np.ndarray | None = None
    Jbar: np.ndarray | None = None
    b: np.ndarray | None = None
    expansion: np.ndarray | None = None
    temperature: np.ndarray | None = None


@dataclass
class Evaluation:
    """The whole body at one iterate.

    Attributes
    ----------
    internal, external : (n_nodes, d) N
    trouble : str
        Empty, or why the iterate is not admissible.
    """

    u: np.ndarray
    groups: list[GroupEvaluation]
    internal: np.ndarray
    external: np.ndarray
    pressure_K: list[np.ndarray]
    seam_K: list[np.ndarray]
    trouble: str = ""

    @property
    def residual(self) -> np.ndarray:
        """Internal minus external nodal forces  # (n_nodes, d) N"""
        return self.internal - self.external


def evaluate_system(system: System, params: Mapping[str, np.ndarray], u: np.ndarray, states, dt: float, drives: Drives,
             guesses=None, stiffness: bool = True) -> Evaluation:
    """Stress, forces and (unless `stiffness` is False) element matrices at the displacement u (n_nodes, d).

    Parameters
    ----------
    states : per group (n_points, n_state), at the beginning of the step; not changed
    guesses : per group new states of an earlier iterate (start values of plane stress), optional
    """
    body = system.body
    ev = Evaluation(u, [], np.zeros_like(u), external_force(system, drives, u), [], [])
    for k, group in enumerate(system.groups):
        g, trouble = _deform(group, u)
        if not trouble and drives.temperature is not None:
            trouble = _expand(system, group, drives.temperature, g)
        values = params[body.sections[group.section].name]
        if not trouble and group.law.spec.temperature is not None:
            trouble = _warm(system, group, values, drives, g)
        if not trouble and group.size is not None:
            trouble = group.law.spec.crack_band.trouble(
                dict(zip(group.law.spec.parameter_names, values, strict=True)), group.size)
        if not trouble:
            guess = np.ascontiguousarray(guesses[k][:, -1]) if guesses is not None and body.mode == 2 else None
            point_params = values_at(group, values, g)
            args = (group.law, body.mode, g.Fbar, g.expansion, states[k], point_params, dt)
            linear = _linear(group, g, point_params)
            if linear is not None:
                ok, (g.P, g.state) = True, linear.stress(g.F)
                if stiffness:
                    g.A, g.Ke = linear.tangent
            elif stiffness:
                g.P, g.state, g.A, ok = expansion.tangent(*args, guess=guess)
            else:
                g.P, g.state, ok = expansion.stress(*args, guess=guess)
            trouble = "" if ok else _without_stress(group.law.spec, values)
        if trouble:
            ev.trouble = trouble
            return ev
        _effective_stress(group, g)
        kernels.add_internal_forces(group.connectivity, group.grads, group.weights, g.P, ev.internal)
        ev.groups.append(g)
    if stiffness:
        x = body.mesh.nodes + u
        ev.pressure_K = [-drives.pressure[p.load] * pressure_stiffness(p, x) for p in system.pressures]
        ev.seam_K = [seam.matrices(tip) for seam, tip in zip(body.seams, drives.tips, strict=True)]
    return ev


def _without_stress(law: LawSpec, params: np.ndarray) -> str:
    reason = law.why_impossible(params)
    return f"law {law.name} did not converge at a point" + (reason and f": no body has {reason}")


def external_force(system: System, drives: Drives, u: np.ndarray) -> np.ndarray:
    """Dead loads, follower pressure on the present shape, and what ties the faces of cracks  # (n_nodes, d) N"""
    force = np.zeros(u.size)
    if system.body.loads.dead is not None:
        force += system.body.loads.dead @ drives.dead
    for faces in system.pressures:
        np.add.at(force, faces.dofs, drives.pressure[faces.load]
                  * pressure_force(faces, system.body.mesh.nodes + u).reshape(faces.dofs.shape))
    for seam, dofs, tip in zip(system.body.seams, system.seam_dofs, drives.tips, strict=True):
        np.add.at(force, dofs, -np.einsum("eij,ej->ei", seam.matrices(tip), u.ravel()[dofs]))
    return force.reshape(u.shape)


def _deform(group: Group, u: np.ndarray) -> tuple[GroupEvaluation, str]:
    d = u.shape[1]
    F = np.empty((group.n_points, d, d))
    smallest = min(_in_parts(group, lambda e, p: kernels.deformation_gradients(
        group.connectivity[e], group.grads[p], u, F[p])))
    g = GroupEvaluation(F, F, F, F)
    if not group.law.small and not smallest > 0.0:
        return g, f"an element would turn inside out (det F = {smallest:.3g})"
    if group.mean_dilatation and not group.law.small:
        g.Fbar, g.scale = np.empty_like(F), np.empty(group.n_points)
        g.b, g.Jbar = np.empty(group.dofs.shape), np.empty(len(group.elements))
        _in_parts(group, lambda e, p: locking.modify_finite(F[p], group.grads[p], group.weights[p], g.Fbar[p],
                                                            g.scale[p], g.b[e], g.Jbar[e]))
    elif group.mean_dilatation:
        g.Fbar = F.copy()
        locking.average_trace(g.Fbar[:, None], group.weights, len(group.elements))
    return g, ""


def _expand(system: System, group: Group, temperature: np.ndarray, g: GroupEvaluation) -> str:
    nodal_expansion = system.body.sections[group.section].expansion * temperature
    g.expansion = points_of(system, group, nodal_expansion)
    if not group.law.small and not g.expansion.min() > -1.0:
        return f"thermal expansion of {g.expansion.min():.3g} gives a stretch of zero or less: check alpha, its unit"
    return ""


def _warm(system: System, group: Group, params: np.ndarray, drives: Drives, g: GroupEvaluation) -> str:
    start = system.body.start_temperature
    if drives.temperature is None or start is None:
        raise InputError("a law depends on the temperature, which the model does not have", expected="a temperature",
                         found="none", remedy="give the model its temperature")
    g.temperature = points_of(system, group, start + drives.temperature)
    return group.law.spec.temperature.trouble(params, g.temperature)


def values_at(group: Group, params: np.ndarray, g: GroupEvaluation) -> np.ndarray:
    """The parameters of the law, at the temperature and the element size of each point where they depend on them

    Returns
    -------
    ([n_points,] n_params)
    """
    spec = group.law.spec
    values = params if g.temperature is None else spec.temperature.values(params, g.temperature)
    return values if group.size is None else spec.crack_band.values(band_place(group), values, group.size)


def _linear(group: Group, g: GroupEvaluation, params: np.ndarray) -> LinearResponse | None:
    if group.linear is None or g.expansion is not None or g.temperature is not None or group.size is not None:
        return None
    return group.linear.of(params)


def band_place(group: Group) -> int:
    """The place of the length of a crack band among the parameters."""
    return group.law.spec.parameter_names.index(group.law.spec.crack_band.name)


def points_of(system: System, group: Group, nodal: np.ndarray) -> np.ndarray:
    """Nodal values of an expansion or temperature at the points of a group  # (n_nodes, ...) -> (n_points, ...)"""
    return expansion.at_points(system.body, group.cell, group.connectivity, group.weights, group.mean_dilatation,
                               nodal)


def stress_variations(system: System, group: Group, directions) -> csc_array | None:
    """Relative change of the weights of the points along each direction; None: none concerns the group  # (n, nd)"""
    body, section = system.body, system.body.sections[group.section].name
    concerned = [k for k, direction in enumerate(directions)
                 if direction.variation is not None and body.variations[direction.variation[0]].section == section]
    if not concerned:
        return None
    places, parts = points_of(system, group, body.mesh.nodes), []
    for number in sorted({directions[k].variation[0] for k in concerned}):
        columns = [k for k in concerned if directions[k].variation[0] == number]
        slopes = coo_array(body.variations[number].relative_slopes(places, [directions[k].variation[1]
                                                                            for k in columns]))
        row, column = slopes.coords
        parts.append((slopes.data, row, np.array(columns)[column]))
    entries, row, column = (np.concatenate(part) for part in zip(*parts, strict=True))
    return csc_array(coo_array((entries, (row, column)), shape=(group.n_points, len(directions))))


def _effective_stress(group: Group, g: GroupEvaluation) -> None:
    if g.scale is not None:
        locking.stress_finite(g.scale, g.P.shape[1], g.P)
    elif group.mean_dilatation:
        locking.average_trace(g.P[:, None], group.weights, len(group.elements))


def stiffness_values(system: System, ev: Evaluation) -> np.ndarray:
    """Stored values of the stiffness of the free dofs; leaves the element matrices in ``ev``  # (n_stored,)"""
    values = np.zeros(system.pattern.n_stored)
    for group, g in zip(system.groups, ev.groups, strict=True):
        element_matrices(group, g)
        storage.scatter(g.Ke, group.positions, values)
    for K, positions in (*zip(ev.pressure_K, system.pressure_positions, strict=True),
                         *zip(ev.seam_K, system.seam_positions, strict=True)):
        storage.scatter(K, positions, values)
    return values


def element_matrices(group: Group, g: GroupEvaluation) -> None:
    """Fill ``g.Ke`` (n_el, nn d, nn d) from the material tangent, which mean dilatation changes in place."""
    if g.Ke is not None:
        return
    Ke = np.empty((*group.dofs.shape, group.dofs.shape[1]))
    solid = group.grads.shape[2] == 3
    stiffness = kernels_solid.element_stiffness if solid else kernels.element_stiffness_plane
    if g.scale is not None:
        side = np.empty(group.dofs.shape)
        dilate = kernels_solid if solid else locking

        def part(e, p):
            dilate.tangent_finite(g.F[p], g.scale[p], g.Jbar[e], group.grads[p], group.weights[p], g.P[p], g.A[p],
                                  side[e])
            stiffness(group.grads[p], group.weights[p], g.A[p], Ke[e])
            locking.add_rank_one(side[e], g.b[e], Ke[e])

        _in_parts(group, part)
    elif group.mean_dilatation:
        g1, g2, s = np.empty(group.dofs.shape), np.empty(group.dofs.shape), np.empty(len(group.elements))
        locking.tangent_small(group.grads, group.weights, g.A, g1, g2, s)
        stiffness(group.grads, group.weights, g.A, Ke)
        locking.add_rank_one(g1 + s[:, None] * group.mean_b, group.mean_b, Ke)
        locking.add_rank_one(group.mean_b, g2, Ke)
    else:
        _in_parts(group, lambda e, p: stiffness(group.grads[p], group.weights[p], g.A[p], Ke[e]))
    g.Ke = Ke


def _in_parts(group: Group, work) -> list:
    return in_parts.in_parts(len(group.elements), group.n_points, work)


def stiffness_times(system: System, ev: Evaluation, fields: np.ndarray, transposed: bool = False) -> np.ndarray:
    """K fields, or K^T fields, prescribed dofs included on both sides  # fields (n_dof, m) -> (n_dof, m)"""
    fields = np.ascontiguousarray(fields)
    out = np.zeros_like(fields)

    def add(matrices: np.ndarray, dofs: np.ndarray) -> None:
        matrices = np.ascontiguousarray(matrices.transpose(0, 2, 1)) if transposed else matrices
        kernels.add_stiffness_times(matrices, dofs, fields, out)

    for group, g in zip(system.groups, ev.groups, strict=True):
        element_matrices(group, g)
        add(g.Ke, group.dofs)
    for K, dofs in further_matrices(system, ev):
        add(K, dofs)
    return out


def further_matrices(system: System, ev: Evaluation) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Matrices of follower pressures and tied faces of cracks, and their dofs  # (n, m, m), (n, m)"""
    yield from ((K, faces.dofs) for K, faces in zip(ev.pressure_K, system.pressures, strict=True))
    yield from zip(ev.seam_K, system.seam_dofs, strict=True)


def held_stiffness_times(system: System, ev: Evaluation, fields: np.ndarray) -> np.ndarray:
    """K fields at the prescribed dofs; other rows are undefined  # fields (n_dof, m) -> (n_dof, m)"""
    fields = np.ascontiguousarray(fields)
    out = np.zeros_like(fields)
    for group, g in zip(system.groups, ev.groups, strict=True):
        element_matrices(group, g)
        kernels.add_stiffness_times(g.Ke[group.holding], group.dofs[group.holding], fields, out)
    for K, dofs in further_matrices(system, ev):
        kernels.add_stiffness_times(K, dofs, fields, out)
    return out


# changes of the points along directions -----------------------------------------------------------
def point_changes(system: System, k: int, g: GroupEvaluation, params: np.ndarray, states, dt: float,
                  du: np.ndarray | None, dstate: np.ndarray, dparams: np.ndarray | None,
                  dexpansion: np.ndarray | None = None):
    """Change of stress (n_points, nd, d, d), acting on F, and of the new state, of group k.

    Parameters
    ----------
    du : (n_nodes, d, nd) or None (zero)
    dstate : (n_points, nd, n_state) at the beginning of the step
    dparams : (nd, n_params), of each point (n_points, nd, n_params), or None (zero)
    dexpansion : (n_points, nd) change of the free thermal expansion, or None (zero)
    """
    group, mode = system.groups[k], system.body.mode
    d = system.n_dim
    nd = dstate.shape[1]
    if du is None and dparams is not None and _linear(group, g, params) is not None:
        return group.linear.changes(params, dparams, g.F), dstate
    dF = np.zeros((group.n_points, nd, d, d))
    if du is not None:
        changes = (kernels_solid if d == 3 else kernels).gradient_changes
        _in_parts(group, lambda e, p: changes(group.connectivity[e], group.grads[p], du, dF[p]))
        if g.scale is not None:
            _in_parts(group, lambda e, p: locking.changes_finite(g.F[p], g.scale[p], g.Jbar[e], group.weights[p],
                                                                 dF[p]))
        elif group.mean_dilatation:
            locking.average_trace(dF, group.weights, len(group.elements))
    guess = np.ascontiguousarray(g.state[:, -1]) if mode == 2 else None
    P = g.P if g.scale is None or dexpansion is None else g.P * g.scale[:, None, None] ** (d - 1)  # acting on Fbar
    dP, dstate_new, _ = expansion.directional(group.law, mode, g.Fbar, g.expansion, P, states[k],
                                              values_at(group, params, g), dt, dF, dstate, dparams, dexpansion,
                                              guess=guess)
    return dP, dstate_new


def stretch_changes(system: System, k: int, g: GroupEvaluation, params: np.ndarray, states, dt: float,
                    du: np.ndarray) -> np.ndarray:
    """Change of F33 of a sheet in plane stress by motions at fixed history, of group k  # (n_points, m)

    Of a point it is linear in the change of F, so that four derivatives serve any number of motions.

    du : (n_nodes, 2, m); states : at the beginning of the step
    """
    group = system.groups[k]
    dF = np.zeros((group.n_points, du.shape[-1], 2, 2))
    _in_parts(group, lambda e, p: kernels.gradient_changes(group.connectivity[e], group.grads[p], du, dF[p]))
    unit = np.tile(np.eye(4).reshape(4, 2, 2), (group.n_points, 1, 1, 1))
    nothing = np.zeros((group.n_points, 4, g.state.shape[-1]))
    slopes = expansion.directional(group.law, system.body.mode, g.Fbar, g.expansion, g.P, states[k],
                                   values_at(group, params, g), dt, unit, nothing, None, None,
                                   guess=np.ascontiguousarray(g.state[:, -1]))[1][:, :, -1]
    return np.einsum("pmc,pc->pm", dF.reshape(group.n_points, -1, 4), slopes)


def force_changes(system: System, k: int, g: GroupEvaluation, dP: np.ndarray, out: np.ndarray) -> None:
    """Add the nodal forces of stress changes at fixed displacement; dP is changed in place, out (n_nodes, d, nd)."""
    group = system.groups[k]
    if g.scale is not None:
        locking.stress_finite(g.scale, system.n_dim, dP)
    elif group.mean_dilatation:
        locking.average_trace(dP, group.weights, len(group.elements))
    hot = kernels_solid if system.n_dim == 3 else kernels
    hot.add_internal_force_changes(group.connectivity, group.grads, group.weights, dP, out)
