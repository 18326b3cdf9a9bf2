"""The report in words: numbers with their standard deviations, and the sentences a user wants to read first."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, isfinite, log10

STATUS = {
    "converged": "Converged in {n}.",
    "stalled": "Stalled after {n}: no step lowered the residual any further, and the last step was not small.",
    "max_iterations": "Stopped after {n}, the limit, before it had converged.",
    "at_bound": "Stopped after {n} with a parameter at its bound: its true value may lie outside.",
    "forward_failed": "The simulation failed after {n}; the values are those of the last step that worked.",
    "interrupted": "Interrupted after {n}; resume with idic identify --resume.",
}
NOISE_SOURCE = {
    "given": "as given in the experiment file",
    "still_frames": "from still frames",
    "residual_of_free_dic": "from the local residual of a free FE-DIC",
    "free_dic": "from the local residual of a free FE-DIC",
}
NOISE_LIKE = (0.9, 1.1)  # image chi² per pixel that counts as "nothing but noise": its own uncertainty is below 1 %,
#                          the rest is what the estimate of sigma may be off by


def with_std(value: float, std: float | None, unit: str = "") -> str:
    """A value to two significant digits of its standard deviation: ``70.012 ± 0.055 GPa``."""
    factor, unit = _readable_unit(value, unit)
    value, std = value / factor, None if std is None else std / factor
    tail = f" {unit}" if unit and unit != "-" else ""
    if std is None or not isfinite(std) or std <= 0:
        return f"{value:.5g}{tail}"
    exponent = floor(log10(abs(value))) if value else 0
    if not -3 <= exponent < 6:
        scale = 10.0**exponent
        digits = max(0, 1 - floor(log10(std / scale)))
        power = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})·10{power}{tail}"
    digits = max(0, 1 - floor(log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}{tail}"


def number(value: float | None, like: float | None = None) -> str:
    """A plain number, rounded to two digits of `like` (a standard deviation) where that is given; – for None."""
    if value is None or not isfinite(value):
        return "–"
    if like and isfinite(like) and 1e-4 < abs(value or 1.0) < 1e7:
        return f"{value:.{max(0, 1 - floor(log10(like)))}f}"
    return f"{value:.6g}" if value == 0 or 1e-4 <= abs(value) < 1e6 else f"{value:.4g}"


def short_names(names) -> dict[str, str]:
    """Names as they are shown: without the set where there is only one set."""
    heads = {n.split(".", 1)[0] for n in names if "." in n}
    single = len(heads) == 1 and not heads & {"camera", "channel", "boundary", "geometry", "time"}
    return {n: n.split(".", 1)[1] if single and "." in n else n for n in names}


def found(result: Mapping) -> str:
    """``E = 70.012 ± 0.055 GPa, nu = 0.3001 ± 0.0004`` of the free parameters that were determined."""
    free = {n: p for n, p in result["parameters"].items() if p.get("free") and p.get("std") is not None}
    names = short_names(result["parameters"])
    return ", ".join(f"{names[n]} = {with_std(p['value'], p['std'], p.get('unit', ''))}" for n, p in free.items())


def convergence(result: Mapping) -> str:
    n = result.get("iterations", 0)
    text = STATUS.get(result["status"], "Status: " + str(result["status"]) + " after {n}.")
    return text.format(n=f"{n} iteration{'' if n == 1 else 's'}")


def explained(result: Mapping) -> str:
    """Whether the model explains what was measured, image and channels."""
    residual = result.get("residual", {})
    chi2 = residual.get("image_chi2_dof")
    parts = []
    if chi2 is not None:
        rms = residual.get("image_rms_gv")
        numbers = f"χ² = {chi2:.3g} per pixel" + ("" if rms is None else f", rms {rms:.3g} grey values")
        if chi2 < NOISE_LIKE[0]:
            parts.append(
                f"The image residual is smaller than the stated camera noise allows ({numbers}): "
                "the noise is overstated and so are the error bars."
            )
        elif chi2 <= NOISE_LIKE[1]:
            parts.append(f"Only camera noise is left in the images ({numbers}).")
        else:
            parts.append(
                f"The model leaves more than camera noise in the images ({numbers}): something is missing "
                "from it, and the error bars do not cover that. idic diagnose tells what and where."
            )
    for name, value in residual.get("channel_chi2_dof", {}).items():
        if value is not None and value > 2.0:  # 20 frames: χ² per frame above 2 has a probability below 0.5 %
            parts.append(f"{name} is not met within its noise (χ² = {value:.3g} per frame).")
    return " ".join(parts)


def undetermined(result: Mapping) -> str:
    """What could not be determined and why, in one sentence; empty if there is nothing to say."""
    names = short_names(result["parameters"])
    items = [f"{names.get(i['name'], i['name'])} ({i['reason']})" for i in result.get("not_identifiable", ())]
    return f"Not determined by this test: {'; '.join(items)}. Kept at the starting value." if items else ""


def headline(result: Mapping) -> list[str]:
    """The sentences a user wants first, in order: values, convergence, what is left, what could not be determined."""
    values = found(result)
    first = f"{values}." if values else "No parameter could be determined from this test."
    return [s for s in (first, convergence(result), explained(result), undetermined(result)) if s]


def _readable_unit(value: float, unit: str) -> tuple[float, str]:
    if unit == "MPa" and abs(value) >= 1e4:
        return 1e3, "GPa"
    return 1.0, unit
