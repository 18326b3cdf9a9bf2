"""The declaration of a constitutive law, and the registry of all laws.

A law is one function for one point, in one file, with one `LawSpec`. To add a law, copy ``neo_hookean.py``, write
``update`` with plain Python arithmetic (numba compiles it for real and for complex numbers: the derivatives then come
by themselves, exactly, from the complex step) and call `register`. Rules for ``update``:

* compare real parts only (``if x.real > 0.0``), no ``abs`` of anything that is differentiated;
* an inner iteration converges on real parts and then takes one more, complex, Newton step (see ``rate/creep.py``);
* inputs are never written; return 0, or 1 where the point did not converge (``J <= 0``, no root).
"""

from __future__ import annotations

import difflib
import dis
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from functools import cache
from types import MappingProxyType

import numpy as np

from idic.errors import InputError
from idic.laws.core.crack_band import CrackBand
from idic.laws.core.declaration_check import check_declaration
from idic.laws.core.temperature import TemperatureDependence
from idic.parameters import USUAL_MAX_STEP


@dataclass(frozen=True)
class LawParameter:
    """One constitutive parameter.

    Attributes
    ----------
    name, unit, description : str
        ``unit`` is one of ``MPa``, ``-``, ``deg``, ``s``, ...
    default : float or None
        A typical value, used by the material-point curves and the tests.
    null : float or None
        The value at which the parameter has no effect, where there is one.
    positive : bool
        True: the optimiser works in ``ln(value)``.
    bounds : (float, float)
        Values outside are refused.
    max_step : float
        Largest step of one iteration (of ln where positive): small where nothing depends on the parameter beyond it,
        large where only the order of magnitude matters.
    start_values : tuple of float
        Of a parameter that decides when an effect begins: the values where the global search starts, over the range
        that a test can determine.
    stabilising_factor : float
        A factor on the value that makes a body more stable; the global search tries it where simulations fail.
    activation_factor : float
        Of a threshold (a yield stress): the factor of one activation step, below 1; an activation step is taken while
        no evaluated point depends on the parameter (`idic.identification.step.activation`).
    reach, trials, calmer, sooner : optional
        Former names of the four, accepted from law files.
    """

    name: str
    unit: str
    description: str
    default: float | None = None
    null: float | None = None
    positive: bool = True
    bounds: tuple[float, float] = (0.0, np.inf)
    max_step: float = USUAL_MAX_STEP
    start_values: tuple[float, ...] = ()
    stabilising_factor: float = 1.0
    activation_factor: float = 1.0
    reach: InitVar[float | None] = None
    trials: InitVar[tuple[float, ...] | None] = None
    calmer: InitVar[float | None] = None
    sooner: InitVar[float | None] = None

    def __post_init__(self, reach, trials, calmer, sooner):
        for name, former in (("max_step", reach), ("start_values", trials), ("stabilising_factor", calmer),
                             ("activation_factor", sooner)):
            if former is not None:
                object.__setattr__(self, name, former)


EXPANSION = LawParameter(
    "alpha", "1/K", "linear thermal expansion, of any law where a temperature is given", default=1e-5, null=0.0,
    # no parameter of the law: it changes the mechanical strain (fe/expansion.py)
    positive=False, bounds=(-np.inf, np.inf))


@dataclass(frozen=True)
class DerivedQuantity:
    """A constant that follows from the law's parameters; it is reported with its standard deviation.

    Attributes
    ----------
    unit : str
    value : callable
        Its arguments are named as the law's parameters and are complex where it is differentiated.
    """

    unit: str
    value: Callable


@dataclass(frozen=True)
class Modes:
    """A law that comes with any number of like modes: named NAME with one, NAME_n with n.

    stems : beginnings of the parameters that are numbered, ``("G", "eta0")`` for G1, eta01, G2, eta02, ...
    make : (law with one mode, n) -> law with n
    """

    stems: tuple[str, ...]
    make: Callable[[LawSpec, int], LawSpec]

    def count(self, names: Iterable[str]) -> int:
        """The highest number among parameter names, at least 1."""
        numbers = [name.removeprefix(stem) for stem in self.stems for name in names if name.startswith(stem)]
        return max((int(number) for number in numbers if number.isdecimal()), default=1)


