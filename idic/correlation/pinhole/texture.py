"""Texture consistency: the reference images of two cameras compared with each other, at the same material points.

    r(x) = f(x) - g'(Q(X(x))),       g' = level + gain g                    docs/method.md, equation 17.10
    L_i  = (F^-T grad f) . phi_i,    F = J_Q T [J_P T]^-1                   equation 17.11
    phi  = q(X) - F p(X)                                                    equation 17.12

f is the reference image of one camera with projection P, g that of another with projection Q; X(x) is the point of the
surface that the pixel x shows, T two tangents of the surface there; p and q are the velocities of the images of a point
by a degree of freedom of a camera, of the placement or of the shape of the mesh. Nothing is deformed in the reference
state: no other degree of freedom has a column. With the frames of both cameras against their own reference images, this
pair holds all differences of the images; frames of one against the reference of the other would repeat them.

Gain and offset of every patch of elements are eliminated. Points that the other camera does not see are left out.
Gloss, blur and interpolation leave more than noise. The weight is that of the variance with which the residual scatters
sums against the gradient, element by element, and no more than that of noise: M is then the covariance of b.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation.comparison import at_nodes
from idic.correlation.context import CorrelationContext
from idic.correlation.frame import nodal_equations, residual_map
from idic.correlation.grey import GreyReference, squares_about_mean
from idic.correlation.pinhole.agreement import seen_as_well
from idic.correlation.pinhole.view import in_space, solved_at_seen, surface_tangents
from idic.correlation.pixels.cells import (N_MONOMIALS, N_NODES, NODE_POINTS, TRANSFORMS, inverse_gradients,
                                           monomials)
from idic.correlation.pixels.pixel_map import PixelMap
from idic.correlation.system import CorrelationSystem, solve_positive
from idic.images.interpolate import Spline, prefilter
from idic.images.placed_camera import PLACEMENT_STEM, PlacedCamera
from idic.model.experiment import Experiment

BRIGHTNESS = "patch"  # light falls on two cameras differently, and not evenly
MIN_CORRELATION = 0.6  # of the two textures: below, the pair is farther off than a step can mend and moves nothing
MIN_COMMON_PIXELS = 200


@dataclass(frozen=True, eq=False)
class TexturePair:
    """Two cameras whose reference images are compared.

    n_pixels : of the first that the second sees as well; n_all : that the first has; correlation : of the two textures,
    patch by patch; gain : of the second camera's grey values; excess : variance of sums against the gradient over that
    of the noise, at least 1.
    """

    first: str
    second: str
    n_pixels: int
    n_all: int
    correlation: float
    gain: float
    excess: float

    @property
    def is_used(self) -> bool:
        """Whether the textures agree well enough to enter the equations."""
        return self.n_pixels >= MIN_COMMON_PIXELS and self.correlation >= MIN_CORRELATION

    def entry(self) -> dict:
        """For ``result.json``."""
        return {"compared_with": self.first, "pixels": self.n_pixels, "share": self.n_pixels / max(self.n_all, 1),
                "correlation": self.correlation, "gain": self.gain, "excess_variance": self.excess,
                "used": self.is_used}

    def note(self) -> str:
        """One sentence for the report."""
        if not self.is_used:
            return (f"the textures of {self.first} and {self.second} were not compared: their correlation is "
                    f"{self.correlation:.2f}, less than {MIN_CORRELATION:g}; check placement, calibration and light")
        share = 100.0 * self.n_pixels / max(self.n_all, 1)
        return (f"{self.second} is compared with the texture of {self.first}: correlation {self.correlation:.3f} on "
                f"{share:.0f} % of the pixels of {self.first}; the differences scatter sums against the gradient "
                f"{np.sqrt(self.excess):.2f} times as much as noise, which the standard deviations count")


@dataclass(frozen=True, eq=False)
class TextureEquations:
    """Contribution of all pairs to the system of an evaluation; weighted.

    M, spread : (n, n); b : (n,); phi : of the functional; shared : (n_shared, n) what the noise of the reference images
    is multiplied by, see `CorrelationSystem.shared`.
    """

    M: np.ndarray
    b: np.ndarray
    phi: float
    spread: np.ndarray
    shared: np.ndarray
    pairs: tuple[TexturePair, ...]

    def added_to(self, system: CorrelationSystem) -> CorrelationSystem:
        """The closed system of all frames with the pairs."""
        predicted = None if system.predicted is None else system.predicted + self.M
        return replace(system, M=system.M + self.M, b=system.b + self.b, phi=system.phi + self.phi,
                       spread=system.spread + self.spread, predicted=predicted)


def texture_equations(context: CorrelationContext, names: tuple[str, ...]) -> TextureEquations | None:
    """The equations of all pairs of cameras with a common texture; None where there is none, or nothing to determine.

    context : of the main camera, with those of the further ones; names : (n,) of the system
    """
    if not determined_by_texture(context.experiment, names):
        return None
    n, rows = len(names), [_n_rows(camera) for camera in context.cameras]
    starts, pairs = np.cumsum([0, *rows]), []
    total = TextureEquations(np.zeros((n, n)), np.zeros(n), 0.0, np.zeros((n, n)), np.zeros((starts[-1], n)), ())
    for first, second in _compared(context):
        one, two = context.cameras[first], context.cameras[second]
        found = _Comparison(one, two)
        pairs.append(found.pair)
        total = replace(total, phi=total.phi + found.phi)
        if found.pair.is_used:
            M, b, of_one, of_two = found.equations(names)
            noise = context.weights.image_noise  # of the main camera, by which the covariance multiplies `shared`
            for start, own, sigma in ((starts[first], of_one, one.weights.image_noise),
                                      (starts[second], of_two, two.weights.image_noise)):
                total.shared[start:start + len(own)] += found.weight * sigma / noise * own
            base = found.weight * found.variance
            total = replace(total, M=total.M + M, b=total.b + b,
                            spread=total.spread + (found.pair.excess - 1.0) * base * M)
    return replace(total, pairs=tuple(pairs))


def texture_pairs(context: CorrelationContext) -> tuple[TexturePair, ...]:
    """What the pairs of cameras with a common texture show, whatever is free."""
    return tuple(_Comparison(context.cameras[first], context.cameras[second]).pair
                 for first, second in _compared(context))


def determined_by_texture(experiment: Experiment, names: Sequence[str]) -> list[str]:
    """Which degrees of freedom a comparison of textures depends on."""
    compared = {name for further in experiment.cameras if further.texture is not None
                for name in (further.texture, further.name)}
    views = [view for view in experiment.views if view.camera_name in compared]
    return [name for name in names if any(_moves(view, name) for view in views)]


def _compared(context: CorrelationContext) -> Iterator[tuple[int, int]]:
    """Numbers of the two cameras of every pair, that of the texture first."""
    names = [camera.experiment.camera_name for camera in context.cameras]
    for number, further in enumerate(context.experiment.cameras, 1):
        if further.texture is not None and isinstance(context.cameras[number].reference, GreyReference):
            yield names.index(further.texture), number


def _moves(view: Experiment, name: str) -> bool:
    """Whether a degree of freedom moves the image of a point of the undeformed surface in this camera."""
    stem = f"{view.camera_name}."
    if name.startswith((stem, f"{PLACEMENT_STEM}.")):
        return isinstance(view.camera, PlacedCamera) and not view.camera.is_motion(name.removeprefix(stem))
    return any(morph.name == name for morph in view.morphs)


def _n_rows(context: CorrelationContext) -> int:
    """Of `CorrelationSystem.shared` that belong to a camera."""
    reference, options = context.reference, context.experiment.options
    if not isinstance(reference, GreyReference):
        raise TypeError("texture consistency is of grey images")
    n_brightness = reference.layout(options.brightness).n_columns + (options.defocus != "none")
    return 2 * reference.pixel_map.n_nodes + n_brightness


class _Comparison:
    """The reference image of camera `two` against that of camera `one`."""

    def __init__(self, one: CorrelationContext, two: CorrelationContext):
        assert isinstance(one.reference, GreyReference) and isinstance(two.reference, GreyReference)
        self.one, self.two, self.reference, self.other = one, two, one.reference, two.reference
        # rounded: the same at neighbouring parameters; the brightness columns fit the rest
        self.gain = float(10.0 ** round(np.log10(self.reference.contrast / self.other.contrast), 2))
        own, n_images = one.weights, self.reference.n_images
        self.variance = (own.image_noise**2 + (self.gain * two.weights.image_noise) ** 2) / n_images
        self.weight = own.image * own.image_noise**2 / self.variance
        self.weight *= 1.0 if own.generalised else 1.0 + 1.0 / n_images
        seen = self._seen()
        spline, motion = self._spline(), _motion(self.reference.pixel_map, one, two)
        self.nodal = nodal_equations(self.reference, spline, motion, BRIGHTNESS, np.flatnonzero(~seen))
        self.back = _inverse_gradients(self.reference.pixel_map, motion)
        self.pair, left = self._judged(spline, motion)
        self.phi = self.weight * left  # of one weight at all points of a search: it is to fall
        self.weight /= self.pair.excess

    def _seen(self) -> np.ndarray:
        """Pixels of the first camera whose point is compared in the second one as well  # (n_pixels,) bool"""
        nodes = in_space(self.one.experiment.mesh.nodes)
        here = self.reference.pixel_map.interpolate(nodes)  # (n_pixels, 3) mm
        return seen_as_well(here, self.two.camera, self.other.pixel_map, nodes)

    def _spline(self) -> Spline:
        """The reference image of the second camera in the grey values of the first."""
        view, reference = self.two.experiment, self.reference
        images = [view.stack.frame(k) for k in view.averaged or (view.reference,)]
        mean = np.mean([np.asarray(image, dtype=np.float64) for image in images], axis=0)
        matched = reference.level + self.gain * (mean - self.other.level)
        return prefilter(matched.astype(np.float32), reference.degree, reference.lowpass_px)

    def _judged(self, spline: Spline, motion: np.ndarray) -> tuple[TexturePair, float]:
        """The pair, and the sum of squares that counts: no more than at the least correlation that is used."""
        nodal, reference = self.nodal, self.reference
        brightness = solve_positive(nodal.bb, nodal.rb)
        rr, (_, squares) = max(nodal.rr - float(brightness @ nodal.rb), 0.0), squares_about_mean(nodal)
        correlation = float(np.sqrt(max(1.0 - rr / squares, 0.0))) if squares > 0.0 else 0.0
        left = residual_map(reference, spline, motion, BRIGHTNESS, brightness, nodal.lost_pixels)
        starts, r = reference.pixel_map.start[:-1], np.where(left.valid, left.r, 0.0).astype(float)
        gradient = [np.where(left.valid, d, 0.0).astype(float) for d in (reference.fx, reference.fy)]
        sums = sum(float((np.add.reduceat(d * r, starts) ** 2).sum()) for d in gradient)  # of each element
        white = self.variance * sum(float((d**2).sum()) for d in gradient)
        excess = max(sums / white, 1.0) if white > 0.0 else 1.0
        pair = TexturePair(self.one.experiment.camera_name, self.two.experiment.camera_name, nodal.n_valid,
                           reference.pixel_map.n_pixels, correlation, self.gain, excess)
        return pair, min(rr, (1.0 - MIN_CORRELATION**2) * squares)

    def equations(self, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """M (n, n), b (n,), weighted, and the columns (2 n_nodes, n) in the bases of both references."""
        pixel_map, n, columns = self.reference.pixel_map, len(names), _columns(self.one, self.two, names)
        found = self.nodal.gram(columns)
        whole, rhs = self.weight * found.matrix, self.weight * found.rhs
        slope = solve_positive(whole[n:, n:], np.column_stack([whole[n:, :n], rhs[n:]]))
        M, b = whole[:n, :n] - whole[:n, n:] @ slope[:, :n], rhs[:n] - whole[:n, n:] @ slope[:, n]
        share = np.zeros(pixel_map.n_nodes)  # of the pixels around a node that both cameras show
        share[pixel_map.visible_nodes] = self.reference.visible_share(self.nodal)[pixel_map.visible_nodes]
        fields = share[:, None, None] * columns.reshape(-1, 2, n)
        back = at_nodes(pixel_map, self.back)
        density = np.abs(np.linalg.det(back))  # pixels of the first camera per pixel of the second
        of_one = np.einsum("nij,njm->nim", back, fields).reshape(columns.shape)
        of_two = -self.gain**2 * (density[:, None, None] * fields).reshape(columns.shape)
        return 0.5 * (M + M.T), b, of_one, of_two


def _motion(pixel_map: PixelMap, one: CorrelationContext, two: CorrelationContext) -> np.ndarray:
    """From the pixel of one camera to that of the other: monomial coefficients  # (n_elements, 2, 8) px

    Quadratic on every face, also of linear elements: perspective is not linear between their nodes.
    """
    nodes, found = in_space(one.experiment.mesh.nodes), np.zeros((pixel_map.n_elements, 2, N_MONOMIALS))
    for kind in np.unique(pixel_map.kind):
        quadratic, of_kind = 2 + kind % 2, pixel_map.kind == kind
        points, n = NODE_POINTS[quadratic], N_NODES[kind]
        shape = (monomials(points[:, 0], points[:, 1]) @ TRANSFORMS[kind])[:, :n]  # (n_points, n)
        places = np.einsum("qi,eid->eqd", shape, nodes[pixel_map.conn[of_kind, :n]]).reshape(-1, 3)
        apart = (two.camera.project(places) - one.camera.project(places)).reshape(-1, len(points), 2)
        found[of_kind] = np.einsum("kq,eqc->eck", TRANSFORMS[quadratic][:, :len(points)], apart)
    return found


def _inverse_gradients(pixel_map: PixelMap, motion: np.ndarray) -> np.ndarray:
    """F^-1 of every element  # (n_elements, 2, 2)"""
    inverse = np.empty((pixel_map.n_elements, 2, 2))
    inverse_gradients(motion, pixel_map.centre, pixel_map.inverse_jacobian, inverse, np.empty(pixel_map.n_elements))
    return inverse


def _columns(one: CorrelationContext, two: CorrelationContext, names: tuple[str, ...]) -> np.ndarray:
    """Motion of the second image against the first by every degree of freedom  # (2 n_nodes, n) px per unit"""
    experiment = one.experiment
    nodes = experiment.mesh.nodes
    tangents = in_space(surface_tangents(experiment.mesh, experiment.surface))  # (n_nodes, 3, 2)
    before, after = (context.camera.jacobian(nodes) @ tangents for context in (one, two))
    columns = np.zeros((len(nodes), 2, len(names)))
    for i, name in enumerate(names):
        if _moves(one.experiment, name) or _moves(two.experiment, name):
            along = solved_at_seen(before, _velocity(one, name))  # of the point that a pixel shows, along the surface
            columns[:, :, i] = _velocity(two, name) - np.einsum("nck,nk->nc", after, along)
    return columns.reshape(2 * len(nodes), -1)


def _velocity(context: CorrelationContext, name: str) -> np.ndarray:
    """Motion of the images of the nodes at rest by a degree of freedom  # (n_nodes, 2) px per unit"""
    nodes = in_space(context.experiment.mesh.nodes)
    if not _moves(context.experiment, name):
        return np.zeros((len(nodes), 2))
    for morph in context.experiment.morphs:
        if morph.name == name:
            return np.einsum("ncd,nd->nc", context.camera.jacobian(nodes), in_space(morph.velocity))
    stem = f"{context.experiment.camera_name}."
    return context.camera.parameter_jacobian(nodes, name.removeprefix(stem))
