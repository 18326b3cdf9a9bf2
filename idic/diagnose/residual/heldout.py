"""How well a model explains a recording that had no part in its choice.

The excess is what free smooth motions could still explain of the residual, per such motion, less what they explain of
mere noise: (gain - rank) / rank, 0 for a model that is right. Channels are counted beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.diagnose.residual.evidence import Evidence
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.subspace import Grid, explained, grid_over, hats

FREE_MOTION_SPACING = 2.5  # element sizes between the free motions' grid points
CAMERA_GAP_SHARE = 0.25  # of the width of the mesh, between the images of two cameras: few motions reach over it


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residual of a model that free motions and channels explain.

    gain, rank : (T,) of free motions, per frame; channels : (T, n_channels) white residual of the channels; pixels :
    r^T V^-1 r of the images over their number; light : (T,) drop of chi-square by the frames' own light from
    place to place and blur, less what noise gives: what a model with other light explains, which no motion sees
    """

    frames: np.ndarray
    gain: np.ndarray
    rank: np.ndarray
    channels: np.ndarray
    pixels: float
    light: np.ndarray | float = 0.0

    @property
    def excess(self) -> float:
        """0 for mere noise."""
        return float((self.gain.sum() - self.rank.sum()) / max(self.rank.sum(), 1))

    @property
    def excess_z(self) -> float:
        """The same in standard deviations of its noise."""
        return float((self.gain.sum() - self.rank.sum()) / np.sqrt(2.0 * max(self.rank.sum(), 1)))

    @property
    def excess_std(self) -> float:
        return float(np.sqrt(2.0 / max(self.rank.sum(), 1)))

    @property
    def frame_excess(self) -> np.ndarray:
        """Excess of every frame  # (T,)"""
        return (self.gain - self.rank) / np.maximum(self.rank, 1)

    @property
    def frame_excess_std(self) -> np.ndarray:
        """Standard deviation of the excess of every frame under noise alone  # (T,)"""
        return np.sqrt(2.0 / np.maximum(self.rank, 1))

    @property
    def worst_frame(self) -> int:
        """Frame number of the largest gain beyond noise."""
        return int(self.frames[np.argmax(self.gain - self.rank)])

    @property
    def room(self) -> float:
        """Chi-square that free motions explain beyond noise, two standard deviations taken off."""
        rank = self.rank.sum()
        return float(max(self.gain.sum() - rank - 2.0 * np.sqrt(2.0 * rank), 0.0))

    @property
    def chi2(self) -> float:
        """Of free motions (beyond noise), channels and light: models are compared by it."""
        return float(self.gain.sum() - self.rank.sum() + (self.channels**2).sum() - np.sum(self.light))

    @property
    def channel_chi2(self) -> np.ndarray:
        """Mean square of each channel's white residual  # (n_channels,)"""
        return np.mean(self.channels**2, axis=0) if len(self.channels) else np.zeros(self.channels.shape[1])


def misfit_of(residual: ResidualEvidence, grid: Grid) -> Misfit:
    """Measure a gathered residual against free motions on a grid, the same for all models that are compared."""
    evidence = residual.evidence
    explanation = explained(evidence, hats(evidence, grid))
    return Misfit(evidence.frames, explanation.gain, explanation.rank, white_channels(evidence),
                  evidence.chi2 / evidence.n_pixels,
                  np.array([part.light for part in evidence.parts]))


def pooled(first: Misfit, second: Misfit) -> Misfit:
    """Of two judgements on two copies that make one: both count."""
    return Misfit(first.frames, first.gain + second.gain, first.rank + second.rank,
                  np.vstack([first.channels, second.channels]),
                  0.5 * (first.pixels + second.pixels), first.light + second.light)


def white_channels(evidence: Evidence) -> np.ndarray:
    """Residual of the channels over their noise, per frame  # (T, n_channels)"""
    root = np.sqrt(evidence.channel_weight)
    return np.array([part.channel_q / root for part in evidence.parts]).reshape(len(evidence.parts), len(root))


def readings(evidence: Evidence) -> np.ndarray:
    """Residual of every channel over the noise that frame-local unknowns leave in it  # (T, n_channels)

    Unit normal for a complete model, also where a log's own noise is an unknown of every frame.
    """
    n, ratios = len(evidence.seen), np.zeros((len(evidence.parts), len(evidence.channel_weight)))
    for t, part in enumerate(evidence.parts):
        border = part.border[n:]
        information = evidence.channel_weight - np.einsum("ci,ij,cj->c", border, part.inner, border)
        ratios[t] = evidence.residual(part)[1] / np.sqrt(np.maximum(information, 1e-12 * evidence.channel_weight))
    return ratios


def positions(residual: ResidualEvidence) -> np.ndarray:
    """Nodes in the reference image; of further cameras beside it, to the right  # (n_cameras n_nodes, d) px"""
    places, end = [], 0.0
    for number, camera in enumerate(residual.cameras):
        at = camera.context.camera.project(camera.view.points(camera.context.experiment.model.mesh.nodes))
        if number:
            at = at + [end + CAMERA_GAP_SHARE * float(np.ptp(at[:, 0])) - at[:, 0].min(), 0.0]
        end = float(at[:, 0].max())
        places.append(at)
    return places[0] if len(places) == 1 else np.concatenate(places)


def grid_of(residual: ResidualEvidence, elements: float = FREE_MOTION_SPACING) -> Grid:
    """A grid over the visible region; elements : its spacing in element sizes of the visible mesh."""
    at, model = positions(residual), residual.context.experiment.model
    cells = model.mesh.blocks if residual.evidence.n_axes == 3 else model.mesh.surface_cells(model.surface)
    edges = [np.linalg.norm(at[block.connectivity[:, 0]] - at[block.connectivity[:, 1]], axis=1) for block in cells]
    return grid_over(residual.evidence, at, elements * float(np.median(np.concatenate(edges))))


def ratio(base: Misfit, enriched: Misfit) -> float:
    """Excess after over before; clipped at zero, where noise is all that is left."""
    if base.excess <= 0.0:
        return float("nan")
    return max(enriched.excess, 0.0) / base.excess


def share_recovered(base: Misfit, enriched: Misfit, camera_chi2: float = 0.0) -> float:
    """Share of the explainable residual that a model explains: 1 = as good as an unconstrained measurement.

    Its drop of chi-square over that drop and what is left of free motions and channels beyond noise.

    camera_chi2 : part of what is left that the camera shows at rest, and no model explains
    """
    drop = base.chi2 - enriched.chi2
    remainder = max(enriched.gain.sum() - enriched.rank.sum() - camera_chi2,
                    0.0) + max((enriched.channels**2).sum() - enriched.channels.size, 0.0)
    return float(max(drop, 0.0) / (max(drop, 0.0) + remainder)) if drop > 0.0 or remainder > 0.0 else float("nan")


def better_blocks(base: Misfit, enriched: Misfit, n_blocks: int = 6) -> tuple[float, float]:
    """Contiguous blocks of frames: share of the affected ones that got better, worst change of an unaffected one.

    Affected: an excess of more than three standard deviations before.
    """
    improved, affected, worst = 0, 0, 0.0
    for block in np.array_split(np.arange(len(base.gain)), min(n_blocks, len(base.gain))):
        gain, rank, later = base.gain[block].sum(), base.rank[block].sum(), enriched.gain[block].sum()
        if gain - rank > 3.0 * np.sqrt(2.0 * max(rank, 1)):
            affected += 1
            improved += later < gain
        else:
            worst = max(worst, float((later - gain) / max(gain, 1e-300)))
    return (improved / affected if affected else 1.0), worst
