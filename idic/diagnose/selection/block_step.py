"""Judgement on blocks of the recording without another fit: squares of the specimen, and later frames.

The residual of a model and its derivatives stand at the nodes (`idic.diagnose.residual.evidence`). With the test
functions of the nodes of one part alone, the normal equations see only the pixels of that part,

    J_A^T A J delta = J_A^T r,

so one Gauss-Newton step from the finished fit gives the parameters of a fit to that part. The residual r - A J delta is
then measured on the other part. Nodes of the two parts never share an element, and their shape functions vanish at the
border:
nothing leaks but the frames' own unknowns (gain, offset, noise of a logged grip). White frames are independent under
noise; of the motion of a later frame a share c (`idic.diagnose.residual.evidence`) stands in the earlier ones.

squares        a chessboard: one colour fits, the other one judges, and the reverse; motions judge
later frames   fitted up to some frame, judged after it; motions and channels judge
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from idic.diagnose.residual.evidence import Evidence
from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import NullModel, null_model
from idic.diagnose.residual.subspace import Grid, gain_and_rank, gram_of_fields, hats

SQUARES_PER_SIDE = 4  # along the longer side of the visible region
FITTED_FRAME_SHARES = (0.5, 0.75)  # of the frames that fit; the following ones up to the next part judge
# of the whole recording's information on every direction: a smaller part does not determine the model
MIN_PART_SHARE = 0.05
# of chi-square: two models that differ by D lower it by D +- 2 sqrt(D) with the right one; however large D is, noise
# raises it by as much in one of 700 cases
MAX_LUCK_OF_BLOCKS = 9.0


@dataclass(frozen=True, eq=False)
class Part:
    """What fits and what judges: fit, judge : (n_seen,) bool of the seen dofs; fit_frames, judge_frames : (T,) bool."""

    name: str
    fit: np.ndarray
    judge: np.ndarray
    fit_frames: np.ndarray
    judge_frames: np.ndarray
    with_channels: bool = False


@dataclass(frozen=True)
class BlockJudgement:
    """The model before and after on one block.

    before, after : held-out excess (`Misfit.excess`), NaN where a fit failed; std : of its noise; drop : of chi-square
    """

    name: str
    before: float
    after: float
    std: float
    drop: float

    @property
    def better(self) -> bool:
        """Whether the enriched model explains more of the block."""
        return self.drop > 0.0

    def content(self) -> dict:
        """An entry of ``fit.blocks`` of diagnosis.json."""
        return asdict(self) | {"better": self.better}


def block_judgement(name: str, base: Misfit | None, enriched: Misfit | None) -> BlockJudgement:
    """Both models on one block; None where a fit failed."""
    nan = float("nan")
    drop = nan if base is None or enriched is None else base.chi2 - enriched.chi2
    return BlockJudgement(name, base.excess if base else nan, enriched.excess if enriched else nan,
                          base.excess_std if base else nan, drop)


def judged_by_step(base: ResidualEvidence, enriched: ResidualEvidence, grid: Grid) -> tuple[BlockJudgement, ...]:
    """Two models of one recording, fitted to one part each and measured on the other; parts that determine both."""
    judgements = []
    for base_part, enriched_part in zip(_fits(base, grid), _fits(enriched, grid), strict=False):
        if base_part[1] is not None and enriched_part[1] is not None:
            judgements.append(block_judgement(base_part[0], base_part[1], enriched_part[1]))
    return tuple(judgements)


def holds(judged: Sequence[BlockJudgement]) -> bool:
    """Whether a model explains more of the blocks that had no part in its fit, or no less than noise allows; also where
    none says anything.

    Squares say next to nothing of a cause that only readings show: a faint force offset raised their chi-square by 3.7,
    that of later frames fell by 1.8, and both noise copies confirmed it by 46.
    """
    return not judged or sum(judgement.drop for judgement in judged) > -MAX_LUCK_OF_BLOCKS


def _fits(residual: ResidualEvidence, grid: Grid) -> list[tuple[str, Misfit | None]]:
    parts = parts_of(residual.evidence, grid)
    return [(part.name, misfit) for part, misfit in zip(parts, judged_parts(residual, grid, parts), strict=True)]


def parts_of(evidence: Evidence, grid: Grid) -> tuple[Part, ...]:
    """Both colours of the squares, and the later frames."""
    every, frames = np.ones(len(evidence.seen), dtype=bool), np.ones(len(evidence.frames), dtype=bool)
    black = _colour(evidence, grid)
    parts = []
    for name, colour in (("squares 1", black), ("squares 2", ~black)):
        judge = ~colour & ~_beside(evidence, colour)
        if colour.any() and judge.any():
            parts.append(Part(name, colour, judge, frames, frames))
    number = np.arange(len(frames))
    ends = [int(np.ceil(share * len(frames))) for share in FITTED_FRAME_SHARES]
    for first, end in pairwise([*ends, len(frames)]):
        if 0 < first < end:
            label = f"frames {evidence.frames[first]} to {evidence.frames[end - 1]}"
            parts.append(Part(label, every, every, number < first, (number >= first) & (number < end), True))
    return tuple(parts)


def _colour(evidence: Evidence, grid: Grid) -> np.ndarray:
    """Whether a seen dof lies in a black square  # (n_seen,) bool"""
    side = float(grid.extent.max()) / SQUARES_PER_SIDE
    place = np.floor((grid.at[evidence.seen // evidence.n_components] - grid.low) / side + 1e-9).astype(int)
    return place.sum(axis=1) % 2 == 0


def _beside(evidence: Evidence, chosen: np.ndarray) -> np.ndarray:
    """Whether a dof shares pixels with a chosen one  # (n_seen,) bool"""
    part = evidence.parts[0]
    return np.asarray(abs(part.A) @ chosen.astype(float)).ravel() > 0.0


def judged_parts(residual: ResidualEvidence, grid: Grid, parts: Sequence[Part]) -> tuple[Misfit | None, ...]:
    """A model fitted to one part and measured on the other; None where a part does not determine it."""
    null = null_model(residual.evidence, residual.null)
    fields = hats(residual.evidence, grid).fields
    return tuple(_judged(residual.evidence, null, fields, part) for part in parts)


def _judged(evidence: Evidence, null: NullModel, fields, part: Part) -> Misfit | None:
    step = _step(evidence, null, part)
    if step is None:
        return None
    part_fields = fields.multiply(part.judge[:, None]).tocsr()
    part_fields = part_fields[:, np.flatnonzero(abs(part_fields).sum(axis=0) > 0.0)]
    gains, ranks, channels = [], [], []
    root = np.sqrt(evidence.channel_weight)
    chosen = np.flatnonzero(part.judge_frames)
    for t in chosen:
        frame, n = evidence.parts[t], len(evidence.parts[t].q)
        q, channel_q = evidence.residual(frame)
        border = np.asarray(part_fields.T @ frame.border[:n])
        matrix = gram_of_fields(frame.A, part_fields) - border @ frame.inner @ border.T
        gain, rank = gain_and_rank(matrix, np.asarray(part_fields.T @ (q - null.weighed.fields[t] @ step)))
        gains.append(gain)
        ranks.append(rank)
        channels.append((channel_q - null.weighed.channels[t] @ step) / root if part.with_channels else np.zeros(0))
    return Misfit(evidence.frames[chosen], np.array(gains), np.array(ranks), np.array(channels), float("nan"))


def _step(evidence: Evidence, null: NullModel, part: Part) -> np.ndarray | None:
    """Change of the parameters by a fit to one part  # (n,)"""
    gram, b = null.precision.copy(), null.pull.copy()
    for t in np.flatnonzero(part.fit_frames):
        white, weighed = null.white.fields[t][part.fit], null.weighed.fields[t][part.fit]
        q, channel_q = evidence.residual(evidence.parts[t])
        gram += white.T @ weighed + null.white.channels[t].T @ null.weighed.channels[t]
        b += white.T @ q[part.fit] + null.white.channels[t].T @ channel_q
    if not len(b):
        return b
    share = np.linalg.eigvals(null.covariance @ gram).real  # of the whole recording's information, by direction
    return np.linalg.solve(gram, b) if share.min() > MIN_PART_SHARE else None
