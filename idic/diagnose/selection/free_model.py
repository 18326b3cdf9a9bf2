"""A refitted model that describes the recording without the name of a cause: a free law, a free end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from idic.diagnose.refits.refit import Fit
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.residual.heldout import share_recovered
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP
from idic.diagnose.selection.verdict import MIN_RECOVERED_SHARE
from idic.parameters import ParameterSet

SHAPES = ("as a whole", "linear along it", "bent", "s-shaped")  # by the degree of their polynomial
MIN_SHAPE_STD = 3.0  # standard deviations of a shape that is told


@dataclass(frozen=True, eq=False)
class FreeModel:
    """excess : excess of the identified model and of this one on the copy that had no part in the fits."""

    refitted: Fit
    excess: ExcessLeft

    @property
    def unknowns(self) -> Sequence[str]:
        """Names of the parameters that the model adds."""
        raise NotImplementedError

    @property
    def next_test(self) -> str:
        """What the user can do."""
        raise NotImplementedError

    @property
    def share(self) -> float:
        """Of the explainable residual, held out."""
        return share_recovered(self.excess.before, self.excess.after)

    @property
    def heldout(self) -> float:
        """Drop of chi-square, held out."""
        return self.excess.before.chi2 - self.excess.after.chi2

    @property
    def describes(self) -> bool:
        """Whether it describes the recording by the bars that a named cause has to pass."""
        return (self.heldout > MIN_HELDOUT_DROP + len(self.unknowns) and self.share >= MIN_RECOVERED_SHARE
                and not self.excess.matters)


@dataclass(frozen=True)
class EndMotion:
    """A freed motion of one set. names : amplitudes, of the file's unit of length; free_course : whether the data give
    its course."""

    nodes: str
    edits: Mapping[str, Any]
    names: tuple[str, ...]
    free_course: bool
    unit: str = "mm"


@dataclass(frozen=True, eq=False)
class FreeEnd(FreeModel):
    """A freed end after its refit.

    achieved : drop of chi-square where it was fitted; instead_of : candidates that it explains more than
    """

    motion: EndMotion
    achieved: float
    instead_of: tuple[str, ...] = ()

    @property
    def unknowns(self) -> Sequence[str]:
        """Amplitudes of its shapes."""
        return self.motion.names

    @property
    def evidence(self) -> float:
        """As of a rival (`Rival.evidence`)."""
        return self.heldout + self.achieved - 2.0 * len(self.motion.names)

    @property
    def shapes(self) -> list[dict[str, Any]]:
        """Significant shapes, the largest first: component, degree, in words, amplitude and its std where the amplitude
        is largest."""
        shapes: dict[tuple[str, str], dict[str, Any]] = {}
        for name in self.motion.names:
            stem, _, degree = name.partition("_knot[")[0].rpartition("shape")
            value, std = self.refitted.values[name], self.refitted.stds.get(name)
            if std is None or abs(value) < MIN_SHAPE_STD * std:
                continue
            entry = {"component": stem.split(".")[-2], "degree": int(degree), "words": SHAPES[int(degree)],
                     "value": value, "std": std, "unit": self.motion.unit}
            if abs(value) > abs(shapes.get((stem, degree), {"value": 0.0})["value"]):
                shapes[stem, degree] = entry
        return sorted(shapes.values(), key=lambda entry: -abs(entry["value"]))

    def content(self, identified_names: Sequence[str], parameters: ParameterSet) -> dict[str, Any]:
        """The entry of diagnosis.json; identified_names : names of identified parameters, which are given in the
        user's units."""
        values, stds = self.refitted.values, self.refitted.stds
        units = {name: (parameters[name].factor, stds[name]) for name in identified_names if name in stds}
        return {"nodes": self.motion.nodes, "share": self.share, "heldout_chi2_drop": self.heldout,
                "left_px": self.excess.motion_px, "course": "free" if self.motion.free_course else "motion",
                "shapes": self.shapes, "instead_of": list(self.instead_of),
                "parameters": {name: {"value": values[name] / factor, "std": None if std is None else std / abs(factor)}
                               for name, (factor, std) in units.items()}}

    @property
    def next_test(self) -> str:
        """What the user can do."""
        return (f'take the motion of {self.motion.nodes} from the images: nodes = "{self.motion.nodes}" with u = {{ '
                'virtual = "bspline", modes = 6, time_modes = … } (docs/virtual-boundaries.md), and identify again')
