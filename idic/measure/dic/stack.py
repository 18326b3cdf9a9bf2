"""Free FE-DIC of a whole experiment: one frame at a time, each starting from the motion of the frames before it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.correlation import ReferenceImage, build_experiment_reference, frame_spline, nodal_equations
from idic.measure.dic.field import field_motion
from idic.measure.dic.frame import DicFrame, Factorisation, dic_frame
from idic.measure.dic.noise import fitted_dof, noise_of_frames, residual_noise
from idic.measure.dic.regularisation import Regularisation, Smoother, build_smoother
from idic.measure.dic.start import Level, build_pyramid, coarse_motion, descend, feature_motion
from idic.measure.dic.status import (
    MAX_MISMATCHED_PART, is_recognised, mismatched_elements, nodes_of, pixels_of, unexplained, unlikeness,
    unlikeness_of, with_neighbours,
)
from idic.fe import Block
from idic.images import Spline
from idic.model import Experiment

_MAX_MISMATCHED_PART = 0.002  # of the elements; with more, other starts are tried
_MAX_UNLIKENESS_RATIO = 0.999  # new result over present result: above, the present one stays
_MAX_START_UNLIKENESS = 3.0  # correlation 0.3; Gauss-Newton does not converge from more
_MAX_REPAIR_RMS_RATIO = 2.0  # residual to that of the frame before; more is a new feature (crack), no wrong minimum
_MAX_REPAIRED_PART = 0.3  # of the elements
_MAX_REMAINING_PART = 0.95  # of a mismatched region after each pass of its repair; a crack stays
_MAX_LAST_STEP_PX = 0.01  # of an iteration that may count as ended
_FEATURES = 6  # the number of the last start
_MAX_RMS_RATIO = 1.5  # residual to that of the frame before; with more, other starts are tried


@dataclass(frozen=True, eq=False)
class DicStack:
    """Measured displacement of every frame.

    Attributes
    ----------
    u_px : array (n_frames, n_nodes, 2)
        NaN in excluded and lost frames and at nodes that are not seen; 0 in the reference frame.
    status : list of "ok" | "lost" | "unexplained" | "excluded"
        "lost": nothing was recognised, or hardly anything is left in view. "unexplained": a displacement was found but
        the residual is more than twice that of the other moved frames, or more than 5 % of the elements match nothing
        (crack, failed paint, lamp): do not trust it.
    rms_gv : array (n_frames,)
        Root mean square residual, brightness removed; NaN where nothing was compared (also the reference frame).
    chi2_dof : array (n_frames,)
        Squared residual / noise (given, else `noise_gv`) per degree of freedom; 1: nothing but noise.
    noise_gv : float
        Noise of one image estimated from the best-explained frames (NaN where no frame is ok).
    noise_frames_gv : array (n_frames,)
        The same from each frame alone.
    n_pixels, n_lost : arrays (n_frames,)
        Pixels compared; pixels that left the image.
    mismatched : array (n_frames,)
        Part of the elements that match nothing (crack, lost paint, no start); their nodes are NaN in `u_px`.
    iterations : array (n_frames,), converged : array (n_frames,) bool
    attempts : array (n_frames,)
        The start that led to the result: 1 the frame before, 2 blur pyramid, 3 and 4 subsets of the frame before and
        of the reference found again by correlation, then the pyramid, 6 features of the reference, then the pyramid.
    length_px : float
        Regularisation length in effect.
    """

    u_px: np.ndarray
    status: list[str]
    rms_gv: np.ndarray
    chi2_dof: np.ndarray
    noise_gv: float
    noise_frames_gv: np.ndarray
    n_pixels: np.ndarray
    n_lost: np.ndarray
    mismatched: np.ndarray
    iterations: np.ndarray
    converged: np.ndarray
    attempts: np.ndarray
    length_px: float


@dataclass(frozen=True, eq=False)
class _Setting:
    experiment: Experiment
    reference: ReferenceImage
    smoother: Smoother
    measuring: Smoother | None  # the shorter one, with which frames are measured that the other one has found
    cells: list[Block]
    brightness: str
    pyramid: list[Level]  # filled when first needed


@dataclass(frozen=True, eq=False)
class _LastFrame:
    """The last frame with a usable displacement."""

    frame: int
    time: float
    u: np.ndarray
    velocity: np.ndarray | None
    rms: float
    factorisation: Factorisation | None


def dic_stack(experiment: Experiment, regularisation: Regularisation | str | None = "mechanical",
              progress: Callable[[int, int], None] | None = None,
              keep: Callable[[np.ndarray], None] | None = None) -> DicStack:
    """Measure the displacement of all frames of an experiment on its mesh, from the images alone.

    Of measured fields it is the smooth nodal motion that follows the points (`idic.measure.dic.field`).

    Each frame starts from the frame before, extrapolated with its velocity; where that leaves a larger residual than
    in the other frames, a blur pyramid gives a better start, and after it a correlation of subsets with the last usable
    frame and with the reference. Memory does not grow with the number of frames except for the result.

    Parameters
    ----------
    experiment : Experiment
        Mesh, camera, stack, reference frame, mask, excluded frames and the image options are used; no law, no force.
    regularisation : Regularisation | "mechanical" | "gradient" | "none" | None
        A name takes its default length. Frames are searched for and judged with a mechanical one of twice the distance
        of the nodes, at least 24 px; where the given length is shorter, the motion is then measured with it.
    progress : callable, optional
        Called with (frames done, frames in all).
    keep : callable, optional
        Takes the motion (n_nodes, 2) px of every frame, in their order; `u_px` of the result is then empty, and of
        measured fields no two frames are held at once.

    Examples
    --------
    >>> from idic.experiment_file.load import load_experiment
    >>> from idic.measure.dic import Regularisation, dic_stack
    >>> experiment = load_experiment("my-test")
    >>> motion = dic_stack(experiment, Regularisation("mechanical", length_px=60))
    >>> motion.status[-1], motion.u_px.shape == (experiment.model.n_frames, experiment.model.mesh.n_nodes, 2)
    ('ok', True)
    """
    model, recording = experiment.model, experiment.recording
    if recording.points is not None:
        return DicStack(**field_motion(experiment, _named(regularisation), progress, keep))
    setting = _set_up(experiment, regularisation)
    n, nodes = model.n_frames, model.mesh.n_nodes
    u_px = np.full((n, nodes, 2), np.nan)
    u_px[model.reference] = 0.0
    rms, variance, local = (np.full(n, np.nan) for _ in range(3))
    pixels, lost, iterations, attempts = (np.zeros(n, dtype=int) for _ in range(4))
    converged = np.zeros(n, dtype=bool)
    recognised, mismatched, moved_px, unlike = np.zeros(n, dtype=bool), np.zeros(n), np.zeros(n), np.zeros(n)
    searched_rms = np.full(n, np.nan)
    for n_done, (k, frame, measured, tried, noise) in enumerate(_frames(setting), 1):
        recognised[k] = is_recognised(setting.reference, frame)
        rms[k], pixels[k], lost[k] = measured.rms_gv, measured.n_pixels, measured.n_lost
        iterations[k], converged[k], attempts[k] = measured.iterations, measured.converged, tried
        if recognised[k]:
            wrong = mismatched_elements(setting.reference, frame)
            moved_px[k], searched_rms[k] = np.sqrt(np.nanmean(frame.u_px**2)), frame.rms_gv
            unlike[k] = unlikeness_of(setting.reference, frame)
            mismatched[k], variance[k], local[k] = wrong.mean(), noise.variance, noise.local_variance
            u_px[k] = np.where(nodes_of(setting.reference, wrong)[:, None], np.nan, measured.u_px)
        if progress is not None:
            progress(n_done, n)
    status = _status(experiment, recognised, unexplained(searched_rms, mismatched, moved_px, unlike))
    good = np.array([s == "ok" and k not in recording.averaged for k, s in enumerate(status)])  # part of the reference
    noise_gv = noise_of_frames(np.where(good, local, np.nan))
    if keep is not None:
        for motion in u_px:
            keep(motion)
        u_px = u_px[:0].copy()
    return DicStack(u_px, status, rms, variance / (recording.noise.std_gv or noise_gv) ** 2, noise_gv, np.sqrt(local),
                    pixels, lost, mismatched, iterations, converged, attempts,
                    (setting.measuring or setting.smoother).length_px)


def _named(regularisation: Regularisation | str | None) -> Regularisation:
    if isinstance(regularisation, Regularisation):
        return regularisation
    return Regularisation("none" if regularisation is None else regularisation)


def _set_up(experiment: Experiment, regularisation) -> _Setting:
    model = experiment.model
    regularisation = _named(regularisation)
    cells = model.mesh.surface_cells(model.surface)
    reference = build_experiment_reference(experiment, model.camera)
    smoother = build_smoother(reference.pixel_map.nodes_px, cells, regularisation)
    longer = replace(smoother, length_px=Regularisation.smooth().of_nodes(smoother.size_px))
    if regularisation.kind == "mechanical" and smoother.length_px < longer.length_px:
        return _Setting(experiment, reference, longer, smoother, cells, experiment.options.brightness, [])
    return _Setting(experiment, reference, smoother, None, cells, experiment.options.brightness, [])


def _frames(setting: _Setting) -> Iterator[tuple[int, DicFrame, DicFrame, int, Any]]:
    """Forward from the reference frame to the last, then backward to the first: how each frame is judged and how it is
    measured."""
    experiment = setting.experiment
    zero = np.zeros((experiment.model.mesh.n_nodes, 2))
    dof_of: tuple[Factorisation | None, float] = (None, 0.0)
    factor: Factorisation | None = None
    for order in (range(experiment.model.reference + 1, experiment.model.n_frames),
                  range(experiment.model.reference - 1, -1, -1)):
        start = _LastFrame(experiment.model.reference, experiment.model.times[experiment.model.reference], zero, None,
                           np.inf, None)
        for k in order:
            if k in experiment.recording.excluded:
                continue
            image = experiment.recording.stack.frame(k)
            spline = frame_spline(experiment, k)
            frame, tried = _measure(setting, k, image, spline, start)
            noise, measured = None, frame
            if is_recognised(setting.reference, frame):
                measured = _remeasured(setting, spline, frame, factor)
                factor = measured.factorisation
                if dof_of[0] is not factor:
                    dof_of = (factor, fitted_dof(measured))
                noise = residual_noise(setting.reference, spline, measured, setting.brightness, dof_of[1])
                if not _suspicious(setting, frame, 2 * start.rms):
                    start = _follow(start, k, experiment.model.times[k], frame)
            yield k, frame, measured, tried, noise


def _remeasured(setting: _Setting, spline: Spline, frame: DicFrame, factor: Factorisation | None) -> DicFrame:
    """A frame with the shorter regularisation; as it was searched for where that does not converge, or is none."""
    if setting.measuring is None:
        return frame
    measured = dic_frame(setting.reference, spline, frame.u_full_px, setting.measuring, setting.brightness,
                         factorisation=factor)
    return measured if measured.converged else frame


def _follow(start: _LastFrame, k: int, time: float, frame: DicFrame) -> _LastFrame:
    elapsed = time - start.time
    velocity = (frame.u_full_px - start.u) / elapsed if elapsed else None
    return _LastFrame(k, time, frame.u_full_px, velocity, frame.rms_gv, frame.factorisation)


def _measure(setting: _Setting, k: int, image, spline: Spline, start: _LastFrame) -> tuple[DicFrame, int]:
    """The best of up to six starts; the next one is tried only while the result looks wrong."""
    best: tuple[DicFrame, int] | None = None
    lowest = np.inf
    for tried, trial_start in enumerate(_starts(setting, k, image, spline, start), 1):
        if tried == _FEATURES and best is not None and not _unmatched(setting, best[0]):
            break  # a crack: features find the same motion
        trial_px = trial_start()
        if trial_px is None:
            continue
        frame = dic_frame(setting.reference, spline, trial_px, setting.smoother, setting.brightness,
                          factorisation=start.factorisation)
        value = unlikeness_of(setting.reference, frame)
        if best is None or value < _MAX_UNLIKENESS_RATIO * lowest:
            best, lowest = (frame, tried), value
        if not _suspicious(setting, frame, _MAX_RMS_RATIO * start.rms):
            break
    if best[0].rms_gv < _MAX_REPAIR_RMS_RATIO * start.rms:
        return _repaired(setting, spline, best[0]), best[1]
    return best


def _repaired(setting: _Setting, spline: Spline, frame: DicFrame) -> DicFrame:
    """Mismatched regions measured again from their surroundings, as long as they shrink.

    Their pixels are left out, the regularisation carries the displacement of the matching elements a little way into
    them, and all pixels are used again: the matching region grows ring by ring.
    """
    reference = setting.reference
    wrong = mismatched_elements(reference, frame)
    while is_recognised(reference, frame) and 0 < wrong.mean() < _MAX_REPAIRED_PART:
        around = dic_frame(reference, spline, frame.u_full_px, setting.smoother, setting.brightness,
                           exclude=pixels_of(reference, with_neighbours(reference, wrong)))
        trial = dic_frame(reference, spline, around.u_full_px, setting.smoother, setting.brightness)
        still = mismatched_elements(reference, trial)
        gained = unlikeness_of(reference, trial) < _MAX_UNLIKENESS_RATIO * unlikeness_of(reference, frame)
        if not (gained and still.sum() < _MAX_REMAINING_PART * wrong.sum()):
            break
        frame, wrong = trial, still
    return frame


def _starts(setting: _Setting, k: int, image, spline: Spline,
            last_frame: _LastFrame) -> Iterator[Callable[[], np.ndarray | None]]:
    """Makers of starting displacements from cheap to thorough, each (n_nodes, 2) px, None: no match"""
    first, value = _from_frame_before(setting, k, spline, last_frame)
    is_near = value < _MAX_START_UNLIKENESS
    yield lambda: first if is_near else None
    experiment = setting.experiment
    reference = experiment.model.reference
    reference_image = experiment.recording.stack.frame(reference)
    if not setting.pyramid:
        setting.pyramid.extend(build_pyramid(setting.reference.pixel_map, reference_image, setting.cells,
                                             setting.smoother.length_px, setting.reference.degree))

    def sharpened(u: np.ndarray | None) -> np.ndarray | None:
        return None if u is None else descend(setting.pyramid, image, u, setting.brightness)

    def by_subsets(frame: int, u: np.ndarray) -> np.ndarray | None:
        nodes = setting.reference.pixel_map.nodes_px + u
        moved = coarse_motion(experiment.recording.stack.frame(frame), image,
                              nodes[setting.reference.pixel_map.visible_nodes], nodes)
        return sharpened(None if moved is None else u + moved)

    yield lambda: sharpened(first) if is_near else None
    yield lambda: by_subsets(last_frame.frame, last_frame.u)
    yield lambda: None if last_frame.frame == reference else by_subsets(reference, np.zeros_like(last_frame.u))
    yield lambda: None if is_near else sharpened(first)
    yield lambda: sharpened(feature_motion(setting.reference, setting.pyramid[0].smoother, reference_image, image))


def _from_frame_before(setting: _Setting, k: int, spline: Spline, last_frame: _LastFrame) -> tuple[np.ndarray, float]:
    """The last displacement or its extrapolation in time, whichever fits the frame better, and its unlikeness."""
    candidates = [last_frame.u]
    if last_frame.velocity is not None:
        candidates.append(last_frame.u + last_frame.velocity * (setting.experiment.model.times[k] - last_frame.time))
    trials = [nodal_equations(setting.reference, spline, u, setting.brightness) for u in candidates]
    fits = [nodal.brightness_fit() for nodal in trials]
    likeness = [unlikeness(setting.reference, nodal.n_valid, fit.rr, fit.coefficients)
                for nodal, fit in zip(trials, fits, strict=True)]
    best = int(np.argmin(likeness))
    return candidates[best], likeness[best]


def _unmatched(setting: _Setting, frame: DicFrame) -> bool:
    """Whether the frame would be said not to match the reference."""
    return not (is_recognised(setting.reference, frame) and (frame.converged or frame.last_step_px <= _MAX_LAST_STEP_PX)
                and mismatched_elements(setting.reference, frame).mean() <= MAX_MISMATCHED_PART)


def _suspicious(setting: _Setting, frame: DicFrame, largest_rms: float) -> bool:
    """Whether another start may do better: not converged, not recognised, grown residual, or islands of mismatch."""
    if not (is_recognised(setting.reference, frame) and frame.rms_gv <= largest_rms):
        return True
    if not frame.converged and frame.last_step_px > _MAX_LAST_STEP_PX:
        return True
    return bool(mismatched_elements(setting.reference, frame).mean() > _MAX_MISMATCHED_PART)


def _status(experiment: Experiment, recognised: np.ndarray, is_unexplained: np.ndarray) -> list[str]:
    model = experiment.model
    status = []
    for k in range(model.n_frames):
        if k in experiment.recording.excluded and k != model.reference:
            status.append("excluded")
        elif k == model.reference:
            status.append("ok")
        elif not recognised[k]:
            status.append("lost")
        else:
            status.append("unexplained" if is_unexplained[k] else "ok")
    return status
