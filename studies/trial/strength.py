"""Strength of an effect, measured on the fit of the wrong model.

The user's model is identified on a test without the effect. The change of image motion and force by the effect is one
column of the score test (`idic.diagnose.residual.score`), at amplitude one:

    seen      size of the part that is not collinear with the identified parameters, in standard deviations of noise
    hidden    1 - visibility: the share of the effect that is collinear with them
    bias      shift of the parameter that moves most, in standard deviations
    rise      relative rise of the image residual (rms)

faint: seen = 8. concealed: seen = 30 or a rise of 1.5 %, whichever is smaller. clear: a rise of 7 % or seen = 100,
whichever is smaller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import map_coordinates

from idic.diagnose import Columns, ResidualEvidence, null_model, residual_evidence, score
from idic.experiment_file import load_experiment
from idic.identification import identify, measured_noise
from idic.images import Camera
from idic_studies.trial.scenes.effects import Effect
from idic_studies.trial.scenes.recording import Paint, as_logged, camera, clean_images, logged, write_public
from idic_studies.trial.scenes.scene import Scene
from idic_studies.trial.scenes.solve import Motion, solve

FAINT, CONCEALED, CLEAR = "faint", "concealed", "clear"
STRENGTHS = (FAINT, CONCEALED, CLEAR)
SEEN_OF = {FAINT: 8.0, CONCEALED: 30.0, CLEAR: 100.0}  # standard deviations
MAX_RISE = {FAINT: 0.015, CONCEALED: 0.015, CLEAR: 0.07}  # of the image residual
STRENGTH_TOLERANCE, MAX_MEASUREMENTS = 0.1, 7  # relative; per amplitude
RESIDUAL_VARIANCE_RATIO = 1.76  # variance of a residual over that of one image, interpolation included

Solver = Callable[[Scene], Motion]


@dataclass(frozen=True)
class Seen:
    """The four figures of the module."""

    seen: float
    hidden: float
    bias: float
    rise: float

    def reaches(self, strength: str) -> float:
        """Size over that of a strength; 1: reached."""
        return max(self.seen / SEEN_OF[strength], np.sqrt(self.rise / MAX_RISE[strength]))


@dataclass(frozen=True, eq=False)
class Bench:
    """An identified test without effects, on which strengths are measured; kept : of effects at amplitude zero"""

    plain: Scene
    motion: Motion
    paint: Paint
    residual: ResidualEvidence
    kept: dict[str, Motion] = field(default_factory=dict)

    @classmethod
    def of(cls, plain: Scene, folder: Path, paint: Paint, solver: Solver = solve) -> Bench:
        motion = solver(plain)
        stack = write_public(folder, plain, motion, paint)
        experiment = load_experiment(folder, stack=stack)
        identification = identify(replace(experiment,
                                          recording=replace(experiment.recording, noise=measured_noise(experiment))))
        return cls(plain, motion, paint, residual_evidence(identification))

    def measure(self, scene: Scene, solver: Solver = solve) -> Seen:
        """Strength of the effects of a scene that equals the plain one otherwise."""
        if scene.image is not None:
            return self._grey(scene)
        motion = solver(scene)
        plain = as_logged(scene, self.plain, motion)
        plain_motion = self.motion if np.array_equal(plain.grip, self.plain.grip) else solver(plain)
        return self._scored(self._column(scene, motion, plain, plain_motion))

    def measure_effect(self, effect: Effect, amplitude: float) -> Seen:
        """Strength of an effect. A law that strains finitely, where the user's does not, is compared with itself.

        Creep in the drawn world of a D-shape was called faint (8 standard deviations) with 0.8 of its own and 5.8 of
        the finite strains that its law brings.
        """
        scene, nothing = (effect.change(self.plain, a, np.random.default_rng(5)) for a in (amplitude, 0.0))
        if not scene.has_finite_strains or self.plain.has_finite_strains:
            return self.measure(scene)
        if effect.name not in self.kept:
            self.kept[effect.name] = solve(nothing)
        return replace(self, plain=nothing, motion=self.kept[effect.name]).measure(scene)

    def _column(self, scene: Scene, motion: Motion, plain: Scene, plain_motion: Motion) -> Columns:
        evidence, context = self.residual.evidence, self.residual.context
        # nodes of the second face of a cut follow
        nodes, n = context.experiment.model.mesh.nodes, plain_motion.mesh.n_nodes
        fields = []
        for k in evidence.frames:
            moved = apparent(scene, motion, int(k))[:n] - apparent(plain, plain_motion, int(k))[:n]
            fields.append(at_nodes(plain_motion.mesh.nodes[:n], moved, nodes).reshape(-1, 1)[evidence.seen])
        rows = (logged(scene, motion)[0] - logged(plain, plain_motion)[0])[evidence.frames]
        return Columns(("effect",), np.array(fields), rows[:, None, None])

    def _scored(self, column: Columns) -> Seen:
        evidence = self.residual.evidence
        null = null_model(evidence, self.residual.null)
        scores = score(evidence, null, column)
        images = Columns(("images",), column.fields, np.zeros_like(column.channels))
        image_scores = score(evidence, null, images)
        shift = np.abs(scores.moves[:, 0]) / np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
        return Seen(float(np.sqrt(scores.own[0])), float(1.0 - scores.visibility[0]), float(shift.max(initial=0.0)),
                    float(np.sqrt(1.0 + image_scores.own[0] / evidence.chi2) - 1.0))

    def _grey(self, scene: Scene) -> Seen:
        """Effects on grey values: change of the images without gain and offset of a frame, over residual noise.

        Of the pixels that the mesh covers, where the body has moved them: outline and background take part in no
        correlation, and a blur changes them most.
        """
        context = self.residual.context
        sensor_gv = context.experiment.recording.noise.std_gv
        nodes, n = context.experiment.model.mesh.nodes, self.motion.mesh.n_nodes
        pixel_map = context.reference.pixel_map
        points, shapes = pixel_map.points(), pixel_map.shape_matrix()
        total, count = 0.0, 0
        pairs = zip(clean_images(scene, self.motion, self.paint), clean_images(self.plain, self.motion, self.paint),
                    strict=True)
        for k, (changed, image) in enumerate(pairs):
            moved = at_nodes(self.motion.mesh.nodes[:n], apparent(self.plain, self.motion, k)[:n], nodes)
            place = (points + shapes @ moved)[:, ::-1].T
            value, d = (map_coordinates(field_image, place, order=3, mode="nearest")
                        for field_image in (image, changed - image))
            base = np.column_stack([np.ones(value.size), value])
            d = d - base @ np.linalg.lstsq(base, d, rcond=None)[0]
            total += float(d @ d) / (RESIDUAL_VARIANCE_RATIO * sensor_gv**2)
            count += value.size
        return Seen(float(np.sqrt(total)), 0.0, 0.0, float(np.sqrt(1.0 + total / count) - 1.0))


def apparent(scene: Scene, motion: Motion, k: int) -> np.ndarray:
    """Image motion of the nodes between the reference and frame k  # (n, 2) px"""
    nodes, nominal = motion.mesh.nodes, camera(scene.view)

    def seen(frame: int, u: np.ndarray) -> np.ndarray:
        view: Camera = nominal if scene.camera is None else scene.camera(nominal, frame)
        points = view.project(nodes + u)
        return points if scene.warp is None else scene.warp(points, frame)

    return seen(k, motion.u[k]) - (seen(0, motion.u[0]) - nominal.project(nodes)) - nominal.project(nodes)


