"""Whether the displacements of a series count from the stage before, as codes with a moving reference write them.

    e_k ~ F_k - F_0              displacements count from the reference
    e_k ~ F_k - F_(k-1)          they are increments

e : the mean strain along its main direction, F : a load. In its first part a test is elastic, as far as it ever is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MIN_STAGES = 6
MAX_INCREMENT_MISFIT = 0.2  # of the strain, not explained by the change of load from stage to stage
MIN_TOTAL_MISFIT = 0.35  # by the load; a constant strain under a steadily growing load leaves half


@dataclass(frozen=True)
class IncrementEvidence:
    """Shares of the strain (rms) that the load, and its change from stage to stage, leave unexplained."""

    by_load: float
    by_change: float


def increments_of(strains: np.ndarray, load: np.ndarray) -> IncrementEvidence | None:
    """Evidence that strains follow the change of the load; None where they do not.

    strains : (n, 2, 2), of the stages from the reference on, which is zero; load : (n,)
    """
    n = len(load)
    for end in dict.fromkeys((n, max(n // 2, MIN_STAGES))):
        evidence = _evidence(strains[:end], load[:end])
        if evidence is not None:
            return evidence
    return None


def _evidence(strains: np.ndarray, load: np.ndarray) -> IncrementEvidence | None:
    values = strains[1:].reshape(len(strains) - 1, 4)
    if len(load) < MIN_STAGES or not np.isfinite(load).all() or not values.any():
        return None
    strain = values @ np.linalg.svd(values, full_matrices=False)[2][0]
    evidence = IncrementEvidence(_misfit(strain, (load - load[0])[1:]), _misfit(strain, np.diff(load)))
    is_increment = evidence.by_change < MAX_INCREMENT_MISFIT and evidence.by_load > MIN_TOTAL_MISFIT
    return evidence if is_increment else None


def _misfit(values: np.ndarray, cause: np.ndarray) -> float:
    """Share of the values (rms) that a multiple of the cause leaves; 1 where there is no cause."""
    size = float(cause @ cause)
    residual = values - (float(values @ cause) / size if size else 0.0) * cause
    return float(np.linalg.norm(residual) / np.linalg.norm(values))
