"""A physics between specimen and logged channel, declared whole: unknowns, effect with derivatives, words, probes.

The simulated value passes through the terms of `CHANNEL_TERMS` in their order. A term is one file of this folder; from
it follow its degrees of freedom ``channel.COLUMN.NAME``, its part of the residual of a channel with every derivative,
and its candidate in the diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Channel, Load, Prescribed
from idic.model.load_train import way_of
from idic.parameters import Parameter, ParameterSet, PlausibleSize


@dataclass(frozen=True)
class Reading:
    """A channel in a frame, and the values of its degrees of freedom.

    simulated : of the channel, internal units
    """

    experiment: Experiment
    channel: Channel
    parameters: ParameterSet
    frame: int
    simulated: float

    @property
    def way(self) -> float:
        """Direction of the load train in this frame: 1, -1, or 0 where no motion is logged."""
        way = way_of(self.experiment.model.prescribed)
        return 0.0 if way is None else float(way[self.frame])

    def has(self, name: str) -> bool:
        """Whether the last word `name` is a degree of freedom of the channel."""
        return self.channel.dof(name) in self.parameters

    def value(self, name: str, null: float = 0.0) -> float:
        """Value of a degree of freedom by its last word; `null` where the experiment does not have it."""
        full = self.channel.dof(name)
        return self.parameters[full].value if full in self.parameters else null


@dataclass(frozen=True)
class Step:
    """What a term makes of a reading r: its new value, with derivatives by r, by the simulated value at constant r, and
    by the degrees of freedom of the term (last words)."""

    value: float
    by_parameter: Mapping[str, float]
    by_reading: float = 1.0
    by_simulated: float = 0.0


@dataclass(frozen=True)
class Probe:
    """A way in which a term may be missing: a degree of freedom at a plausible size.

    name : its last word; value : internal units; sign : +1 where only positive amplitudes are possible; keys : further
    entries of the [[channel]] table
    """

    label: str
    name: str
    value: float
    null: float = 0.0
    sign: int = 0
    keys: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Course:
    """The time course of a term.

    amplitude : (experiment, channel, last word) -> (n_frames,) per unit of the degree of freedom, None of one that the
    channel does not have; stem : last word of the degree of freedom that has it; knots : key of [[channel]] that makes
    the data give it, `Channel.hats`; start : key of when it begins, `Channel.starts`, "" for none; is_directed : its
    sign is that of a logged motion: of reactions, where one is logged
    """

    amplitude: Callable[[Experiment, Channel, str], np.ndarray | None]
    stem: str
    knots: str
    start: str = ""
    is_directed: bool = False


@dataclass(frozen=True)
class ChannelTerm:
    """A physics of the measuring chain.

    Attributes
    ----------
    name : of its candidate; title : in standard words; paraphrase : in plain words; null : where it is absent, in words
    names : last words of its degrees of freedom, knots apart
    parameters : (channel, times (n_frames,) s or None, prescribed motions) -> its degrees of freedom
    step : (reading r, `Reading`) -> `Step`; the identity at the null values
    probes : (experiment, channel) -> ways in which it may be missing
    load_probe : (load) -> null and value of the same degree of freedom of a load that is applied; None without one
    course : of a term whose amplitude changes with time
    size : how large it plausibly is
    rivals, separating_tests : as those of a candidate
    """

    name: str
    title: str
    paraphrase: str
    null: str
    names: tuple[str, ...]
    parameters: Callable[[Channel, np.ndarray | None, Sequence[Prescribed]], list[Parameter]]
    step: Callable[[float, Reading], Step]
    probes: Callable[[Experiment, Channel], list[Probe]]
    rivals: Mapping[str, str]
    separating_tests: tuple[str, ...]
    load_probe: Callable[[Load], tuple[float, float] | None] = lambda load: None
    course: Course | None = None
    size: PlausibleSize | None = None


def logged_size(channel: Channel) -> float:
    """Largest logged value of the compared frames, 1 where all are zero."""
    return float(np.abs(channel.values).max()) or 1.0
