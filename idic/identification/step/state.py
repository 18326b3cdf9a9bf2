"""The state of the identification loop, in groups, and an evaluated point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from idic.correlation import CorrelationSystem
from idic.images import still_gain

ORDINARY, GENERALISED, GENERALISED_REJECTED = "ordinary", "generalised", "generalised_rejected"
AS_GIVEN, COMPARED, OPEN, ENOUGH = "as_given", "compared", "open", "enough"
AT_LIMIT, FAILED = "at_limit", "failed"
FORWARD_FAILED = "forward_failed"  # status: a simulation ended the search
HALF_RATE = 1  # increments per frame of a known simulation that is extrapolated in time with steps of two frames


@dataclass(frozen=True)
class ParallelTrial:
    """A further version of a step: values (internal units), its damping, and how often its length was halved."""

    values: Mapping[str, float]
    damping: float
    halvings: int


@dataclass(frozen=True)
class Trial:
    """The point to be evaluated next.

    values : of all parameters, internal units
    parallel : further versions of the same step, numbered after this one (`LoopState.trial_states`)
    re_evaluation : a known point, evaluated by another estimator or on the images of another stage
    tries_activation : the step changes inactive parameters too (`idic.identification.step.activation`)
    new_increments : a known point, simulated with other increments than the accepted one
    """

    values: Mapping[str, float]
    parallel: tuple[ParallelTrial, ...] = ()
    re_evaluation: bool = False
    tries_activation: bool = False
    new_increments: bool = False


@dataclass(frozen=True)
class AcceptedPoint:
    """The last accepted point: values (internal units), number of its evaluation, functional."""

    values: Mapping[str, float]
    number: int = -1
    phi: float | None = None


@dataclass(frozen=True)
class TrustRegion:
    """What limits the next step.

    radius : the limit of a step over the usual one (`idic.identification.step.trust_radius`)
    damping : of Levenberg and Marquardt, multiplies the diagonal of M
    rejections : rejected steps in a row
    """

    radius: float = 1.0
    damping: float = 0.0
    rejections: int = 0


@dataclass(frozen=True)
class SchedulePosition:
    """The stage of the schedule, and the steps accepted in it by the present estimator."""

    stage: int = 0
    iterations: int = 0


@dataclass(frozen=True)
class Activation:
    """Parameters that may be inactive at the start (`idic.identification.step.activation`).

    active : those that have changed the residual at some point so far
    reactivated : those that were active on the way and not at the end, and are activated once more
    rejections : rejected steps that tried to activate one
    """

    active: tuple[str, ...] = ()
    reactivated: tuple[str, ...] = ()
    rejections: int = 0


@dataclass(frozen=True)
class EstimatorChoice:
    """The estimator of the present search.

    kind : "ordinary" least squares, "generalised" ones where they gain something
    (`idic.identification.step.estimator`),
    "generalised_rejected" for ordinary ones after generalised ones that did not converge
    ordinary_solution : values where ordinary least squares ended, None before
    """

    kind: str = ORDINARY
    ordinary_solution: Mapping[str, float] | None = None


@dataclass(frozen=True)
class IncrementChoice:
    """The increments of the present search (`idic.identification.step.increments`).

    per_frame : of the fine one of two simulations that are extrapolated in time, HALF_RATE: of the known one, beside
    one in steps of two frames (`idic.fe.half_rate`); None: one simulation, as the options say
    status : AS_GIVEN before any choice, COMPARED while one increment per frame is compared with finer ones, OPEN while
    the choice is made, ENOUGH, or why it ended before: AT_LIMIT, FAILED
    coarser : values where the search ended with half as many, None where none has
    change : of the values when the increments were last halved, None before; predicted, where one per frame is kept
    """

    per_frame: int | None = None
    status: str = AS_GIVEN
    coarser: Mapping[str, float] | None = None
    change: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Ending:
    """How the loop ended: status, the reason as a part of a sentence, and which limit it was, if one
    (`idic.identification.step.ending`)."""

    status: str
    reason: str
    limit: str | None = None


@dataclass(frozen=True)
class LoopState:
    """Where an identification stands; plain values only, so that it goes into a checkpoint.

    evaluations : evaluated points, parallel_evaluations : how many of them were parallel versions of a step;
    iteration : accepted steps; status : "running" until the loop ends; history : one entry per evaluation;
    end : why it ended, None while it runs
    """

    trial: Trial
    accepted: AcceptedPoint | None = None
    trust: TrustRegion = TrustRegion()
    schedule: SchedulePosition = SchedulePosition()
    activation: Activation = Activation()
    estimator: EstimatorChoice = EstimatorChoice()
    increments: IncrementChoice = IncrementChoice()
    evaluations: int = 0
    parallel_evaluations: int = 0
    iteration: int = 0
    status: str = "running"
    history: tuple[dict, ...] = ()
    end: Ending | None = None

    @classmethod
    def of_content(cls, content: Mapping[str, Any]) -> LoopState:
        """The state that `dataclasses.asdict` made plain."""
        trial, accepted, end = dict(content["trial"]), content["accepted"], content["end"]
        trial["parallel"] = tuple(ParallelTrial(**step) for step in trial["parallel"])
        activation = content["activation"] | {name: tuple(content["activation"][name])
                                              for name in ("active", "reactivated")}
        return cls(**content | {
            "trial": Trial(**trial), "accepted": accepted and AcceptedPoint(**accepted),
            "trust": TrustRegion(**content["trust"]), "schedule": SchedulePosition(**content["schedule"]),
            "activation": Activation(**activation), "estimator": EstimatorChoice(**content["estimator"]),
            "increments": IncrementChoice(**content["increments"]), "history": tuple(content["history"]),
            "end": end and Ending(**end)})

    @property
    def rounds(self) -> int:
        """Evaluated points, parallel versions of one step counted as one."""
        return self.evaluations - self.parallel_evaluations

    @property
    def generalised(self) -> bool:
        """Whether the trial is evaluated with the weights of generalised least squares."""
        return self.estimator.kind == GENERALISED

    @property
    def running(self) -> bool:
        return self.status == "running"

    @property
    def failed(self) -> bool:
        """Whether a simulation ended the search: the accepted point is one on the way, no minimum."""
        return self.status == FORWARD_FAILED

    def has_accepted(self, number: int) -> bool:
        """Whether the evaluation `number` is the accepted point."""
        return self.accepted is not None and self.accepted.number == number

    @property
    def trial_states(self) -> tuple[LoopState, ...]:
        """All trials of a state, each as the state that tries it alone: the ordinary step first, then the parallel
        ones."""
        ordinary = replace(self, trial=replace(self.trial, parallel=()))
        return (ordinary, *(replace(ordinary, trial=replace(ordinary.trial, values=dict(trial.values)),
                                    trust=replace(self.trust, damping=trial.damping),
                                    evaluations=self.evaluations + number)
                            for number, trial in enumerate(self.trial.parallel, start=1)))


@dataclass(frozen=True)
class Evaluation:
    """An evaluated trial: the system over every free parameter, or None where the simulation failed.

    reference_gram : (n, n) S^T H S of the system's shared columns; increments : of its simulation, 0 where unknown;
    intervals : between the frames that the increments lie in, of several experiments, None: those of the one;
    parts : of several experiments, the evaluation of each.
    """

    number: int
    system: CorrelationSystem | None
    reference_gram: np.ndarray | None
    message: str = ""
    increments: int = 0
    intervals: int | None = None
    parts: Mapping[str, Evaluation] = field(default_factory=dict)

    def part(self, name: str) -> Evaluation:
        """The evaluation of an experiment: itself where it is the only one, or where no simulation of all converged."""
        return self.parts.get(name, self)

    def misfit(self, lowpass_px: float) -> float:
        """Mean squared residual over that of the noise after the low-pass: 0.8 to 1.1 where the residual is noise.

        Roughly chi^2 per pixel, which takes the interpolation of every pixel into account, too.
        """
        pixels = max(sum(record.n_pixels for record in self.system.frames), 1)
        return self.system.phi_image / pixels / still_gain(lowpass_px)
