"""Bending of a sheet in tension: the bending strain at its surface over the strain of its middle.

It is called percent bending; 5 to 10 % are allowed (ASTM E1012). More indicates grips that are not aligned, or a sheet
that was not flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idic.readers.fields.chosen_stages import mean_strain
from idic.readers.fields.plane import out_of_plane
from idic.readers.fields.series import FieldStack

N_STAGES = 8  # looked at, spread over the test
MIN_STRAIN_PART = 0.2  # of the largest mean strain; below, a share of it says little
ALLOWED_SHARE = 0.1  # of a tension test, ASTM E1012


@dataclass(frozen=True)
class Bending:
    """The stage with the largest share: its number, strain of bending at the surface, and that over its mean strain."""

    stage: int
    strain: float
    share: float


def largest_bending(stack: FieldStack, stages: Sequence[int], thickness_mm: float) -> Bending | None:
    """Of stages that are loaded; None where no stage shows it  # points in three coordinates"""
    chosen = np.array(stages)[np.unique(np.linspace(0, len(stages) - 1, min(N_STAGES, len(stages))).astype(int))]
    strains = []
    for k in chosen.tolist():
        moved = stack.points.moved(stack.series.stage(k))
        out = out_of_plane(stack.points.positions, moved[:, 2])
        if out is None:
            continue
        flat = moved[:, :2] if stack.flattening is None else stack.flattening(moved)[:, :2]
        strain = float(np.abs(np.linalg.eigvalsh(mean_strain(stack.points.positions, flat))).max())
        strains.append((k, 0.5 * thickness_mm * out.curvature, strain))
    most = max((strain for _, _, strain in strains), default=0.0)
    shares = [Bending(k, bent, bent / strain) for k, bent, strain in strains if strain > MIN_STRAIN_PART * most]
    return max(shares, key=lambda bending: bending.share, default=None)
