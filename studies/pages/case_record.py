"""The record of a finished case, from which figures and tables are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

MAX_NOISE_RATIO = 1.5  # rms residual over that of noise alone, of explained images


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
        ``correlation``, ``case`` (the definition).
    arrays : mapping of name to array
        ``start``, ``value``, ``std``, ``std_noise`` (the part of noise), ``truth`` : (n,) in the user's units, NaN
        where unknown;
        ``history`` : (n_evaluations, n), ``accepted`` : (n_evaluations,) bool; ``M`` : (n, n) in scaled unknowns;
        ``frame_rms`` : (n_frames,), NaN where a frame takes no part; the fields of `Case.keep`.
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
        """Converged without a residual beyond the noise."""
        return self.converged and self.facts["noise_units"] <= MAX_NOISE_RATIO

    @property
    def outcome(self) -> str:
        """Status in words, with a residual beyond the noise; without the residual where no simulation converged."""
        status = self.facts["status"].replace("_", " ")
        if "noise_units" not in self.facts:
            return status
        beyond = self.facts["noise_units"]
        return status if beyond <= MAX_NOISE_RATIO else f"{status}, residual {beyond:.3g} × noise"

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
