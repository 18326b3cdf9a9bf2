"""What the table of causes looks at: the measured motion beside the expected one, as components along directions.

    misfit of an entry q in frame k:   d_q . u_k(p_q) - m_k,q

p : place in the reference image, d : unit direction, u : measured motion, m : expected by log or model. Two entries of
a place give its whole motion; of a driven or held end only the components are known that the model prescribes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from idic.measure import AffineMotions
from idic.model import Experiment

MIN_SHARE = 0.8  # of the misfit (squares) that a cause explains before it is named
MIN_SHARE_WITHOUT_UNKNOWNS = 0.9  # the same of a cause that has nothing to fit


@dataclass(frozen=True)
class Cause:
    """A cause of the misfit.

    Attributes
    ----------
    name : its row in the table
    share : of the squared misfit that it explains, 0 … 1; None: it does not show in the motion
    text : what happened and what it means, in words
    lines : what to write into experiment.toml
    frames : that it takes away, of the end of a test
    """

    name: str
    share: float | None
    text: str
    lines: tuple[Line, ...] = ()
    frames: tuple[int, ...] = ()

    def entry(self) -> dict:
        """The entry ``residual.cause`` of result.json."""
        return {"name": self.name, "share": self.share, "text": self.sentence(),
                "lines": [{"table": line.table, "key": line.key, "value": line.value} for line in self.lines]}

    def sentence(self) -> str:
        """The text with the lines to write."""
        if not self.lines:
            return self.text.removesuffix(" Write").removesuffix(".")
        written = ", ".join(dict.fromkeys(line.text() for line in self.lines))
        return f"{self.text}: {written}"


@dataclass(frozen=True)
class Line:
    """An entry of experiment.toml: a key of a table, or a further degree of freedom (table "dof", key its name)."""

    table: str
    key: str
    value: str = ""  # as TOML

    def text(self) -> str:
        if self.table == "dof":
            return f'[[dof]] name = "{self.key}"'
        return f"{self.key} = {self.value} under [{self.table}]"


@dataclass(frozen=True)
class Evidence:
    """Measured and expected motion of one view.

    Attributes
    ----------
    experiment : the view
    motions : measured, of the frames in `motions.frames`
    places_px, directions : (q, 2); expected_px : (n_frames, q) of all frames of the test
    by : "log" | "model", what the motion is expected by; sets : (q,) node set of an entry, "" of the whole surface
    loads : name -> (n_frames,) forces and pressures of the log; columns : name -> (n_frames,) logged motions
    """

    experiment: Experiment
    motions: AffineMotions
    places_px: np.ndarray
    directions: np.ndarray
    expected_px: np.ndarray
    by: str
    sets: tuple[str, ...] = ()
    loads: dict[str, np.ndarray] = field(default_factory=dict)
    columns: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def frames(self) -> np.ndarray:
        return np.array(self.motions.frames, dtype=int)

    @property
    def labels(self) -> tuple[str, ...]:
        return self.experiment.recording.labels

    @property
    def expected(self) -> np.ndarray:
        """Of the measured frames  # (n, q)"""
        return self.expected_px[self.frames]

    @property
    def measured(self) -> np.ndarray:
        return self.measured_at(self.places_px, self.directions)

    def measured_at(self, places_px: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Measured components at other places along other directions  # (n, q)"""
        return np.einsum("nqc,qc->nq", self.motions.at(places_px), directions)

    @property
    def misfit(self) -> np.ndarray:
        """(n, q) px, 0 in frames without a measured motion"""
        return np.nan_to_num(self.measured - self.expected)

    @property
    def is_seen(self) -> np.ndarray:
        """Frames with a measured motion  # (n,) bool"""
        return np.isfinite(self.motions.fits).all(axis=(1, 2))

    @property
    def noise_px(self) -> float:
        return self.motions.noise_px

    @property
    def source(self) -> str:
        """Where the motion was measured, in words."""
        return "the images" if self.experiment.recording.points is None else "the measured fields"

    @property
    def reference(self) -> str:
        return "image" if self.experiment.recording.points is None else "stage"

    def explained(self, misfit: np.ndarray) -> float:
        """Share of the squared misfit that a cause explains; misfit : (n, q) with it"""
        total = float((self.misfit**2).sum())
        return 1.0 - float((np.nan_to_num(misfit) ** 2).sum()) / total if total else 0.0

    def of(self, share: float) -> str:
        """The share in words."""
        against = "the log" if self.by == "log" else "the model"
        return (f"this explains {100.0 * share:.0f} % of the difference between the motion in {self.source} and "
                f"{against}")

    def length(self, px: float) -> str:
        """A length in px of images, or of measured fields in mm."""
        points = self.experiment.recording.points
        return f"{px:.2g} px" if points is None else f"{px * points.pitch_mm:.2g} mm"
