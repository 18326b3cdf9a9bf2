"""A held end that moves in another shape than any candidate describes: the last rival of what was selected.

A free motion of one end, the law kept, imitates an inclusion or a stiffness of another direction near it, and two
rotations imitate a bent end. So before a cause of the material, or several causes, are told, every end in turn moves
by Legendre polynomials along itself (`EDGE_MODE_DEGREE`), in every component that the model prescribes: in proportion
to the logged motion, or with a course that the data give. Such a model is refitted and judged as every candidate is;
where it explains more than the selected causes, less what its unknowns could by chance, none of them is told. Where one
cause of the boundary was selected, it must explain as much more as a further cause: less is a flaw of its course.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.diagnose.locate.freedoms import EDGE_MODE_DEGREE
from idic.diagnose.locate.mismatch import Mismatch
from idic.diagnose.physics.candidate import Candidate, Situation
from idic.diagnose.physics.edits import driven, with_correction
from idic.diagnose.refits.refit import Refit
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob, Refits
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.residual.margin import Margin
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.free_courses import KNOTTED
from idic.diagnose.selection.free_model import FreeModel
from idic.diagnose.selection.own_course import leaves_something
from idic.diagnose.selection.rival import (COPIES, MIN_DROP_DIFFERENCE, MIN_FURTHER_SHARE,
                                           MIN_SEPARATION_CHI2, Round)
from idic.diagnose.selection.verdict import MIN_RECOVERED_SHARE
from idic.model import Column
from idic.parameters import ParameterSet

SHAPES = ("as a whole", "linear along it", "bent", "s-shaped")  # by the degree of their polynomial
MIN_SHAPE_STD = 3.0  # standard deviations of a shape that is told


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
        found = {}
        for name in self.motion.names:
            stem, _, degree = name.partition("_knot[")[0].rpartition("shape")
            value, std = self.refitted.values[name], self.refitted.stds.get(name)
            if std is None or abs(value) < MIN_SHAPE_STD * std:
                continue
            own = {"component": stem.split(".")[-2], "degree": int(degree), "words": SHAPES[int(degree)],
                   "value": value, "std": std, "unit": self.motion.unit}
            if abs(value) > abs(found.get((stem, degree), {"value": 0.0})["value"]):
                found[stem, degree] = own
        return sorted(found.values(), key=lambda one: -abs(one["value"]))

    def content(self, before: Sequence[str], parameters: ParameterSet) -> dict[str, Any]:
        """The entry of diagnosis.json; before : names of identified parameters, which are given in the user's units."""
        values, stds = self.refitted.values, self.refitted.stds
        shown = {name: (parameters[name].factor, stds[name]) for name in before if name in stds}
        return {"nodes": self.motion.nodes, "share": self.share, "heldout_chi2_drop": self.heldout,
                "left_px": self.left.motion_px, "course": "free" if self.motion.free_course else "motion",
                "shapes": self.shapes, "instead_of": list(self.instead_of),
                "parameters": {name: {"value": values[name] / factor, "std": None if std is None else std / abs(factor)}
                               for name, (factor, std) in shown.items()}}

    @property
    def next_test(self) -> str:
        """What the user can do."""
        return (f'take the motion of {self.motion.nodes} from the images: nodes = "{self.motion.nodes}" with u = {{ '
                'virtual = "bspline", modes = 6, time_modes = … } (docs/virtual-boundaries.md), and identify again')


def may_be_an_end(mismatch: Mismatch | None, rounds: Sequence[Round], left: ExcessLeft) -> bool:
    """Whether a free end may explain more than the selected causes.

    The free motion of all ends, in every frame, recovers as much of the motions as a cause must; and what was selected
    is no single cause of the camera or the force that leaves nothing.

    left : of the last model, on the copy without a part in its fit
    """
    if mismatch is None or not mismatch.is_significant:
        return False
    if not mismatch.nested_tests.share("boundary") >= MIN_RECOVERED_SHARE:
        return False
    won = [one.winner.ranked.candidate.side for one in rounds if one.winner is not None]
    return len(won) != 1 or won[0] in ("bulk", "boundary") or left.matters


