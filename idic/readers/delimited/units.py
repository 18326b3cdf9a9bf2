"""Conversion of user units to the internal units mm, s, MPa, N (degrees, kelvin for differences).

A unit is a product of names with integer powers: ``MPa``, ``kN``, ``1/s``, ``MPa*s``, ``N/mm^2``, ``-``.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

from idic.errors import InputError

_DIMENSIONS = ("length", "time", "force", "temperature", "angle", "pixel", "grey value")

_LENGTHS = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6, "in": 25.4, "inch": 25.4}
_TIMES = {"s": 1.0, "sec": 1.0, "Sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6,
          "μs": 1e-6, "min": 60.0, "h": 3600.0}
_FORCES = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "µN": 1e-6, "μN": 1e-6, "kN": 1e3, "MN": 1e6, "lbf": 4.4482216152605,
           "lb": 4.4482216152605, "lbs": 4.4482216152605, "kip": 4448.2216152605, "kgf": 9.80665, "kp": 9.80665}
_STRESSES = {"MPa": 1.0, "GPa": 1e3, "kPa": 1e-3, "Pa": 1e-6, "bar": 0.1, "mbar": 1e-4, "psi": 6.894757293168e-3,
             "ksi": 6.894757293168}


@dataclass(frozen=True)
class Unit:
    """A factor to internal units and the powers of `_DIMENSIONS`."""

    factor: float
    powers: tuple[int, ...] = (0,) * len(_DIMENSIONS)

    @property
    def dimension(self) -> str:
        """In words: "length", "force/length^2", "none"."""
        parts = [f"{name}^{p}" if p != 1 else name for name, p in zip(_DIMENSIONS, self.powers, strict=True) if p]
        return " ".join(parts) or "none"


def _power(**powers: int) -> tuple[int, ...]:
    return tuple(powers.get(name.replace(" ", "_"), 0) for name in _DIMENSIONS)


_UNITS: dict[str, Unit] = {"1": Unit(1.0), "-": Unit(1.0), "": Unit(1.0), "%": Unit(0.01)}
_UNITS |= {name: Unit(factor, _power(length=1)) for name, factor in _LENGTHS.items()}
_UNITS |= {name: Unit(factor, _power(time=1)) for name, factor in _TIMES.items()}
_UNITS |= {name: Unit(factor, _power(force=1)) for name, factor in _FORCES.items()}
_UNITS |= {name: Unit(factor, _power(force=1, length=-2)) for name, factor in _STRESSES.items()}
_UNITS |= {name: Unit(1.0, _power(temperature=1)) for name in ("C", "degC", "°C", "K")}
_UNITS |= {name: Unit(1.0, _power(angle=1)) for name in ("deg",
                                                         "°")} | {"rad": Unit(57.29577951308232, _power(angle=1))}
_UNITS |= {"px": Unit(1.0, _power(pixel=1)), "GV": Unit(1.0, _power(grey_value=1)),
           "gv": Unit(1.0, _power(grey_value=1))}

KNOWN = ", ".join(sorted((name for name in _UNITS if name), key=str.lower))
_TOKEN = re.compile(r"\s*([*/·.])?\s*([A-Za-zµμ°%]+|1|-)(?:\^?([+-]?\d+))?")


def parse_unit(text: str) -> Unit | None:
    """The unit in `text`; None if the text is not a unit."""
    text = text.strip()
    if text in _UNITS:
        return _UNITS[text]
    factor, powers, position = 1.0, [0] * len(_DIMENSIONS), 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None or match.group(2) not in _UNITS or (position and match.end() == position):
            return None
        unit = _UNITS[match.group(2)]
        exponent = int(match.group(3) or 1) * (-1 if match.group(1) == "/" else 1)
        factor *= unit.factor**exponent
        powers = [p + exponent * q for p, q in zip(powers, unit.powers, strict=True)]
        position = match.end()
    return Unit(factor, tuple(powers))


def factor_between(unit_name: str, internal: str, *, file=None, key=None) -> float:
    """Factor from the unit `unit_name` to the internal unit `internal` (``"MPa"``, ``"-"``).

    Raises
    ------
    InputError
        `unit_name` is not a unit, or a unit of another dimension.
    """
    unit, expected = parse_unit(unit_name), parse_unit(internal)
    if unit is None:
        raise InputError("unknown unit", file=file, key=key, expected=f"a unit such as {internal or '-'}",
                         found=repr(unit_name), remedy=f"use one of {KNOWN}, or a product of them such as MPa*s")
    if expected is None or unit.powers != expected.powers:
        raise InputError("wrong unit", file=file, key=key, found=f"{unit_name!r} ({unit.dimension})",
                         expected=f"a unit of the dimension of {internal or '-'}",
                         remedy=f'write e.g. unit = "{internal or "-"}"')
    return unit.factor / (1.0 if expected is None else expected.factor)


def factor_to(target: str, source: str) -> float | None:
    """Factor from the unit `source` to `target`; None where they have other dimensions or are not known."""
    if source == target:
        return 1.0
    unit, target_unit = parse_unit(source), parse_unit(target)
    if unit is None or target_unit is None or unit.powers != target_unit.powers:
        return None
    return unit.factor / target_unit.factor


def suffix_unit(column: str) -> str | None:
    """The unit after the last underscore of a column name (``force_N``: ``N``); None without a unit."""
    name, _, suffix = column.rpartition("_")
    return suffix if name and suffix in _UNITS and suffix not in ("", "1", "-") else None


_IN_BRACKETS = re.compile(r"(.+?)\s*(?:\[([^\[\]]+)\]|\(([^()]+)\)|\s/\s*(\S+))")


def _parts(column: str) -> tuple[str, str] | None:
    match = _IN_BRACKETS.fullmatch(column.strip())
    if match is None:
        return None
    unit = next(group for group in match.groups()[1:] if group is not None).strip()
    return (match[1], unit) if unit not in ("", "1", "-") and parse_unit(unit) is not None else None


def _ending(column: str) -> str:
    """What stands in brackets at the end of a column name, or after its last underscore if it is a unit in other
    letters (``Force_KN``); "" otherwise."""
    match = _IN_BRACKETS.fullmatch(column.strip())
    if match is not None:
        return next(group for group in match.groups()[1:] if group is not None).strip()
    name, _, suffix = column.rpartition("_")
    return suffix if name and suffix.lower() in {symbol.lower() for symbol in _UNITS if len(symbol) > 1} else ""


def unit_in_name(column: str) -> str | None:
    """The unit at the end of a column name: ``force_N``, ``Force [N]``, ``Force (N)``, ``Force / N``; None without."""
    parts = _parts(column)
    return parts[1] if parts else suffix_unit(column)


def without_unit(column: str) -> str:
    """The column name without the unit at its end."""
    parts = _parts(column)
    return parts[0] if parts else column.rpartition("_")[0] if suffix_unit(column) else column


def column_factor(column: str, internal: str, unit: str | None = None, *, file=None, key=None) -> float:
    """Factor from a logged column to internal units, by ``unit`` if given, else by the unit in its name."""
    unit_name = unit or unit_in_name(column)
    if unit_name is None and (ending := _ending(column)):
        candidates = [name for name, known_unit in _UNITS.items() if name.lower() == ending.lower()
                      and known_unit.powers == parse_unit(internal).powers]
        likely = (candidates or [internal])[0]
        raise InputError(f'column "{column}" ends in a unit that idic does not know', file=file, key=key,
                         expected=f"one of {KNOWN}" if not candidates else " or ".join(candidates), found=ending,
                         remedy=f'write {{ column = {json.dumps(column)}, unit = "{likely}" }} if that is its unit; '
                                "else convert the column")
    if unit_name is None:
        raise InputError(f'column "{column}" has no unit', file=file, key=key, found=f'"{column}"',
                         expected=f"a name that ends in a unit, such as {column}_{internal}",
                         remedy=f'rename the column, or write {{ column = "{column}", unit = "{internal}" }}')
    return factor_between(unit_name, internal, file=file, key=key)
