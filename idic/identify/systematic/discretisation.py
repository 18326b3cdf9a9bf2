"""Discretisation bias: the error of the identified parameters due to the element size, by one refinement.

At the identified point the test is simulated once more, on quadratic elements in the place of linear ones or on
elements of half the size, and compared with the same images. The Gauss-Newton step from there is the change on the
finer mesh; the noise is the same on both, so that the change is hardly noisy:

    bias = value - value on the finer mesh = -(M^-1 b) on the finer mesh

The finer mesh has a bias, too, by which the figure is too small. Quadratic elements of the same size have a small
part of the bias of linear ones. Elements of half the size keep 2^-p of it: next to nothing of quadratic ones where the
strain is smooth; a quarter of linear bricks; about half where a front of yielding runs through the elements (p = 1), so
that there the true bias is up to twice the figure. A difference in shape between mesh and body (a polygon for a circle)
remains under refinement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from idic.correlation.equations import Weights
from idic.errors import InputError, NotConverged
from idic.fe.mesh import element
from idic.fe.mesh.halve import can_halve, halve
from idic.fe.mesh.refine import is_raised_by_default, raise_order
from idic.identify.covariance import MAX_UNDETERMINED_SHARE, scaled_system, spectrum, undetermined_share
from idic.identify.discrepancy.normal_equations import DiscrepancySystem
from idic.identify.step.state import Evaluation
from idic.model.drives import DriveTable, build_drives, set_nodes
from idic.model.experiment import Experiment, Parametrised, Prescribed, TemperatureField

Evaluate = Callable[[Experiment, Mapping[str, float], np.ndarray, bool, int | None], tuple[Evaluation, Weights]]


@dataclass(frozen=True)
class Refined:
    """The same test on a finer mesh; how : in words; carry : nodal fields onto its nodes  # (n_new, n_old)"""

    experiment: Experiment
    carry: sparse.csr_array
    how: str


def refined(experiment: Experiment) -> Refined:
    """The experiment on quadratic elements where it has linear ones, else (and bricks) on elements of half the size.

    Raises
    ------
    InputError
        An external solver, whose mesh is its own; tetrahedra of second order.
    """
    mesh = experiment.mesh
    if experiment.solver is not None:
        raise InputError("an external solver has its own mesh", expected="the built-in solver", found="external",
                         remedy="refine the mesh of the external solver and identify again")
    if is_raised_by_default(mesh):
        fine, how = raise_order(mesh), "quadratic elements"
        carry = _midpoints(mesh.n_nodes, fine)
    elif can_halve(mesh):
        found = halve(mesh)
        fine, carry, how = found.mesh, found.carry, "elements of half the size"
    else:
        raise InputError("these elements are not refined", expected="triangles, quadrilaterals, bricks, tet4",
                         found=", ".join(block.cell for block in mesh.blocks),
                         remedy="use such elements, or compare with an identification on a finer mesh")
    made = replace(experiment, mesh=fine)
    prescribed = tuple(_carried_shapes(experiment, made, carry, entry) for entry in experiment.prescribed)
    temperatures = tuple(
        replace(entry, drive=replace(entry.drive, values=(carry @ entry.drive.values.T).T))
        if isinstance(entry.drive, TemperatureField) else entry for entry in experiment.temperatures)
    morphs = tuple(replace(morph, velocity=carry @ morph.velocity) for morph in experiment.morphs)
    return Refined(replace(made, prescribed=prescribed, temperatures=temperatures, morphs=morphs), carry, how)


def is_coarse(experiment: Experiment) -> bool:
    """Whether an identification estimates its discretisation bias by itself: linear elements in the plane, as given.

    Solid ones would cost more than the identification.
    """
    return (experiment.solver is None and experiment.options.weighting == "noise" and experiment.mesh.n_dim == 2
            and is_raised_by_default(experiment.mesh))


def with_mesh_error(found: DiscrepancySystem, evaluate: Evaluate, experiment: Experiment, values: Mapping[str, float],
                    local: np.ndarray, generalised: bool, ended: Evaluation,
                    increments: int | None) -> DiscrepancySystem:
    """The normal equations of a discrepancy with the error of a coarse mesh; without it where the finer one fails.

    Parameters
    ----------
    experiment : as its last stage sees it; the others as for `discretisation_bias`
    """
    try:
        biases, _ = discretisation_bias(evaluate, replace(experiment, stages=()), values, local, generalised, ended,
                                        increments)
    except NotConverged:
        return found
    bias = np.array([biases.get(name, 0.0) for name in found.names])
    return replace(found, mesh_error=found.M[:found.n, :found.n] @ bias)


def discretisation_bias(evaluate: Evaluate, experiment: Experiment, values: Mapping[str, float], local: np.ndarray,
                        generalised: bool, ended: Evaluation,
                        increments: int | None = None) -> tuple[dict[str, float], str]:
    """Bias of every free parameter that the data determine (internal units), and how the mesh was refined.

    Parameters
    ----------
    evaluate : simulates and correlates a point, `idic.identify.in_memory.evaluate_at`
    values : identified, internal units
    local : (n_frames, m) mm, frame-local unknowns there
    generalised : whether generalised least squares found them
    ended : on the given mesh there; its remaining step is not due to the mesh
    increments : per frame, extrapolated in time, with which it was simulated; None: those of the options

    Raises
    ------
    InputError
        As `refined`.
    NotConverged
        If the finer model does not converge.
    """
    finer = refined(experiment)
    start = carried_local(build_drives(experiment), build_drives(finer.experiment), experiment, finer, local)
    evaluated, weights = evaluate(finer.experiment, values, start, generalised, increments)
    if evaluated.system is None:
        raise NotConverged(f"the finer model does not converge: {evaluated.message}")
    return _biases(experiment, values, evaluated, ended, weights.image_noise), finer.how


