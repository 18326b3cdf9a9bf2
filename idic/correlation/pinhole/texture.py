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

from idic.correlation.image_equations.context import CorrelationContext
from idic.correlation.image_equations.frame import nodal_equations
from idic.correlation.image_equations.grey import GreyReference
from idic.correlation.image_equations.residual import residual_map
from idic.correlation.pinhole.agreement import seen_as_well
from idic.correlation.pinhole.two_views import columns_between, moves_at_rest, way_between
from idic.correlation.pixels.pixel_map import at_nodes
from idic.correlation.views.pinhole_view import in_space
from idic.correlation.image_equations.system import CorrelationSystem, solve_positive
from idic.images import Spline, prefilter
from idic.model import Experiment

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
        return (f"the textures of {self.first} and {self.second} correlate by {self.correlation:.3f} at the end; "
                f"their differences scatter sums against the gradient {np.sqrt(self.excess):.2f} times as much as "
                "noise, which sets the weight of the pair")


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
    for i, j in _compared(context):
        first, second = context.cameras[i], context.cameras[j]
        comparison = _Comparison(first, second)
        pairs.append(comparison.pair)
        total = replace(total, phi=total.phi + comparison.phi)
        if comparison.pair.is_used:
            M, b, of_one, of_two = comparison.equations(names)
            noise = context.weights.image_noise  # of the main camera, by which the covariance multiplies `shared`
            for start, columns, sigma in ((starts[i], of_one, first.weights.image_noise),
                                          (starts[j], of_two, second.weights.image_noise)):
                total.shared[start:start + len(columns)] += comparison.weight * sigma / noise * columns
            base = comparison.weight * comparison.variance
            total = replace(total, M=total.M + M, b=total.b + b,
                            spread=total.spread + (comparison.pair.excess - 1.0) * base * M)
    return replace(total, pairs=tuple(pairs))


def texture_pairs(context: CorrelationContext) -> tuple[TexturePair, ...]:
    """What the pairs of cameras with a common texture show, whatever is free."""
    return tuple(_Comparison(context.cameras[first], context.cameras[second]).pair
                 for first, second in _compared(context))


def determined_by_texture(experiment: Experiment, names: Sequence[str]) -> list[str]:
    """Which degrees of freedom a comparison of textures depends on."""
    compared = {name for camera in experiment.cameras if camera.texture is not None
                for name in (camera.texture, camera.name)}
    views = [view for view in experiment.views if view.recording.camera_name in compared]
    return [name for name in names if any(moves_at_rest(view, name) for view in views)]


def _compared(context: CorrelationContext) -> Iterator[tuple[int, int]]:
    """Numbers of the two cameras of every pair, that of the texture first."""
    names = [camera.experiment.recording.camera_name for camera in context.cameras]
    for number, camera in enumerate(context.experiment.cameras, 1):
        if camera.texture is not None and isinstance(context.cameras[number].reference, GreyReference):
            yield names.index(camera.texture), number


def _n_rows(context: CorrelationContext) -> int:
    """Of `CorrelationSystem.shared` that belong to a camera."""
    reference, options = context.reference, context.experiment.options
    if not isinstance(reference, GreyReference):
        raise TypeError("texture consistency is of grey images")
    n_brightness = reference.layout(options.brightness).n_columns + (options.defocus != "none")
    return 2 * reference.pixel_map.n_nodes + n_brightness


