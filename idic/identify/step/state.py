"""Where an identification stands: the state of its loop, and an evaluated point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation.system import CorrelationSystem
from idic.identify.step.parallel_steps import ParallelTrial

ORDINARY, GENERALISED, GENERALISED_REJECTED = "ordinary", "generalised", "settled"


@dataclass(frozen=True)
class LoopState:
    """Where an identification stands; plain values only, so that it goes into a checkpoint.

    evaluations : number of evaluated points; iteration : accepted steps; trial, accepted : values in internal units;
    damping : Levenberg–Marquardt; rejected : rejections in a row; history : one entry per evaluation; estimator :
    "ordinary" least squares to begin with, "generalised" ones where these gain something (`idic.identify.step.estimator`),
    "settled" where that was tried in vain; fresh : the trial is a known point, looked at by another estimator or
    with the images of another stage; beside : further trials of the same step, numbered after the trial
    (`trial_states`); extra : how many of the evaluated points were such; reach : the limit of a step over the usual one
    (`idic.identify.step.trust_radius`); felt : what has had a say so far of what may begin too late (`idic.identify.step.activation`);
    sought : whether the trial lets the others begin sooner; refused : how often that was in vain; again : what had a say
    on the way and none at the end, so that it begins sooner once more; arrived : where ordinary least squares ended, for
    the way back from generalised ones.
    """

    trial: dict[str, float]
    accepted: dict[str, float] | None = None
    accepted_evaluation: int = -1
    evaluations: int = 0
    iteration: int = 0
    stage: int = 0
    stage_iterations: int = 0
    damping: float = 0.0
    rejected: int = 0
    phi: float | None = None
    status: str = "running"
    history: tuple[dict, ...] = ()
    estimator: str = ORDINARY
    fresh: bool = False
    beside: tuple[ParallelTrial, ...] = ()
    extra: int = 0
    reach: float = 1.0
    felt: tuple[str, ...] = ()
    sought: bool = False
    refused: int = 0
    again: tuple[str, ...] = ()
    arrived: dict[str, float] | None = None

    @property
    def rounds(self) -> int:
        """Evaluated points, those that were tried side by side counted as one."""
        return self.evaluations - self.extra

    @property
    def generalised(self) -> bool:
        """Whether the trial is to be evaluated with the weights of generalised least squares."""
        return self.estimator == GENERALISED

    @property
    def running(self) -> bool:
        return self.status == "running"


@dataclass(frozen=True)
class Evaluation:
    """An evaluated trial: the system over every free parameter, or None where the simulation failed.

    reference_gram : (n, n) S^T H S of the system's shared columns; increments : of its simulation, 0 where unknown.
    """

    number: int
    system: CorrelationSystem | None
    reference_gram: np.ndarray | None
    message: str = ""
    increments: int = 0
