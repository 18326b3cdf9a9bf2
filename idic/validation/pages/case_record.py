"""What the figures of a study are made of: one frozen record per case. No files, no solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

UNEXPLAINED = 1.5  # rms residual over that of noise alone: beyond, the images are not explained


@dataclass(frozen=True)
class CaseRecord:
    """A finished case of a study.

    Attributes
    ----------
    key : str
        ``GROUP/NAME``.
    facts : mapping
        ``names``, ``units``, ``status``, ``iterations``, ``evaluations``, ``failed_runs``, ``wall_s``, ``cpu_s``,
        ``peak_rss_mb``, ``noise`` (of one image), ``noise_units`` (rms residual over that of two noisy images),
        ``correlation``, and ``case``: what was asked for.
    arrays : mapping of name to array
        ``start``, ``value``, ``std``, ``truth`` : (n,) in the user's units, NaN where there is none;
        ``history`` : (n_evaluations, n), ``accepted`` : (n_evaluations,) bool; ``M`` : (n, n) in scaled unknowns;
        ``frame_rms`` : (n_frames,), NaN where a frame took no part; and what the case was asked to keep.
    """

    key: str
    facts: Mapping
    arrays: Mapping[str, np.ndarray]

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]

    @property
    def name(self) -> str:
        return self.key.partition("/")[2]

    @property
    def names(self) -> tuple[str, ...]:
        """Identified parameters, ``SET.parameter``."""
        return tuple(self.facts["names"])

    @property
    def converged(self) -> bool:
        return self.facts["status"] == "converged"

    @property
    def explained(self) -> bool:
        """Whether the identification says of itself that it succeeded: converged, and no residual beyond the noise."""
        return self.converged and self.facts["noise_units"] <= UNEXPLAINED

    @property
    def outcome(self) -> str:
        """Status in words, with the residual where it gives the end away; without one nothing could be simulated."""
        status = self.facts["status"].replace("_", " ")
        if "noise_units" not in self.facts:
            return status
        beyond = self.facts["noise_units"]
        return status if beyond <= UNEXPLAINED else f"{status}, residual {beyond:.3g} × noise"

    @property
    def relative_error(self) -> np.ndarray:
        """value / truth - 1  # (n,)"""
        return self.arrays["value"] / self.arrays["truth"] - 1.0

    @property
    def relative_std(self) -> np.ndarray:
        """std / |value|  # (n,)"""
        return self.arrays["std"] / np.abs(self.arrays["value"])

    @property
    def normalised_error(self) -> np.ndarray:
        """(value - truth) / std  # (n,)"""
        return (self.arrays["value"] - self.arrays["truth"]) / self.arrays["std"]
