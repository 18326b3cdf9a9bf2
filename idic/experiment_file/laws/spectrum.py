"""A free relaxation spectrum of experiment.toml as flat parameters, and what the frames of a test can say of it.

    spectrum = { times = 8, shortest = 0.5, longest = 500.0, share = 0.5 }

of ``law = "free_relaxation"`` becomes ``free_relaxation(8)`` with shortest and longest (s) and the weights g_1 ... g_8,
identified and starting alike with the sum ``share``; g_3 = ... gives one its own value. ``times = "evidence"``: as the
knots of free curves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.errors import InputError
from idic.experiment_file.laws.free_curves import BY_EVIDENCE, is_number, stated_smoothness
from idic.laws import DEFAULT_SHARE, DEFAULT_TIMES, FREE_RELAXATION, TIMES, times_of, weight_names
from idic.model import Material
from idic.parameters import Parameter

KEY = "spectrum"
ENDS = ("shortest", "longest")


def free_relaxation(table: Mapping, file: str, key: str) -> dict:
    """The table of a free spectrum as flat parameters; one without ``spectrum`` as it is.

    Raises
    ------
    InputError
        An unknown key, or a number of times, an end of the grid or a share that is none.
    """
    if KEY not in table:
        return dict(table)
    entry, place = table[KEY], f"{key}.{KEY}"
    if not isinstance(entry, Mapping):
        raise InputError("a relaxation spectrum is a table", file=file, key=place,
                         expected="{ times = 8, shortest = 0.5, longest = 500.0 }", found=repr(entry)[:80],
                         remedy="write it in { }")
    n = entry.get("times", DEFAULT_TIMES)
    chosen = n == BY_EVIDENCE
    n = TIMES[1] if chosen else n
    if not isinstance(n, int) or isinstance(n, bool) or not TIMES[0] <= n <= TIMES[1]:
        raise InputError("a relaxation spectrum needs its number of times", file=file, key=f"{place}.times",
                         expected=f'a whole number, {TIMES[0]} to {TIMES[1]}, or "{BY_EVIDENCE}"', found=repr(n)[:80],
                         remedy="two or three per decade between shortest and longest")
    weights, allowed = weight_names(n), ("times", *ENDS, "share", "smoothness")
    unknown = [name for name in entry if name not in (*allowed, *weights)]
    if unknown:
        raise InputError("a relaxation spectrum has no such key", file=file, key=f"{place}.{unknown[0]}",
                         expected=f"{', '.join(allowed)}, g_1 ... g_{n}", found=unknown[0], remedy="remove it")
    values = [end.get("value") if isinstance(end := entry.get(name), Mapping) else end for name in ENDS]
    for name, value in zip(ENDS, values, strict=True):
        if not is_number(value) or not value > 0:
            raise InputError("a relaxation spectrum needs the ends of its times", file=file, key=f"{place}.{name}",
                             expected="a time in s above zero; about the interval between two frames, and the length "
                             "of the test", found=repr(entry.get(name))[:80], remedy=f"write e.g.  {name} = 1.0")
    if all(is_number(entry[name]) for name in ENDS) and not values[0] < values[1]:
        raise InputError("the relaxation times of a spectrum do not increase", file=file, key=f"{place}.longest",
                         expected=f"more than shortest = {values[0]:g} s", found=f"{values[1]:g} s",
                         remedy="swap them")
    share = entry.get("share", DEFAULT_SHARE)
    if not is_number(share) or not 0.0 <= share < 1.0:
        raise InputError("the weights of a spectrum leave a stiffness", file=file, key=f"{place}.share",
                         expected="their sum at the start, 0 or more and below 1", found=repr(share)[:80],
                         remedy=f"write  share = {DEFAULT_SHARE}")
    flat = {"law": f"{FREE_RELAXATION}({n})", **{name: entry[name] for name in ENDS}}
    flat |= {name: entry.get(name, {"value": share / n, "identify": True}) for name in weights}
    smoothness_table = stated_smoothness(entry, file, place) | ({"by_evidence": True} if chosen else {})
    flat_table = {name: value for name, value in table.items() if name != KEY} | flat
    return flat_table | ({"smoothness": {KEY: smoothness_table}} if smoothness_table else {})


def spectrum_notes(materials: Sequence[Material], parameters: Sequence[Parameter],
                   times: np.ndarray | None) -> list[str]:
    """Which relaxation times lie outside of those that the frames can tell; times : (n_frames,) s, None: not known."""
    values, notes = {p.name: p.value for p in parameters}, []
    for material in materials:
        if times is None or len(times) < 2 or not times_of(material.law):
            continue
        shortest, longest = (values[f"{material.element_set}.{name}"] for name in ENDS)
        interval, duration = float(np.diff(times).min()), float(times[-1] - times[0])
        if shortest < 0.5 * interval or longest > 2.0 * duration:
            notes.append(f"material.{material.element_set}: relaxation times of {shortest:.3g} to {longest:.3g} s; the "
                         f"frames show {interval:.3g} to {duration:.3g} s: faster relaxation is over before a frame, "
                         "slower relaxation looks elastic, and such weights follow the smoothness prior")
    return notes
