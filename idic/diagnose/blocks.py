"""Judgement on blocks of the recording that had no part in the fit: squares of pixels, and later frames.

Two thinned copies of one recording (`idic.diagnose.residual.thinning`) are exact for normal noise of known variance.
The systematic errors of a real camera are the same in both copies; blocks have errors of their own. The simulation
always runs the whole test; only the compared pixels and frames are masked.

squares        a chessboard of blocks: one colour fits, the other one judges, and the reverse. Pixels within a buffer of
               the border take no part: neighbours share texture and interpolation.
later frames   fitted up to some frame, judged after it (forward chaining)

Frame-local unknowns (noise of a logged grip, a measured edge) begin at the values of the finished fit. The judging
block has free steps of them, so that the choice of pixels does not move an edge. The courses of a virtual boundary in
later frames are known from those frames alone: `reason_against_later_frames`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from idic.correlation.frame_equations import correlated_frames
from idic.diagnose.chain import Diagnosis
from idic.diagnose.refit import identification_at
from idic.diagnose.residual.heldout import Fit, fit
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.selection.block_step import BlockJudgement, block_judgement
from idic.errors import InputError, NotConverged
from idic.identify.in_memory import identify
from idic.model.experiment import Experiment, Parametrised

SQUARES_PER_SIDE = 4  # blocks along the longer side of the image
BUFFER_PX = 4  # on both sides of a border: twice the reach of interpolation and texture
MIN_SIDE_BUFFERS = 6  # of a square, in buffers
FITTED_FRAME_SHARES = (0.5, 0.75)  # of the frames that fit, the following ones up to the next part judge
MIN_FITTED_FRAMES = 3


@dataclass(frozen=True, eq=False)
class Block:
    """Data for fitting and data for judging: masks (ny, nx) bool, None for all pixels; frame numbers, None for all
    frames."""

    name: str
    fit_mask: np.ndarray | None = None
    judge_mask: np.ndarray | None = None
    fit_frames: tuple[int, ...] | None = None
    judge_frames: tuple[int, ...] | None = None


@dataclass(frozen=True, eq=False)
class FittedModel:
    """Where the fit of a model to the whole recording ended.

    values : parameters, internal units; local : (n_frames, m) mm, unknowns of single frames, zero without it
    """

    experiment: Experiment
    values: Mapping[str, float]
    local: np.ndarray | None = None


def block_judgements(diagnosis: Diagnosis) -> tuple[BlockJudgement, ...]:
    """The identified and the enriched model of a diagnosis on blocks; () without a selected candidate."""
    if diagnosis.final is None or not diagnosis.final.usable:
        return ()
    begun, error = diagnosis.begun or diagnosis.source, diagnosis.source.motion_error
    before, after = (begun if error is None else begun.with_motion_error(error)).load(), diagnosis.source.load()
    return judged_by_blocks(FittedModel(before, diagnosis.found.parameters.as_values(), diagnosis.found.local),
                            FittedModel(after, diagnosis.final.values, diagnosis.final.local), diagnosis.grid)


def block_cautions(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Blocks that are left out of the judgement, and why."""
    if diagnosis.final is None or not diagnosis.final.usable:
        return ()
    experiment = diagnosis.found.experiment
    return tuple(reason for reason in (reason_against_later_frames(experiment), reason_against_squares(experiment))
                 if reason is not None)


