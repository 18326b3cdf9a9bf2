"""Memory and time that an identification will take, from mesh, law, frames and images; `idic check` prints them.

The constants are rounded measurements: one core of a shared machine (two cores with other programs on them, one thread
per BLAS, September 2026 versions of NumPy and SciPy): the LU by small fronts on stiffness patterns of 300 to 18 000
equations, simulations of 10 000 to 22 000 equations in elastic, rubber-like and elastoplastic laws, image
passes with ten parameters. Kept factors of large solids: cubes of 9 000 to 101 000 equations on a quiet machine, memory
up to 318 000. Multigrid: cubes of 25 000 to 1 000 000. Within these the estimates were between half and twice the
measurement; beyond them they are extrapolations.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.fe import dissected, Fill, Mesh
from idic.correlation import MAX_DENSE_UNKNOWNS
from idic.laws import get_law
from idic.model import Column, Experiment, Measured, Model, Recording, Remedies

# memory, bytes
_PROCESS = 0.35e9  # libraries and compiled kernels
_PER_ENTRY = 50.0  # of one triangular factor: two factors, one while the other is made, matrix and fronts at work
_PER_ENTRY_KEPT = 16.0  # of a kept factor, of the symmetric part: itself, and fronts at work
_PER_ELEMENT_ENTRY = 40.0  # places of the element matrices in the stiffness, and their values
_PER_PIXEL = 120.0  # of one camera: spline, pixel map, gradients, residual
_POINT_VALUES = 60  # numbers per integration point: strain, stress, tangent, state; the last again per parameter
_REPORT = 8e6  # bytes on disk: page, figures, maps, files for ParaView
# time, seconds on one core
_START = 20.0  # servers, compiled kernels, first look at the data
_PER_ENTRY_S, _PER_OPERATION_S = 5e-9, 2.5e-10
_SOLVE_S = 4e-9  # per entry of a factor and right-hand side
_PER_ENTRY_KEPT_S, _PER_OPERATION_KEPT_S, _SOLVE_KEPT_S = 4e-8, 1e-11, 2.1e-9  # the same of kept factors
_PER_ELEMENT_ENTRY_S = 7e-9  # element matrices and their sum
_FACTORISATIONS, _ITERATIONS_KEPT = 1.3, 6.0  # per increment, where a factor is kept
_SOLUTIONS_PER_CORRECTION, _SOLUTIONS_PER_DERIVATIVE = 4, 6  # each iteration and each parameter then needs several
_DERIVATIVE_SHARE = 0.15  # of an evaluation of all points, per parameter
_PER_ELEMENT_ENTRY_LEVELS = 20.0  # bytes of multigrid: matrix by nodes, coarser levels, what they are made of
_LEVELS_S, _CYCLES_S = 8e-8, 2e-8  # making them; one solution that an iteration then corrects
_PER_POINT_S = {2: 1.6e-6, 3: 2.3e-6}  # stress and tangent of an integration point, by dimension
_DIRECT_SHARE = 0.12  # of a simulation, per directly differentiated parameter
_PER_PIXEL_S = 3e-8  # per frame and evaluation: spline, residual, its derivatives
_PER_PIXEL_ONCE_S = 1.5e-6  # pixel map and spline of the reference, residual maps of the report
_EVALUATIONS = 10  # usual number; the gallery needs 6 to 14
_NEWTON_ITERATIONS = 3  # per increment
_CHOSEN_INCREMENTS = 3  # 2 and 1 per frame, extrapolated: where most rate-dependent laws end
_FREE_DIC_PASSES = 10  # image passes of a free FE-DIC, which finds the noise where it is not given
_FITS_SHARE, _TIGHT_SHARE = 2.0, 0.5  # of the memory of the machine
_HOPELESS_SHARE = 4.0  # twice what the factor of two leaves open: the estimate of large meshes is extrapolated
_LONG_S = 24 * 3600.0
_WORTH_WORKERS_S = 30.0  # of computing: the start of worker processes takes about ten


@dataclass(frozen=True)
class Cost:
    """Expected cost of an identification in one process on one core; each value within a factor of two.

    memory, disk : bytes; factor : bytes of the memory for the factorised stiffness; time_s : seconds;
    available : bytes of memory that this machine allows, None if unknown
    """

    memory: float
    factor: float
    disk: float
    time_s: float
    equations: int
    available: float | None
    smaller: str = "larger elements"  # what takes less memory

    @property
    def worth_workers(self) -> bool:
        """Whether worker processes save more time than their start takes."""
        return self.time_s - _START > _WORTH_WORKERS_S

    def line(self) -> str:
        """One line for people."""
        memory_text = "" if self.available is None else f"; this machine has {_whole(self.available)}"
        return (f"about {_bytes(self.memory)} of memory, {_duration(self.time_s)} on one core, {_bytes(self.disk)} of "
                f"disk (each within a factor of 2){memory_text}")

    def refuse_hopeless(self, file: str) -> None:
        """`InputError` where this machine has not a quarter of the memory: it would be ended in the middle."""
        if self.available is not None and self.memory > _HOPELESS_SHARE * self.available:
            raise InputError("the identification needs far more memory than this machine has", file=file,
                             key="experiment.mesh", expected=f"at most about {_whole(self.available)}",
                             found=f"about {_bytes(self.memory)} for {self.equations} equations",
                             remedy="use larger elements (idic check tells the cost), or workers of larger machines "
                                    "(--scheduler)")

    def warnings(self) -> list[str]:
        """Warnings if memory is short or the run takes longer than a day."""
        warnings = []
        if self.available is not None and self.memory > _TIGHT_SHARE * self.available:
            verb = "needs" if self.memory > _FITS_SHARE * self.available else "may need"
            warnings.append(f"the identification {verb} more memory than this machine has: about "
                            f"{_bytes(self.memory)} of "
                         f"{_whole(self.available)}; the factorised stiffness of {self.equations} equations takes "
                         f"{_bytes(self.factor)}. Use {self.smaller}, half of a symmetric specimen, or a machine with "
                         "more memory")
        if self.time_s > _LONG_S:
            warnings.append(f"the identification takes about {_duration(self.time_s)} on one core: larger elements or "
                         f"fewer "
                         "frames shorten it; --workers spreads images and perturbed simulations over cores")
        return warnings


def expected_cost(experiment: Experiment) -> Cost:
    """The cost of `idic identify` with the options of the experiment.

    An external solver counts nothing: its cost is its own.
    """
    model = experiment.model
    mesh, options = model.mesh, experiment.options
    n_frames, n_free = model.n_frames, len(model.parameters.free)
    nodal = 8.0 * mesh.n_nodes * mesh.n_dim * (1 + n_free)  # bytes of displacements and sensitivities of a frame
    frames = n_frames - model.reference
    pixels = sum(math.prod(view.recording.image_shape) for view in experiment.views if view.recording.stack is not None)
    images = pixels * n_frames * _bytes_per_pixel(experiment.recording)
    image_pass = _PER_PIXEL_S * pixels * n_frames
    evaluations = min(_EVALUATIONS, options.max_iterations)
    body = SimulationCost(0.0, 0.0, 0.0)
    if model.solver is None:
        body = simulation_cost(mesh, frames, 0 if _is_linear(model) else frames * _increments(experiment), n_free)
    time_s = _START + _PER_PIXEL_ONCE_S * pixels + evaluations * (body.time_s + image_pass)
    if experiment.recording.noise.std_gv is None or _measured_unknowns(model):
        time_s += _FREE_DIC_PASSES * image_pass
    memory = (_PROCESS + body.factor + body.kept_bytes + _PER_PIXEL * pixels / max(len(experiment.views), 1)
              + max(nodal, 8e6) + _generalised(experiment, n_frames))
    smaller = Remedies(experiment).possible("larger elements", 'element_order = "as_given"')
    return Cost(memory, body.factor, images + 3.0 * nodal * n_frames + _REPORT, time_s, mesh.n_nodes * mesh.n_dim,
                memory_here(), smaller)


@dataclass(frozen=True)
class SimulationCost:
    """factor : bytes of the factorised stiffness; kept_bytes : of stiffness and points; time_s : of a simulation, s"""

    factor: float
    kept_bytes: float
    time_s: float


def simulation_cost(mesh: Mesh, frames: int, increments: float, n_free: int) -> SimulationCost:
    """One simulation with the derivatives of `n_free` parameters.

    increments : of all frames together; 0: one factorisation serves all frames
    """
    points = sum(block.n_elements * len(block.kind.quadrature_rule()[1]) for block in mesh.blocks)
    entries = sum(block.n_elements * (mesh.n_dim * block.connectivity.shape[1]) ** 2 for block in mesh.blocks)
    kept_bytes = _PER_ELEMENT_ENTRY * entries + 8.0 * points * _POINT_VALUES * (1 + 0.1 * n_free)
    evaluation = _PER_POINT_S[mesh.n_dim] * points
    fill = dissected(mesh)
    if fill.costs_much:
        evaluation += _PER_ELEMENT_ENTRY_S * entries
        factor, factorisation, solution = _kept_factor(fill, entries)
        time_s = _by_kept_factors(factorisation, solution, frames, increments, n_free, evaluation)
        return SimulationCost(factor, kept_bytes, time_s)
    factorisation = _PER_ENTRY_S * fill.entries + _PER_OPERATION_S * fill.operations
    factor, solution = _PER_ENTRY * fill.entries, _SOLVE_S * fill.entries
    steps = max(1.0, increments * _NEWTON_ITERATIONS)
    time_s = steps * (factorisation + solution + evaluation) + frames * solution
    return SimulationCost(factor, kept_bytes, time_s * (1.0 + _DIRECT_SHARE * n_free))


def _kept_factor(fill: Fill, element_entries: float) -> tuple[float, float, float]:
    """Bytes of a factor of the symmetric part, or of the levels of multigrid; seconds to make it, and of a solution."""
    if fill.is_too_large:
        return (_PER_ELEMENT_ENTRY_LEVELS * element_entries, _LEVELS_S * element_entries,
                _CYCLES_S * element_entries)
    return (_PER_ENTRY_KEPT * fill.entries,
            _PER_ENTRY_KEPT_S * fill.entries + _PER_OPERATION_KEPT_S * fill.operations, _SOLVE_KEPT_S * fill.entries)


def _by_kept_factors(factorisation: float, solution: float, frames: int, increments: float, n_free: int,
                     evaluation: float) -> float:
    """Seconds of a simulation whose factors, of symmetric parts, serve several iterations (`idic.fe.solver.krylov`)."""
    iteration = evaluation + _SOLUTIONS_PER_CORRECTION * solution
    derivatives = n_free * (_SOLUTIONS_PER_DERIVATIVE * solution + _DERIVATIVE_SHARE * evaluation)
    steps = max(1.0, increments)
    return steps * (_FACTORISATIONS * factorisation + _ITERATIONS_KEPT * iteration + derivatives) + frames * solution


def _is_linear(model: Model) -> bool:
    """Whether one factorisation serves all frames."""
    return all(material.kinematics == "small" and not get_law(material.law).state_names
               for material in model.materials)


def _increments(experiment: Experiment) -> float:
    """Increments per frame; where the identification chooses them, those that most rate-dependent laws end with."""
    return experiment.options.substeps or (_CHOSEN_INCREMENTS if experiment.model.rate_dependent_laws else 1)


def _measured_unknowns(model: Model) -> int:
    """Unknowns of every frame on edges whose motion is measured."""
    return sum(len(model.mesh.node_sets[entry.nodes]) for entry in model.prescribed
               if isinstance(entry.drive, Measured))


def _generalised(experiment: Experiment, n_frames: int) -> float:
    """Bytes of generalised least squares: a matrix of the unknowns of all frames, or where they are many of the nodal
    values."""
    model = experiment.model
    edges = _measured_unknowns(model)
    if experiment.options.estimator == "ordinary" or (experiment.options.estimator == "auto" and not edges):
        return 0.0
    logged = sum(isinstance(entry.drive, Column) and entry.drive.noise_std > 0.0 for entry in model.prescribed)
    unknowns = 2 * len(experiment.views) + logged + edges
    n, values = n_frames * unknowns, model.mesh.n_nodes * model.mesh.n_dim
    if n <= MAX_DENSE_UNKNOWNS:
        return 24.0 * n * (n + values)
    return 24.0 * (2 * values) ** 2  # their columns lie on disk


def _bytes_per_pixel(recording: Recording) -> int:
    dtype = getattr(recording.stack.entries[0], "dtype", "uint16") if hasattr(recording.stack,
                                                                               "entries") else "uint16"
    return np.dtype(dtype).itemsize


def memory_here() -> float | None:
    """Bytes of memory that this process may use: of the machine, or of its control group; None if unknown."""
    try:
        limits = [float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")]
    except (AttributeError, ValueError, OSError):
        return None
    for file in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(float(Path(file).read_text(encoding="utf-8")))
        except (OSError, ValueError):  # no such control group, or "max"
            continue
    return min(limits)


def _bytes(value: float) -> str:
    """Of an estimate."""
    unit, size = _unit_of(value)
    return f"{_one_or_two_digits(value / size)} {unit}"


def _whole(value: float) -> str:
    """Of a machine, which is known: 25.3 GB, not 30."""
    unit, size = _unit_of(value)
    return f"{value / size:.3g} {unit}"


def _unit_of(value: float) -> tuple[str, float]:
    return next((pair for pair in (("TB", 1e12), ("GB", 1e9)) if value >= pair[1]), ("MB", 1e6))


def _duration(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{_one_or_two_digits(seconds / size)} {unit}"
    return f"{_one_or_two_digits(seconds)} s"


def _one_or_two_digits(value: float) -> str:
    """2.3 -> 2, 0.42 -> 0.4, 16.7 -> 17, 530 -> 500: no more digits than the estimate has."""
    digits = 2 if f"{value:e}".startswith("1") else 1
    return f"{float(f'{value:.{digits}g}'):g}"
