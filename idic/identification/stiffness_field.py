"""Where a body is stiffer or softer than the identified model says: a field of hundreds of unknowns.

The stress of the points is multiplied by exp(field): a thickness that varies, or a modulus where the stress is
proportional to it. The field is bilinear on a regular grid. Before the test it is zero up to `std`, alike within
`length_mm` (a covariance of Matern's with smoothness 3/2); all other parameters stay as they were identified. Found by
Gauss and Newton's method with products (`idic.identification.many_unknowns`): no derivative is made for an unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idic.correlation import CorrelationContext, ordinary_variance
from idic.errors import InputError, NotConverged
from idic.fe import Body, Direction, Linearisation, StepList, Variation
from idic.identification.many_unknowns import LanczosStep, MotionEquations, lanczos_step, motion_equations
from idic.model import ForwardModel
from idic.parameters import ParameterSet

MAX_UNKNOWNS = 3000  # their prior covariance is a dense matrix: 72 MB
MAX_STEPS = 12
MAX_HALVINGS = 5
MIN_STEP_STD = 0.05  # of the unknowns by their noise: a shorter step is the last one
JITTER = 1e-9  # on the diagonal of a correlation matrix whose neighbours are nearly one


@dataclass(frozen=True, eq=False)
class StiffnessField:
    """The factor on the stress over an element set.

    Attributes
    ----------
    places : (n, d) mm, the grid points
    factor, std : (n,), where 1 is the identified model; std : of the logarithm, by noise and prior
    elements : (n_el,) of the set; element_factor, element_std : (n_el,) at their middle
    phi, start_phi : weighted sum of squares of images and channels, with the field and without
    products : products with the derivatives that it took; converged : whether the steps ended by themselves
    """

    places: np.ndarray
    factor: np.ndarray
    std: np.ndarray
    elements: np.ndarray
    element_factor: np.ndarray
    element_std: np.ndarray
    phi: float
    start_phi: float
    products: int
    converged: bool


def stiffness_field(forward: ForwardModel, parameters: ParameterSet, context: CorrelationContext, frames: Sequence[int],
                    steps: np.ndarray | None, element_set: str, spacing_mm: float, length_mm: float,
                    std: float) -> StiffnessField:
    """The field over an element set at an identified point.

    Parameters
    ----------
    context : of the point, all cameras, with the weights of ordinary least squares
    frames : that are compared; steps : increments of the point (s)
    spacing_mm : of the grid; length_mm : within which the field is alike; std : of its logarithm before the test

    Raises
    ------
    InputError
        For what has no products (`idic.fe.Linearisation`), images that are not grey, frame-local unknowns, too many
        grid points.
    NotConverged
        If the identified model itself is not simulated.
    """
    body = _checked_body(forward, parameters, context, element_set, spacing_mm, length_mm, std)
    field = _grid(body, element_set, spacing_mm)
    places, root = _prior(field, length_mm, std)
    problem = _Problem(forward, parameters, context, tuple(frames), steps, body, field, root)
    at = problem.at(np.zeros(len(places)))
    start_phi, n_products, length = at.phi, 0, np.inf
    for _ in range(MAX_STEPS):
        step = lanczos_step(at.curvature, at.pull)
        n_products += 2 * step.vectors.shape[1]
        length = float(np.sqrt(max(at.pull @ step.x, 0.0)))  # in standard deviations
        following = None if length <= MIN_STEP_STD else problem.after(at, step.x)
        if following is None:
            break
        at = following
    step = lanczos_step(at.curvature, at.pull if at.pull.any() else np.ones(len(places)), complete=True)
    n_products += 3 * step.vectors.shape[1]
    deviations, values = root @ at.deviations(step), root @ at.x
    elements, middles = _middles(body, element_set)
    number, hats = field.hats(middles)
    return StiffnessField(
        places, np.exp(values), np.linalg.norm(deviations, axis=1), elements,
        np.exp((values[number] * hats).sum(axis=1)),
        np.linalg.norm(np.einsum("ek,ekn->en", hats, deviations[number]), axis=1), at.phi, start_phi, n_products,
        length <= MIN_STEP_STD)


def _checked_body(forward: ForwardModel, parameters: ParameterSet, context: CorrelationContext, element_set: str,
                  spacing_mm: float, length_mm: float, std: float) -> Body:
    model, names = context.experiment.model, [section.name for section in forward.body.sections]
    if element_set not in names:
        raise InputError("no such element set for a field of the stiffness", expected=", ".join(names),
                         found=str(element_set), remedy="give a set with a material")
    if not (spacing_mm > 0.0 and length_mm > 0.0 and std > 0.0):
        raise InputError("a field of the stiffness needs sizes above zero", found=f"{spacing_mm}, {length_mm}, {std}",
                         expected="spacing_mm, length_mm and std above zero", remedy="give them in mm, and std as 0.3")
    body = forward.body_at(parameters)
    obstacles = {"images that are not grey": any(view.recording.quantity != "grey"
                                                 for view in context.experiment.views),
                 "frame-local unknowns": forward.drives.n_local > 0,
                 "channels that are no reactions": forward.readings is not None,
                 "a sheet seen from its side": bool(body.surface_side),
                 "a known error of the motion": model.motion_error is not None}
    faults = [word for word, is_there in obstacles.items() if is_there]
    if faults:
        raise InputError("no field of the stiffness for this test", expected="grey images, known drives, reactions",
                         found=", ".join(faults), remedy="declare [[heterogeneity]] instead")
    return body


def _grid(body: Body, element_set: str, spacing_mm: float) -> Variation:
    parts = _connectivity(body, element_set)
    nodes = body.mesh.nodes[np.unique(np.concatenate([connectivity.ravel() for _, connectivity in parts]))]
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    cells = np.maximum(1, np.rint((high - low) / spacing_mm)).astype(int)
    n = int(np.prod(cells + 1))
    if n > MAX_UNKNOWNS:
        raise InputError("too many unknowns in a field of the stiffness",
                         expected=f"at most {MAX_UNKNOWNS} grid points", found=f"{n} at a spacing of {spacing_mm:g} mm",
                         remedy="a larger spacing")
    return Variation(element_set, "field", {str(k): 0.0 for k in range(n)}, 0.5 * (low + high), 0.5 * (high - low),
                     tuple(int(c) for c in cells))


def _connectivity(body: Body, element_set: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Elements of a section and their nodes, block by block"""
    elements = next(np.asarray(section.elements) for section in body.sections if section.name == element_set)
    parts = ((block, elements[(elements >= block.first) & (elements < block.first + block.n_elements)])
             for block in body.mesh.blocks)
    return [(inside, block.connectivity[inside - block.first]) for block, inside in parts if len(inside)]