def free_end(source: ExperimentSource, situation: Situation, null: Refit, last: Refit, selected: Sequence[Candidate],
             refits: Refits, grid: Grid, seed: int, power: float, margin: Margin) -> FreeEnd | None:
    """The freed end that explains more than the selected causes; None where none describes the recording so.

    Parameters
    ----------
    source, situation, null : the identified model and its fit to the copy for choosing
    last : the model with the selected causes, fitted to the same copy; selected : these causes
    power : chi-square of a motion of one px (rms) in all frames of a copy
    """
    def refitted(motions: Sequence[EndMotion]) -> list[FreeEnd]:
        jobs = [RefitJob(f"free_end_{number}{'_course' * motion.free_course}", source, (motion.nodes,),
                         (motion.edits,), (null.values,), null.local, grid, np.inf, seed)
                for number, motion in enumerate(motions)]
        return [FreeEnd(one, ExcessLeft(null.judgement, one.judgement, power,  # type: ignore[arg-type]
                                        margin_px=margin.px, camera_px=margin.camera_px), motion,
                        null.choice.chi2 - one.choice.chi2, tuple(cause.name for cause in selected))  # type: ignore[union-attr]
                for motion, one in zip(motions, refits(jobs) if jobs else [], strict=True) if one.judgement is not None]

    motions, moves_an_end = list(end_motions(source, situation)), [one.side for one in selected] == ["boundary"]
    found = refitted([motion for motion in motions if not motion.free_course])
    best = max(found, key=lambda one: one.evidence, default=None)
    unsettled = last is null or leaves_something(last.choice)  # type: ignore[arg-type]
    if best is None or (unsettled and leaves_something(best.refitted.choice)):  # type: ignore[arg-type]
        found += refitted([motion for motion in motions if motion.free_course
                           and (best is None or motion.nodes == best.motion.nodes)])
        best = max(found, key=lambda one: one.evidence, default=None)
    return best if best is not None and best.describes and explains_more(best, null, last, moves_an_end) else None


def explains_more(end: FreeEnd, null: Refit, last: Refit, moves_an_end: bool = False) -> bool:
    """Whether a freed end explains more than the selected causes on both copies, less twice its further unknowns, by
    more than noise and the error of two simulations; moves_an_end : where one cause of the boundary was selected, by as
    much as a further cause must."""
    if last is null:
        return True
    achieved = null.choice.chi2 - last.choice.chi2  # type: ignore[union-attr]
    heldout = null.judgement.chi2 - last.judgement.chi2  # type: ignore[union-attr]
    own = achieved + heldout - 2.0 * (len(last.stds) - len(null.stds))
    share = MIN_FURTHER_SHARE if moves_an_end else MIN_DROP_DIFFERENCE
    return end.evidence - own > COPIES * max(MIN_SEPARATION_CHI2, share * achieved)


def end_motions(source: ExperimentSource, situation: Situation) -> Iterator[EndMotion]:
    """Of every prescribed set of a plane model its freed motion: in proportion to the log, and with a free course."""
    experiment = situation.experiment
    if experiment.n_dim != 2:
        return
    column = max((entry.drive for entry in experiment.prescribed if isinstance(entry.drive, Column)),
                 key=lambda drive: float(np.abs(drive.values).max()), default=None)
    held: dict[str, list[tuple[int, str, bool]]] = {}
    for number, nodes, component, drive in driven(situation):
        held.setdefault(nodes, []).append((number, component, "column" in drive))
    for nodes, entries in held.items():
        if len(experiment.mesh.node_sets[nodes]) <= EDGE_MODE_DEGREE:
            continue
        for free_course in (False, True):
            if column is None and not free_course:
                continue
            document = dict(situation.document)
            for number, component, logged in entries:
                own = dict(KNOTTED) if free_course else {} if logged else {"column": column.column}
                for degree in range(EDGE_MODE_DEGREE + 1):
                    document |= with_correction(replace(situation, document=document), number, component,
                                                {"kind": "shape", "degree": degree} | own)
            edits = {"boundary": document["boundary"]}
            after = source.load(edits).parameters.free
            names = tuple(name for name in after if name not in experiment.parameters.free)
            yield EndMotion(nodes, edits, names, free_course, experiment.length_unit)


def told(end: FreeEnd, mismatch: Mismatch, rounds: Sequence[Round]) -> tuple[Mismatch, list[Round]]:
    """Side and rounds of a diagnosis whose last word is a free end: no cause is selected."""
    reason = (f"the free motion of {end.motion.nodes} describes {100.0 * end.share:.0f} % of the residual on held-out "
              "data, more than any cause of the library")
    tests = replace(mismatch.nested_tests, side="boundary", reason=reason)
    return (replace(mismatch, side="boundary", nested_tests=tests),
            [replace(rounds[0], winner=None, equals=(), passed_over=None)])