def time_step_bias(evaluate: Evaluate, experiment: Experiment, values: Mapping[str, float], local: np.ndarray,
                   generalised: bool, ended: Evaluation, increments: int | None = None) -> dict[str, float]:
    """Bias by the increments of every free parameter that the data determine (internal units), by halving them.

    The test is simulated once more, extrapolated in time from the given increments and half of their length.
    Extrapolated increments leave a quarter of their error when they are halved.

    Parameters
    ----------
    evaluate, values, local, generalised, ended, increments : as for `discretisation_bias`

    Raises
    ------
    NotConverged
        If the simulation with shorter increments does not converge.
    """
    finer = 2 * (increments or experiment.options.substeps or 1)
    evaluated, weights = evaluate(experiment, values, local, generalised, finer)
    if evaluated.system is None:
        raise NotConverged(f"no equilibrium with shorter increments: {evaluated.message}")
    whole = 1.0 if increments is None else 4.0 / 3.0
    found = _biases(experiment, values, evaluated, ended, weights.image_noise)
    return {name: whole * bias for name, bias in found.items()}


def _biases(experiment: Experiment, values: Mapping[str, float], evaluated: Evaluation, ended: Evaluation,
            image_noise: float) -> dict[str, float]:
    """Values less those where one Gauss-Newton step of the finer model leads, without the step left of the given
    one."""
    parameters = experiment.parameters.with_values(values)
    steps = []
    for point in (evaluated, ended):
        scaled = scaled_system(point.system, parameters, point.reference_gram, image_noise)
        found = spectrum(scaled)
        steps.append(found.inverse @ scaled.b)
    step = steps[0] - steps[1]
    moved = parameters.unpack(parameters.pack() + step)
    share = undetermined_share(found)  # of the given mesh, whose parameters are reported
    own = [name for i, name in enumerate(scaled.names) if share[i] <= MAX_UNDETERMINED_SHARE]
    return {name: values[name] - moved[name].value for name in own}


def carried_local(old: DriveTable, new: DriveTable, experiment: Experiment, finer: Refined,
                  local: np.ndarray) -> np.ndarray:
    """Frame-local unknowns on the finer mesh: measured edges interpolated along them, all others as they are.

    Returns
    -------
    array (n_frames, m_new) mm
    """
    dim = experiment.n_dim
    motion = np.zeros((len(local), experiment.mesh.n_nodes * dim))
    for column, dof in _measured_dofs(old).items():
        motion[:, dof] = local[:, column]
    nodal = motion.reshape(len(local), -1, dim)
    fine = np.stack([(finer.carry @ nodal[:, :, i].T).T for i in range(dim)], axis=2).reshape(len(local), -1)
    carried = np.zeros((len(local), new.n_local))
    carried[:, np.flatnonzero(~new.measured)] = local[:, np.flatnonzero(~old.measured)]
    for column, dof in _measured_dofs(new).items():
        carried[:, column] = fine[:, dof]
    return carried


def _measured_dofs(drives: DriveTable) -> dict[int, int]:
    """Column of the frame-local unknowns -> degree of freedom of the measured edge that it moves."""
    return {column: int(drives.dofs[np.flatnonzero(drives.basis[:, drive])[0]])
            for column, (drive, measured) in enumerate(zip(drives.local, drives.measured, strict=False))
            if measured and drives.basis[:, drive].any()}


def _carried_shapes(experiment: Experiment, made: Experiment, carry: sparse.csr_array,
                    entry: Prescribed) -> Prescribed:
    """Shapes of a measured boundary's own modes on the nodes of the finer edge."""
    drive = entry.drive
    if not isinstance(drive, Parametrised) or drive.shapes is None:
        return entry
    whole = np.zeros((experiment.mesh.n_nodes, drive.shapes.shape[1]))
    whole[set_nodes(experiment, entry.nodes)] = drive.shapes
    return replace(entry, drive=replace(drive, shapes=(carry @ whole)[set_nodes(made, entry.nodes)]))


def _midpoints(n_old: int, fine) -> sparse.csr_array:
    """Nodal fields on a mesh of raised order: old nodes, then the means of the ends of each edge."""
    rows, columns = [], []
    ends: dict[int, tuple[int, int]] = {}
    for block in fine.blocks:
        cell = element.cell(block.cell)
        pairs = element.edges(block.cell)
        for nodes in block.connectivity.tolist():
            ends.update({nodes[cell.n_corners + i]: (nodes[a], nodes[b]) for i, (a, b) in enumerate(pairs)})
    for node, pair in ends.items():
        rows += [node, node]
        columns += pair
    old = np.arange(n_old)
    values = np.concatenate([np.ones(n_old), np.full(len(rows), 0.5)])
    return sparse.csr_array((values, (np.concatenate([old, rows]), np.concatenate([old, columns]))),
                            shape=(len(fine.nodes), n_old))
