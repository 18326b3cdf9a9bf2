"""Which stages of a long series are compared: by strain, by change of shape, by time, or a number of them.

    kept stage k -> next kept stage: the first one that differs from k by the strain, the change or the time of the rule

The strain is that of the affine motion that fits the points best; the change is the rms of the displacement less a
rigid motion. So neither counts a motion of the whole specimen.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from idic.errors import InputError
from idic.readers.fields.series import FieldSeries, MeasuredPoints


@dataclass(frozen=True)
class StageRule:
    """Least difference between stages that are compared; None: this one does not count.

    strain : norm of the change of the mean strain; change_um : rms change of the displacement less a rigid motion;
    time_s : s; most : evenly thinned to so many in the end
    """

    strain: float | None = None
    change_um: float | None = None
    time_s: float | None = None
    most: int | None = None

    @property
    def words(self) -> str:
        """The rule as a clause: "one each time that the mean strain has changed by 0.0001 or 5 s have passed"."""
        steps = [*([f"the mean strain has changed by {self.strain:g}"] if self.strain else []),
                 *([f"the shape has changed by {self.change_um:g} µm (rms)"] if self.change_um else []),
                 *([f"{self.time_s:g} s have passed"] if self.time_s else [])]
        parts = [f"one each time that {' or '.join(steps)}"] if steps else []
        return ", ".join([*parts, *([f"{self.most} at most, evenly spread"] if self.most else [])])


def chosen_stages(series: FieldSeries, points: MeasuredPoints, rule: StageRule, references: Collection[int],
                  never: Collection[int]) -> tuple[int, ...]:
    """Numbers of the stages that the rule keeps, in order; the last one is kept.

    references : kept in any case (reference stages); never : excluded stages, which are not read

    Raises
    ------
    InputError
        The rule counts time and the stages have none.
    """
    first = min(references)
    candidates = [k for k in range(first, len(series.entries)) if k not in never]
    chosen = _by_difference(series, points, rule,
                            candidates) if rule.strain or rule.change_um or rule.time_s else candidates
    if rule.most is not None and len(chosen) > rule.most:
        chosen = [chosen[i] for i in np.unique(np.rint(np.linspace(0, len(chosen) - 1, rule.most)).astype(int))]
    return tuple(sorted({*chosen, *references}))


def _by_difference(series: FieldSeries, points: MeasuredPoints, rule: StageRule, stages: Sequence[int]) -> list[int]:
    chosen = [stages[0]]
    last_shape = _Shape.of(series, points, rule, stages[0])
    for k in stages[1:]:
        shape = _Shape.of(series, points, rule, k)
        if shape.far_from(last_shape, rule, points):
            chosen.append(k)
            last_shape = shape
    return chosen if chosen[-1] == stages[-1] else [*chosen, stages[-1]]


@dataclass(frozen=True, eq=False)
class _Shape:
    """The quantities of a stage that a rule compares: moved (n, 2) mm, strain (2, 2), time s; each None where the rule
    does not need it."""

    moved: np.ndarray | None
    strain: np.ndarray | None
    time_s: float | None

    @classmethod
    def of(cls, series: FieldSeries, points: MeasuredPoints, rule: StageRule, k: int) -> _Shape:
        entry = series.entries[k]
        if rule.time_s and entry.time_s is None:
            raise InputError("stages without a time", file=entry.path, key="experiment.stages.every_time_s",
                             expected="the time of every stage", found="none in this stage",
                             remedy="use every_strain, every_change_um or max")
        if not (rule.strain or rule.change_um):
            return cls(None, None, entry.time_s)
        moved = points.moved(series.stage(k))[:, :2]
        return cls(moved, mean_strain(points.positions, moved), entry.time_s)

    def far_from(self, earlier: _Shape, rule: StageRule, points: MeasuredPoints) -> bool:
        if rule.time_s and self.time_s - earlier.time_s >= rule.time_s:
            return True
        if rule.strain and np.linalg.norm(self.strain - earlier.strain) >= rule.strain:
            return True
        return bool(rule.change_um) and change_of_shape(points.positions,
                                                        self.moved - earlier.moved) * 1e3 >= rule.change_um


def mean_strain(positions: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Small strain of the affine motion that fits best  # (2, 2); zero where fewer than 3 points are measured"""
    measured = np.isfinite(moved).all(axis=1)
    if measured.sum() < 3:
        return np.zeros((2, 2))
    x = positions[measured] - positions[measured].mean(axis=0)
    gradient = np.linalg.lstsq(np.column_stack([np.ones(len(x)), x]), moved[measured], rcond=None)[0][1:].T
    return 0.5 * (gradient + gradient.T)


def change_of_shape(positions: np.ndarray, moved: np.ndarray) -> float:
    """rms length of a displacement less the rigid motion that fits best  # (n, 2) mm -> mm"""
    measured = np.isfinite(moved).all(axis=1)
    if measured.sum() < 3:
        return 0.0
    x, u = (values[measured] - values[measured].mean(axis=0) for values in (positions, moved))
    turned = x[:, ::-1] * [-1.0, 1.0]
    u = u - turned * (np.sum(u * turned) / max(np.sum(turned * turned), 1e-300))
    return float(np.sqrt(np.mean(np.sum(u**2, axis=1))))


def strain_path(series: FieldSeries, points: MeasuredPoints, stages: Sequence[int]) -> float:
    """Length of the path of the mean strain over these stages."""
    strains = [mean_strain(points.positions, points.moved(series.stage(k))[:, :2]) for k in stages]
    return float(sum(np.linalg.norm(b - a) for a, b in pairwise(strains)))
