"""The end of the test: the specimen breaks, leaves the image, or the load cell no longer measures.

From a frame on the load is gone at once while the grips do not return; the images tell which of these it is: two
bodies, a body in one piece that is still strained (the load cell), or one that has sprung back (a break out of view).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from idic.measure import AffineMotions
from idic.model import Column, Experiment
from idic.report.evidence.causes.ends import component_px, counted_frames, loads_of
from idic.report.evidence.causes.evidence import Cause
from idic.report.evidence.causes.lines import excluded_frames

MAX_BROKEN_SHARE = 0.1  # of the largest load: less from one frame to the next is a break
MIN_LOAD_BEFORE = 0.5  # of the largest load, in one of the two frames before
MAX_PARTIAL_SHARE = 0.6  # of the load before, of a break that leaves a part: the images have to show two bodies
MAX_RETURN = 0.8  # of the logged motion before: with less the grips have gone back, an unloading
MIN_ONE_BODY, MAX_TWO_BODIES = 0.85, 0.75  # share of the places that follow one affine motion
MIN_STILL_STRAINED = 0.8  # of the stretch before the drop: the specimen still bears its load
MIN_IN_VIEW = 0.7  # of the ends: less, and an end has left the image


@dataclass(frozen=True)
class Drop:
    """A load that is gone for good; first : the first frame without it; load_before, load_after : its column's unit"""

    column: str
    first: int
    load_before: float
    load_after: float
    is_total: bool


def load_drops(experiment: Experiment) -> list[Drop]:
    """Loads that fall at once and stay low until the end, while no logged motion returns."""
    counted = [experiment.model.reference, *counted_frames(experiment)]
    drops = []
    for column, values in loads_of(experiment).items():
        size = np.abs(values[counted] - values[counted[0]])
        factor = next((c.shown_factor for c in experiment.model.channels if c.column == column), 1.0)
        for i in range(int(np.argmax(size)) + 1, len(size)):
            largest_before = size[max(i - 2, 0):i].max()
            if largest_before < MIN_LOAD_BEFORE * size.max():
                break
            later = size[i:].max()
            if later < MAX_PARTIAL_SHARE * largest_before and later < MAX_PARTIAL_SHARE * size[i - 1] and not (
                    _returns(experiment, counted[i - 1], counted[i])):
                drops.append(Drop(column, counted[i], float(values[counted[i - 1]]) / factor,
                                  float(values[counted[i]]) / factor, later < MAX_BROKEN_SHARE * size.max()))
                break
    return drops


def _returns(experiment: Experiment, until: int, first: int) -> bool:
    """Whether a logged motion goes back between two frames."""
    for entry in experiment.model.prescribed:
        if isinstance(entry.drive, Column):
            motion = np.abs(np.asarray(entry.drive.values, float) - entry.drive.values[experiment.model.reference])
            if motion[until] > 0.0 and motion[first] < MAX_RETURN * motion[until]:
                return True
    return False


def end_of_test(experiment: Experiment, motions: AffineMotions | None) -> Cause | None:
    """The frames after the end of the test, and why it ended; None where nothing shows an end.

    motions : measured, of the frames around a drop among others; None: the log decides alone
    """
    after_reference = counted_frames(experiment)
    for drop in load_drops(experiment):
        frames = [k for k in after_reference if k >= drop.first]
        evidence = _shown_after(experiment, motions, drop)
        if not drop.is_total and evidence != "two":
            continue
        text = (f"{drop.column} falls from {drop.load_before:.4g} to {drop.load_after:.4g} at "
                f"{experiment.recording.labels[drop.first]} and stays low: {_MEANING[evidence]}. Nothing after it "
                "fits a model of the whole specimen. Write")
        return Cause("broken", None, text, excluded_frames(experiment, frames), tuple(frames))
    return None if motions is None else _out_of_view(experiment, motions)


_MEANING = {"two": "the specimen is broken, its parts move apart",
            "lost": "the specimen is broken or gone, its pattern is not recognised any more",
            "strained": "but the specimen is still strained, so that the load cell or its cable has failed",
            "sprung": "the specimen springs back in one piece: it broke or slipped out of a grip outside the part that "
                      "is seen, or it was unloaded between two frames",
            "": "after the break?"}