def squares(shape: tuple[int, int], mask: np.ndarray | None = None) -> tuple[Block, Block]:
    """Both colours of a chessboard over an image, less the buffer."""
    side = max(max(shape) / SQUARES_PER_SIDE, MIN_SIDE_BUFFERS * BUFFER_PX)
    rows, columns = (np.arange(n) for n in shape)
    colour = (rows[:, None] // side + columns[None, :] // side).astype(int) % 2
    near = [np.minimum(at % side, side - at % side) < BUFFER_PX for at in (rows, columns)]
    # the edge of the image is no border between blocks
    within = [(np.rint(at / side) >= 1) & (np.rint(at / side) * side < n)
              for at, n in zip((rows, columns), shape, strict=True)]
    border = [a & b for a, b in zip(near, within, strict=True)]
    allowed = ~(border[0][:, None] | border[1][None, :])
    if mask is not None:
        allowed &= mask
    white, black = allowed & (colour == 0), allowed & (colour == 1)
    return Block("squares, one colour", white, black), Block("squares, the other", black, white)


def later_frames(frames: Sequence[int]) -> tuple[Block, ...]:
    """Forward chaining over the frames that are compared."""
    frames, found = list(frames), []
    bounds = [int(round(part * len(frames))) for part in FITTED_FRAME_SHARES] + [len(frames)]
    for first, last in pairwise(bounds):
        if first >= MIN_FITTED_FRAMES and last > first:
            found.append(Block(f"frames {frames[first]} to {frames[last - 1]}", fit_frames=tuple(frames[:first]),
                               judge_frames=tuple(frames[first:last])))
    return tuple(found)


def reason_against_later_frames(experiment: Experiment) -> str | None:
    """Why later frames cannot judge a model that earlier ones have fitted, None where they can."""
    courses = [entry for entry in experiment.prescribed if isinstance(entry.drive, Parametrised)]
    if not courses:
        return None
    names = ", ".join(sorted({f"{entry.nodes} along {entry.component}" for entry in courses}))
    return (f"Later frames do not judge the model: the motion of the virtual boundary ({names}) in them is known from "
            "these frames alone. The squares of pixels judge it.")


def reason_against_squares(experiment: Experiment) -> str | None:
    """Why squares of pixels cannot judge a model that the others have fitted, None where they can."""
    return ("Squares of pixels do not judge the model: every camera sees all of the specimen. Later frames judge it."
            if experiment.cameras else None)


def judged_by_blocks(before: FittedModel, after: FittedModel, grid: Grid) -> tuple[BlockJudgement, ...]:
    """Both models fitted to one part of the recording and measured on the other, block by block.

    Later frames are left out where `reason_against_later_frames` has a reason, squares where `reason_against_squares`
    has one.

    Parameters
    ----------
    before, after : the identified model and the enriched one on the same recording; their fits begin there
    """
    recording = before.experiment
    blocks = squares(recording.image_shape, recording.mask) if reason_against_squares(recording) is None else ()
    if reason_against_later_frames(recording) is None:
        blocks += later_frames(correlated_frames(recording, range(recording.n_frames)))
    made = [(block, judged(before, block, grid), judged(after, block, grid)) for block in blocks]
    return tuple(block_judgement(block.name, one, other) for block, one, other in made)


def judged(model: FittedModel, block: Block, grid: Grid) -> Fit | None:
    """A model fitted to one part of the recording and measured on the other; None where its fit fails."""
    known = {name: value for name, value in model.values.items() if name in model.experiment.parameters}
    experiment = replace(model.experiment, parameters=model.experiment.parameters.with_values(known), stages=())
    try:
        fitted = identify(_masked(experiment, block.fit_mask, block.fit_frames), model.local)
        if fitted.point is None:
            return None
        there = identification_at(_masked(experiment, block.judge_mask, block.judge_frames),
                                  fitted.parameters.as_values(), fitted.local, None)
        return fit(residual_evidence(there, light=False, null=False), grid)
    except (NotConverged, InputError):
        return None


def _masked(experiment: Experiment, mask: np.ndarray | None, frames: tuple[int, ...] | None) -> Experiment:
    excluded = experiment.excluded
    if frames is not None:
        left_out = set(range(experiment.n_frames)) - set(frames) - {experiment.reference}
        excluded = tuple(sorted({*excluded, *left_out}))
    return replace(experiment, mask=experiment.mask if mask is None else mask, excluded=excluded)
