"""Monte Carlo on the polycarbonate strip: error over reported standard deviation at every noise level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic_studies.pages import study_charts as charts
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.polycarbonate_figures import PLAIN, SYMBOLS
from idic_studies.pages.study_page import Goal, StudySection, Table

Records = Mapping[str, CaseRecord]
MAX_SCATTER_OVER_BOUND = 1.15  # target
MIN_DRAWS_OF_A_TARGET = 40  # of all levels together: the scatter is known to 11 % then
Z95 = 1.96
MIN_DITHERING_NOISE = 3  # tenths of a per cent, 0.37 grey values: from here on the rounding differs between draws
OF_EIGHT, EXPOSED, OF_TEN = "draws", "draws-exposed", ("draws-ten", "draws-full")


@dataclass(frozen=True)
class Level:
    """The draws of one noise level that converged.

    z, above : (draws, parameters) error over reported standard deviation, over the Cramér-Rao bound (None: unknown)
    stated : (parameters,) mean reported standard deviation over the truth
    dithered : the noise varies the rounding from draw to draw
    """

    label: str
    names: tuple[str, ...]
    asked: int
    z: np.ndarray
    above: np.ndarray | None
    stated: np.ndarray
    dithered: bool = True


def draws(records: Records):
    """Tables, pictures and goals of the draws.

    Groups `draws` (eight parameters, five levels), `draws-exposed` (the lowest levels), `draws-ten`, `draws-full`.
    """
    eight, exposed = (_levels([r for r in records.values() if r.group == group], records, "")
                      for group in (OF_EIGHT, EXPOSED))
    ten = []
    for group, size in zip(OF_TEN, ("", ", full size"), strict=True):
        ten += _levels([r for r in records.values() if r.group == group], {}, size)
    parts = [(levels, *words) for levels, words in (
        (eight, ("eight parameters", "monte_carlo_8")),
        (exposed, ("eight parameters, exposure varied", "monte_carlo_8_exposed")),
        (ten, ("ten parameters", "monte_carlo_10"))) if levels]
    if not parts:
        return None
    tables = [_table(levels, words) for levels, words, _ in parts]
    pictures = [charts.draws([(level.label, level.z) for level in levels], [SYMBOLS[n] for n in levels[0].names], name,
                             f"Error bars over draws: {words}",
                             "Grey: 99 % of such figures if the reported standard deviations hold.")
                for levels, words, name in parts]
    goals = [goal for levels, words, _ in parts for goal in _goals(levels, words)]
    text = ("Every image has its own noise, the reference included, and is rounded to 8 bits; the force has its stated "
            "noise. Start: the truth. Where the noise is too small to vary the rounding, further draws vary the "
            "brightness of all frames by part of a grey value.")
    return StudySection("draws", "Monte Carlo: the error bars", text, tuple(tables), tuple(pictures)), goals


def _levels(drawn: Sequence[CaseRecord], records: Records, size: str) -> list[Level]:
    members: dict[str, list[CaseRecord]] = {}
    for record in drawn:
        members.setdefault(record.name.partition("-")[0], []).append(record)
    levels = []
    for key, group in sorted(members.items()):
        good = [record for record in group if record.converged]
        if len(good) > 1:
            bound, above = records.get(f"bound/{key}"), None
            z = np.array([record.normalised_error for record in good])
            if bound is not None:
                above = z * np.array([record.arrays["std"] for record in good]) / bound.arrays["std"]
            mean_std = np.mean([record.relative_std for record in good], axis=0)
            label = f"{0.1 * int(key):g} % noise{size}, {len(good)} draws"
            dithered = int(key) >= MIN_DITHERING_NOISE
            levels.append(Level(label, tuple(good[0].names), len(group), z, above, mean_std, dithered))
    return levels


def _table(levels: Sequence[Level], words: str) -> Table:
    rows = [(level.label, *(f"{s:.2f} ({100 * d:.2g} %)" for s, d in zip(_scatter(level.z), level.stated, strict=True)),
             "{:.2f} … {:.2f}".format(*charts.chance(len(level.z))), f"{len(level.z)} of {level.asked}")
            for level in levels]
    if len(levels) > 1:
        z = np.concatenate([level.z for level in levels])
        chance = f"± {2.58 / np.sqrt(len(z)):.2f}"
        rows.append(("all, mean of error / std", *(f"{m:+.2f}" for m in z.mean(axis=0)), chance, ""))
        rows.append(("all, within 1.96 std", *(f"{100 * c:.0f} %" for c in (np.abs(z) < Z95).mean(axis=0)), "95 %", ""))
    above = _above(levels)
    if above is not None:
        chance = "{:.2f} … {:.2f}".format(*charts.chance(len(above)))
        rows.append(("all, scatter / Cramér-Rao bound", *(f"{s:.2f}" for s in _rms(above)), chance, ""))
        rows += [(f"{level.label}, mean of error / std", *(f"{m:+.2f}" for m in level.z.mean(axis=0)),
                  f"± {2.58 / np.sqrt(len(level.z)):.2f}", "") for level in levels if not level.dithered]
    return Table(f"Standard deviation of (error / reported std), {words}; mean reported std in brackets",
                 ("", *(PLAIN[n] for n in levels[0].names), "99 % of chance", "converged"), tuple(rows))


def _goals(levels: Sequence[Level], words: str) -> list[Goal]:
    inside = [bool(low <= s <= high) for level in levels for low, high in [charts.chance(len(level.z))]
              for s in _scatter(level.z)]
    goals = [Goal(f"std of (error / reported std), {words}, every level", "consistent with 1 (99 % of chance)",
                  f"{sum(inside)} of {len(inside)} inside", sum(inside) >= len(inside) - 1)]
    random = [level for level in levels if level.dithered]
    for compared, suffix in ((levels, ""), (random, ", levels whose noise varies the rounding")):
        above = _above(compared)
        if above is not None and len(above) >= MIN_DRAWS_OF_A_TARGET and (compared is levels
                                                                          or len(random) < len(levels)):
            worst = float(_rms(above).max())
            goals.append(Goal(f"scatter over the Cramér-Rao bound, {words}, {len(above)} draws{suffix}",
                              f"at most {MAX_SCATTER_OVER_BOUND}", f"{worst:.3f}", worst <= MAX_SCATTER_OVER_BOUND))
    return goals


def _above(levels: Sequence[Level]) -> np.ndarray | None:
    """Errors over the bound, all levels together; None where a bound is unknown  # (draws, parameters)"""
    if not levels or any(level.above is None for level in levels):
        return None
    return np.concatenate([level.above for level in levels])


def _scatter(z: np.ndarray) -> np.ndarray:
    return z.std(axis=0, ddof=1)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))
