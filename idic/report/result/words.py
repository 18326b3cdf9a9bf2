"""The report in words: numbers with their standard deviations, and the sentences at its top."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor, isfinite, log10

import numpy as np

from idic.fe import OUTLINE
from idic.model import in_words, is_mode, motions
from idic.parameters import STRESS_UNITS, digits_text
from idic.report.result.fit_words import (
    MAX_P_OF_EQUAL_SPECIMENS, MIN_SHOWN_PART, NOISE_CHI2, against_free, basis_verdict, chi2_text, cluster,
    has_model_part, images, in_error_bars, missing_load, noise_chi2, remedies,
)
from idic.report.result.stress_scale import held_stresses, in_ratios

NO_SETS = {"camera", "channel", "boundary", "geometry", "time", "placement"}  # heads of other names
MIN_SHOWN_PX, MIN_SHOWN_SHARE, MIN_SHOWN_ROUGH = 1e-4, 1e-5, 0.05  # of a discrepancy: less is zero to the reader

STATUS = {
    "converged": "Converged in {n}.",
    "stalled": "Stalled after {n}: no trial step reduced the objective, and the last step was not small.",
    "max_iterations": "Stopped after {n} without convergence.",
    "at_bound": "Stopped after {n} with {which} at its bound: the true value may lie outside.",
    "forward_failed": "The simulation failed after {n}. The values are those of the last accepted step, no "
                      "minimum: they have no error bars.",
    "interrupted": "Interrupted after {n}. Resume with idic identify --resume.",
}
NOISE_SOURCE = {
    "given": "as given in the experiment file",
    "still_frames": "from still frames",
    "residual_of_free_dic": "from the local residual of a free FE-DIC",
    "free_dic": "from the local residual of a free FE-DIC",
    "stage_differences": "from the differences of stages",
}
MAX_CHANNEL_CHI2 = 2.0  # χ² per frame of a channel: with 20 frames a larger one has a probability below 0.5 %
MODES_OPEN = "the images do not separate them all; undetermined modes keep their start values"
EDGES_OPEN = (" These edges stay where the margin puts them; moduli by the force depend on it, and no error bar counts "
              "it: draw the outline (outline_mm).")
UNEXPLAINED_BY_MOTION = {  # a residual that no motion explains, by the quantity that was measured
    "grey": "Look at the light and at the pattern in the residual maps; a mask leaves out what changes.",
    "height": "The surface changes where no motion explains it: gaps, dirt, focus. Mask it, or state the noise "
              "(noise_std_gv under [camera]).",
    "displacement": "The points scatter by more than their noise, whatever the motion: glare, lost points or a crack. "
                    "Leave them out in the program that exports them, or state the noise (fields_noise_um under "
                    "[experiment]).",
    "volume": "The scans change where no motion explains it: drift of their grey values, artefacts, or more noise than "
              "stated. Two scans of one state show the noise (still_frames; noise_std_gv under [scanner]).",
}
MAX_LISTED = 4  # frames, or pairs of parameters, named in a sentence
MIN_STRONG_CORRELATION = 0.95  # |coefficient| above which two parameters are hardly separated


def with_std(value: float, std: float | None, unit: str = "") -> str:
    """A value to two significant digits of its standard deviation: ``70.012 ± 0.055 GPa``."""
    factor, unit = readable_unit(value, unit)
    value, std = value / factor, None if std is None else std / factor
    tail = f" {unit}" if unit and unit != "-" else ""
    if std is None or not isfinite(std) or std <= 0:
        return f"{value:.5g}{tail}"
    exponent = floor(log10(max(abs(value), std)))  # a value near zero has the digits of its error
    if not -3 <= exponent < 6:
        scale = 10.0**exponent
        digits = max(0, 1 - floor(log10(std / scale)))
        power = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})·10{power}{tail}"
    digits = max(0, 1 - floor(log10(std)))
    return f"{value:.{digits}f} ± {two_digits(std) if std >= 100.0 else f'{std:.{digits}f}'}{tail}"


def number_text(value: float | None, like: float | None = None) -> str:
    """A plain number, rounded to two digits of `like` (a standard deviation) where that is given; – for None."""
    if value is None or not isfinite(value):
        return "–"
    if like and isfinite(like) and 1e-4 < abs(value or 1.0) < 1e7:
        return f"{value:.{max(0, 1 - floor(log10(like)))}f}"
    if like and isfinite(like) and value:
        return f"{value:.{min(max(0, 1 + floor(log10(abs(value))) - floor(log10(like))), 5)}e}"
    return f"{value:.6g}" if value == 0 or 1e-4 <= abs(value) < 1e6 else f"{value:.4g}"


def relative_std(value: float | None, std: float | None) -> str:
    """A standard deviation in per cent of the value; a value within it of zero has none."""
    if not value or not std:
        return "–"
    return f"{two_digits(100.0 * std / abs(value))} %" if std < abs(value) else "> 100 %"


def parts_of_std(entry: Mapping) -> str:
    """A standard deviation by its parts from noise and from the model: ``0.055, 0.21``."""
    parts = [entry.get("std_noise"), entry.get("std_model")]
    return ", ".join("–" if part is None else error_text(part, entry.get("std"), two_digits(part)) for part in parts)


def error_text(error: float | None, std: float | None, text: str) -> str:
    """The text of an error beside a standard deviation; 0 where it is no part of that."""
    return "0" if error is not None and std and abs(error) < MIN_SHOWN_PART * std else text


def two_digits(std: float) -> str:
    """An error to two digits, a zero at the end too: ``0.0030``; without an exponent where it can be written out."""
    return digits_text(std, 2, zeros=True)


def size_text(size: float) -> str:
    """A share or a size to two digits, without zeros at the end: ``1`` %."""
    return digits_text(size, 2)


def discrepancy_text(result: Mapping) -> str:
    """The part of the standard deviations that is due to the model, in a sentence; "" without an estimate."""
    values_text = result.get("discrepancy") or {}
    if "not_estimated" in values_text:
        return f"The error bars do not count the error of the model: {values_text['not_estimated']}."
    if "significant" not in values_text:
        return ""
    if not values_text["significant"]:
        return ("No smooth error of the model stands out of the noise; the second part is the error of the simulation "
                "itself, of its mesh above all." if has_model_part(result) else
                "No error beyond noise widens the intervals.")
    unit = "distances of the points" if (result.get("noise") or {}).get("unit") == "µm" else "px"
    return (f"The residual shows an error of the model (twice the gain in log-likelihood: "
            f"{values_text['likelihood_ratio']:.0f}; {_left_unexplained(values_text, unit)}): the intervals count it.")


def _left_unexplained(values_text: Mapping, unit: str) -> str:
    """The parts of a discrepancy that are not zero; of several experiments the largest. unit : of motions, in words"""
    def largest(kind: str) -> float:
        return max((std for name, std in values_text["std"].items() if name.split(".")[-1] == kind), default=0.0)

    motion = max(values_text["motion_px"].values())
    parts = [f"smooth motion of about {motion:.2g} {unit}" if motion > MIN_SHOWN_PX else "",
             f"smooth stress of about {100 * largest('stress'):.2g} %" if largest("stress") > MIN_SHOWN_SHARE else "",
             f"channels of about {100 * largest('channel'):.2g} %" if largest("channel") > MIN_SHOWN_SHARE else "",
             f"finer motion {largest('rough'):.2g} times the noise" if largest("rough") > MIN_SHOWN_ROUGH else ""]
    return ", ".join(part for part in parts if part)


def short_names(names) -> dict[str, str]:
    """Names as they are shown: without the set where there is only one set of elements."""
    sets = {n.split(".", 1)[0] for n in names if "." in n} - NO_SETS
    return {n: n.split(".", 1)[1] if len(sets) == 1 and n.split(".", 1)[0] in sets else n for n in names}


def values_text(result: Mapping) -> str:
    """``E = 70.012 ± 0.055 GPa, nu = 0.3001 ± 0.0004`` of the free parameters that were determined."""
    hardly = hardly_determined(result)
    determined = {n: p for n, p in result["parameters"].items()
            if p.get("free") and p.get("std") is not None and not is_mode(n) and n not in hardly}
    names = short_names(result["parameters"])
    return ", ".join(f"{names[n]} = {with_std(p['value'], p['std'], p.get('unit', ''))}" for n, p in determined.items())


def ratios(result: Mapping) -> str:
    """``E1/E2 = 1.4557 ± 0.0062`` for what is determined although its parts are not."""
    names, open_ = derived_names(result), left_open(result)
    return ", ".join(f"{names[n]} = {with_std(d['value'], d.get('std'), d.get('unit', ''))}"
                     for n, d in result.get("derived", {}).items() if n not in open_)  # fmt: skip


def left_open(result: Mapping) -> set[str]:
    """Names of parameters and derived quantities that the test does not determine."""
    return {entry["name"] for entry in result.get("not_identifiable", ())}


def derived_names(result: Mapping) -> dict[str, str]:
    """Derived quantities as they are shown: ``PLY.E1/E2`` is ``E1/E2`` where PLY is the only set."""
    short = short_names(result["parameters"])
    single = any(name != short_name for name, short_name in short.items())
    return {n: n.partition(".")[2] if single and "." in n.partition("/")[0] else n for n in result.get("derived", {})}


def convergence(result: Mapping) -> str:
    """How the search ended, in a sentence."""
    n = result.get("iterations", 0)
    text = STATUS.get(result["status"], "Status: " + str(result["status"]) + " after {n}.")
    bounds, names = result.get("at_bound", {}), short_names(result["parameters"])
    units = {name: result["parameters"][name]["unit"] for name in bounds}
    bounded = ", ".join(f"{names.get(name, name)} ({bounds[name]:g} {units[name]})".replace(" )", ")")
                        for name in bounds)
    sentence = text.format(n=f"{n} iteration{'' if n == 1 else 's'}", which=bounded or "a parameter")
    return f"{sentence} {ending(result)}".rstrip()


def ending(result: Mapping) -> str:
    """Which limit ended the search, or that the objective is flat, in a sentence; empty for a usual convergence."""
    end = result.get("end") or {}
    reason = end.get("reason", "")
    if not reason or (result["status"] == "converged" and not reason.startswith("the objective is flat")):
        return ""
    return f"{reason[0].upper()}{reason[1:]}."


def explained(result: Mapping) -> str:
    """Whether the model explains the images and the channels within their noise."""
    parts = [images(result)[2]] if result.get("residual", {}).get("image_chi2_dof") is not None else []
    for name, value in result.get("residual", {}).get("channel_chi2_dof", {}).items():
        if value is not None and value > MAX_CHANNEL_CHI2:
            parts.append(f"The simulated {name} differs from the measured one by more than its noise "
                         f"(χ² = {chi2_text(value)} per frame).")
    return " ".join(parts)


def undetermined(result: Mapping) -> str:
    """What could not be determined and why, in one sentence; empty if there is nothing to say."""
    names, reasons = short_names(result["parameters"]) | derived_names(result), {}
    listed = result.get("not_identifiable", ())
    for name, reason in _together(listed).items():
        if not is_mode(name):
            reasons.setdefault(reason, []).append(names.get(name, name))
    modes = in_words([item["name"] for item in listed if is_mode(item["name"])], result["parameters"])
    if modes:
        reasons[MODES_OPEN, frozenset()] = modes
    if hardly := hardly_determined(result):
        reasons["the 95 % interval reaches zero: the error of the model decides the value; fix it at a known value, "
                "or add a test that depends on it", frozenset()] = [names[name] for name in hardly]
    items = [f"{', '.join(group)} ({reason})" for (reason, _), group in reasons.items()]
    edges = any(item["name"].startswith(OUTLINE) for item in listed)
    return f"Not determined by this test: {'; '.join(items)}.{EDGES_OPEN if edges else ''}" if items else ""


def _together(listed: Sequence[Mapping]) -> dict[str, tuple[str, frozenset]]:
    """Reason of every open parameter, and the group that it is said of: one reason where each imitates the others."""
    groups = {item["name"]: frozenset((item["name"], *item["together_with"])) for item in listed}
    values_text = {}
    for item in listed:
        name, reason, alike = item["name"], item["reason"], item.get("correlation")
        if alike is not None and all(groups.get(member) == groups[name] for member in groups[name]):
            reason = f"cannot be told apart from each other: correlation {alike:.3f}"
        values_text[name] = (reason, groups[name] if alike is not None else frozenset())
    return values_text


def hardly_determined(result: Mapping) -> list[str]:
    """Moduli whose 95 % interval reaches zero by the error of the model, not by noise."""
    open_ = left_open(result)
    return [name for name, entry in result["parameters"].items()
            if entry.get("free") and entry.get("ci95") and entry.get("unit") in STRESS_UNITS and name not in open_
            and entry["ci95"][0] <= 0.0 < entry["value"] - 1.96 * (entry.get("std_noise") or np.inf)]


def virtual_boundaries(result: Mapping) -> list[dict]:
    """One entry per virtual boundary and component: name, modes, how many are determined, range of their std, unit."""
    values_text = []
    for motion, names in motions(result["parameters"]).items():
        entries = [result["parameters"][n] for n in names]
        stds = sorted(p["std"] for p in entries if p.get("std") is not None)
        n_free = sum(bool(p.get("free")) for p in entries)
        text = f"{len(names)} modes" + ("" if n_free == len(names) else f", {n_free} free")
        values_text.append({"name": motion, "free": n_free, "determined": len(stds), "unit": entries[0].get("unit", ""),
                      "std": f"{two_digits(stds[0])} … {two_digits(stds[-1])}" if stds else "–",
                      "text": text + ("" if len(stds) == n_free else f", {len(stds)} determined")})
    return values_text


def left_out(result: Mapping) -> str:
    """Frames that are not compared, with the reason; empty if there are none."""
    reasons = {"unexplained": "unexplained: the image does not match the reference",
               "lost": "lost: the specimen's pattern is not in the image",
               "excluded": "excluded in the experiment file"}  # fmt: skip
    items = []
    for status, reason in reasons.items():
        frames = [f for f in result.get("frames", ()) if f.get("status") == status and not f.get("used")]
        if frames:
            items.append(f"{_listed(frames)}, {reason}")
    return f"Left out: {'; '.join(items)}." if items else ""


def not_explained(result: Mapping) -> str:
    """Frames that are compared and have a far larger residual than the others; empty if there are none."""
    frames = [f for f in result.get("frames", ()) if f.get("status") == "unexplained" and f.get("used")]
    if not frames:
        return ""
    worst = max(f["chi2_dof"] or 0.0 for f in frames)
    return (f"The model does not explain {_listed(frames)}: chi² per pixel up to {worst:.2g}. "
            "Run idic diagnose to look for the missing effect.")


def _listed(frames: Sequence[Mapping]) -> str:
    frames_text = ", ".join(f"{f['frame']} ({f.get('label') or '?'})" for f in frames[:MAX_LISTED])
    more = f" and {len(frames) - MAX_LISTED} more" if len(frames) > MAX_LISTED else ""
    return f"frame{'' if len(frames) == 1 else 's'} {frames_text}{more}"


def result_headline(result: Mapping) -> list[str]:
    """The sentences a user wants first, in order: values, convergence, residual, undetermined parameters."""
    scale_sentence, result = held_stresses(result), in_ratios(result)
    values = ", ".join(text for text in (values_text(result), ratios(result)) if text)
    first = f"{values}." if values else "No parameter could be determined from this test."
    if values and result["status"] != "converged":
        first = f"Not converged: {first}"
    sentences = (first, missing_load(result), scale_sentence, convergence(result), explained(result),
                 undetermined(result), not_explained(result), left_out(result))
    return [s for s in sentences if s]


def result_verdict(result: Mapping) -> tuple[str, str]:
    """The fit in a few words: ("good" | "look" | "bad", text)."""
    if result["status"] != "converged":
        return "bad", "Not converged: do not use the values"
    if not values_text(result) and not ratios(result):
        return "bad", "Converged, but no parameter is determined"
    if missing_load(result):
        return basis_verdict(result)
    level, text, _ = images(result)
    if missed := channels_missed(result):
        return "look", f"Look closer: {' and '.join(missed)} not matched within the noise"
    return level, text


def advice(result: Mapping) -> list[str]:
    """Advice on a fit that is not good, and cautions, in sentences."""
    level, text = result_verdict(result)
    chi2 = result.get("residual", {}).get("image_chi2_dof")
    sentences = [] if level == "good" else [f"{text}."]
    if sentence := missing_load(result):
        sentences.append(sentence)
    if result["status"] != "converged" or ending(result):
        sentences.append(convergence(result))
    if cause := cause_text(result):
        return [*sentences, cause, *result_cautions(result)]
    free_fit = against_free(result)
    only_light = free_fit is not None and free_fit.follows and chi2 is not None and chi2 > NOISE_CHI2[1]
    if result["status"] == "converged" and images(result)[0] == "look" and (place := cluster(result)):
        sentences.append(f"The residual is raised {place}.")
    if only_light and not channels_missed(result):
        sentences.append(remedies(result) or UNEXPLAINED_BY_MOTION[result.get("quantity") or "grey"])
    elif channels_missed(result) or (level == "look" and (chi2 is None or chi2 >= noise_chi2(result)[0])):
        sentences.append(f"The model does not explain the test within its noise. {in_error_bars(result)} The report "
                         f"shows where "
                         "and when. Check the position of the mesh (idic check), scale, thickness and boundaries; idic "
                         "diagnose looks for the missing effect.")
    return sentences + result_cautions(result)


def cause_text(result: Mapping) -> str:
    """The cause that the measured motion shows, as a sentence; "" where none explains the misfit."""
    text = ((result.get("residual") or {}).get("cause") or {}).get("text", "")
    return f"{text[0].upper()}{text[1:]}." if text else ""


def channels_missed(result: Mapping) -> list[str]:
    """Channels whose simulated values differ from the measured ones by more than their noise."""
    return [name for name, value in result.get("residual", {}).get("channel_chi2_dof", {}).items()
            if value is not None and value > MAX_CHANNEL_CHI2]


def result_cautions(result: Mapping) -> list[str]:
    """Strong correlations, and biases larger than the error bars, in sentences."""
    names, table = short_names(result["parameters"]) | derived_names(result), result.get("correlation", {})
    open_, sentences = left_open(result), []
    of_parameters = [(i, name) for i, name in enumerate(table.get("names", ())) if not is_mode(name)]
    pairs = sorted(((abs(table["matrix"][i][j]), first, second) for k, (i, first) in enumerate(of_parameters)
                    for j, second in of_parameters[k + 1:]), reverse=True)
    high = [f"{names.get(a, a)} with {names.get(b, b)} ({c:.3f})" for c, a, b in pairs if c > MIN_STRONG_CORRELATION]
    if high:
        more = f" and {len(high) - MAX_LISTED} more pairs" if len(high) > MAX_LISTED else ""
        sentences.append(f"Strongly correlated, so that an error in one compensates an error in the other: "
                         f"{', '.join(high[:MAX_LISTED])}{more}.")
    beyond = {"discretisation_bias": "a finer mesh changes the value by more than a standard deviation",
              "systematic_std": "other treatments of boundary and camera change the value by more than a standard "
                                "deviation"}
    for key, meaning in beyond.items():
        moved = [names[n] for n, p in (result["parameters"] | result.get("derived", {})).items()
                 if n not in open_ and p.get(key) is not None and p.get("std") and abs(p[key]) > p["std"]]
        if moved:
            sentences.append(f"{', '.join(moved)}: {meaning}.")
    return sentences


def between_specimens(result: Mapping) -> list[str]:
    """One sentence on the parameters that differ between specimens by more than their standard deviations."""
    names = short_names(result["parameters"])
    texts = [f"{names.get(name, name)} by {with_unit(entry['between_std'], entry['unit'])} (mean of the material "
             f"{with_std(entry['mean'], entry['mean_std'], entry['unit'])})"
             for name, entry in (result.get("specimens") or {}).items()
             if entry["p_value"] is not None and entry["p_value"] < MAX_P_OF_EQUAL_SPECIMENS]
    return [f"The specimens differ by more than their error bars; standard deviation between them: {', '.join(texts)}. "
            "The joint values assume equal specimens."] if texts else []


def with_unit(std: float, unit: str) -> str:
    """A standard deviation with its unit."""
    return f"{two_digits(std)} {unit}" if unit and unit != "-" else two_digits(std)


def readable_unit(value: float, unit: str) -> tuple[float, str]:
    """Divisor and unit to show a value: 1e3 and GPa from 10 000 MPa on."""
    if unit == "MPa" and abs(value) >= 1e4:
        return 1e3, "GPa"
    return 1.0, unit


def time_label(times: np.ndarray) -> str:
    """The label of an axis over the frames: their numbers, or their times."""
    return "frame" if np.array_equal(times, np.arange(len(times))) else "time [s]"
