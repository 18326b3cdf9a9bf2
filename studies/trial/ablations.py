"""Ablations: the screening without one of its parts.

no_reference    the shared noise of the reference image is not separated from the noise of the frames
no_projection   the columns are not projected on the complement of the identified parameters
size            only the size of the residual (the omnibus test)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from idic.diagnose import (
    Columns, Evidence, MAX_FAMILYWISE_P, ResidualEvidence, ScoreColumn, decoy_scores, null_model, screen_candidates,
)


class Uncorrected(Evidence):
    """Evidence whose frames are taken to be independent: V = diag(kappa) sigma^2."""

    share = 0.0


def uncorrected(evidence: Evidence) -> Uncorrected:
    """The residual of the frames as they are.

    Frames' fields count as fields of the reference image: below some per cent of strain that is the same.
    """
    kappa, back = evidence.kappa, evidence.share_back

    def raw(values: np.ndarray) -> np.ndarray:  # (T, ...) of white frames -> of recorded ones, over root kappa
        shared = np.tensordot(1.0 / np.sqrt(kappa), values, axes=(0, 0))
        root = np.sqrt(kappa).reshape(-1, *[1] * (values.ndim - 1))
        return values + back * shared / root

    n = len(evidence.seen)
    of_channels = np.array([part.border[n:].T @ (part.channel_q / evidence.channel_weight) for part in evidence.parts])
    q = raw(np.array([part.q for part in evidence.parts]))
    inner_q = raw(np.array([part.inner_q for part in evidence.parts]) - of_channels) + of_channels
    parts = [replace(part, q=q[t], inner_q=inner_q[t]) for t, part in enumerate(evidence.parts)]
    if evidence.pixel_names:
        pixels = raw(np.array([part.pixel.q for part in evidence.parts]))
        parts = [replace(part, pixel=replace(part.pixel, q=pixels[t])) for t, part in enumerate(parts)]
    fields = {name: getattr(evidence, name) for name in evidence.__dataclass_fields__}
    return Uncorrected(**fields | {"parts": tuple(parts)})


def ablations(residual: ResidualEvidence, trials: Sequence[ScoreColumn], columns: Columns) -> dict[str, dict]:
    """First candidate and significance of the complete screening and of every ablation; scores of the decoys."""
    evidence, parameters = residual.evidence, residual.null
    outcomes = {"whole": _first(evidence, parameters, trials, columns),
             "no_reference": _first(uncorrected(evidence), parameters, trials, columns),
             "no_projection": _first(evidence, parameters.pick([]), trials, columns)}
    drawn = decoy_scores(evidence, null_model(evidence, parameters), columns)
    outcomes["decoys"] = {"n": len(drawn.z), "mean": float(drawn.z.mean()) if len(drawn.z) else 0.0,
                       "std": float(drawn.z.std()) if len(drawn.z) else 1.0, "largest": drawn.largest,
                       "p_normal": drawn.p_normal}
    return outcomes


def _first(evidence: Evidence, parameters: Columns, trials: Sequence[ScoreColumn], columns: Columns) -> dict:
    ranked = screen_candidates(evidence, parameters, trials, columns).ranked
    best = max(ranked, key=lambda r: r.gain, default=None)
    if best is None:
        return {"name": None, "alarm": False}
    smallest = min(r.p_familywise for r in ranked)
    return {"name": best.candidate.name, "family": best.candidate.family, "statistic": best.statistic,
            "p_familywise": smallest, "alarm": bool(smallest < MAX_FAMILYWISE_P)}


def omnibus(tests: Sequence[dict]) -> dict:
    """The alarm by the size of the residual alone, from the tests of ``diagnosis.json``."""
    p_value = next((test["p_value"] for test in tests if test["name"] == "omnibus"), 1.0)
    return {"p_familywise": p_value, "alarm": p_value is not None and p_value < MAX_FAMILYWISE_P,
            "z": float(stats.norm.isf(max(p_value or 0.0, 1e-300)))}