def _shown_after(experiment: Experiment, motions: AffineMotions | None, drop: Drop) -> str:
    """What the motion shows from a drop on: "two" bodies, "lost", still "strained", "sprung" back, "" not known."""
    if motions is None:
        return ""
    frames = np.array(motions.frames)
    frames_before, frames_after = np.flatnonzero(frames < drop.first), np.flatnonzero(frames >= drop.first)
    if not len(frames_before) or not len(frames_after) or not np.isfinite(motions.fits[frames_before[-1]]).all():
        return ""
    share_before, parts = motions.agreeing[frames_before].max(), motions.agreeing[frames_after]
    if not np.isfinite(motions.fits[frames_after]).all(axis=(1, 2)).any():
        return "lost"
    if share_before >= MIN_ONE_BODY and parts.max() < MAX_TWO_BODIES:
        return "two"
    stretch = _stretch(motions)
    later = float(np.nanmax(stretch[frames_after]))
    return "strained" if later > MIN_STILL_STRAINED * stretch[frames_before[-1]] else "sprung"


def _stretch(motions: AffineMotions) -> np.ndarray:
    """Largest principal strain of the affine motion, by size  # (n,)"""
    gradients = np.nan_to_num(motions.fits[:, 1:])
    return np.abs(np.linalg.eigvalsh(0.5 * (gradients + gradients.transpose(0, 2, 1)))).max(axis=1)


def _out_of_view(experiment: Experiment, motions: AffineMotions) -> Cause | None:
    """Frames at the end in which the pattern is not recognised any more, or an end has left the image."""
    frames, labels = np.array(motions.frames), experiment.recording.labels
    if experiment.recording.points is not None or not len(frames):
        return None
    recognised = np.isfinite(motions.fits).all(axis=(1, 2)) & (motions.agreeing >= 1.0 - MIN_ONE_BODY)
    lost_from = int(np.flatnonzero(recognised)[-1]) + 1 if recognised.any() else 0
    out_from = next((i for i in range(len(frames)) if all(_is_out(experiment, motions, j)
                                                          for j in range(i, max(lost_from, i + 1)))), len(frames))
    if 0 < out_from < len(frames) and out_from <= lost_from:
        first, text = int(frames[out_from]), (
            f"an end of the specimen leaves the image: from {labels[int(frames[out_from])]} on less than "
            f"{100.0 * MIN_IN_VIEW:.0f} % of it is seen, and its motion is known by the log alone")
    elif 0 < lost_from < len(frames):
        first, text = int(frames[lost_from]), (
            f"from {labels[int(frames[lost_from])]} on the pattern of the specimen is not recognised: it has left the "
            "image, is broken, or the light has changed")
    else:
        return None
    later = [k for k in counted_frames(experiment) if k >= first]
    return Cause("out_of_view", None, f"{text}. Write", excluded_frames(experiment, later), tuple(later))


def _is_out(experiment: Experiment, motions: AffineMotions, i: int) -> bool:
    """Whether less than a part of some end, by its measured motion, is in the image of frame number i of the motions
    although it is in the reference image."""
    if not np.isfinite(motions.fits[i]).all():
        return False
    corner = np.array(experiment.recording.image_shape[::-1]) - 0.5
    for name, component in dict.fromkeys((entry.nodes, entry.component) for entry in experiment.model.prescribed):
        places, _ = component_px(experiment, name, component)
        moved = places + np.column_stack([np.ones(len(places)), places]) @ motions.fits[i]
        inside = [((at > -0.5) & (at < corner)).all(axis=1) for at in (places, moved)]
        if len(places) and inside[0].mean() >= MIN_IN_VIEW > inside[1].mean():
            return True
    return False


def first_of(frames: list[int], is_after: Callable[[int], bool]) -> int | None:
    """The first of the frames at the end for which all later ones are, by halving; None where the last is not."""
    if not frames or not is_after(frames[-1]):
        return None
    low, high = -1, len(frames) - 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_after(frames[middle]) else (middle, high)
    return frames[high]