@dataclass(frozen=True)
class LawSpec:
    """One constitutive law.

    Attributes
    ----------
    name : str
    parameters : tuple of LawParameter
        Their order is the order of the ``params`` vector.
    updates : {"small" | "finite": function}
        ``update(F, state, params, dt, P, state_new) -> 0 | 1`` for one point; the first key is the default kinematics.
        ``F`` (3, 3) is the deformation gradient, ``P`` (3, 3) the first Piola-Kirchhoff stress in MPa. Small
        kinematics: ``F = I + grad u`` and ``P`` is the (symmetric) stress.
    linearise : {"small" | "finite": function}
        Optional, hand-written: ``linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new)``,
        the same update with its derivative along ``nd`` directions: ``dF`` (nd, 3, 3), ``dstate`` (nd, n_state),
        ``dparams`` (nd, n_params). ``dstate`` and ``dparams`` with no rows mean zero; only the first
        ``len(dstate_new)`` rows of the state's derivative are wanted.
    tangents : {"small" | "finite": function}
        Optional, of laws of this package: ``tangent(F, state, params, dt, P, state_new, A, work)``, the same update
        with dP/dF: ``A[3 a + b, 3 c + e] = dP_ab / dF_ce`` (9, 9); ``work`` (2, 9, 9) is scratch. Other laws have it
        from ``linearise`` or the complex step.
    state_names : tuple of str
    initial_state : tuple of float
        The state at rest; zeros where not given.
    linear : bool
        With small kinematics the stress is linear in the strain, whatever happened before.
    isotropic : bool
        The response does not depend on how the body was turned before loading.
    reference : str
        Equation and source.
    alternatives : {(name, ...): function}
        Other sets of parameter names accepted at the edge; the function returns ``{name: value}`` of the law's own.
    derived : {name: DerivedQuantity}
        Usual constants that are no parameters here.
    modes : Modes, optional
        How the law is made with more than one mode.
    time_order : int
        Order of the error of ``update`` in the time increment: 1 with backward Euler.
    compose : function, optional
        ``(kinds of terms) -> LawSpec`` of a law that is composed of terms: ``NAME(voce+linear)``.
    temperature : TemperatureDependence, optional
        How parameters depend on the temperature; ``update`` is given their values at the temperature of the point.
    crack_band : CrackBand, optional
        Which parameter is the length of a softening law; ``update`` is given it over the size of the element.
    impossible : function, optional
        Values of the parameters by name -> why no body has them together, or an empty text.
    """

    name: str
    parameters: tuple[LawParameter, ...]
    updates: Mapping[str, Callable]
    linearise: Mapping[str, Callable] = field(default_factory=dict)
    tangents: Mapping[str, Callable] = field(default_factory=dict)
    state_names: tuple[str, ...] = ()
    initial_state: tuple[float, ...] = ()
    linear: bool = False
    isotropic: bool = True
    reference: str = ""
    alternatives: Mapping[tuple[str, ...], Callable] = field(default_factory=dict)
    derived: Mapping[str, DerivedQuantity] = field(default_factory=dict)
    modes: Modes | None = None
    time_order: int = 1
    compose: Callable[[Sequence[str]], LawSpec] | None = None
    temperature: TemperatureDependence | None = None
    crack_band: CrackBand | None = None
    impossible: Callable[[Mapping[str, float]], str] | None = None

    def __post_init__(self):
        if isinstance(self.state_names, str):
            raise ValueError(f"law {self.name}: state_names is a tuple of names; one name alone is written "
                             f"({self.state_names!r},)")
        if not self.initial_state:
            object.__setattr__(self, "initial_state", (0.0,) * len(self.state_names))
        if len(self.initial_state) != len(self.state_names):
            raise ValueError(f"law {self.name}: {len(self.state_names)} state names, "
                             f"{len(self.initial_state)} initial values")
        if EXPANSION.name in self.parameter_names:
            raise ValueError(f"law {self.name}: {EXPANSION.name} is the thermal expansion of every law")
        unknown = (set(self.updates) - {"small", "finite"} | set(self.linearise) - set(self.updates)
                   | set(self.tangents) - set(self.updates))
        if unknown or not self.updates:
            raise ValueError(f"law {self.name}: kinematics are 'small' and/or 'finite', found {sorted(unknown)}")
        check_declaration(self)

    @property
    def kinematics(self) -> tuple[str, ...]:
        """Kinematics offered; the first is the default."""
        return tuple(self.updates)

    @property
    def rate_dependent(self) -> bool:
        """Whether the response depends on time: an ``update`` reads its time increment."""
        return any(_reads_time(update) for update in self.updates.values())

    @property
    def n_state(self) -> int:
        return len(self.state_names)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    def why_impossible(self, values: Sequence[float] | np.ndarray) -> str:
        """Why no body has these parameters (n_params,) together; empty where nothing is known against them."""
        named_values = dict(zip(self.parameter_names, map(float, values), strict=True))
        return "" if self.impossible is None else self.impossible(named_values)

    def defaults(self) -> np.ndarray:
        """Typical parameter values  # (n_params,)"""
        return np.array([np.nan if p.default is None else p.default for p in self.parameters])


