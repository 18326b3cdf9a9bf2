"""A planned test in words: expected standard deviations, undetermined parameters with reasons, the better plan."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from idic.report.result.fit_words import in_words_of
from idic.report.result.words import number_text, short_names, two_digits

MODE = re.compile(r"(boundary\..+)\.s\d+t\d+")  # amplitude of a mode of a virtual boundary: there may be hundreds
MAX_TERMS = 6  # of a direction that are written out
MAX_PAIRS = 8  # of parameters in a sentence, the strongest first
MIN_SHOWN_COMPONENT = 0.05  # of a direction in its text
MAX_STD_WELL, MAX_STD_FAIR = 0.01, 0.1  # relative standard deviations (of the scale where a value may be zero)
GRADES = {"well": "well determined", "fair": "determined", "poor": "poorly determined", "open": "not determined"}


def grade(relative_std: float | None) -> str:
    """well (1 % or better) | fair | poor (above 10 %) | open (not determined)"""
    if relative_std is None:
        return "open"
    return "well" if relative_std <= MAX_STD_WELL else "fair" if relative_std <= MAX_STD_FAIR else "poor"


def in_words(plan: Mapping, text: str) -> str:
    """A text on images in the words of what the plan measures: unchanged for images."""
    return text if plan["points"] is None else in_words_of({"quantity": "displacement"}, text)


def named(parameters: Mapping) -> dict:
    """The parameters without the modes of virtual boundaries."""
    return {name: entry for name, entry in parameters.items() if not MODE.fullmatch(name)}


def mode_groups(parameters: Mapping) -> list[str]:
    """One sentence per virtual boundary: how many modes, how well they are determined."""
    groups: dict[str, list[Mapping]] = {}
    for name, entry in parameters.items():
        if mode := MODE.fullmatch(name):
            groups.setdefault(mode[1], []).append(entry)
    sentences = []
    for stem, entries in groups.items():
        stds = [entry["std"] for entry in entries if entry["std"] is not None]
        spread = (f"std {two_digits(min(stds))} to {two_digits(max(stds))} {entries[0]['unit']}" if stds
                  else "none determined")
        lost = len(entries) - len(stds)
        sentences.append(f"{stem}: {len(entries)} modes are identified together with the material, {spread}"
                         + (f"; {lost} not determined." if lost and stds else "."))
    return sentences


def direction(vector: np.ndarray, names: Sequence[str], scales: Sequence[float | None]) -> str:
    """A combination of scaled parameters, largest part first: ``ln K +0.98, ln n -0.19``.

    scales : None for a parameter seen by its logarithm, else what one scaled unit of it is.
    """
    order = _largest_first(vector)
    sign = np.sign(vector[order[0]])
    unit = lambda i: f"ln {names[i]}" if scales[i] is None else f"{names[i]}/{two_digits(scales[i])}"  # noqa: E731
    more = f", … ({len(order) - MAX_TERMS} more)" if len(order) > MAX_TERMS else ""
    return ", ".join(f"{unit(i)} {sign * vector[i]:+.2f}" for i in order[:MAX_TERMS]) + more


def _largest_first(vector: np.ndarray) -> list[int]:
    """Parts that are shown; of parts that differ by rounding the first parameter comes first, on every machine."""
    order = np.argsort(-np.abs(vector).round(9), kind="stable")
    return [int(i) for i in order if abs(vector[i]) >= MIN_SHOWN_COMPONENT]


def fixed_product(vector: np.ndarray, names: Sequence[str], scales: Sequence[float | None]) -> str | None:
    """The product of powers ``E·t`` that is determined although a direction of two positive parameters is not."""
    components = _largest_first(vector)
    if len(components) != 2 or any(scales[i] is not None for i in components):
        return None
    first, second = components  # where ln(first) changes by v1 and ln(second) by v2, v2 ln(first) - v1 ln(second) stays
    power = -vector[first] / vector[second]
    if abs(power) > 1.0 / MIN_SHOWN_COMPONENT:
        return None
    exponent = "" if abs(abs(power) - 1.0) < MIN_SHOWN_COMPONENT else f"^{abs(power):.2g}"
    return f"{names[first]}{'·' if power > 0 else '/'}{names[second]}{exponent}"


def headline(plan: Mapping) -> str:
    """The parameters of one plan by grade, in one sentence."""
    short = short_names(named(plan["parameters"]))
    groups: dict[str, list[str]] = {}
    for name, entry in named(plan["parameters"]).items():
        text = short[name] if entry["relative_std"] is None else f"{short[name]} to {percent(entry['relative_std'])}"
        groups.setdefault(entry["grade"], []).append(text)
    parts = [f"{GRADES[key]}: {', '.join(groups[key])}" for key in GRADES if key in groups]
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}."


def motion_unit(plan: Mapping) -> tuple[float, str]:
    """What a motion in px is multiplied by to be shown, and its unit: mm of measured fields, whose px is their
    pitch."""
    return (1.0, "px") if plan["points"] is None else (plan["points"]["pitch"], plan["points"]["unit"])


def largest_motion(plan: Mapping) -> str:
    """With its unit."""
    scale, unit = motion_unit(plan)
    return f"{scale * plan['motion_px']:.3g} {unit}"


def seen_area(plan: Mapping) -> str:
    """The size of the images, or the points of the measured fields."""
    if plan["points"] is None:
        return " × ".join(map(str, plan["image_px"])) + (" voxels" if len(plan["image_px"]) == 3 else " px")
    return "{number} points, {pitch:.3g} {unit} apart".format(**plan["points"])


def percent(relative: float) -> str:
    return f"{two_digits(100.0 * relative)} %"


def open_parameters(plan: Mapping) -> list[str]:
    """Sentences on undetermined parameters with their reasons, and on those that need the channels."""
    short = short_names(named(plan["parameters"]))
    sentences = [f"{names} cannot be determined: {reason}."
                 for reason, names in _by_reason(plan["not_identifiable"], short).items()]
    determined = {name for name, entry in plan["parameters"].items() if entry["std"] is not None}
    lost = [item for item in plan["without_channels"] if item["name"] in determined]
    channels = ", ".join(plan["channels"])
    return sentences + [f"{names} cannot be determined without {channels} ({reason.replace('no force', 'without it')})."
                        for reason, names in _by_reason(lost, short).items()]


def _by_reason(items: Sequence[Mapping], short: Mapping[str, str]) -> dict[str, str]:
    """Names of parameters, joined, per reason why they are open."""
    reasons: dict[str, list[str]] = {}
    for item in items:
        reasons.setdefault(item["reason"], []).append(short.get(item["name"], item["name"]))
    return {reason: ", ".join(names) for reason, names in reasons.items()}


def confusions(plan: Mapping) -> list[str]:
    """Pairs of parameters that the test hardly separates, the strongest first, without pairs of boundary modes."""
    short = short_names(named(plan["parameters"]))
    pair_text = lambda pair: " and ".join(short.get(name, name) for name in pair["names"])  # noqa: E731
    sentences = []
    pairs = _strongest(plan["confusable"], "correlation")
    lost = [pair_text(pair) for pair in pairs if pair["correlation"] is None]
    hard = [f"{pair_text(pair)} ({pair['correlation']:+.3f})" for pair in pairs if pair["correlation"] is not None]
    if lost:
        sentences.append(f"Not separated by this test: {'; '.join(lost)}.")
    if hard:
        sentences.append(f"Hardly separated, an error in one compensates an error in the other (correlation): "
                         f"{'; '.join(hard)}.")
    alike = [f"{pair_text(pair)} ({pair['cosine']:+.3f})" for pair in _strongest(plan["alike"], "cosine")]
    if alike:
        sentences.append("Almost the same motion in the images (cosine of the sensitivity fields): "
                         f"{'; '.join(alike)}.")
    return sentences


def _strongest(pairs: Sequence[Mapping], key: str) -> list[Mapping]:
    of_parameters = [pair for pair in pairs if not all(MODE.fullmatch(name) for name in pair["names"])]
    return sorted(of_parameters, key=lambda pair: -2.0 if pair[key] is None else -abs(pair[key]))[:MAX_PAIRS]


def weakest(plan: Mapping) -> str:
    """The direction that the plan determines worst, as a sentence."""
    entry = plan["directions"][-1]
    std = "not determined"
    if entry["std"] is not None:
        std = f"standard deviation {number_text(entry['std'], entry['std'])}"
    product = f"; the test determines {entry['fixed']}" if entry["fixed"] and not entry["determined"] else ""
    return f"Weakest combination: {entry['text']} ({std}){product}."


def best_plan(comparison: Mapping) -> str:
    """Which plan is better for which parameters, in one sentence."""
    wins: dict[str, list[str]] = {}
    for name, entry in comparison["parameters"].items():
        if entry["best"] is not None:
            wins.setdefault(entry["best"], []).append(name)
    if not wins:
        return "The plans determine no common parameter."
    short = short_names(comparison["parameters"])
    if len(wins) == 1 and len(comparison["parameters"]) == len(names := next(iter(wins.values()))):
        return f"{next(iter(wins))} is the best plan for every parameter ({', '.join(short[n] for n in names)})."
    parts = [f"{plan} is better for {', '.join(short[n] for n in names)}"
             for plan, names in sorted(wins.items(), key=lambda item: -len(item[1]))]
    return f"{'; '.join(parts)}."
