"""The data of the page of a diagnosis. No files, no solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.diagnose import LawPair, WindowCurve
from idic.report.figures.picture import Picture


KNOWN_ERROR_COUNTED = "known errors counted"  # a map of the model with them, where it has no cause


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured channel and its simulation before and after; (n_frames,) each, NaN where not correlated."""

    name: str
    unit: str
    measured: np.ndarray
    simulated_before: np.ndarray
    simulated_after: np.ndarray | None
    std: float


@dataclass(frozen=True, eq=False)
class DiagnosisRecord:
    """All that the page shows.

    Attributes
    ----------
    title : str
    content : mapping
        diagnosis.json.
    titles : mapping
        Candidate to its name in standard words.
    residuals : tuple of (camera, tuple of (label, (ny, nx) float))
        Residual maps in standard deviations of noise, NaN outside: before; after and held out, or with the known errors
        of the model where it has no cause and they count; a draw of noise; of every camera, whose name is "" where
        there is but one.
    frame : int
        The frame of the maps: with the largest excess before, or the largest motion where its residual is larger.
    excess_frames : (T,) int
    excess_before, excess_after : (T,) float
        Held-out excess of every frame.
    excess_std : (T,) float
        Its standard deviation under noise.
    abscissa : (n_frames,) float, time_label : str
    further : tuple of Picture
        Figures of place, onset and side.
    windows : tuple of WindowCurve
        Free parameters that both models have.
    laws : tuple of LawPair
        Materials whose law or parameters changed.
    """

    title: str
    content: Mapping
    titles: Mapping[str, str]
    residuals: tuple[tuple[str, tuple[tuple[str, np.ndarray], ...]], ...]
    frame: int
    excess_frames: np.ndarray
    excess_before: np.ndarray
    excess_after: np.ndarray | None
    excess_std: np.ndarray
    abscissa: np.ndarray
    time_label: str
    curves: tuple[Curve, ...]
    further: tuple[Picture, ...] = ()
    windows: tuple[WindowCurve, ...] = ()
    laws: tuple[LawPair, ...] = ()