def _middles(body: Body, element_set: str) -> tuple[np.ndarray, np.ndarray]:
    """Elements and their middles  # (n_el,), (n_el, d) mm"""
    parts = _connectivity(body, element_set)
    return (np.concatenate([elements for elements, _ in parts]),
            np.concatenate([body.mesh.nodes[connectivity].mean(axis=1) for _, connectivity in parts]))


def _prior(field: Variation, length_mm: float, std: float) -> tuple[np.ndarray, np.ndarray]:
    """Grid points, and S with S S^T the covariance before the test  # (n, d) mm, (n, n)"""
    axes = [np.linspace(m - h, m + h, c + 1) for m, h, c in zip(field.middle, field.half, field.cells, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    distance = np.sqrt(3.0) * np.linalg.norm(places[:, None] - places, axis=-1) / length_mm
    return places, std * np.linalg.cholesky((1.0 + distance) * np.exp(-distance) + JITTER * np.eye(len(places)))


@dataclass(frozen=True, eq=False)
class _Problem:
    """The test, and the field whose unknowns are x: its values are root @ x."""

    forward: ForwardModel
    parameters: ParameterSet
    context: CorrelationContext
    frames: tuple[int, ...]
    steps: np.ndarray | None
    body: Body
    field: Variation
    root: np.ndarray

    def at(self, x: np.ndarray, begun: Linearisation | None = None) -> _Point:
        """Simulated and compared there; begun : a simulation near it, whose increments are followed

        Raises
        ------
        NotConverged
            If no equilibrium is found.
        """
        values = {str(k): float(value) for k, value in enumerate(self.root @ x)}
        body = replace(self.body, variations=(*self.body.variations, replace(self.field, values=values)))
        directions = [Direction(name, variation=(len(self.body.variations), name)) for name in values]
        model = self.forward.model
        steps = StepList(tuple(float(t) for t in self.steps)) if self.steps is not None else None
        simulated = Linearisation.of(
            body, self.forward.law_values(self.parameters), model.times[model.reference:], directions,
            steps if begun is None else begun.steps, self.forward.options.substeps or 1, self.forward.control,
            None if begun is None else begun.motion.u, may_cut=True)
        motion, equations = simulated.motion, {}
        for frame in self.frames:
            k = frame - model.reference
            equations[k] = motion_equations(self.context, frame, motion.u[k], motion.u[k - 1], motion.channels[k])
        return _Point(self, x, simulated, equations)

    def after(self, at: _Point, step: np.ndarray) -> _Point | None:
        """The point after a step, shortened until it makes the objective smaller; None where it does not."""
        for halvings in range(MAX_HALVINGS + 1):
            try:
                following = self.at(at.x + 0.5**halvings * step, at.simulated)
            except NotConverged:
                continue
            if following.objective < at.objective:
                return following
        return None


@dataclass(frozen=True, eq=False)
class _Point:
    """The equations at unknowns x (n,), frame by frame from the reference."""

    problem: _Problem
    x: np.ndarray
    simulated: Linearisation
    equations: Mapping[int, MotionEquations]

    @property
    def phi(self) -> float:
        return sum(equations.phi for equations in self.equations.values())

    @property
    def objective(self) -> float:
        return self.phi + float(self.x @ self.x)

    def curvature(self, v: np.ndarray) -> np.ndarray:
        """H v, the information of the test on the unknowns  # (n,) -> (n,)"""
        moved = self.simulated.tangent(self.problem.root @ v)
        return self._gathered(lambda k, equations: (equations.of_images(moved.u[k].ravel()),
                                                    equations.of_channels(moved.channels[k])))

    @cached_property
    def pull(self) -> np.ndarray:
        """Right-hand side of a step  # (n,)"""
        return self._gathered(lambda k, equations: (equations.pull, equations.channel_pull)) - self.x

    def _gathered(self, sums: Callable[[int, MotionEquations], tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        motion = self.simulated.motion
        u, channels = np.zeros_like(motion.u), np.zeros_like(motion.channels)
        for k, equations in self.equations.items():
            of_u, channels[k] = sums(k, equations)
            u[k] = of_u.reshape(u[k].shape)
        return self.problem.root.T @ self.simulated.adjoint(u, channels)

    def deviations(self, step: LanczosStep) -> np.ndarray:
        """R with R R^T the covariance of the unknowns  # (n, n)

        Deformed images have noise of their own, and that of the reference in common (docs/method.md, section 7).
        """
        basis, n_references = step.vectors, self.problem.context.experiment.recording.n_references
        k = basis.shape[1]
        images, shared, channels = np.zeros((k, k)), np.zeros((k, k)), np.zeros((k, k))
        if k:
            moved = [self.simulated.tangent(self.problem.root @ vector) for vector in basis.T]
            total = np.zeros((moved[0].u[0].size, k))
            for frame, equations in self.equations.items():
                u = np.stack([motion.u[frame].ravel() for motion in moved], axis=1)
                changes = np.stack([motion.channels[frame] for motion in moved], axis=1)
                images += u.T @ equations.of_images(u)
                channels += changes.T @ (equations.of_channels(np.ones(len(changes)))[:, None] * changes)
                total += u
            for equations in self.equations.values():
                shared += total.T @ equations.of_images(total) / len(self.equations)
        share = ordinary_variance(n_references)
        inverse = np.linalg.inv(np.eye(k) + images + channels)
        covariance = inverse @ (np.eye(k) + (images + shared / n_references) / share + channels) @ inverse
        within = np.linalg.cholesky(0.5 * (covariance + covariance.T))
        return np.eye(len(basis)) + basis @ ((within - np.eye(k)) @ basis.T)