class _Comparison:
    """The reference image of camera `two` against that of camera `one`."""

    def __init__(self, first: CorrelationContext, second: CorrelationContext):
        assert isinstance(first.reference, GreyReference) and isinstance(second.reference, GreyReference)
        self.first, self.second, self.reference, self.other = first, second, first.reference, second.reference
        # rounded: the same at neighbouring parameters; the brightness columns fit the rest
        self.gain = float(10.0 ** round(np.log10(self.reference.contrast / self.other.contrast), 2))
        weights, n_images = first.weights, self.reference.n_images
        self.variance = (weights.image_noise**2 + (self.gain * second.weights.image_noise) ** 2) / n_images
        self.weight = weights.image * weights.image_noise**2 / self.variance
        self.weight *= 1.0 if weights.generalised else 1.0 + 1.0 / n_images
        visible = self._seen()
        spline, motion = self._spline(), way_between(self.reference.pixel_map, first, second)
        self.nodal = nodal_equations(self.reference, spline, motion, BRIGHTNESS, np.flatnonzero(~visible))
        self.pair, squares = self._judged(spline)
        self.phi = self.weight * squares  # of one weight at all points of a search: it is to fall
        self.weight /= self.pair.excess

    def _seen(self) -> np.ndarray:
        """Pixels of the first camera whose point is compared in the second one as well  # (n_pixels,) bool"""
        nodes = in_space(self.first.experiment.model.mesh.nodes)
        points = self.reference.pixel_map.interpolate(nodes)  # (n_pixels, 3) mm
        return seen_as_well(points, self.second.camera, self.other.pixel_map, nodes)

    def _spline(self) -> Spline:
        """The reference image of the second camera in the grey values of the first."""
        view, reference = self.second.experiment, self.reference
        images = [view.recording.stack.frame(k) for k in view.recording.averaged or (view.model.reference,)]
        mean = np.mean([np.asarray(image, dtype=np.float64) for image in images], axis=0)
        matched = reference.level + self.gain * (mean - self.other.level)
        return prefilter(matched.astype(np.float32), reference.degree, reference.lowpass_px)

    def _judged(self, spline: Spline) -> tuple[TexturePair, float]:
        """The pair, and the sum of squares that counts: no more than at the least correlation that is used."""
        nodal, reference = self.nodal, self.reference
        brightness = solve_positive(nodal.bb, nodal.rb)
        rr, (_, squares) = max(nodal.rr - float(brightness @ nodal.rb), 0.0), nodal.squares or (0.0, 0.0)
        correlation = float(np.sqrt(max(1.0 - rr / squares, 0.0))) if squares > 0.0 else 0.0
        residual = residual_map(reference, spline, nodal.motion, BRIGHTNESS, brightness, nodal.lost_pixels)
        starts, r = reference.pixel_map.start[:-1], np.where(residual.valid, residual.r, 0.0).astype(float)
        gradient = [np.where(residual.valid, d, 0.0).astype(float) for d in (reference.fx, reference.fy)]
        sums = sum(float((np.add.reduceat(d * r, starts) ** 2).sum()) for d in gradient)  # of each element
        white = self.variance * sum(float((d**2).sum()) for d in gradient)
        excess = max(sums / white, 1.0) if white > 0.0 else 1.0
        pair = TexturePair(self.first.experiment.recording.camera_name, self.second.experiment.recording.camera_name,
                           nodal.n_valid,
                           reference.pixel_map.n_pixels, correlation, self.gain, excess)
        return pair, min(rr, (1.0 - MIN_CORRELATION**2) * squares)

    def equations(self, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """M (n, n), b (n,), weighted, and the columns (2 n_nodes, n) in the bases of both references."""
        pixel_map, n, columns = self.reference.pixel_map, len(names), columns_between(self.first, self.second, names)
        gram = self.nodal.gram(columns)
        matrix, rhs = self.weight * gram.matrix, self.weight * gram.rhs
        slope = solve_positive(matrix[n:, n:], np.column_stack([matrix[n:, :n], rhs[n:]]))
        M, b = matrix[:n, :n] - matrix[:n, n:] @ slope[:, :n], rhs[:n] - matrix[:n, n:] @ slope[:, n]
        share = np.zeros(pixel_map.n_nodes)  # of the pixels around a node that both cameras show
        share[pixel_map.visible_nodes] = self.reference.visible_share(self.nodal)[pixel_map.visible_nodes]
        fields = share[:, None, None] * columns.reshape(-1, 2, n)
        back = at_nodes(pixel_map, self.nodal.motion.inverse)
        density = np.abs(np.linalg.det(back))  # pixels of the first camera per pixel of the second
        of_one = np.einsum("nij,njm->nim", back, fields).reshape(columns.shape)
        of_two = -self.gain**2 * (density[:, None, None] * fields).reshape(columns.shape)
        return 0.5 * (M + M.T), b, of_one, of_two
