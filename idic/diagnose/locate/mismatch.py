"""The mismatch in one record: significance, side, size, onset, place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.diagnose.locate.adjoint_sources import SourceMap, adjoint_source_map
from idic.diagnose.locate.fingerprint import Fingerprint, fingerprint
from idic.diagnose.locate.nested_tests import NestedTests, run_nested_tests
from idic.diagnose.locate.noise_draws import FreeMotion, free_motion
from idic.diagnose.locate.onset import (
    MotionRecord, Onset, course, growing_windows, load_histories, onset, parameter_cusum,
)
from idic.diagnose.locate.place import Place, place_of
from idic.diagnose.residual.excess import ExcessTest, pixel_tests, power
from idic.diagnose.residual.heldout import grid_of
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import NullModel, null_model
from idic.diagnose.residual.subspace import explained, hats
from idic.identification import Identification

ONSET_GRID_ELEMENTS, EFFECT_GRID_ELEMENTS = 8.0, 4.0  # element sizes between grid points
SEED = 71
MAX_MISMATCH_P = 0.01
SIDES_WITH_PLACE = ("bulk", "boundary")  # sides that have a place on the specimen
MIN_FRAMES_BEFORE_ONSET = 3  # frames before the onset that fix the parameters for the map of sources


@dataclass(frozen=True)
class SelectedEffect:
    """What the selected candidate says of place and onset of the mismatch.

    side : of the candidate; from_start : whether it acts from the reference image on
    active_frame : first frame in which its law acts in the enriched model; None where it is no law of yielding or
    damage
    modifies_yield_law : whether it changes a law of yielding, flow or damage that was identified. The parameters of
    that
        law imitate the change for many frames, so that the recording shows it late.
    course_onset : frames between which its amplitude begins, of a cause with an onset that is no material
    """

    side: str
    from_start: bool
    active_frame: int | None = None
    modifies_yield_law: bool = False
    course_onset: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class Mismatch:
    """Where, when and on which side simulation and recording differ.

    Attributes
    ----------
    p_value : of noise and a motion at the practical margin doing as much (any level, any growing window, Bonferroni)
    side : "bulk" | "boundary" | "camera" | "force", "" where nothing is there
    effect_px_rms : motion that nothing in the model explains, rms over specimen and frames from the onset on
    onset_frame, onset_ci : frame numbers of the recording, of the corner in its growth; the reference's where it is
        there from the start; None where there is nothing
    visible_frame : from then on it is more than noise
    elements : labels of the mesh file; centroid_mm, centroid_std_mm, extent_mm : (dim,) of them
    frames : first and last frame that show it
    nested_tests, onset, source_map, place, motion, course : the results that they rest on
    tests : of the pixels and the channels: omnibus, whiteness, runs
    constant : identified parameter -> probability of its scores wandering like this if it is constant in time
    """

    p_value: float
    side: str
    effect_px_rms: float
    onset_frame: int | None
    onset_ci: tuple[int, int] | None
    visible_frame: int | None
    elements: tuple[int, ...]
    centroid_mm: tuple[float, ...] | None
    centroid_std_mm: tuple[float, ...] | None
    extent_mm: tuple[float, ...] | None
    frames: tuple[int, int] | None
    nested_tests: NestedTests
    onset: Onset
    source_map: SourceMap
    place: Place | None
    motion: FreeMotion
    course: Fingerprint
    constant: dict[str, float]
    tests: tuple[ExcessTest, ...]

    @property
    def is_significant(self) -> bool:
        return self.p_value < MAX_MISMATCH_P and bool(self.side)

    def reported_onset(self, selected: SelectedEffect | None) -> tuple[int | None, tuple[int, int] | None]:
        """Onset and its interval as they are reported; (None, None) without a significant mismatch.

        selected : the selected candidate; None without one. The recording then decides: a growth that does without a
        corner begins with the reference image.
        """
        if selected is None and not self.is_significant:
            return None, None
        without_corner = self.onset_frame is not None and self.onset.from_start
        if selected is None:
            if without_corner and self.onset_ci is not None:
                return 0, (0, self.onset_ci[1])
            return self.onset_frame, self.onset_ci
        if selected.from_start:
            return 0, (0, 0)
        if selected.course_onset:
            low, high = self.onset_ci or selected.course_onset
            last_at_zero, begun = selected.course_onset
            return begun, (min(low, last_at_zero), max(high, begun))
        active = selected.active_frame
        if active is not None and (selected.modifies_yield_law or self.onset_frame is None or without_corner):
            low, high = self.onset_ci or (active, active)
            return active, (min(low, active), max(high, active))
        return self.onset_frame, self.onset_ci

    def content(self, selected: SelectedEffect | None = None) -> dict:
        """The keys of ``diagnosis.json``'s mismatch.

        selected : the selected candidate; only an effect on the body has a place on it
        """
        onset, interval = self.reported_onset(selected)
        is_shown = self.is_significant or selected is not None
        keys = {"p_value": self.p_value, "side": self.side or None, "effect_px_rms": self.effect_px_rms,
                "onset_frame": onset, "onset_ci": _listed(interval),
                "visible_frame": self.visible_frame if is_shown else None, "elements": list(self.elements),
                "centroid_mm": _listed(self.centroid_mm), "centroid_std_mm": _listed(self.centroid_std_mm),
                "extent_mm": _listed(self.extent_mm), "frames": _listed(self.frames),
                "tests": [{"name": t.name, "p_value": t.p_value, "words": t.words} for t in self.tests],
                "parameters_constant_p": dict(self.constant)}
        if self.has_place(selected):
            return keys
        return keys | {"elements": [], "centroid_mm": None, "centroid_std_mm": None, "extent_mm": None}

    def has_place(self, selected: SelectedEffect | None = None) -> bool:
        """Whether the mismatch has a place on the specimen; the side of the selected candidate decides where one is."""
        side = selected.side if selected else self.side if self.is_significant else ""
        return self.place is not None and side in SIDES_WITH_PLACE


def _listed(value) -> list | None:
    return None if value is None else list(value)


def locate(identification: Identification, residual: ResidualEvidence, null: NullModel | None = None, seed: int = SEED,
           margin: Margin = ASSUMED) -> Mismatch:
    """Locate the mismatch of a finished identification.

    margin : motion that is no mismatch

    Raises
    ------
    NotConverged
        If a law finds no answer along the path of the identified model.
    """
    evidence, experiment = residual.evidence, identification.experiment
    null = null_model(evidence, residual.null) if null is None else null
    rng = np.random.default_rng(seed)
    nested_tests = run_nested_tests(identification, residual, null, margin)
    motion, record = short_record(residual, null, rng)
    times = experiment.model.times[evidence.frames] - experiment.model.times[experiment.model.reference]
    loads = [k for k, channel in enumerate(experiment.model.channels) if channel.is_load]
    load = residual.channels[:, loads[0]] if loads else None
    begins = onset(record, margin.px, load_histories(times, load))
    p_value = float(min(1.0, 2.0 * min(nested_tests.p_value, begins.p_value)))
    real = bool(nested_tests.side) and p_value < MAX_MISMATCH_P
    if np.isnan(begins.frame):  # too weak in any one frame to exceed the margin there
        begins = onset(record, margin_px=0.0, followed=load_histories(times, load))
    source_map = adjoint_source_map(identification, residual, null, rng,
                                    sound_frames=_frames_before_onset(record, begins))
    place = place_of(experiment.model.mesh, source_map)
    first, interval = _frames(begins, evidence.frames, experiment.model.reference)
    visible = None
    if first is not None:
        visible = first if np.isnan(begins.alarm) else int(evidence.frames[int(begins.alarm) - 1])
    frames = None if first is None else (max(first, int(evidence.frames[0])), int(evidence.frames[-1]))
    effect = effect_px(residual, first if first is not None else int(evidence.frames[0]))
    follows = fingerprint(begins.amplitude, begins.std, times, load, begins.frame)
    constant = dict(zip(null.names, parameter_cusum(record)[1].tolist(), strict=True))
    labels = () if place is None else experiment.model.mesh.labels_of(place.elements)
    centroid, centroid_std, extent = (_numbers(place, name) for name in ("centroid", "centroid_std", "extent"))
    return Mismatch(p_value, nested_tests.side if real else "", effect, first, interval, visible,
                    labels, centroid, centroid_std, extent, frames,
                    nested_tests, begins, source_map, place, motion, follows, constant, pixel_tests(residual))


def short_record(residual: ResidualEvidence, null: NullModel, rng: np.random.Generator,
                 draws: int = 300) -> tuple[FreeMotion, MotionRecord]:
    """Free motion on a coarse grid, and the record of all frames that is made of it."""
    evidence = residual.evidence
    basis = hats(evidence, grid_of(residual, ONSET_GRID_ELEMENTS))
    motion = free_motion(evidence, null, basis, rng, draws)
    return motion, course(evidence, null, motion)


def parameters_over_windows(residual: ResidualEvidence) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, and by growing windows of frames the step and standard deviation of the parameters (`growing_windows`)."""
    null = null_model(residual.evidence, residual.null)
    return null.names, *growing_windows(short_record(residual, null, np.random.default_rng(SEED), 1)[1])