@cache
def _reads_time(update: Callable) -> bool:
    code = getattr(update, "py_func", update).__code__
    dt = code.co_varnames[3]
    return any(dt == instruction.argval or (isinstance(instruction.argval, tuple) and dt in instruction.argval)
               for instruction in dis.get_instructions(code) if instruction.opname.startswith("LOAD"))


def _typed_in(spec: LawSpec) -> bool:
    return all(update.__module__ in ("__main__", "__mp_main__") for update in spec.updates.values())


_laws: dict[str, LawSpec] = {}


def register(spec: LawSpec) -> LawSpec:
    """Make a law known by its name; the contract test (``tests/laws``) covers it from then on.

    A law of a notebook or prompt replaces that of the same name which was typed there before.

    Raises
    ------
    ValueError
        Another law has the name.
    """
    registered = _laws.get(spec.name)
    if registered is not None and registered.updates != spec.updates:
        if not (_typed_in(registered) and _typed_in(spec)):
            raise ValueError(f"a law named {spec.name} is registered already")
        _with_modes.cache_clear()
        _with_terms.cache_clear()
    _laws[spec.name] = spec
    return spec


def get_law(name: str) -> LawSpec:
    """The law of that name; ``egp_3`` is ``egp`` with three modes, ``elastoplastic(voce+linear)`` one with two terms.

    Raises
    ------
    InputError
        No such law; the message lists near matches. Or such terms do not go together.
    """
    composed, bracket, terms = name.partition("(")
    if bracket and terms.endswith(")") and composed in _laws and _laws[composed].compose is not None:
        return _with_terms(composed, tuple(terms[:-1].replace(" ", "").split("+")))
    stem, _, number = name.rpartition("_")
    if name not in _laws and stem in _laws and number.isdecimal() and int(number) > 0 and _laws[stem].modes is not None:
        return _with_modes(stem, int(number))
    if name not in _laws:
        suggestions = _named_after(name) or difflib.get_close_matches(name, _laws, n=3, cutoff=0.4)
        raise InputError("unknown constitutive law", key="law", expected=f"one of {', '.join(_laws)}", found=repr(name),
                         remedy=f"did you mean {' or '.join(suggestions)}?" if suggestions else
                         "list the laws with  idic laws ; load a law file of yours with  idic --laws FILE COMMAND ...")
    return _laws[name]


def _named_after(author: str) -> list[str]:
    """Names of the laws that cite this author: Ludwik's law is ``j2_power``."""
    word = re.compile(rf"\b{re.escape(author)}\b", re.IGNORECASE)
    return [law.name for law in _laws.values() if word.search(law.reference)] if len(author) > 3 else []


def law_for(name: str, parameters: Iterable[str]) -> LawSpec:
    """The law of that name with as many modes as the names of the parameters count; raises as `get_law`."""
    law = get_law(name)
    return law if law.modes is None else _with_modes(law.name, law.modes.count(parameters))


@cache
def _with_modes(name: str, n: int) -> LawSpec:
    law = _laws[name]
    return law if n == 1 or law.modes is None else law.modes.make(law, n)


@cache
def _with_terms(name: str, kinds: tuple[str, ...]) -> LawSpec:
    compose = _laws[name].compose
    assert compose is not None  # `get_law` looks
    return compose(kinds)


def all_laws() -> Mapping[str, LawSpec]:
    """All registered laws, in order of registration (read only)."""
    return MappingProxyType(_laws)
