"""Frames at other times than log and model have them: another order, displacements against the stage before, a delay.

    order       u_k ~ m_s(k)             s : a permutation of the frames
    increments  strain ~ F_k - F_(k-1)   displacements against the stage before (`evidence.fields.increments`)
    delay       u(t) ~ m(t - T)          linear between the frames
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model import Experiment
from idic.report.evidence.causes.evidence import MIN_SHARE, Cause, Evidence
from idic.report.evidence.causes.lines import time_offset
from idic.report.evidence.fields.increments import increments_of

MIN_FRAMES = 5  # that a course is judged by
MIN_DELAY = 0.1  # frames: less is what a straight line between the frames may be off
MAX_DELAY = 3.0  # frames
DELAY_STEP = 0.05
MIN_NOISE_RATIO = 4.0  # amplitude between two frames over its noise: less says nothing of their order
MAX_LISTED = 12


def other_order(evidence: Evidence) -> Cause | None:
    """Frames in another order than that of the log."""
    measured_frames = evidence.is_seen
    if measured_frames.sum() < MIN_FRAMES or len(evidence.frames) < evidence.experiment.model.n_frames - 1 - len(
            evidence.experiment.recording.excluded):
        return None  # a permutation is judged on all frames
    expected = evidence.expected[measured_frames]
    direction = np.linalg.svd(expected, full_matrices=False)[2][0]
    logged, moved = expected @ direction, evidence.measured[measured_frames] @ direction
    place_in_log = np.empty(len(logged), dtype=int)  # the place in the log of the frame at each place
    place_in_log[np.argsort(moved, kind="stable")] = np.argsort(logged, kind="stable")
    wrong = place_in_log != np.arange(len(place_in_log))
    if wrong.sum() < 2 or np.abs(logged[place_in_log] - logged).max() < MIN_NOISE_RATIO * evidence.noise_px:
        return None
    misfit = np.zeros_like(evidence.misfit)
    misfit[measured_frames] = evidence.measured[measured_frames] - expected[place_in_log]
    share = evidence.explained(misfit)
    if share < MIN_SHARE:
        return None
    labels = [evidence.labels[k] for k in evidence.frames[measured_frames][np.argsort(place_in_log)]]
    order = ", ".join(labels[:MAX_LISTED]) + (", …" if len(labels) > MAX_LISTED else "")
    return Cause("order", share, f"{evidence.source} are in another order than the log: by their motion it is {order}; "
                                 f"{evidence.of(share)}. Name them so, or sort the rows of the log")


def increments(evidence: Evidence) -> Cause | None:
    """Displacements that count from the stage before; images do not."""
    model, frames = evidence.experiment.model, [evidence.experiment.model.reference, *evidence.motions.frames]
    if evidence.experiment.recording.points is None or not evidence.is_seen.all():
        return None
    gradients = evidence.motions.fits[:, 1:]
    strains = np.concatenate([np.zeros((1, 2, 2)), 0.5 * (gradients + gradients.transpose(0, 2, 1))])
    return increments_by_load(evidence.experiment, frames, strains) if model.reference < frames[1] else None


def increments_by_load(experiment: Experiment, frames: Sequence[int], strains: np.ndarray) -> Cause | None:
    """Displacements whose mean strain follows the change of a load from stage to stage.

    frames : the reference and the compared ones after it; strains : (n, 2, 2) of any scale
    """
    for channel in experiment.model.channels:
        shares = increments_of(strains, channel.values[list(frames)])
        if shares is not None:
            text = ("the displacements seem to count from the stage before, not from the reference: the mean strain "
                    f"follows the change of {channel.column} from stage to stage (all but {100 * shares.by_change:.0f} "
                    f"% of it) and not {channel.column} ({100 * shares.by_load:.0f} % unexplained). Every value would "
                    "be wrong: export the displacements against the first stage (total, not incremental, correlation)")
            return Cause("increments", 1.0 - shares.by_change**2, text)
    return None


def delay(evidence: Evidence) -> Cause | None:
    """Images that are later or earlier than the log."""
    best = delay_of(evidence)
    if best is None or abs(best[0]) < MIN_DELAY or best[1] < MIN_SHARE:
        return None
    frames, share = best
    way = "later" if frames > 0 else "earlier"
    lines = time_offset(evidence.experiment)
    remedy = ("Write" if lines else "Shift the rows of the log against the images, or give the times of both")
    return Cause("delay", share, f"{evidence.source} show what the log has {abs(frames):.2g} frames {way}: "
                                 f"{evidence.of(share)}. Two clocks, a trigger, or play in the grips. {remedy}", lines)


def delay_of(evidence: Evidence) -> tuple[float, float] | None:
    """The delay of the measured behind the expected motion that explains most, in frames, and its share."""
    measured_frames = evidence.is_seen
    if measured_frames.sum() < MIN_FRAMES:
        return None
    numbers, frames = np.arange(len(evidence.expected_px)), evidence.frames
    measured, best = np.nan_to_num(evidence.measured), (0.0, 0.0)
    for frames_late in np.arange(-MAX_DELAY, MAX_DELAY + DELAY_STEP / 2, DELAY_STEP):
        at = frames + frames_late
        inside = (at >= numbers[0]) & (at <= numbers[-1]) & measured_frames
        if inside.sum() < MIN_FRAMES:
            continue
        low = np.clip(np.floor(at).astype(int), 0, numbers[-1] - 1)
        part = (at - low)[:, None]
        expected = (1.0 - part) * evidence.expected_px[low] + part * evidence.expected_px[low + 1]
        total = float((evidence.misfit[inside] ** 2).sum())
        share = 1.0 - float(((measured - expected)[inside] ** 2).sum()) / total if total else 0.0
        best = max(best, (float(frames_late), share), key=lambda pair: pair[1])
    return best