def at_nodes(points: np.ndarray, values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Values at points, linearly between them, at other nodes (the nearest point's value on a curved edge)."""
    interpolated = LinearNDInterpolator(points, values)(nodes)
    lost = np.isnan(interpolated).any(axis=1)
    nearest = np.argmin(((nodes[lost, None] - points[None]) ** 2).sum(axis=2), axis=1)
    interpolated[lost] = values[nearest]
    return interpolated


def calibrated(measure: Callable[[float], Seen], strength: str, most: float, start: float,
               limit: int = MAX_MEASUREMENTS) -> tuple[float, Seen]:
    """The amplitude at which an effect has a strength, and its figures there.

    Secant steps of the logarithms; an effect that cannot reach the strength stays at its largest amplitude.
    """
    a, slope, previous, best = min(start, most), 1.0, None, None
    for _ in range(limit):
        figures = measure(a)
        size = max(figures.reaches(strength), 1e-6)
        if best is None or abs(np.log(size)) < best[0]:
            best = (abs(np.log(size)), a, figures)
        if abs(size - 1.0) < STRENGTH_TOLERANCE or (a >= most and size < 1.0):
            break
        if previous is not None and abs(np.log(a / previous[0])) > 1e-3:
            slope = float(np.clip(np.log(size / previous[1]) / np.log(a / previous[0]), 0.3, 6.0))
        previous = (a, size)
        a = min(most, a * float(np.clip(size ** (-1.0 / slope), 0.3, 5.0)))
    return best[1:]


def as_table(amplitude: float, figures: Seen) -> dict[str, float]:
    """Entry of the table of strengths."""
    return {"amplitude": float(f"{amplitude:.4g}")} | {k: float(f"{v:.3g}") for k, v in asdict(figures).items()}