def _frames_before_onset(record: MotionRecord, begins: Onset) -> tuple[int, np.ndarray] | None:
    """The frames before the onset, and the parameters' step that they ask for; None where they are too few."""
    if np.isnan(begins.frame) or begins.frame < MIN_FRAMES_BEFORE_ONSET:
        return None
    n = int(begins.frame)
    step, _, rank = record.fit(np.arange(n))
    return (n, step) if rank == record.J.shape[2] else None


def _numbers(place: Place | None, name: str) -> tuple[float, ...] | None:
    return None if place is None else tuple(float(x) for x in getattr(place, name))


def _frames(begins: Onset, frames: np.ndarray, reference: int) -> tuple[int | None, tuple[int, int] | None]:
    """From fractional places in the evidence to frame numbers of the recording."""
    if np.isnan(begins.frame):
        return None, None
    numbers = np.concatenate([[reference], frames])
    places = [begins.frame, np.floor(begins.interval[0]), begins.interval[1]]  # a corner between two frames: the later
    first, low, high = (int(numbers[int(np.clip(np.ceil(place), 0, len(numbers) - 1))]) for place in places)
    return first, (low, high)


def effect_px(residual: ResidualEvidence, first: int) -> float:
    """Rms of the motion that free fields ask for, over the frames from `first` on."""
    evidence = residual.evidence
    basis = hats(evidence, grid_of(residual, EFFECT_GRID_ELEMENTS))
    explanation = explained(evidence, basis)
    late = evidence.frames >= first
    excess = (explanation.gain - explanation.rank)[late].sum()
    return float(np.sqrt(max(excess, 0.0) / max(power(evidence)[late].sum(), 1e-300)))
