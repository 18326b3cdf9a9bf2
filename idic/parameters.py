"""Degrees of freedom: value, unit, bounds, scale, transform, lock. The only place that knows "free" and "locked"."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

USUAL_MAX_STEP = 0.35  # largest scaled step of one iteration: about a third of a positive parameter
PRIOR_STDS_PER_STEP = 2.0  # least scaled unit of a linear parameter: its prior alone determines it (std 0.5 of a unit)
MIN_VARIANCE = 1e-9  # of a direction of a joint prior, over those of its values: below, the prior holds it for exact
TIED_VARIANCE = 1e-6  # that such a direction gets: a thousandth of a standard deviation
STRESS_UNITS = ("Pa", "kPa", "MPa", "GPa", "N/mm2", "MPa·s", "MPa s")  # of stresses, and of stresses times a time
_START_MARGIN = 0.02  # share of the interval of starts that is left out at each end: nothing starts at a bound
_START_DIGITS = 8  # of a drawn start value


@dataclass(frozen=True)
class Parameter:
    """One degree of freedom.

    Values are in internal units (mm, s, MPa, N, degrees); ``factor`` converts to the user's unit:
    ``shown = value / factor``.

    Attributes
    ----------
    name : str
        ``SET.parameter``, ``camera.rotation_deg``, ``channel.force_N.offset``, ... (the names of experiment.toml).
    transform : {"log", "linear"}
        The optimiser sees ``ln(value)`` or ``value / unit_step``.
    scale : float
        Typical size of a linear parameter; ignored by the log transform.
    max_step : float
        Largest scaled step of one iteration.
    start_values : tuple of float
        Where the global search starts (`idic.identification.start_search`).
    stabilising_factor, activation_factor : float
        As in `LawParameter`.
    shared : bool
        Of a material: whether experiments that are identified together have it in common.
    """

    name: str
    value: float
    unit: str = ""
    free: bool = False
    bounds: tuple[float, float] = (-np.inf, np.inf)
    prior_mean: float | None = None
    prior_std: float | None = None
    transform: str = "linear"
    scale: float = 1.0
    factor: float = 1.0
    max_step: float = USUAL_MAX_STEP
    start_values: tuple[float, ...] = ()
    stabilising_factor: float = 1.0
    activation_factor: float = 1.0
    shared: bool = True

    @property
    def unit_step(self) -> float:
        """Change of a linear parameter by a unit of its scaled value.

        What a prior states is known: where it is wider than the scale, the unit is `PRIOR_STDS_PER_STEP` of its
        standard deviations, so that the parameter counts as determined
        (`idic.identification.step.parameter_covariance`).
        """
        return max(self.scale, PRIOR_STDS_PER_STEP * (self.prior_std or 0.0))

    def to_scaled(self, value: float | None = None) -> float:
        value = self.value if value is None else value
        return float(np.log(value)) if self.transform == "log" else value / self.unit_step

    def from_scaled(self, z: float) -> float:
        return float(np.exp(z)) if self.transform == "log" else float(z * self.unit_step)

    def slope(self) -> float:
        """d value / d scaled at the present value."""
        return self.value if self.transform == "log" else self.unit_step

    def perturbation(self, epsilon: float) -> float:
        """Change of the value in a perturbed run: `epsilon` of the value (log) or of the scale, within the bounds."""
        change = epsilon * (abs(self.value) if self.transform == "log" else self.scale)
        return change if self.value + change <= self.bounds[1] else -change

    @property
    def shown(self) -> float:
        return self.value / self.factor


@dataclass(frozen=True, eq=False)
class JointPrior:
    """A normal prior of several parameters together: what a calibration says of a camera.

    names : (n,); mean : (n,) internal units; covariance : (n, n)
    """

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    def precision(self, names: Sequence[str]) -> tuple[list[int], np.ndarray, np.ndarray]:
        """Places in `names` of the parameters that have this prior, its mean and inverse covariance for them.

        The others are averaged over: what they may be stays in the covariance of those that are there. What the
        covariance holds for exact (fx = fy of square pixels) stays so, within `TIED_VARIANCE`.
        """
        places = [i for i, name in enumerate(self.names) if name in names]
        covariance = self.covariance[np.ix_(places, places)]
        size = np.sqrt(np.diagonal(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
        values = np.where(values > MIN_VARIANCE, values, TIED_VARIANCE)
        inverse = (vectors / values) @ vectors.T / np.outer(size, size)
        return [names.index(self.names[i]) for i in places], self.mean[places], inverse

    def normal_equations(self, parameters: Mapping[str, Parameter], names: Sequence[str],
                         slopes: np.ndarray) -> tuple[list[int], np.ndarray, np.ndarray]:
        """Places in `names`, and what the prior adds to M and b of the scaled unknowns there; slopes : of `names`."""
        at, mean, inverse = self.precision(names)
        information = slopes[at][:, None] * inverse * slopes[at][None, :]
        return at, information, information @ ((mean - np.array([parameters[names[i]].value for i in at])) / slopes[at])

    def renamed(self, names: Mapping[str, str]) -> JointPrior:
        """The same under other names."""
        return replace(self, names=tuple(names.get(name, name) for name in self.names))


@dataclass(frozen=True)
class SmoothnessPrior:
    """A normal prior of combinations of parameters, each of mean zero and unit variance: the bends of a curve.

    names : (n,); bends : (m, n) per internal unit; rising : whether a value below the one before it counts as that one;
    centre : the value of all parameters at which every combination is zero
    """

    names: tuple[str, ...]
    bends: tuple[tuple[float, ...], ...]
    rising: bool = False
    centre: float = 0.0

    def normal_equations(self, parameters: Mapping[str, Parameter], names: Sequence[str],
                         slopes: np.ndarray) -> tuple[list[int], np.ndarray, np.ndarray]:
        """As `JointPrior.normal_equations`; parameters that are not in `names` keep their values."""
        places = [i for i, name in enumerate(self.names) if name in names]
        at, bends = [names.index(self.names[i]) for i in places], np.array(self.bends)
        moving = bends[:, places] * slopes[at]
        away = np.array([parameters[name].value for name in self.names]) - self.centre
        return at, moving.T @ moving, -moving.T @ (bends @ away)

    def renamed(self, names: Mapping[str, str]) -> SmoothnessPrior:
        """The same under other names."""
        return replace(self, names=tuple(names.get(name, name) for name in self.names))


Prior = JointPrior | SmoothnessPrior


class ParameterSet(Mapping[str, Parameter]):
    """An ordered, immutable set of parameters; ``pack``/``unpack`` see the free ones only.

    joint : priors of several parameters together
    """

    def __init__(self, parameters: Iterable[Parameter], joint: Sequence[Prior] = ()):
        self._items = {p.name: p for p in parameters}
        self.joint = tuple(joint)

    def __getitem__(self, name: str) -> Parameter:
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        rows = (f"{p.name}={p.shown:g}{p.unit and ' ' + p.unit}{' (free)' if p.free else ''}" for p in self.values())
        return f"ParameterSet({', '.join(rows)})"

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free parameters, in order."""
        return tuple(p.name for p in self.values() if p.free)

    def as_values(self) -> dict[str, float]:
        """Every value, in internal units."""
        return {p.name: p.value for p in self.values()}

    def with_values(self, values: Mapping[str, float | None]) -> ParameterSet:
        """These values changed; None (an infinite null value in a JSON file) leaves the present one."""
        unknown = set(values) - set(self._items)
        if unknown:
            raise KeyError(f"no such parameter: {', '.join(sorted(unknown))}")
        changed = {name: float(value) for name, value in values.items() if value is not None}
        return ParameterSet((replace(p, value=changed[p.name]) if p.name in changed else p for p in self.values()),
                            self.joint)

    def own_of(self, values: Mapping[str, float]) -> dict[str, float]:
        """Those of the values that are of a free parameter of this set: a locked one keeps its value, others have
        nothing to do with the experiment."""
        return {name: value for name, value in values.items() if name in self._items and self._items[name].free}

    def with_starts(self, values: Mapping[str, float]) -> ParameterSet:
        """These values changed, for a search that begins there: the unit of a linear parameter is at least the way from
        its present value, unless bounds on both sides say how far it goes.

        A search leaves a direction where it is whose standard deviation exceeds a unit.
        """
        def started(p: Parameter) -> Parameter:
            if p.name not in values or p.transform != "linear" or np.isfinite(p.bounds).all():
                return p
            return replace(p, scale=max(p.scale, abs(values[p.name] - p.value)))

        return ParameterSet(map(started, self.values()), self.joint).with_values(values)

    def with_free(self, names: Iterable[str]) -> ParameterSet:
        """The same set with exactly these names free."""
        names = set(names)
        unknown = names - set(self._items)
        if unknown:
            raise KeyError(f"no such parameter: {', '.join(sorted(unknown))}")
        return ParameterSet((replace(p, free=p.name in names) for p in self.values()), self.joint)

    def prior_equations(self, names: Sequence[str], slopes: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """What all priors add to M and b of these unknowns at the present values  # (n, n), (n,)

        names : others than parameters of this set have no prior; slopes : (n,) d natural / d scaled, default 1
        """
        slopes = np.ones(len(names)) if slopes is None else slopes
        M, b = np.zeros((len(names), len(names))), np.zeros(len(names))
        for i, name in enumerate(names):
            p = self.get(name)
            if p is not None and p.prior_std and p.prior_mean is not None:
                M[i, i] += (slopes[i] / p.prior_std) ** 2
                b[i] += M[i, i] * (p.prior_mean - p.value) / slopes[i]
        for prior in self.joint:
            at, information, pull = prior.normal_equations(self, names, slopes)
            M[np.ix_(at, at)] += information
            b[at] += pull
        return M, b

    # scaled vectors -------------------------------------------------------------------------------
    def pack(self) -> np.ndarray:
        """Scaled values of the free parameters  # (n_free,)"""
        return np.array([self[name].to_scaled() for name in self.free])

    def unpack(self, z: np.ndarray) -> ParameterSet:
        """The set with the free parameters at the scaled values `z`, clipped to their bounds."""
        low, high = self.scaled_bounds()
        values = {}
        for name, zi in zip(self.free, np.clip(z, low, high), strict=True):
            values[name] = float(np.clip(self[name].from_scaled(zi), *self[name].bounds))
        return self.with_values(values)

    def slopes(self) -> np.ndarray:
        """d value / d scaled of the free parameters  # (n_free,)"""
        return np.array([self[name].slope() for name in self.free])

    def scaled_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = [], []
        for name in self.free:
            p = self[name]
            lo, hi = p.bounds
            if p.transform == "log":
                low.append(np.log(lo) if lo > 0 else -np.inf)
                high.append(np.log(hi) if np.isfinite(hi) else np.inf)
            else:
                low.append(lo / p.unit_step)
                high.append(hi / p.unit_step)
        return np.array(low), np.array(high)


def drawn_start(parameter: Parameter, spread: float, place: float) -> float:
    """The start at `place` (0 to 1) of the interval around the present value, in the user's unit."""
    half_width = np.log1p(spread) if parameter.transform == "log" else spread
    low, high = parameter.to_scaled() - half_width, parameter.to_scaled() + half_width
    bounds = [b if parameter.transform == "linear" else max(b, 0.0) for b in parameter.bounds]
    with np.errstate(divide="ignore"):
        scaled = [np.log(b) if parameter.transform == "log" else b / parameter.unit_step for b in bounds]
    low, high = max(low, scaled[0]), min(high, scaled[1])
    margin = _START_MARGIN * (high - low)
    value = parameter.from_scaled(low + margin + place * (high - low - 2.0 * margin)) / parameter.factor
    return float(f"{value:.{_START_DIGITS}g}")


@dataclass(frozen=True)
class PlausibleSize:
    """A prior of the size of an effect, which its declaration states: half of those that occur are smaller.

    Attributes
    ----------
    size : in the internal unit of the degree of freedom, or in probes, the effect that the diagnosis looks for
    words : the size in the units of a reader; source : where it comes from
    """

    size: float
    words: str
    source: str
    in_probes: bool = True

    def share_beyond(self, size: float) -> float:
        """Share of such effects that are as large and larger: with heavy tails, as broken sensors are rare, and are."""
        return 1.0 / (1.0 + (size / self.size) ** 2)


def digits_text(value: float, digits: int = 3, zeros: bool = False) -> str:
    """A number to some digits, without an exponent where it can be written out: ``-760``, ``23100``.

    zeros : a zero at the end is a digit, too: ``0.0030``
    """
    text = f"{value:{'#' if zeros and value else ''}.{digits}g}"
    if "e+" in text and abs(value) < 1e7:
        return f"{float(text):.0f}"
    return text.removesuffix(".")
